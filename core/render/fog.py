"""Fog between surface, projector and camera: the way through its box, and what it takes from light and lays over it.

Light that reaches a surface and then the camera keeps exp(-sigma_t (l_p + l_c)), l_p and l_c the lengths of both legs
inside the fog (model section 4). Ambient light is taken as one radiance L_a from everywhere: a surface shows
exp(-sigma_t l_c) of it, and the fog before it scatters (sigma_s / sigma_t) (1 - exp(-sigma_t l_c)) L_a into the ray,
whatever its phase function. Rays that meet no surface run to the end of the fog.
"""

from __future__ import annotations

from math import exp, expm1, inf, sqrt
from typing import NamedTuple

from slopegate.core.compiled.kept import njit
from slopegate.core.render.kernels import Pixels
from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.core.rig.rig import Vector3
from slopegate.core.scene.media import Fog


class Medium(NamedTuple):
    """Fog as the compiled loops take it: corners of its box in world axes, sigma_s and sigma_t in 1/m, g."""

    lo: Vector3
    hi: Vector3
    scattering: float
    extinction: float
    g: float


def medium_of(fog: Fog | None) -> Medium | None:
    """The fog for compiled loops; None where there is nothing to compute: no fog, or one that changes no light."""
    if fog is None or fog.extinction_per_m == 0:
        return None
    lo, hi = (tuple(float(c) for c in corner) for corner in (fog.lo_m, fog.hi_m))
    scattering, extinction = float(fog.scattering_per_m), float(fog.extinction_per_m)
    return Medium((lo[0], lo[1], lo[2]), (hi[0], hi[1], hi[2]), scattering, extinction, float(fog.g))


@njit(cache=True, nogil=True, error_model="numpy")
def span(lo: Vector3, hi: Vector3, start: Vector3, along: Vector3) -> tuple[float, float]:
    """First and last t >= 0 at which start + t along lies in the box lo..hi, borders included; (0, 0) for none.

    Sides may be infinite, and so may the last t. By slabs: one interval of t for each pair of sides. Each end is good
    to 3 roundings of itself and of start / along.
    """
    first, last = 0.0, inf
    for k in range(3):
        if along[k] == 0.0:
            if start[k] < lo[k] or start[k] > hi[k]:
                return 0.0, 0.0
            continue
        one, other = (lo[k] - start[k]) / along[k], (hi[k] - start[k]) / along[k]
        first, last = max(first, min(one, other)), min(last, max(one, other))
    # Infinite ends meet where a step beyond the range of numbers leads to a side: that far out there is nothing.
    if not first < last:
        return 0.0, 0.0
    return first, last


@njit(cache=True, nogil=True, error_model="numpy")
def length_within(lo: Vector3, hi: Vector3, start: Vector3, along: Vector3, end: float) -> float:
    """Metres that start + t along, 0 <= t <= end, runs inside the box lo..hi; end may be infinite."""
    first, last = span(lo, hi, start, along)
    last = min(last, end)
    if not first < last:
        return 0.0
    return (last - first) * sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])


@njit(cache=True, nogil=True, error_model="numpy")
def dim(
    medium: Medium,
    eye: Vector3,
    light: Vector3,
    directions: Doubles,
    depth: Doubles,
    vectors: Doubles,
    ambient: float,
    places: Indices,
    out: Pixels,
) -> None:
    """Lay fog over what R rays brought into the pixels `places` (R,) of `out`.

    directions (R, 3) from the eye meet surfaces at depth (R,), infinite for none, and vectors (R, 3) lead there from
    the light, all in world axes; ambient: the radiance from everywhere.
    """
    lo, hi, extinction = medium.lo, medium.hi, medium.extinction
    share = medium.scattering / extinction
    for i in range(places.shape[0]):
        p = places[i]
        along = (directions[i, 0], directions[i, 1], directions[i, 2])
        thickness = extinction * length_within(lo, hi, eye, along, depth[i])
        left, added = exp(-thickness), -share * expm1(-thickness) * ambient
        for k in range(3):
            out.ambient[p, k] = left * out.ambient[p, k] + added
        if out.projector_row[p] < 0:
            continue  # unlit, and without a surface there is no vector either
        beam = (vectors[i, 0], vectors[i, 1], vectors[i, 2])
        kept = exp(-thickness - extinction * length_within(lo, hi, light, beam, 1.0))
        for k in range(3):
            out.direct[p, k] = kept * out.direct[p, k]
