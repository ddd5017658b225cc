"""The near halo of light that fog turns several times on its way to the camera, from that of light turned once.

Where turns are small they add up. A turn by T at the distance s from the camera moves what is seen at the distance D by
T (D - s) / D in the image, whatever the other turns do, and how many there are is a matter of chance. So if K is what
one turn lays about each place of the image (`scatter_kernels`), n turns lay there the n-fold convolution of K with
itself, divided by n! (Wells 1969, there for the eye under water; Fourier's transform makes it a power). `Several` keeps
by how much the sum of 1 to MOST_TURNS turns is brighter than one turn: 1 in the sharp middle, smooth about it.

That holds for turns by less than about 45 degrees (SMALL_COSINE), and only these are taken: what fog turned several
times, once of it by more, is smooth and stays in the bake. Taken from one turn, the halo is exact (`scatter_kernels`).
Here surfaces stand across the ray, and fog begins and ends as it does on average on rays of that length.

Against random walks, as shares of the halo within its radius, fog being all the way or 30 cm before the surface: 2 %
for any g up to 0.85 at an optical thickness of up to 1.5, and 5 % at 3. At 6 up to 15 % too little.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.halo import SMALL_COSINE
from slopegate.core.light.scatter_kernels import ANGLE_STEP, ANGLES, RayEnds, Senders, Several, Turns, halo
from slopegate.core.render.fog import Medium
from slopegate.core.rig.arrays import Doubles

_SMALL_COT: Final = SMALL_COSINE / (1 - SMALL_COSINE**2) ** 0.5
_MOST_THICKNESS: Final = 20.0
"""Optical thickness beyond which there is no near halo to speak of: what is left has turned more often."""
_MOST_REACH: Final = 100.0
"""The same, were the fog to begin at the camera: beyond it numbers overflow."""
_DISTANCES: Final = 24
_SIDE: Final = 512
WIDEST_ANGLE: Final = ANGLE_STEP * _SIDE / 2 * 2**0.5
"""The largest angle that is looked at, radians: the corners of the plane."""

_CELL_MEAN: Final = 4 * np.log(1 + np.sqrt(2))
"""Mean of 1/r over a square of side 1 about r = 0."""


def make_several(medium: Medium, turns: Turns, source: Senders, sink: RayEnds, most_turns: int) -> Several:
    """For all distances in this view; turns: good to the sine of WIDEST_ANGLE. most_turns 1: everywhere 1."""
    seen = (source.inverse_depth > 0) & (sink.last > sink.first)
    if most_turns < 2 or medium.scattering == 0 or not seen.any():
        return Several(np.ones((2, ANGLES)), 0.0, 1.0)
    distance = np.sqrt(1 + source.x[seen] ** 2 + source.y[seen] ** 2, dtype=np.float64) / source.inverse_depth[seen]
    logs = np.log(distance)
    low, high = float(logs.min()), float(logs.max())
    step = max(high - low, 1e-3) / (_DISTANCES - 1)
    place = np.rint((logs - low) / step).astype(np.int64)
    count = np.bincount(place, minlength=_DISTANCES)
    known, nodes = np.flatnonzero(count), np.arange(_DISTANCES)
    table = np.ones((_DISTANCES, ANGLES))
    means = [
        np.interp(nodes, known, np.bincount(place, end[seen] / distance, _DISTANCES)[known] / count[known])
        for end in (sink.first, sink.last)
    ]
    for node in nodes:
        # One distance is all that a frontal wall needs.
        if node and high - low < 1e-3:
            table[node] = table[0]
            continue
        reach = float(np.exp(low + node * step))
        last = np.inf if means[1][node] > 0.99 else reach * means[1][node]
        table[node] = several_by_one(medium, turns, (reach, reach * means[0][node], last), most_turns)
    return Several(table, low, step)


def several_by_one(medium: Medium, turns: Turns, ends: tuple[float, float, float], most_turns: int) -> Doubles:
    """The sum of 1 to most_turns turns divided by one turn, at ANGLES angles from 0 on.

    ends: distance of the surface, and of where the fog on the ray to it begins and ends, metres.
    """
    thickness = medium.extinction * (min(ends[0], ends[2]) - ends[1])
    if thickness > _MOST_THICKNESS or medium.extinction * ends[0] > _MOST_REACH:
        return np.ones(ANGLES)
    near = np.arange(1, ANGLES, dtype=np.float64) * ANGLE_STEP
    angles = np.linspace(0.0, WIDEST_ANGLE, 2 * _SIDE, dtype=np.float64)[1:]
    single, radial = np.empty_like(near), np.empty_like(angles)
    _fill_one_turn(turns, medium.extinction, ends, -np.inf, near, single)
    if not (single > 0).all():
        return np.ones(ANGLES)
    _fill_one_turn(turns, medium.extinction, ends, _SMALL_COT, angles, radial)
    radial *= medium.scattering * np.sin(angles)
    # The plane of angles, its middle at the first cell; r K is smooth.
    line = np.minimum(np.arange(_SIDE), np.arange(_SIDE, 0, -1)) * ANGLE_STEP
    away = np.hypot(line[:, None], line)
    away[0, 0] = ANGLE_STEP / _CELL_MEAN
    once = np.interp(away, angles, radial) / away
    power = np.fft.rfft2(once).real * ANGLE_STEP**2
    total, term = np.zeros_like(power), power
    for n in range(2, most_turns + 1):
        term = term * power / n
        total += term
    # Back along one axis alone: the sum over the other is what lies at 0.
    more = np.fft.irfft(total.mean(axis=0), _SIDE) / ANGLE_STEP**2
    # Rounding may leave a trace below nothing.
    found = np.ones(ANGLES)
    found[1:] += np.maximum(more[1:ANGLES], 0) / (medium.scattering * single)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_one_turn(
    turns: Turns, extinction: float, ends: tuple[float, float, float], most_cot: float, angles: Doubles, out: Doubles
) -> None:
    """`halo` of a surface across the ray, at all these angles, by turns up to the one of this cotangent."""
    for n in range(angles.shape[0]):
        sine, cosine = np.sin(angles[n]), np.cos(angles[n])
        last = min(ends[2], ends[0] * (cosine - sine * most_cot))
        out[n] = halo(turns, extinction, ends[0], sine, cosine, 0.0, ends[1], last)
