"""A scene seen by a rig, in float64, and the exact images that errors are counted from.

Two exact answers, because two kinds of error have nothing to do with each other:

- *gate*: the same single ray through each pixel's centre, its projector row and the window's edges in float64. What
  differs from it is rounding: number types, fixed point, whole rows.
- *area*: the mean over each pixel's area by 16 x 16 rays. What differs from it is sampling: hard edges, few rays. It is
  computed for a lattice of pixels, each by itself, so its root mean square estimates that of the whole frame.

The light of a pixel itself (radiance, float32 off by at most 2^-24 of itself, 0.0003 counts) is given, not measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.exposure.sensor import SensorModel, auto_gain, mono
from slopegate.core.gating.gate import RowWindows, recorded_times, row_windows, weights
from slopegate.core.gating.plan import plan
from slopegate.core.render.integrate import pixel_positions, pixel_shifts
from slopegate.core.render.render import make_tracer
from slopegate.core.render.tracing import RAYS_PER_BAND
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene

TILTS_DEG: Final = (0.0, 40.0, -40.0)
THICKNESS: Final = 0.08
"""Of the distance."""


class Sight(NamedTuple):
    """What rays see: projector row float64 (-1 unlit), luminance of the projector's light and of one period's ambient
    light, float32, and inverse depth in 1/m, float64 (0 where there is no surface). Arrays of one shape."""

    row: Doubles
    direct: Singles
    ambient: Singles
    inverse_depth: Doubles


class GateNumbers(NamedTuple):
    """One gate as numbers: its settings, its windows, and its exposure in periods."""

    settings: GateSettings
    windows: RowWindows
    periods: float


@dataclass(frozen=True, eq=False)
class Area:
    """The exact answer for pixels with an area: pixels (n,) flat indices; counts, one (n,) array a gate; flood (n,),
    the counts of each pixel's direct light recorded once."""

    pixels: Indices
    counts: tuple[Doubles, ...]
    flood: Doubles


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene before a rig and nine gates through it; `sight` through pixel centres, (H, W)."""

    name: str
    rig: Rig
    scene: Scene
    sight: Sight
    gates: tuple[GateNumbers, ...]
    sensor: SensorModel

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the camera."""
        return self.sight.row.shape[0], self.sight.row.shape[1]

    def exact_counts(self, index: int) -> Doubles:
        """(H, W) float64 counts of a gate before rounding, without noise, cut to what the sensor can count."""
        gate = self.gates[index]
        light = weights(gate.windows, self.sight.row) * self.sight.direct.astype(np.float64)
        return to_counts(light + gate.periods * self.sight.ambient, self.sensor)

    def area_counts(self, pixels: Indices, samples: int) -> Area:
        """Means over samples x samples rays a pixel, as `core.render.integrate` lays and gates them."""
        width = self.shape[1]
        tracer = make_tracer(self.rig, self.scene)
        bodies = tracer.still() + tracer.moving(0.0)
        light = np.zeros((len(self.gates), len(pixels)))
        flood = np.zeros(len(pixels))
        positions = pixel_positions(samples)
        for part in _bands(len(pixels)):
            rows, columns = np.divmod(pixels[part], width)
            aside, below = pixel_shifts(samples, columns, rows)
            for across, down in positions:
                rays = tracer.trace(columns + (across + aside) % 1, rows + (down + below) % 1, bodies)
                direct = mono(rays.direct).astype(np.float64)
                ambient = mono(rays.ambient)
                flood[part] += direct
                for index, gate in enumerate(self.gates):
                    light[index, part] += recorded_times(gate.windows, rows, rays.projector_row) * direct
                    light[index, part] += gate.periods * ambient
        gain = self.sensor.counts_per_unit / len(positions)
        counts = tuple(to_counts(values / len(positions), self.sensor) for values in light)
        return Area(pixels, counts, flood * gain)

    def lattice(self, count: int) -> Indices:
        """About `count` pixels spread evenly over the frame, by flat index."""
        height, width = self.shape
        stride = max(1, height * width // count)
        while math.gcd(stride, width) > 1:
            stride += 1
        return np.arange(stride // 2, height * width, stride)


def make_subject(name: str, rig: Rig, scene: Scene) -> Subject:
    """Cast one ray per pixel and lay nine gates through what they meet. Raises InputError where nothing is lit."""
    sight = look(rig, scene)
    floodlit = sight.direct + sight.ambient
    return Subject(name, rig, scene, sight, make_gates(rig, sight), auto_gain(floodlit, SensorModel()))


def look(rig: Rig, scene: Scene) -> Sight:
    """One ray through each pixel's centre; the projector row is that of the float64 surface point, unrounded."""
    lens = rig.camera.lens
    tracer = make_tracer(rig, scene)
    bodies = tracer.still() + tracer.moving(0.0)
    count = lens.height * lens.width
    row, inverse = np.full(count, -1.0), np.zeros(count)
    direct, ambient = np.zeros(count, np.float32), np.zeros(count, np.float32)
    for part in _bands(count):
        rows, columns = np.divmod(np.arange(part.start, part.stop), lens.width)
        rays = tracer.trace(columns + 0.5, rows + 0.5, bodies)
        lit = np.flatnonzero(rays.projector_row >= 0)
        beams = rig.camera_rays(columns[lit] + 0.5, rows[lit] + 0.5)
        exact = rig.to_projector(rig.camera_centre_m + beams * rays.depth[lit, None])[1]
        row[part.start + lit] = np.clip(exact, 0, np.nextafter(rig.projector.lens.height, 0))
        inverse[part] = 1 / rays.depth
        direct[part], ambient[part] = mono(rays.direct), mono(rays.ambient)
    shape = (lens.height, lens.width)
    return Sight._make(array.reshape(shape) for array in (row, direct, ambient, inverse))


def make_gates(rig: Rig, sight: Sight) -> tuple[GateNumbers, ...]:
    """Three distances through the scene's depth, each upright and leaning either way, so that edges cross surfaces."""
    lit = sight.inverse_depth[sight.row >= 0]
    if lit.size == 0:
        raise InputError("the projector lights nothing in this scene: there is no gate to measure")
    far, near = np.percentile(lit, (2, 98))
    distances_m = [1 / (far + share * (near - far)) for share in (1 / 6, 1 / 2, 5 / 6)]
    wanted = [
        plan(rig, tilt_deg, float(distance_m), float(THICKNESS * distance_m))
        for distance_m in distances_m
        for tilt_deg in TILTS_DEG
    ]
    period_us = rig.projector.period_us
    return tuple(GateNumbers(item, row_windows(rig, item), item.exposure_us / period_us) for item in wanted)


def scaled_rig(rig: Rig, width: int) -> Rig:
    """The same rig with a camera of this many columns over the same field of view."""
    lens = rig.camera.lens
    small = lens.resized(width, round(lens.height * width / lens.width))
    return replace(rig, camera=replace(rig.camera, lens=small), calibration=None)


def to_counts(light: Doubles, sensor: SensorModel) -> Doubles:
    """Radiance -> counts before rounding, cut to 0..max_count."""
    return np.clip(light * sensor.counts_per_unit + sensor.black_count, 0.0, sensor.max_count)


def _bands(count: int) -> Iterator[slice]:
    for start in range(0, count, RAYS_PER_BAND):
        yield slice(start, min(start + RAYS_PER_BAND, count))
