"""Acquisitions on the bench: what is relit is what the bench shows, to the byte however often it was interrupted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slopegate.core.transport.sliced import relit
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import AcquireProgress, run_acquisition
from slopegate.drivers.transports.storage import TransportFolder, open_transport
from small_transport import Bench


def acquire(bench: Bench, folder: TransportFolder, **options: object) -> AcquireProgress:
    return run_acquisition(bench.projector, bench.shots, folder, **options)  # type: ignore[arg-type]


def decibels(got: np.ndarray, truth: np.ndarray, peak: float) -> float:
    return float(10 * np.log10(peak**2 / max(np.mean((got - truth) ** 2), 1e-20)))


@pytest.mark.parametrize("grid", ["4x4", "8x8", "16x9"])
@pytest.mark.parametrize("codes", ["hadamard", "s", "impulse", "gray", "adaptive"])
def test_relit_slices_are_what_the_bench_shows(tmp_path: Path, codes: CodeName, grid: str) -> None:
    bench = Bench(noise=False)
    slices = bench.slices(2)
    folder = bench.folder(tmp_path / "t", grid, codes, slices)
    assert acquire(bench, folder).state == "done"
    found, white = open_transport(tmp_path / "t"), folder.white()
    assert white is not None
    assert found.complete
    draw = np.random.default_rng(1)
    for index, settings in enumerate(slices):
        pattern = bench.grid(grid).spread(draw.random((found.grid.rows, found.grid.columns), np.float32))
        truth = bench.truth(settings, pattern)
        assert decibels(relit(found.slice(index), pattern), truth, white.max()) > 60
    assert decibels(found.slice(0).total + found.slice(1).total, white, white.max()) > 60
    assert not folder.raw_path(0).exists()
