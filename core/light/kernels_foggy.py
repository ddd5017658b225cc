"""The compiled steps of paths in fog: how far they fly, what lights the fog along a leg, what dims it."""

from __future__ import annotations

from math import atan2, exp, log1p, pi, sqrt, tan
from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.halo import HALO_RADIUS, halo_share
from slopegate.core.light.kernels_bake import FROM_FOG, IN_FOG, NOTHING, WIDE_IN_FOG, Paths, Vertices
from slopegate.core.light.kernels_surfaces import Met
from slopegate.core.light.points import hashed, pair, single
from slopegate.core.render.fog import Medium, length_within, span
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.rig import Vector3

NEAREST_M: Final = 1e-3
"""Fog nearer to the projector is lit as if it were here: what light loses by it is below 0.7 mm of sigma_s. Otherwise
1 / d^2 would have no bounded mean square."""

_FLIGHT, _PLACE = 3000, 4000
_FREE_PATHS: Final = 40.0
"""Fog deeper than so many mean free paths sends nothing back."""


@njit(cache=True, nogil=True, error_model="numpy")
def phase(g: float, cosine: float) -> float:
    """Henyey and Greenstein's phase function, 1/sr, of the cosine between the directions before and after."""
    base = 1.0 + g * g - 2.0 * g * cosine
    return (1.0 - g * g) / (4.0 * pi * base * sqrt(base))


@njit(cache=True, nogil=True, error_model="numpy")
def fly(count: int, order: int, seed: int, medium: Medium, first: bool, paths: Paths, at: Vertices) -> None:
    """Let paths be stopped by fog on their way to their vertices, which then lie in the fog.

    Distances are drawn from scattering alone; absorption goes into the weights. first: on their way from the camera.
    """
    own = hashed(seed, _FLIGHT + order)
    for i in range(count):
        start = (float(paths.origin[i, 0]), float(paths.origin[i, 1]), float(paths.origin[i, 2]))
        along = (float(paths.direction[i, 0]), float(paths.direction[i, 1]), float(paths.direction[i, 2]))
        near, far = span(medium.lo, medium.hi, start, along)
        if at.kind[i] != NOTHING:
            x, y, z = at.point[i, 0] - start[0], at.point[i, 1] - start[1], at.point[i, 2] - start[2]
            far = min(far, sqrt(x * x + y * y + z * z))
        if not near < far:
            continue
        inside = far - near
        if medium.scattering > 0.0:
            u, _ = pair(paths.number[i], own)
            flight = -log1p(-u) / medium.scattering
            if flight < inside:
                inside = flight
                at.kind[i] = IN_FOG
                for k in range(3):
                    at.point[i, k] = start[k] + (near + flight) * along[k]
                    at.normal[i, k] = 0.0
                for k in range(at.albedo.shape[1]):
                    at.albedo[i, k] = 1.0
                if first:
                    paths.plain[i] = FROM_FOG
        absorption = medium.extinction - medium.scattering
        if absorption > 0.0:
            # Without scattering a ray may run to the end of endless fog: nothing comes from there.
            kept = np.float32(exp(-absorption * inside))
            for k in range(paths.weight.shape[1]):
                paths.weight[i, k] *= kept


@njit(cache=True, nogil=True, error_model="numpy")
def light_leg(
    count: int,
    order: int,
    seed: int,
    medium: Medium,
    light: Vector3,
    rotation: Doubles,
    paths: Paths,
    met: Met,
    q: Doubles,
    rays: Singles,
    value: Singles,
) -> None:
    """What the projector sends into the fog along each leg, by one place on it: q, rays and value as in `face`.

    Half of the places are drawn by the angle at which the projector sees the leg (Kulla and Fajardo 2012), which takes
    its 1 / d^2 away, half by how the leg fades; each is weighted by both.
    """
    own, choice = hashed(seed, _PLACE + order), hashed(seed, _PLACE + order + 500)
    for i in range(count):
        q[i, 0], q[i, 1], q[i, 2] = np.nan, np.nan, -1.0
        start = (float(paths.origin[i, 0]), float(paths.origin[i, 1]), float(paths.origin[i, 2]))
        along = (float(paths.direction[i, 0]), float(paths.direction[i, 1]), float(paths.direction[i, 2]))
        near, far = span(medium.lo, medium.hi, start, along)
        far = min(far, float(met.distance[i]), near + _FREE_PATHS / medium.extinction)
        if not near < far:
            continue
        u = single(paths.number[i], own)
        t, density = _place(u, single(paths.number[i], choice) < 0.5, near, far, medium.extinction, start, along, light)
        x = start[0] + t * along[0] - light[0]
        y = start[1] + t * along[1] - light[1]
        z = start[2] + t * along[2] - light[2]
        qz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        if qz <= 0.0:
            continue
        length = sqrt(x * x + y * y + z * z)
        cosine = -(x * along[0] + y * along[1] + z * along[2]) / length
        way = length_within(medium.lo, medium.hi, light, (x, y, z), 1.0)
        # pi / (z^2 cos theta), with cos theta = z / length.
        beam = pi * (length / qz) / max(qz, NEAREST_M) ** 2
        strength = medium.scattering * phase(medium.g, cosine) * beam
        strength *= exp(-medium.extinction * (t - near + way)) / density
        for k in range(value.shape[1]):
            value[i, k] = strength
        q[i, 0] = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) / qz
        q[i, 1] = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) / qz
        q[i, 2] = qz
        rays[i, 0], rays[i, 1], rays[i, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _place(
    u: float,
    by_angle: bool,
    near: float,
    far: float,
    extinction: float,
    start: Vector3,
    along: Vector3,
    light: Vector3,
) -> tuple[float, float]:
    """A distance from near to far along a leg, drawn by u one way or the other, and the density of both together."""
    x, y, z = light[0] - start[0], light[1] - start[1], light[2] - start[2]
    middle = x * along[0] + y * along[1] + z * along[2]
    off = sqrt(max(x * x + y * y + z * z - middle * middle, 1e-12))
    low, high = atan2(near - middle, off), atan2(far - middle, off)
    whole = -np.expm1(-extinction * (far - near))
    t = middle + off * tan(low + u * (high - low)) if by_angle else near - log1p(-u * whole) / extinction
    t = min(max(t, near), far)
    angular = off / ((high - low) * (off * off + (t - middle) * (t - middle)))
    fading = extinction * exp(-extinction * (t - near)) / whole
    return t, 0.5 * (angular + fading)


@njit(cache=True, nogil=True, error_model="numpy")
def dim_rays(count: int, medium: Medium, light: Vector3, q: Doubles, rays: Singles, value: Singles) -> None:
    """Take from value (N, C) what the fog keeps of the projector's light on its way to the points light + rays."""
    for i in range(count):
        if q[i, 2] <= 0.0:
            continue
        along = (float(rays[i, 0]), float(rays[i, 1]), float(rays[i, 2]))
        kept = np.float32(exp(-medium.extinction * length_within(medium.lo, medium.hi, light, along, 1.0)))
        for k in range(value.shape[1]):
            value[i, k] *= kept


@njit(cache=True, nogil=True, error_model="numpy")
def near_halo(
    count: int,
    camera: Vector3,
    field: tuple[float, float, float, float],
    row: Singles,
    paths: Paths,
    at: Vertices,
    asked: Indices,
    share: Singles,
    starts: Singles,
    ways: Singles,
) -> int:
    """Lit surfaces within the camera's field whose light fog alone makes a near halo of: their number.

    field: least x/z and y/z that the camera sees, and the greatest.

    asked (N,): which paths' they are; share (N,): what `scatter` draws of each if the camera sees it; starts and ways
    (N, 3): the camera's rays to them.
    """
    kept = 0
    for i in range(count):
        if (paths.plain[i] != FROM_FOG and paths.plain[i] != WIDE_IN_FOG) or at.kind[i] < 0 or row[i] < 0:
            continue
        z = at.point[i, 2] - camera[2]
        if z <= 0.0:
            continue
        a, b = (at.point[i, 0] - camera[0]) / z, (at.point[i, 1] - camera[1]) / z
        if not (field[0] <= a <= field[2] and field[1] <= b <= field[3]):
            continue
        x, y = a - paths.seen[i, 0], b - paths.seen[i, 1]
        offset = sqrt(x * x + y * y)
        if offset >= HALO_RADIUS:
            continue
        asked[kept], share[kept] = i, halo_share(offset)
        for k in range(3):
            starts[kept, k] = camera[k]
            ways[kept, k] = at.point[i, k] - camera[k]
        kept += 1
    return kept
