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
    surface there, also where it is not lit. sharpness (P,): 1 / (sqrt(2) rows per mm); inverse_mm (L,): 1 / sigma of
    each lobe. amount (P, L, C): each lobe's light when all rows shine, also those beyond the raster.
    """

    first: Indices
    column: Ints
    row: Doubles
    sharpness: Singles
    inverse_mm: Singles
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
            a, b = np.float32(bottom - row) * sharp, np.float32(top - row) * sharp
            begin, finish = np.float32(-row) * sharp, np.float32(end - row) * sharp
            for i in range(lobes):
                scale = pixels.inverse_mm[i]
                share = np.float32(0)
                if not ((a * scale > REACH) | (b * scale < -REACH)):
                    share += more * (half_erf(b * scale) - half_erf(a * scale))
                if rest != 0:
                    share += rest * (half_erf(finish * scale) - half_erf(begin * scale))
                if share != 0:
                    for c in range(channels):
                        out[k, j, c] += share * pixels.amount[p, i, c]


class Light(NamedTuple):
    """What the projector throws on one skin, by its raster (h, w): strength, the irradiance where it meets that skin
    (0 elsewhere), and depth, along its axis, in metres."""

    strength: Singles
    depth: Singles


class Tangents(NamedTuple):
    """Points of skin with their tangent planes. place (P, 3): projector column, row and depth. along (P, 2, 3): how
    these change per metre in two directions of the plane, at right angles. own (P,): irradiance of the point itself."""

    place: Doubles
    along: Doubles
    own: Singles


DIRECTIONS: Final = 8
"""Directions in which light is looked up round a point."""

LEAST_M: Final = 1e-3
"""How far the surface may bend away from the tangent plane in any case."""


@njit(cache=True, nogil=True, error_model="numpy")
def gather(points: Tangents, light: Light, radii_m: Doubles, weights: Doubles, out: Singles) -> None:
    """out (P, L) = irradiance round each point, averaged with each lobe's weights (L, N) over its radii (L, N).

    Above and below the raster the light counts as going on as at the point itself: the gate cuts it there. Where
    another surface is met, or the raster ends sideways, there is none.
    """
    height, width = light.strength.shape
    for p in range(out.shape[0]):
        for i in range(out.shape[1]):
            total = 0.0
            for n in range(radii_m.shape[1]):
                radius = radii_m[i, n]
                for turn in range(DIRECTIONS):
                    # Rings are turned against each other, so that an edge does not cross all of them at once.
                    angle = 2 * math.pi * (turn + 0.5 * (n & 1) + 0.25) / DIRECTIONS
                    u, v = radius * math.cos(angle), radius * math.sin(angle)
                    x = points.place[p, 0] + u * points.along[p, 0, 0] + v * points.along[p, 1, 0]
                    y = points.place[p, 1] + u * points.along[p, 0, 1] + v * points.along[p, 1, 1]
                    z = points.place[p, 2] + u * points.along[p, 0, 2] + v * points.along[p, 1, 2]
                    if y < 0.0 or y >= height:
                        total += weights[i, n] * points.own[p]
                    elif 0.0 <= x < width:
                        r, c = int(y), int(x)
                        if abs(light.depth[r, c] - z) < max(radius, LEAST_M):
                            total += weights[i, n] * light.strength[r, c]
            out[p, i] = total / DIRECTIONS


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
