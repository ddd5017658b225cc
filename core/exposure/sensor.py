"""The sensor model: radiance to counts of a camera, with gain, noise, saturation, quantisation and colour filter.

Model section 4. Two ways with one model. `expose` draws every photon count from the Poisson distribution in float64:
for images that are kept. `Plates` and `expose_fast` make live frames in one pass over fixed-point planes, with a normal
of the exact variance in the Poisson's place. What that costs, in cumulative probability at a mean of n electrons and a
read noise of r electrons: at most 0.0665 n / (n + r^2)^1.5 for the missing skewness (Berry-Esseen expansion, first
term) and, for r below 1, 0.5 / sqrt(2 pi n) for the missing lattice of whole electrons. With r = 8 that is below 0.0033
at any n.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import make_planes, some_rows
from slopegate.core.exposure.kernels import luminance, to_steps
from slopegate.core.exposure.patterned import to_patterned_steps
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import require, require_positive

REC709: Final = (0.2126, 0.7152, 0.0722)
"""Luminance of linear RGB: what a monochrome sensor sees."""

READ_VARIANCE: Final = 16.0
"""counts^2. Where a pixel's noise has to be judged and the sensor is not known: a read noise of 4 counts, beside shot
noise at one electron a count. Better sensors only lose a few dark pixels by that."""

_POOL_SIZE: Final = 1 << 17
_POOL_STEP: Final = 1.0 / 4096.0
_ROWS_PER_FRAME: Final = 1 << 16
_SEED_STRIDE: Final = 0x9E3779B97F4A7C15
_MASK64: Final = (1 << 64) - 1
_FULL: Final = 65535


@dataclass(frozen=True)
class SensorModel:
    """A linear sensor: count = radiance * counts_per_unit + noise + black_count, cut to 0..max_count.

    The unit of radiance is that of `render.Buffers`. Defaults are typical of a small-pixel CMOS sensor at 12 bit.
    """

    counts_per_unit: float = 2000.0
    electrons_per_count: float = 2.0
    read_noise_e: float = 8.0
    black_count: float = 40.0
    max_count: int = 4095

    def __post_init__(self) -> None:
        for name in ("counts_per_unit", "electrons_per_count"):
            require_positive(name, getattr(self, name))
        require(0 <= self.read_noise_e < np.inf, "read_noise_e", self.read_noise_e, "a finite number of at least 0")
        require(1 <= self.max_count <= _FULL, "max_count", self.max_count, f"a whole number from 1 to {_FULL}")
        fits = 0 <= self.black_count < self.max_count
        require(fits, "black_count", self.black_count, f"at least 0 and below max_count ({self.max_count})")


def auto_gain(floodlit: Singles, sensor: SensorModel) -> SensorModel:
    """The same sensor with the gain that puts the fully lit image's 99.5th percentile at 80 % of full scale.

    floodlit: radiance of any shape, direct + ambient of one period; pixels of 0 (nothing there) do not count. A scene
    without any light keeps its gain.
    """
    lit = floodlit[floodlit > 0]
    if lit.size == 0:
        return sensor
    bright = float(np.percentile(lit, 99.5))
    return replace(sensor, counts_per_unit=(0.8 * sensor.max_count - sensor.black_count) / bright)


def mono(rgb: Singles) -> Singles:
    """(..., 3) linear RGB -> (...) luminance, float32."""
    out = np.empty(rgb.shape[:-1], np.float32)
    image = rgb if rgb.ndim == 3 else rgb.reshape(1, -1, 3)
    luminance(image, np.array(REC709, np.float32), out.reshape(image.shape[:2]))
    return out


def bayer_rg(rgb: Singles, first_row: int = 0, first_column: int = 0) -> Singles:
    """(H, W, 3) -> (H, W) float32 through the filters R G / G B, red at even rows and columns of the sensor.

    first_row and first_column are the sensor's coordinates of the image's corner.
    """
    height, width = rgb.shape[:2]
    row_parity = np.arange(first_row, first_row + height) & 1
    channel = row_parity[:, None] + (np.arange(first_column, first_column + width) & 1)
    return np.take_along_axis(rgb, channel[:, :, None], axis=2)[:, :, 0]


def expose(radiance: Singles, sensor: SensorModel, rng: np.random.Generator | None) -> Counts:
    """Radiance of any shape -> uint16 counts with true Poisson noise; rng None: without noise.

    Raises InputError unless the radiance is finite and >= 0.
    """
    light = np.asarray(radiance, np.float64)
    ok = bool(np.isfinite(light).all() and (light >= 0).all())
    require(ok, "radiance", float(np.min(light, initial=0.0)), "finite and at least 0 in every pixel")
    if rng is None:
        counts = light * sensor.counts_per_unit
    else:
        mean_e = light * (sensor.counts_per_unit * sensor.electrons_per_count)
        # Far beyond full scale the counts are saturated whatever is drawn; numpy's Poisson overflows near 1e19.
        electrons = rng.poisson(np.minimum(mean_e, 1e12)) + rng.normal(0.0, sensor.read_noise_e, mean_e.shape)
        counts = electrons / sensor.electrons_per_count
    return np.clip(np.floor(counts + sensor.black_count + 0.5), 0, sensor.max_count).astype(np.uint16)


@dataclass(frozen=True, eq=False)
class NoisePool:
    """Standard normals, drawn once: int16 in steps of 1/4096, mean 0 and variance 1 over the pool.

    The first values are repeated at the end, a row's length of them, so that each is as likely as any other wherever a
    row starts. Two pixels of a row correlate by the pool's own autocorrelation, about 1 / sqrt(131072) = 0.003 at any
    distance; pixels of different rows or frames by chance alone.
    """

    values: NDArray[np.int16]

    def frame(self, seed: int, frame: int, noisy: bool = True) -> kernels.Noise:
        """The noise of one frame, fixed by the two numbers; none, but the same cost, unless noisy."""
        mixed = (seed * _SEED_STRIDE + frame * _ROWS_PER_FRAME) & _MASK64
        return kernels.Noise(self.values, np.float32(_POOL_STEP if noisy else 0.0), np.uint64(mixed))


def noise_pool(rng: np.random.Generator, width: int) -> NoisePool:
    """Draw the pool for rows of `width` pixels. Rounding to the step adds 5e-9 to the variance."""
    draws = np.clip(rng.standard_normal(_POOL_SIZE), -7.9, 7.9)
    draws = (draws - draws.mean()) / draws.std()
    values = np.rint(draws / _POOL_STEP).astype(np.int16)
    return NoisePool(np.concatenate([values, np.resize(values, width)]))


class Plates:
    """What one sensor sees of a scene, as fixed-point counts that frames are made from; filled in place.

    planes.direct is (H, W) uint16 in steps of 2 (max_count + 1) / 65536 (1/8 count at 12 bit), cut at twice full scale,
    60 standard deviations into saturation; off by at most half a step times the weight. planes.ambient, of one period,
    is in steps of its maximum / 65535.
    """

    def __init__(
        self, projector_row: Singles, direct: Singles, ambient: Singles, sensor: SensorModel, skip: bool = True
    ) -> None:
        """Radiance (H, W) float32, as from `mono` or `bayer_rg`; projector_row (H, W) is kept, not copied.

        skip False: frames look at every pixel, whether the gate can light it or not.
        """
        height, width = projector_row.shape
        self.sensor, self._skip, self.poured = sensor, skip, False
        self.direct_step = 2.0 * (sensor.max_count + 1) / (_FULL + 1)
        self.ambient_step = float(ambient.max(initial=0.0)) * sensor.counts_per_unit / _FULL
        empty = np.zeros((height, width), np.uint16)
        self.planes = make_planes(projector_row, empty, empty.copy(), skip)
        self._store(slice(0, height), slice(0, width), direct, ambient)

    def refresh(self, rows: slice, columns: slice, direct: Singles, ambient: Singles) -> bool:
        """Take over the radiance (h, w) of a region in which projector_row has changed as well.

        False, and nothing taken, when ambient exceeds the maximum that these plates were made for: make new ones then.
        """
        peak = float(ambient.max(initial=0.0)) * self.sensor.counts_per_unit
        if peak > self.ambient_step * _FULL * (1 + 1e-6):
            return False
        self._store(rows, columns, direct, ambient)
        planes = self.planes
        if self._skip:
            kernels.tile_bounds(planes.projector_row, (rows.start, rows.stop), planes.tile_low, planes.tile_high)
        return True

    def light_with(self, direct: Singles, projector_column: Singles, picture: Singles | None) -> None:
        """Let frames show direct light as if the projector showed this picture; None: all on.

        direct (H, W): radiance with all on; projector_column (H, W); picture as in `patterned`.
        """
        scale, planes = np.float32(self.sensor.counts_per_unit / self.direct_step), self.planes
        if picture is None:
            to_steps(direct, scale, 0, 0, planes.direct)
        else:
            shown = np.ascontiguousarray(picture)
            to_patterned_steps(direct, planes.projector_row, projector_column, shown, scale, planes.direct)

    def pour(self, light: Singles) -> None:
        """Let frames of `exposure_periods` 1 show this radiance (H, W) where ambient light stood, until `drain`.

        It is light of one gate, all of it that does not go through the gate's own test: rounded to the steps of the
        direct light, by at most half of one.
        """
        self.poured = True
        to_steps(light, np.float32(self.sensor.counts_per_unit / self.direct_step), 0, 0, self.planes.ambient)

    def drain(self, ambient: Singles) -> None:
        """Show the ambient light (H, W) of one period again, times the exposure."""
        self.poured = False
        self._store_ambient(0, 0, ambient)

    @property
    def room_step(self) -> float:
        """What a step of planes.ambient is worth in counts, of one period or of what was poured."""
        return self.direct_step if self.poured else self.ambient_step

    def _store(self, rows: slice, columns: slice, direct: Singles, ambient: Singles) -> None:
        gain, top, left = self.sensor.counts_per_unit, rows.start, columns.start
        to_steps(direct, np.float32(gain / self.direct_step), top, left, self.planes.direct)
        if not self.poured:
            self._store_ambient(top, left, ambient)

    def _store_ambient(self, top: int, left: int, ambient: Singles) -> None:
        if self.ambient_step > 0:
            scale = np.float32(self.sensor.counts_per_unit / self.ambient_step)
            to_steps(ambient, scale, top, left, self.planes.ambient)


def response(plates: Plates, exposure_periods: float) -> kernels.Response:
    """The numbers that `kernels.expose` needs for one frame.

    The noise variance is mean / electrons_per_count + read noise^2, in counts^2.
    """
    sensor = plates.sensor
    return kernels.Response(
        direct_step=np.float32(plates.direct_step),
        ambient_step=np.float32(plates.room_step * exposure_periods),
        variance_per_count=np.float32(1.0 / sensor.electrons_per_count),
        read_variance=np.float32((sensor.read_noise_e / sensor.electrons_per_count) ** 2),
        offset=np.float32(sensor.black_count + 0.5),
        max_count=np.float32(sensor.max_count),
    )


def expose_fast(
    plates: Plates,
    windows: kernels.Windows,
    exposure_periods: float,
    noise: kernels.Noise,
    out: Counts,
    rows: tuple[int, int] | None = None,
) -> float:
    """One live frame into `out` (H, W); returns the share of its pixels whose direct light was not looked at.

    Of `rows`, first and one past the last, None for all, each pixel is what it is in the whole frame; the others are
    not read and hold the black level.
    """
    first, last = rows or (0, out.shape[0])
    black = np.uint16(plates.sensor.black_count + 0.5)
    out[:first], out[last:] = black, black
    if first == last:
        return 1.0
    planes = plates.planes
    if (first, last) != (0, out.shape[0]):
        planes, windows = some_rows(planes, windows, first, last)
        noise = noise._replace(seed=np.uint64((int(noise.seed) + first) & _MASK64))
    skipped = int(kernels.expose(planes, windows, response(plates, exposure_periods), noise, out[first:last]))
    return float(skipped + (out.shape[0] - last + first) * out.shape[1]) / out.size


def frames_of_light(light: Singles, sensor: SensorModel, seed: int, count: int) -> list[Counts]:
    """Frames (H, W) of this light (H, W), with the noise of live frames; the same noise for the same seed and number.

    So frames of different light differ by their light, where noise of their own would hide small differences.
    """
    dark, unlit = np.zeros_like(light), np.full_like(light, -1)
    plates = Plates(unlit, dark, light, sensor)
    nothing = np.zeros(len(light), np.int32)
    windows = kernels.Windows(dark[:, 0].copy(), dark[:, 0].copy(), nothing, nothing)
    pool = noise_pool(np.random.default_rng(seed), light.shape[1])
    frames = [np.empty(light.shape, np.uint16) for _ in range(count)]
    for number, frame in enumerate(frames):
        expose_fast(plates, windows, 1.0, pool.frame(seed, number), frame)
    return frames


def warm_up() -> None:
    """Compile, or load from the cache, what `Plates` and `expose_fast` run, so that no frame waits for it."""
    dark = np.zeros((1, 1), np.float32)
    nothing = np.zeros(1, np.int32)
    windows = kernels.Windows(dark[0], dark[0], nothing, nothing)
    noise = noise_pool(np.random.default_rng(0), 1).frame(0, 0)
    mono(np.zeros((2, 2, 3), np.float32)[:, :1])
    expose_fast(Plates(dark, dark, dark, SensorModel()), windows, 0.0, noise, np.empty((1, 1), np.uint16))
