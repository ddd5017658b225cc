"""Sight through glass: rays that are refracted from surface to surface until they meet one that is not glass.

Every surface of glass is one between air and glass; a ray starts in air, and each surface that it passes takes it in or
out. Directions follow Snell's law, brightness Fresnel's equations for unpolarised light and the colour of the glass,
the share that passes a surface. Total reflection keeps all. What else is mirrored is not followed: it is part of the
indirect light.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.coats import Looks, nothing_met
from slopegate.core.render.kernels import Hits
from slopegate.core.rig.arrays import Bools, Doubles

MAX_SURFACES: Final = 16
"""Of glass that a line of sight may meet, one behind the other; a line that meets more ends in the dark."""

STEP_M: Final = 1e-5
"""How far from a surface, along its normal, a ray goes on: glass must be thicker than this."""

Meet = Callable[[Doubles, Doubles, Hits, Looks], None]
"""Casts world rays, origins (R, 3) and directions (R, 3), and updates what they meet first; depth in lengths of the
direction."""


@njit(cache=True, nogil=True)
def fresnel(cosine: float, ratio: float) -> np.float64:
    """Share of unpolarised light that a smooth surface mirrors.

    cosine of the angle of incidence, 0..1; ratio: index of refraction before the surface over the one behind it.
    """
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    if square <= 0.0:
        return np.float64(1.0)
    behind = np.sqrt(square)
    across = (ratio * cosine - behind) / (ratio * cosine + behind)
    along = (cosine - ratio * behind) / (cosine + ratio * behind)
    return np.float64(0.5 * (across * across + along * along))


@njit(cache=True, nogil=True)
def bend(origins: Doubles, directions: Doubles, inside: Bools, weight: Doubles, hits: Hits, looks: Looks) -> None:
    """Take R rays, directions of length 1, through the surfaces of glass that they met, or back from them.

    origins (R, 3), directions (R, 3), inside (R,), whether they run in glass, and weight (R, 3), what is left of their
    light, are updated.
    """
    for i in range(inside.shape[0]):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        nx, ny, nz = looks.normal[i, 0], looks.normal[i, 1], looks.normal[i, 2]
        cosine = -(nx * dx + ny * dy + nz * dz)
        if cosine < 0.0:
            nx, ny, nz, cosine = -nx, -ny, -nz, -cosine
        cosine = min(cosine, 1.0)
        ratio = looks.glass[i] if inside[i] else 1.0 / looks.glass[i]
        mirrored = fresnel(cosine, ratio)
        t = hits.depth[i]
        if mirrored == 1.0:
            side, stretch, lean = STEP_M, 1.0, 2.0 * cosine
        else:
            inside[i] = not inside[i]
            side, stretch = -STEP_M, ratio
            lean = ratio * cosine - np.sqrt(1.0 - ratio * ratio * (1.0 - cosine * cosine))
            for k in range(3):
                weight[i, k] *= (1.0 - mirrored) * hits.colour[i, k]
        origins[i, 0] += t * dx + side * nx
        origins[i, 1] += t * dy + side * ny
        origins[i, 2] += t * dz + side * nz
        x, y, z = stretch * dx + lean * nx, stretch * dy + lean * ny, stretch * dz + lean * nz
        length = np.sqrt(x * x + y * y + z * z)
        directions[i, 0], directions[i, 1], directions[i, 2] = x / length, y / length, z / length


def look_through(eye: Doubles, directions: Doubles, hits: Hits, looks: Looks, meet: Meet) -> Doubles:
    """Replace what rays (R, 3), z = 1 from the eye, met of glass by what is seen through it.

    directions, hits and looks then tell of the straight line from the eye to the point that is seen, with the colour
    and the lobe dimmed by the glass; of nothing, in the old direction, where nothing is seen, or only what lies behind
    the eye. Returns the directions (R, 3) in which the lines of sight arrive.
    """
    views = directions.copy()
    which = np.flatnonzero(looks.glass > 0)
    length = np.sqrt((directions[which] ** 2).sum(axis=1))
    travel = directions[which] / length[:, None]
    origins = np.tile(eye, (len(which), 1))
    inside, weight = np.zeros(len(which), np.bool_), np.ones((len(which), 3))
    now = Hits(hits.depth[which] * length, hits.facing[which], hits.colour[which])
    met = looks.some(which)
    hits.depth[which], hits.colour[which], looks.glass[which] = np.inf, 0.0, 0.0
    for _ in range(MAX_SURFACES):
        if not len(which):
            break
        bend(origins, travel, inside, weight, now, met)
        count = len(which)
        now = Hits(np.full(count, np.inf), np.zeros(count), np.zeros((count, 3), np.float32))
        met = nothing_met(count)
        meet(origins, travel, now, met)
        end = np.flatnonzero((now.depth < np.inf) & (met.glass == 0))
        points = origins[end] + now.depth[end, None] * travel[end] - eye
        ahead = points[:, 2] > 0
        end, points = end[ahead], points[ahead]
        pixel = which[end]
        directions[pixel], views[pixel] = points / points[:, 2:], travel[end]
        hits.depth[pixel], hits.facing[pixel] = points[:, 2], now.facing[end]
        hits.colour[pixel] = now.colour[end] * weight[end]
        looks.normal[pixel], looks.matt[pixel] = met.normal[end], met.matt[end]
        looks.lobe[pixel], looks.exponent[pixel] = met.lobe[end] * weight[end], met.exponent[end]
        on = np.flatnonzero(met.glass > 0)
        which, origins, travel, inside, weight = which[on], origins[on], travel[on], inside[on], weight[on]
        now, met = Hits(now.depth[on], now.facing[on], now.colour[on]), met.some(on)
    return views
