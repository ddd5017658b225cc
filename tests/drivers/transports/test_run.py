"""Acquisitions on the bench: what is relit is what the bench shows, to the byte however often it was interrupted."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.settings import gate
from slopegate.core.transport.plan import slice_frames
from slopegate.core.transport.sliced import relit
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.storage import claim
from slopegate.drivers.contract.camera import CameraGoneError
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.contract.projector import ProjectorError, Showing
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import AcquireProgress, AcquisitionError, Attendance, run_acquisition
from slopegate.drivers.transports.shots import CameraShots, Order
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


def arrays(folder: TransportFolder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.path.glob("*.npz"))}


class Counted:
    """True from the time on when it has been called so often."""

    def __init__(self, calls: int) -> None:
        self._left = calls

    def __call__(self) -> bool:
        self._left -= 1
        return self._left < 0


@pytest.mark.parametrize("codes", ["hadamard", "adaptive"])
def test_resumed_it_has_the_same_bytes_as_uninterrupted(tmp_path: Path, codes: CodeName) -> None:
    whole = Bench().folder(tmp_path / "whole", "8x8", codes)
    acquire(Bench(), whole)
    folder = Bench().folder(tmp_path / "resumed", "8x8", codes)
    for most in (20, 45, 90, 10_000):
        attendance = Attendance(given_up=Counted(most))
        ended = acquire(Bench(), folder, attendance=attendance)
        assert not list(folder.path.glob("raw_*"))
    assert ended.state == "done"
    assert arrays(folder) == arrays(whole)
    assert len(arrays(folder)) == 4


def test_noise_differs_from_slice_to_slice_and_pattern_to_pattern(tmp_path: Path) -> None:
    bench = Bench()
    lit = bench.slices(1)[0]
    folder = bench.folder(tmp_path / "t", slices=(lit, lit))
    acquire(bench, folder, keep_raw=True)
    first, second = (frames(folder, index, "codes") for index in (0, 1))
    assert (first != second).mean() > 0.9
    assert (first[3].astype(int) - first[2] != second[3].astype(int) - second[2]).mean() > 0.9


def frames(folder: TransportFolder, index: int, stage: str) -> np.ndarray:
    import zarr

    return np.asarray(zarr.open_group(str(folder.raw_path(index)), mode="r")[stage])


def test_frames_are_added_up_and_can_be_kept(tmp_path: Path) -> None:
    bench = Bench(noise=False)
    folder = bench.folder(tmp_path / "t", slices=bench.slices(1), frames=3)
    ended = acquire(bench, folder, keep_raw=True)
    sums = frames(folder, 0, "codes")
    assert sums.shape == (16, 60, 80)
    assert (sums % 3 == 0).all()
    record = folder.record(0)
    assert record is not None
    assert [(stage.name, stage.patterns, stage.frames) for stage in record.stages] == [
        ("even", 2, 96), ("check", 2, 6), ("codes", 16, 48),
    ]  # fmt: skip
    assert ended.frames == 96 + record.frames
    light = (sums[0] / 3 - bench.camera.sensor.black_count) / bench.camera.sensor.counts_per_unit
    np.testing.assert_allclose(folder.slice(0).total, light, atol=1e-3)


def test_sums_that_16_bits_cannot_hold_are_wider(tmp_path: Path) -> None:
    bench = Bench(noise=False)
    folder = bench.folder(tmp_path / "t", "4x2", slices=bench.slices(1), frames=20)
    acquire(bench, folder, keep_raw=True)
    assert frames(folder, 0, "codes").dtype == np.uint32
    assert decibels(folder.slice(0).total, folder.white(), folder.white().max()) > 60


def test_a_slice_without_light_is_noted_and_not_acquired(tmp_path: Path) -> None:
    bench = Bench()
    lit = bench.slices(1)[0]
    nothing = gate(lit.line_time_us, lit.delay_us + lit.exposure_us + 100, 50.0)
    folder = bench.folder(tmp_path / "t", slices=(nothing, lit))
    acquire(bench, folder)
    empty, full = folder.record(0), folder.record(1)
    assert empty is not None
    assert full is not None
    assert (empty.empty, empty.entries, [stage.name for stage in empty.stages]) == (True, 0, ["even"])
    assert not full.empty
    assert not folder.slice(0).total.any()


@pytest.mark.parametrize("codes", ["gray", "adaptive"])
def test_noise_in_dark_pixels_is_not_taken_for_light(tmp_path: Path, codes: CodeName) -> None:
    bench = Bench()
    slices = bench.slices(2)
    folder = bench.folder(tmp_path / "t", "16x16", codes, slices)
    assert acquire(bench, folder).remarks == ()
    for index, settings in enumerate(slices):
        found, dark = folder.slice(index), bench.truth(settings, None).ravel() == 0
        assert dark.sum() > 500
        assert np.diff(found.layers[0].starts)[dark].mean() < 1e-3


def test_progress_counts_down_to_nothing_left(tmp_path: Path) -> None:
    bench, told = Bench(), []
    folder = bench.folder(tmp_path / "t")
    ended = acquire(bench, folder, attendance=Attendance(told.append))
    left = [progress.frames_left for progress in told]
    assert left[-1] == ended.frames_left == 0
    assert all(a >= b for a, b in pairwise(left))
    assert [progress.frames for progress in told] == list(range(1, len(told) + 1))
    assert told[-1].frames == slice_frames("hadamard", folder.grid, 1) * 2 + 32
    assert "s left" in told[10].sentence
    assert ended.slices_done == 2


def test_a_pause_takes_no_frames(tmp_path: Path) -> None:
    bench, told, asked = Bench(), [], []

    def paused() -> bool:
        asked.append(1)
        return 5 < len(asked) < 9

    acquire(bench, bench.folder(tmp_path / "t"), attendance=Attendance(told.append, paused))
    states = [progress.state for progress in told]
    assert states[5:8] == ["paused"] * 3
    assert states.count("paused") == 3
    assert {progress.frames for progress in told[4:8]} == {5}


class Unplugged:
    """A projector that is pulled out after so many patterns."""

    def __init__(self, projector: VirtualProjector, after: int) -> None:
        self.info, self.load, self.stop = projector.info, projector.load, projector.stop
        self._projector, self._left = projector, after

    def show(self, index: int) -> Showing:
        self._left -= 1
        if self._left < 0:
            raise ProjectorError("The projector's screen has gone.")
        return self._projector.show(index)

    def black(self) -> Showing:
        return self._projector.black()

    def white(self) -> Showing:
        return self._projector.white()


class Faulty(CameraShots):
    """Frames of a camera that fails after so many, or whose pixels are changed."""

    def __init__(
        self, bench: Bench, after: int = 10**9, change: Callable[[np.ndarray], np.ndarray] = lambda image: image
    ) -> None:
        super().__init__(bench.camera, 0.0, bench.camera.number_frames_from)
        self._left, self._change = after, change

    def take(self, order: Order, buffer: np.ndarray, given_up: Callable[[], bool]) -> FrameStamp | None:
        self._left -= 1
        if self._left < 0:
            raise CameraGoneError("The camera was unplugged.")
        stamp = super().take(order, buffer, given_up)
        buffer[:] = self._change(buffer)
        return stamp


def test_what_is_unplugged_in_the_middle_loses_one_slice_and_goes_on_later(tmp_path: Path) -> None:
    whole = Bench().folder(tmp_path / "whole")
    acquire(Bench(), whole)
    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    with pytest.raises(ProjectorError, match="screen has gone"):
        run_acquisition(Unplugged(bench.projector, 25), bench.shots, folder)
    assert folder.missing() == [1]
    with pytest.raises(CameraGoneError, match="unplugged"):
        run_acquisition(bench.projector, Faulty(bench, 30), folder)
    assert folder.missing() == [1]
    acquire(bench, folder)
    assert arrays(folder) == arrays(whole)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot limit the size of files")
def test_a_full_disk_is_told_and_loses_no_finished_slice(tmp_path: Path) -> None:
    import resource

    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(told: AcquireProgress) -> None:
        if told.slices_done == 1:
            resource.setrlimit(resource.RLIMIT_FSIZE, (5000, unlimited[1]))

    try:
        with pytest.raises(StorageError, match="is full"):
            acquire(bench, folder, attendance=Attendance(fill))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert folder.missing() == [1]
    assert acquire(bench, folder).state == "done"


def test_a_camera_that_sees_no_light_is_told(tmp_path: Path) -> None:
    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    bench.camera.cover(True)
    with pytest.raises(AcquisitionError, match="sees no light of the projector"):
        acquire(bench, folder)


def test_a_saturated_camera_is_told(tmp_path: Path) -> None:
    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    with pytest.raises(AcquisitionError, match=r"\d+% of the pixels are saturated"):
        run_acquisition(bench.projector, Faulty(bench, change=lambda image: np.minimum(20 * image, 4095)), folder)


@pytest.mark.parametrize("codes", ["hadamard", "gray"])
def test_light_that_does_not_add_up_is_remarked(tmp_path: Path, codes: CodeName) -> None:
    def mixed(image: np.ndarray) -> np.ndarray:
        return cv2.blur(image, (15, 15))

    def bent(image: np.ndarray) -> np.ndarray:
        return 40 + 2000 * (np.maximum(mixed(image) - 40.0, 0) / 2000) ** 0.5

    bench = Bench(noise=False)
    for change, remarks in ((mixed, 0), (bent, 2)):
        folder = bench.folder(tmp_path / change.__name__, "8x8", codes)
        ended = run_acquisition(bench.projector, Faulty(bench, change=change), folder)
        assert len(ended.remarks) == remarks
    assert "the light does not add up" in ended.remarks[0]


def test_two_cannot_acquire_into_one_folder(tmp_path: Path) -> None:
    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    with claim(folder.path), pytest.raises(StorageError, match="another process is recording"):
        acquire(bench, folder)


def test_a_projector_of_another_size_cannot_go_on_with_it(tmp_path: Path) -> None:
    bench = Bench()
    folder = bench.folder(tmp_path / "t")
    other = Unplugged(bench.projector, 0)
    other.info = replace(bench.projector.info, raster=Raster(10, 10))
    with pytest.raises(StorageError, match="another scene, camera, projector or rig"):
        run_acquisition(other, bench.shots, folder)
