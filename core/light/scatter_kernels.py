"""The compiled loops of the near halo: the law of one pair of pixels, and its sum over all pairs.

A surface element seen at pixel p', at the distance D, sends light to the point X of the camera ray of pixel p, which
fog turns there by the angle T towards the camera. With alpha the angle between both rays, h = D sin(alpha) the distance
of the element from the ray, and s the distance of X from the camera: s = D cos(alpha) - h cot(T) and ds / rho^2 = dT /
h, so that per solid angle of p' and per radiance that p' shows (which holds exp(-sigma_t D) already)

    K = sigma_s D / sin(alpha)  INT dT  phase(cos T)  (cos(psi) + tilt sin(psi))  exp(-sigma_t (s + rho - D)),

psi = T - alpha the angle at the element between X and the camera, cos(psi) + tilt sin(psi) = cos(beta) / cos(beta_c)
the facing of the tilted surface, and s + rho - D = h tan(T / 2) - D (1 - cos(alpha)). T runs over what of the ray lies
in fog, in front of what p shows and before the element's own plane. cos(psi) + tilt sin(psi) is a sum of cos(T) and
sin(T), so two tables over T and sigma_t h hold every integral.
This is light turned once; `Several` makes it that of one or more turns.
"""

from __future__ import annotations

from math import exp, inf, log, sqrt
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.halo import HALO_RADIUS, halo_share
from slopegate.core.render.fog import Medium, span
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Vector3


class Turns(NamedTuple):
    """Light turned by less than T: integrals of phase(cos T) exp(-x tan(T / 2)) times cos(T) and sin(T), per radian.

    table (X, Q, 2) float64, cos first: x = m x_step, and q = -log(tan(T / 2)) = q_low + n q_step, from which the
    integral runs to infinity (T = 0).
    """

    table: Doubles
    x_step: float
    q_low: float
    q_step: float


ANGLE_STEP: Final = 0.002
ANGLES: Final = int(HALO_RADIUS / ANGLE_STEP) + 3


class Several(NamedTuple):
    """By how much several turns make a halo brighter than one (`several_turns`).

    table (D, ANGLES) float64: log of the distance in metres = low + n step, sine of alpha = m ANGLE_STEP.
    """

    table: Doubles
    low: float
    step: float


class Senders(NamedTuple):
    """What pixels show, seen as places that send light (H, W).

    x, y: tangents of their rays; steradian: a pixel's solid angle; log_x, log_y: the surface's gradient of log inverse
    depth by tangents (0: it stands across the camera's axis).
    """

    x: Singles
    y: Singles
    inverse_depth: Singles
    steradian: Singles
    log_x: Singles
    log_y: Singles


class RayEnds(NamedTuple):
    """Where rays meet fog (H, W): metres from the camera at which it begins, and at which it or the ray ends."""

    first: Singles
    last: Singles


@njit(cache=True, nogil=True, error_model="numpy")
def enter(medium: Medium, eye: Vector3, source: Senders, sink: RayEnds) -> None:
    """Fill the sink for camera rays from the eye that end at their surfaces."""
    for k in range(source.x.shape[0]):
        for j in range(source.x.shape[1]):
            x, y, w = np.float64(source.x[k, j]), np.float64(source.y[k, j]), np.float64(source.inverse_depth[k, j])
            first, last = span(medium.lo, medium.hi, eye, (x, y, 1.0))
            length = sqrt(x * x + y * y + 1.0)
            sink.first[k, j] = first * length
            sink.last[k, j] = (min(last, 1.0 / w) if w > 0.0 else last) * length


@njit(cache=True, nogil=True, error_model="numpy")
def _turned(table: Doubles, x: float, q: float) -> tuple[float, float]:
    """Read both integrals at x and q in steps of the table, linear between its entries."""
    column = min(max(q, 0.0), table.shape[1] - 1.001)
    row = min(x, table.shape[0] - 1.001)
    n, m = int(column), int(row)
    a, b = column - n, row - m
    top, low = (1.0 - a) * (1.0 - b), (1.0 - a) * b
    top_next, low_next = a * (1.0 - b), a * b
    cosine = top * table[m, n, 0] + top_next * table[m, n + 1, 0]
    cosine += low * table[m + 1, n, 0] + low_next * table[m + 1, n + 1, 0]
    sine = top * table[m, n, 1] + top_next * table[m, n + 1, 1]
    sine += low * table[m + 1, n, 1] + low_next * table[m + 1, n + 1, 1]
    return cosine, sine


@njit(cache=True, nogil=True, error_model="numpy")
def _asinh(v: float) -> float:
    """Inverse hyperbolic sine, without cancellation for negative v."""
    if v < 0.0:
        return -log(sqrt(v * v + 1.0) - v)
    return log(v + sqrt(v * v + 1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def halo(
    turns: Turns, extinction: float, distance: float, sine: float, cosine: float, tilt: float, first: float, last: float
) -> float:
    """K / sigma_s of the module's head, 1/sr times metres, for sine and cosine of alpha.

    distance: D in metres; tilt: the surface's; first and last: the metres of the camera ray that count.
    """
    height = distance * sine
    # Cotangents of the turning angle: they fall from the camera towards the surface.
    start, end = (distance * cosine - first) / height, (distance * cosine - last) / height
    edge = cosine - tilt * sine
    if edge > 0.0:
        end = max(end, -(tilt * cosine + sine) / edge)
    if not end < start:
        return 0.0
    x = extinction * height / turns.x_step
    early, late = (_asinh(start) - turns.q_low) / turns.q_step, (_asinh(end) - turns.q_low) / turns.q_step
    along, across = _turned(turns.table, x, late)
    along_early, across_early = _turned(turns.table, x, early)
    facing = edge * (along - along_early) + (sine + tilt * cosine) * (across - across_early)
    return float(max(facing, 0.0) * exp(extinction * distance * (1.0 - cosine)) * distance / sine)


class HaloLaw(NamedTuple):
    """What the sums over pairs need of fog, scene and camera.

    spread (2 S + 1, 2 S + 1): what averaging over the pixels' area makes of 1/r, and at its middle the distance in
    pixels whose 1/r stands for that of a pixel to itself; pixel: its width and height in tangents.
    """

    turns: Turns
    several: Several
    scattering: float
    extinction: float
    source: Senders
    sink: RayEnds
    spread: Doubles
    pixel: tuple[float, float]


@njit(cache=True, nogil=True, error_model="numpy")
def _more(several: Several, distance: float, sine: float) -> float:
    """Read by how much several turns are brighter than one, linear between entries."""
    table = several.table
    row = min(max((log(distance) - several.low) / several.step, 0.0), table.shape[0] - 1.001)
    column = min(sine / ANGLE_STEP, table.shape[1] - 1.001)
    n, m = int(row), int(column)
    a, b = row - n, column - m
    here = (1.0 - b) * table[n, m] + b * table[n, m + 1]
    return float((1.0 - a) * here + a * ((1.0 - b) * table[n + 1, m] + b * table[n + 1, m + 1]))


@njit(cache=True, nogil=True, error_model="numpy")
def halo_of(
    law: HaloLaw,
    place: tuple[float, float, float],
    slope: tuple[float, float],
    step: tuple[float, float],
    first: float,
    last: float,
) -> float:
    """`halo` of one or more turns times its share, of a surface to the ray a step in tangents off.

    place: tangents x, y and inverse depth of the surface; slope: its gradient of log inverse depth.
    """
    bx, by, w = place
    dx, dy = step
    share = halo_share(sqrt(dx * dx + dy * dy))
    if share == 0.0:
        return 0.0
    ax, ay = bx + dx, by + dy
    here, there = sqrt(1.0 + ax * ax + ay * ay), sqrt(1.0 + bx * bx + by * by)
    turn = bx * dy - by * dx
    sine = sqrt(dx * dx + dy * dy + turn * turn) / (here * there)
    cosine = (1.0 + ax * bx + ay * by) / (here * there)
    tilt = (cosine - there / here * (1.0 + slope[0] * dx + slope[1] * dy)) / sine
    once = halo(law.turns, law.extinction, there / w, sine, cosine, tilt, first, last)
    return once * share * _more(law.several, there / w, sine)


@njit(cache=True, nogil=True, error_model="numpy")
def _own(
    law: HaloLaw,
    place: tuple[float, float, float],
    slope: tuple[float, float],
    pitch: tuple[float, float],
    first: float,
    last: float,
) -> float:
    """What a pixel's own light adds to it: the mean over four steps of `pitch` along the axes."""
    dx, dy = pitch
    # The ray's own surface ends it at the element; a step beside it that depends on the tilt, which `halo` knows.
    x, y, w = place
    end = last if last < 0.999 * sqrt(1.0 + x * x + y * y) / w else inf
    total = halo_of(law, place, slope, (dx, 0.0), first, end)
    total += halo_of(law, place, slope, (-dx, 0.0), first, end)
    total += halo_of(law, place, slope, (0.0, dy), first, end)
    return (total + halo_of(law, place, slope, (0.0, -dy), first, end)) / 4.0


@njit(cache=True, nogil=True, error_model="numpy")
def _pair(law: HaloLaw, k: int, j: int, m: int, n: int, dx: float, dy: float) -> float:
    """Share of the light of pixel (m, n) that is seen in pixel (k, j), a step (dx, dy) in tangents off."""
    source, size = law.source, law.spread.shape[0] // 2
    place = (np.float64(source.x[m, n]), np.float64(source.y[m, n]), np.float64(source.inverse_depth[m, n]))
    slope = (np.float64(source.log_x[m, n]), np.float64(source.log_y[m, n]))
    first, last = np.float64(law.sink.first[k, j]), np.float64(law.sink.last[k, j])
    if k == m and j == n:
        reach = law.spread[size, size]
        pitch = (law.pixel[0] * reach, law.pixel[1] * reach)
        value = _own(law, place, slope, pitch, first, last)
    else:
        value = halo_of(law, place, slope, (dx, dy), first, last)
        if abs(k - m) <= size and abs(j - n) <= size:
            value *= law.spread[size + k - m, size + j - n]
    return value * law.scattering * np.float64(source.steradian[m, n])


@njit(cache=True, nogil=True, error_model="numpy")
def _send(law: HaloLaw, k: int, m: int, n: int, weight: float, light: Singles, out: Singles) -> None:
    """Add to camera row k what the light of pixel (m, n) lays there."""
    x, y = law.source.x, law.source.y
    for side in range(2):
        # To the right until the halo ends, then to the left: whatever the lens, it is one run of columns.
        j = n if side == 0 else n - 1
        while 0 <= j < out.shape[1]:
            dx, dy = np.float64(x[k, j] - x[m, n]), np.float64(y[k, j] - y[m, n])
            if abs(dx) >= HALO_RADIUS:
                break
            if dx * dx + dy * dy < HALO_RADIUS * HALO_RADIUS:
                value = np.float32(weight * _pair(law, k, j, m, n, dx, dy))
                for c in range(out.shape[2]):
                    out[k, j, c] += value * light[m, n, c]
            j += 1 if side == 0 else -1


@njit(cache=True, nogil=True, error_model="numpy")
def halo_sums(
    law: HaloLaw,
    light: Singles,
    lit_by: tuple[Singles, Singles],
    windows: tuple[Doubles, Doubles, Singles, Singles],
    rows: tuple[int, int],
    out: Singles,
) -> None:
    """Add to the camera rows rows[0] .. rows[1] - 1 of out (H, W, C) the light (H, W, C) that fog turns into them.

    lit_by (H, W): the projector row that lights each pixel, -1 for none, and how many rows it spans; windows: low, high
    and the weights inside and outside, of every camera row; a pixel counts by the share of its span that they take.
    """
    height, width = light.shape[:2]
    low, high, inside, outside = windows
    row, spans = lit_by
    for k in range(rows[0], rows[1]):
        for m in range(height):
            if abs(law.source.y[m, width // 2] - law.source.y[k, width // 2]) > 1.5 * HALO_RADIUS:
                continue
            for n in range(width):
                if row[m, n] < 0.0:
                    continue
                half = 0.5 * np.float64(spans[m, n])
                taken = (min(high[k], row[m, n] + half) - max(low[k], row[m, n] - half)) / (2.0 * half)
                weight = outside[k] + (inside[k] - outside[k]) * min(max(taken, 0.0), 1.0)
                if weight != 0.0:
                    _send(law, k, m, n, weight, light, out)
