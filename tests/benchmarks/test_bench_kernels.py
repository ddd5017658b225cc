from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import kernel_windows, make_planes
from slopegate.core.exposure.sensor import NoisePool, Plates, SensorModel, auto_gain, expose_fast, mono, noise_pool
from slopegate.core.gating.gate import RowWindows, row_windows


@dataclass
class Ready:
    """All that a frame needs, at 1600x1200."""

    windows: RowWindows
    edges: kernels.Windows
    linear: kernels.Planes
    plates: Plates
    pool: NoisePool
    periods: float
    frame: NDArray[np.uint16]
    image: NDArray[np.float32]

    def expose(self) -> None:
        expose_fast(self.plates, self.edges, self.periods, self.pool.frame(0, 1), self.frame)

    def gate(self) -> None:
        kernels.gate(self.linear, self.edges, np.float32(0), self.image)


@pytest.fixture(scope="module")
def ready(bench: SimpleNamespace) -> Ready:
    buffers = bench.buffers
    direct, ambient = mono(buffers.direct), mono(buffers.ambient)
    windows = row_windows(bench.rig, bench.settings)
    return Ready(
        windows,
        kernel_windows(windows),
        make_planes(buffers.projector_row, direct, ambient),
        Plates(buffers.projector_row, direct, ambient, auto_gain(direct + ambient, SensorModel())),
        noise_pool(np.random.default_rng(0), direct.shape[1]),
        bench.settings.exposure_us / bench.rig.projector.period_us,
        np.empty(direct.shape, np.uint16),
        np.empty(direct.shape, np.float32),
    )


def without_tiles(planes: kernels.Planes) -> kernels.Planes:
    low, high = np.full_like(planes.tile_low, -np.inf), np.full_like(planes.tile_high, np.inf)
    return planes._replace(tile_low=low, tile_high=high)


def copy_of(image: NDArray[np.float32] | NDArray[np.uint16]) -> Callable[[], None]:
    target = np.empty_like(image)
    return lambda: np.copyto(target, image)


def test_hard_gate(ready: Ready, compare: Callable[..., None]) -> None:
    copy = copy_of(ready.linear.direct)
    compare("hard gate / copyto of the float32 image", ready.gate, copy, "1.5x")
    every = replace(ready, linear=without_tiles(ready.linear))
    compare("  the same, every pixel compared", every.gate, copy, "")
    windows, rows, direct = ready.windows, ready.linear.projector_row, ready.linear.direct
    low, high = windows.low.astype(np.float32)[:, None], windows.high.astype(np.float32)[:, None]

    def plain() -> NDArray[np.float32]:
        hit = (rows >= low) & (rows < high)
        weight = np.where(hit, windows.inside[:, None], windows.outside[:, None]).astype(np.float32)
        return weight * direct

    np.testing.assert_array_equal(plain(), (ready.gate(), ready.image)[1])
    compare("  straightforward numpy / hard gate", plain, ready.gate, "", rounds=20)


def test_noisy_frame(ready: Ready, compare: Callable[..., None]) -> None:
    compare("noisy 12-bit frame / copyto of the float32 image", ready.expose, copy_of(ready.image), "3x")
    compare("noisy 12-bit frame / copyto of the uint16 frame", ready.expose, copy_of(ready.frame), "3x")
    lit = replace(ready, edges=ready.edges._replace(inside=np.ones(1200, np.int32), outside=np.ones(1200, np.int32)))
    compare("  everything lit / copyto of the uint16 frame", lit.expose, copy_of(ready.frame), "")
    every = replace(ready)
    every.plates = Plates(ready.linear.projector_row, ready.linear.direct, ready.linear.ambient, ready.plates.sensor)
    every.plates.planes = without_tiles(every.plates.planes)
    compare("  every pixel compared / copyto of the uint16 frame", every.expose, copy_of(ready.frame), "")


def test_noisy_frame_against_numpy(ready: Ready, compare: Callable[..., None]) -> None:
    sensor, rng = ready.plates.sensor, np.random.default_rng(0)
    windows, rows = ready.windows, ready.linear.projector_row
    low, high = windows.low[:, None], windows.high[:, None]

    def signal() -> NDArray[np.float32]:
        hit = (rows >= low) & (rows < high)
        weight = np.where(hit, windows.inside[:, None], windows.outside[:, None])
        light = weight * ready.linear.direct + ready.periods * ready.linear.ambient
        return (light * sensor.counts_per_unit * sensor.electrons_per_count).astype(np.float32)

    def count(electrons: NDArray[np.floating]) -> NDArray[np.uint16]:
        counts = np.floor(electrons / sensor.electrons_per_count + sensor.black_count + 0.5)
        return np.clip(counts, 0, sensor.max_count).astype(np.uint16)

    def normal() -> NDArray[np.uint16]:
        mean = signal()
        return count(mean + np.sqrt(mean + sensor.read_noise_e**2) * rng.standard_normal(mean.shape, np.float32))

    def poisson() -> NDArray[np.uint16]:
        mean = signal()
        return count(rng.poisson(mean) + rng.normal(0, sensor.read_noise_e, mean.shape))

    ready.expose()
    assert ready.frame.mean() == pytest.approx(poisson().mean(), rel=0.01)
    compare("straightforward numpy, normal noise / noisy frame", normal, ready.expose, "40x", rounds=12)
    compare("straightforward numpy, Poisson noise / noisy frame", poisson, ready.expose, "40x", rounds=8)


def test_no_allocation_per_frame(ready: Ready, note: Callable[[str, str, str], None]) -> None:
    tracemalloc.start()
    for _ in range(500):
        ready.expose()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for _ in range(100):
        ready.expose()
    peak = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    note("memory allocated by 100 frames of 3840 kB", f"{peak / 1000:.1f} kB", "none of a frame's size")
    assert peak < 65536


def test_single_frame(ready: Ready, benchmark: Callable[..., object]) -> None:
    benchmark(ready.expose)
