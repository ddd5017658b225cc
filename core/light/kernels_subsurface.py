"""The compiled loops of subsurface light: how much goes in about a point of skin, and what a gate records of it."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from slopegate.core.render.fog import Medium, length_within
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3

STEPS: Final = 512
"""Entries of the table of the error function for each unit of its argument."""

REACH: Final = 4
"""Where the table ends: half of erf is 1/2 there to 8e-9."""

HALF_ERF: Final = np.array([0.5 * math.erf(step / STEPS) for step in range(REACH * STEPS + 2)], np.float32)
"""Half the error function at step / STEPS. Straight lines between the entries are off by at most h^2 / 8 times the
largest second derivative, 0.484: 2.3e-7; float32 and its arguments add 1e-7."""


class SkinPixels(NamedTuple):
    """The P pixels that see one skin, row by row.

    first (H + 1,): where each camera row's pixels begin; column (P,). row (P,) float64: the projector row through the
    surface there, also where it is not lit. A row x from there is, in mm over sqrt(2), sharpness (P,) times x (1 -
    curvature (P,) x) away. inverse_mm (L,): 1 / sigma of each lobe. drift (P, L): where each lobe's light went in on
    average, towards higher rows, in its sqrt(2) sigma. amount (P, L, C): its light when all rows shine, also those
    beyond the raster.
    """

    first: Indices
    column: Ints
    row: Doubles
    sharpness: Singles
    curvature: Singles
    inverse_mm: Singles
    drift: Singles
    amount: Singles


@njit(cache=True, nogil=True, error_model="numpy")
def half_erf(x: np.float32) -> np.float32:
    """Half the error function, to 4e-7; odd, rising, -1/2 and 1/2 at infinity."""
    size = min(abs(x), np.float32(REACH)) * np.float32(STEPS)
    step = np.int32(size)
    low = HALF_ERF[step]
    value: np.float32 = low + (size - np.float32(step)) * (HALF_ERF[step + 1] - low)
    return value if x >= 0 else np.float32(-value)


@njit(cache=True, nogil=True, error_model="numpy")
def _along(rows: float, curvature: np.float32) -> np.float32:
    """Way to a row in steps of the row at hand, which the skin's curvature makes longer or shorter by up to a quarter.

    Rises with `rows` everywhere, so a window is never recorded less than nothing.
    """
    x = np.float32(rows)
    return x * (np.float32(1) - min(max(curvature * x, np.float32(-0.25)), np.float32(0.25)))


@njit(cache=True, nogil=True, error_model="numpy")
def add_gated(
    pixels: SkinPixels, low: Doubles, high: Doubles, inside: Ints, outside: Ints, end: float, out: Singles
) -> None:
    """Add what the windows record of one skin's light to out (H, W, C).

    Rows from `low` to `high` are recorded `inside` times, the others of the raster, 0 to `end`, `outside` times.
    """
    lobes, channels = pixels.amount.shape[1], pixels.amount.shape[2]
    for k in range(low.shape[0]):
        rest = np.float32(outside[k])
        more = np.float32(inside[k] - outside[k])
        # What comes in beyond the raster's ends does not exist, wherever the window ends.
        bottom, top = min(max(low[k], 0.0), end), min(max(high[k], 0.0), end)
        if (rest == 0) & ((more == 0) | (bottom >= top)):
            continue
        for p in range(pixels.first[k], pixels.first[k + 1]):
            j, row, sharp = pixels.column[p], pixels.row[p], pixels.sharpness[p]
            bent = pixels.curvature[p]
            a, b = sharp * _along(bottom - row, bent), sharp * _along(top - row, bent)
            begin, finish = sharp * _along(-row, bent), sharp * _along(end - row, bent)
            for i in range(lobes):
                scale, drift = pixels.inverse_mm[i], pixels.drift[p, i]
                below, above = a * scale - drift, b * scale - drift
                share = np.float32(0)
                if not ((below > REACH) | (above < -REACH)):
                    share += more * (half_erf(above) - half_erf(below))
                if rest != 0:
                    share += rest * (half_erf(finish * scale - drift) - half_erf(begin * scale - drift))
                if share != 0:
                    for c in range(channels):
                        out[k, j, c] += share * pixels.amount[p, i, c]


class Light(NamedTuple):
    """What the projector throws on one skin, by its raster (h, w): strength, the irradiance where it meets that skin (0
    elsewhere), and points (h, w, 3), where it does in its axes, in metres."""

    strength: Singles
    points: Singles


class Tangents(NamedTuple):
    """Points of skin with their tangent planes, by projector column, row and depth.

    place (P, 3): these three; points (P, 3): the points in the projector's axes. along (P, 2, 3): how the three change
    per metre in two directions of the plane at right angles, the first that in which rows rise fastest. own (P,):
    irradiance of the point itself.
    """

    place: Doubles
    points: Doubles
    along: Doubles
    own: Singles


LEAST_M: Final = 1e-3
"""How far the surface may bend away from the tangent plane in any case."""


@njit(cache=True, nogil=True, error_model="numpy")
def gather(points: Tangents, light: Light, offsets: Doubles, out: Singles, drift: Singles) -> None:
    """out (P, L) = irradiance about each point, averaged as each lobe does, and drift (P, L) where it is on average.

    offsets (L, N, 3): steps in the two directions of the tangent plane, in metres, and their weights; drift is a step
    in the first direction.

    Above and below the raster the light counts as going on as at the point itself: the gate cuts it there. Where
    another surface is met, or the raster ends sideways, there is none.
    """
    height, width = light.strength.shape
    for p in range(out.shape[0]):
        x0, y0, z0, own = points.place[p, 0], points.place[p, 1], points.place[p, 2], points.own[p]
        xu, yu, zu = points.along[p, 0, 0], points.along[p, 0, 1], points.along[p, 0, 2]
        xv, yv, zv = points.along[p, 1, 0], points.along[p, 1, 1], points.along[p, 1, 2]
        for i in range(out.shape[1]):
            total, moment = 0.0, 0.0
            for n in range(offsets.shape[1]):
                u, v, weight = offsets[i, n, 0], offsets[i, n, 1], offsets[i, n, 2]
                x, y = x0 + u * xu + v * xv, y0 + u * yu + v * yv
                found = 0.0
                if y < 0.0 or y >= height:
                    found = weight * own
                elif 0.0 <= x < width:
                    r, c = int(y), int(x)
                    bend = light.points[r, c, 2] - z0 - u * zu - v * zv
                    if bend * bend < max(u * u + v * v, LEAST_M * LEAST_M):
                        found = weight * light.strength[r, c]
                total += found
                moment += found * u
            out[p, i] = total
            drift[p, i] = moment / total if total > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _way(points: Tangents, light: Light, p: int, step_m: float) -> tuple[float, float]:
    """Rows and metres from point p to the lit skin `step_m` on, up or down the rows; (0, 0) where there is none."""
    x = points.place[p, 0] + step_m * points.along[p, 0, 0]
    y = points.place[p, 1] + step_m * points.along[p, 0, 1]
    if not (0.0 <= x < light.strength.shape[1] and 0.0 <= y < light.strength.shape[0]):
        return 0.0, 0.0
    r, c = int(y), int(x)
    if light.strength[r, c] <= 0:
        return 0.0, 0.0
    square = 0.0
    for k in range(3):
        square += (light.points[r, c, k] - points.points[p, k]) ** 2
    rows, size = r + 0.5 - points.place[p, 1], math.sqrt(square)
    if rows * step_m <= 0.0 or not 0.5 * abs(step_m) < size < 2.0 * abs(step_m):
        return 0.0, 0.0
    return rows, size


@njit(cache=True, nogil=True, error_model="numpy")
def bend(points: Tangents, light: Light, step_m: float, steepness: Doubles, curvature: Doubles) -> None:
    """Correct how rows lie on the skin about each point by the lit skin step_m above and below it.

    A row at x from the point's own lies x / steepness (1 - curvature x) metres on; both (P,), from tangent planes
    before. They stay where there is no lit skin on both sides.
    """
    for p in range(steepness.shape[0]):
        up, far = _way(points, light, p, step_m)
        down, near = _way(points, light, p, -step_m)
        if up == 0.0 or down == 0.0:
            continue
        # Lengths per row on either side: a (1 - c up) and a (1 - c down), down being negative.
        above, below = far / up, -near / down
        slope = (below - above) / (up - down)
        at_point = above + slope * up
        if at_point > 0.0:
            steepness[p] = 1.0 / at_point
            curvature[p] = slope / at_point


@njit(cache=True, nogil=True, error_model="numpy")
def dim_ways(medium: Medium, eye: Vector3, light: Vector3, points: Doubles, amount: Singles) -> None:
    """Take from amount (P, L) what fog takes on the ways from the light to points (P, 3) and from there to the eye."""
    for p in range(points.shape[0]):
        out = (points[p, 0] - light[0], points[p, 1] - light[1], points[p, 2] - light[2])
        back = (points[p, 0] - eye[0], points[p, 1] - eye[1], points[p, 2] - eye[2])
        way = length_within(medium.lo, medium.hi, light, out, 1.0) + length_within(medium.lo, medium.hi, eye, back, 1.0)
        kept = math.exp(-medium.extinction * way)
        for i in range(amount.shape[1]):
            amount[p, i] *= kept
