"""The compiled loops of subsurface light: how much goes in about a point of skin, and what a gate records of it."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.fog import Medium, length_within
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3

REACH: Final = 4.0
"""Where a lobe's light ends, in its sqrt(2) sigma: half of erf is 1/2 there to 8e-9."""

LONGEST: Final = 0.25
"""Up to what share a skin's curvature makes ways on it longer or shorter."""

TILE: Final = 64
"""Pixels that are skipped together."""


class SkinPixels(NamedTuple):
    """The P pixels that see one skin, row by row, in T tiles of up to TILE neighbours, with L lobes and C channels.

    first (H + 1,): where each camera row's tiles begin; start (T + 1,): where each tile's pixels begin; column (T,): of
    its first pixel. low, high (T, L): the projector rows between which a lobe's light in the tile comes from.

    row (P,) float64: the projector row through the surface there, also where it is not lit. A row x from there is, in
    mm over sqrt(2), sharpness (P,) times x (1 - curvature (P,) x) away. inverse_mm (L,): 1 / sigma of each lobe. drift
    (L, P): where its light went in on average, towards higher rows, in its sqrt(2) sigma. amount (L, C, P): its light
    when all rows shine, also those beyond the raster; full (C, P): the light of all lobes when the raster shines.
    """

    first: Indices
    start: Indices
    column: Indices
    low: Doubles
    high: Doubles
    row: Doubles
    sharpness: Singles
    curvature: Singles
    inverse_mm: Singles
    drift: Singles
    amount: Singles
    full: Singles


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def half_erf(x: np.float32) -> np.float32:
    """Half the error function, to 9e-7: 3e-7 of erf by its formula (Abramowitz and Stegun 7.1.28), the rest float32.

    Without a branch, a table or an exponential, so that loops over it become vector code.
    """
    y = abs(x)
    u = np.float32(0.0002765672) + y * np.float32(0.0000430638)
    u = np.float32(0.0092705272) + y * (np.float32(0.0001520143) + y * u)
    u = np.float32(1) + y * (np.float32(0.0705230784) + y * (np.float32(0.0422820123) + y * u))
    u *= u
    u *= u
    u *= u
    value = np.float32(0.5) - np.float32(0.5) / (u * u)
    return value if x >= 0 else -value


@njit(cache=True, nogil=True)
def _along(rows: float, curvature: np.float32) -> np.float32:
    """Way to a row in steps of the row at hand, which the skin's curvature makes longer or shorter.

    Rises with `rows` everywhere, so a window is never recorded less than nothing.
    """
    x = np.float32(rows)
    bent = min(max(curvature * x, np.float32(-LONGEST)), np.float32(LONGEST))
    return x * (np.float32(1) - bent)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def add_gated(
    pixels: SkinPixels, low: Doubles, high: Doubles, inside: Ints, outside: Ints, end: float, out: Singles
) -> None:
    """Add what the windows record of one skin's light to out (H, W C), the channels of a pixel side by side.

    Rows from `low` to `high` are recorded `inside` times, the others of the raster, 0 to `end`, `outside` times.
    """
    channels = pixels.full.shape[0]
    for k in range(low.shape[0]):
        # What comes in beyond the raster's ends does not exist, wherever the window ends.
        bottom, top = min(max(low[k], 0.0), end), min(max(high[k], 0.0), end)
        always, more = np.float32(min(inside[k], outside[k])), np.float32(abs(inside[k] - outside[k]))
        for t in range(pixels.first[k], pixels.first[k + 1]):
            if always != 0:
                start, count = pixels.start[t], pixels.start[t + 1] - pixels.start[t]
                for c in range(channels):
                    for n in range(np.uint64(0), np.uint64(count)):
                        place = (np.uint64(pixels.column[t]) + n) * np.uint64(channels) + np.uint64(c)
                        out[k, place] += always * pixels.full[c, np.uint64(start) + n]
            # Only ever added, never taken away: the difference of two roundings could be below nothing.
            if (more != 0) & (inside[k] > outside[k]):
                _add_rows(pixels, t, bottom, top, more, out[k])
            elif more != 0:
                _add_rows(pixels, t, 0.0, bottom, more, out[k])
                _add_rows(pixels, t, top, end, more, out[k])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _add_rows(pixels: SkinPixels, t: int, bottom: float, top: float, times: np.float32, line: Singles) -> None:
    """Add the light that projector rows bottom to top bring to tile t, so many times, to its camera row (W C,)."""
    row, sharpness, curvature = pixels.row, pixels.sharpness, pixels.curvature
    start, count = np.uint64(pixels.start[t]), np.uint64(pixels.start[t + 1] - pixels.start[t])
    first, channels = np.uint64(pixels.column[t]), np.uint64(pixels.amount.shape[1])
    for i in range(pixels.amount.shape[0]):
        if (bottom >= top) | (top <= pixels.low[t, i]) | (bottom >= pixels.high[t, i]):
            continue
        scale, drift = pixels.inverse_mm[i], pixels.drift[i]
        # Most windows cut a lobe on one side or on none: what lies beyond its reach is half of it.
        cut_below, cut_above = bottom > pixels.low[t, i], top < pixels.high[t, i]
        edge, turn = (bottom, np.float32(-1)) if cut_below else (top, np.float32(1))
        for c in range(channels):
            amount, to = pixels.amount[i, c], np.uint64(c)
            if cut_below & cut_above:
                for n in range(np.uint64(0), count):
                    p = start + n
                    sharp = sharpness[p] * scale
                    a = sharp * _along(bottom - row[p], curvature[p]) - drift[p]
                    b = sharp * _along(top - row[p], curvature[p]) - drift[p]
                    share = max(half_erf(b) - half_erf(a), np.float32(0))
                    line[(first + n) * channels + to] += times * share * amount[p]
            elif cut_below | cut_above:
                for n in range(np.uint64(0), count):
                    p = start + n
                    x = sharpness[p] * scale * _along(edge - row[p], curvature[p]) - drift[p]
                    line[(first + n) * channels + to] += times * (np.float32(0.5) + turn * half_erf(x)) * amount[p]
            else:
                for n in range(np.uint64(0), count):
                    line[(first + n) * channels + to] += times * amount[start + n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def sum_lobes(pixels: SkinPixels, end: float) -> None:
    """Write pixels.full: all lobes' light when the raster's rows, 0 to `end`, shine."""
    pixels.full[:] = 0
    for i in range(pixels.amount.shape[0]):
        for p in range(pixels.row.shape[0]):
            sharp = pixels.sharpness[p] * pixels.inverse_mm[i]
            a = sharp * _along(-pixels.row[p], pixels.curvature[p]) - pixels.drift[i, p]
            b = sharp * _along(end - pixels.row[p], pixels.curvature[p]) - pixels.drift[i, p]
            share = max(half_erf(b) - half_erf(a), np.float32(0))
            for c in range(pixels.full.shape[0]):
                pixels.full[c, p] += share * pixels.amount[i, c, p]


class SkinColumns(NamedTuple):
    """Where the projector's columns lie on the skin of P pixels, float32 each: the one through the surface there, by
    how many they move from row to row, and how many there are to a mm along a row."""

    column: Singles
    slant: Singles
    per_mm: Singles


@njit(cache=True, nogil=True, error_model="numpy")
def add_patterned(
    pixels: SkinPixels,
    columns: SkinColumns,
    sums: Doubles,
    windows: tuple[Doubles, Doubles, Ints, Ints],
    out: Singles,
) -> None:
    """`add_gated` under a pattern, of which sums (h, w + 1) are its pixels before each column, row by row."""
    low, high, inside, outside = windows
    channels = pixels.full.shape[0]
    for k in range(low.shape[0]):
        counts = np.float32(inside[k]), np.float32(outside[k])
        if inside[k] == 0 and outside[k] == 0:
            continue
        for t in range(pixels.first[k], pixels.first[k + 1]):
            start = pixels.start[t]
            for i in range(pixels.amount.shape[0]):
                if outside[k] == 0 and (high[k] <= pixels.low[t, i] or low[k] >= pixels.high[t, i]):
                    continue
                for p in range(start, pixels.start[t + 1]):
                    light = _patterned_share(pixels, columns, sums, p, i, (low[k], high[k]), counts)
                    for c in range(channels):
                        out[k, (pixels.column[t] + p - start) * channels + c] += light * pixels.amount[i, c, p]


@njit(cache=True, nogil=True, error_model="numpy")
def _patterned_share(
    pixels: SkinPixels,
    columns: SkinColumns,
    sums: Doubles,
    p: int,
    i: int,
    window: tuple[float, float],
    counts: tuple[np.float32, np.float32],
) -> np.float32:
    """What a window records of lobe i at pixel p, each row times what the pattern sends there, of all rows lit once."""
    sharp, drift, row, curvature = (
        pixels.sharpness[p] * pixels.inverse_mm[i],
        pixels.drift[i, p],
        pixels.row[p],
        pixels.curvature[p],
    )
    per_step = 1.0 / (np.float64(sharp) * (1.0 - LONGEST))
    first = max(row - max(REACH - drift, 0.0) * per_step, 0.0)
    last = min(row + max(REACH + drift, 0.0) * per_step, float(sums.shape[0]))
    if counts[1] == 0:
        first, last = max(first, window[0]), min(last, window[1])
    total = np.float32(0)
    if not first < last:
        return total
    wide = np.float64(columns.per_mm[p]) / np.float64(pixels.inverse_mm[i])
    start = int(first)
    before = sharp * _along(start - row, curvature) - drift
    below = half_erf(before)
    for r in range(start, min(math.ceil(last), sums.shape[0])):
        above = half_erf(sharp * _along(r + 1 - row, curvature) - drift)
        whole, held = max(above - below, np.float32(0)), np.float32(0)
        if r >= window[0] and r + 1 <= window[1]:
            held = whole
        elif r + 1 > window[0] and r < window[1]:
            a = half_erf(sharp * _along(max(window[0], float(r)) - row, curvature) - drift)
            b = half_erf(sharp * _along(min(window[1], r + 1.0) - row, curvature) - drift)
            held = max(b - a, np.float32(0))
        light = counts[0] * held + counts[1] * max(whole - held, np.float32(0))
        if light > 0:
            middle = np.float64(columns.column[p]) + np.float64(columns.slant[p]) * (r + 0.5 - row)
            total += light * np.float32(_mean_about(sums[r], middle, wide))
        below = above
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_about(sums: Doubles, middle: float, sigma: float) -> float:
    """A row's mean about a column, by its sums (w + 1,): over a box of the deviation sigma, a pixel wide at least."""
    width = sums.shape[0] - 1
    half = min(max(math.sqrt(3.0) * sigma, 0.5), 0.5 * width)
    low = min(max(middle - half, 0.0), width - 1.0)
    high = min(max(middle + half, low + 1.0), float(width))
    a, b = min(int(low), width - 1), min(int(high), width - 1)
    one = sums[a] + (low - a) * (sums[a + 1] - sums[a])
    other = sums[b] + (high - b) * (sums[b + 1] - sums[b])
    return float((other - one) / (high - low))


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
    # The middle of the pixel that is met lies a little to the side, which is no part of the way.
    across = points.along[p, 1, 0]
    aside = (c + 0.5 - x) / across if across != 0.0 else 0.0
    square = -aside * aside
    for k in range(3):
        square += (light.points[r, c, k] - points.points[p, k]) ** 2
    rows, size = r + 0.5 - points.place[p, 1], math.sqrt(max(square, 0.0))
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
