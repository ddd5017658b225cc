"""Depth and alarm on real streams of the virtual camera; depth maps on disk."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
import trimesh

from rigs import check_rig
from settings_inside import read_settings
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.measure.alarm import AlarmZone
from slopegate.core.measure.sweep import DepthMap, DepthSweep, SweepSettings, depth_error
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.files.depth_files import error_file, points_m, save_depth
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.stream.alarm_watch import AlarmWatcher
from slopegate.drivers.stream.depth_run import frames_behind, frames_of, run_sweep
from slopegate.drivers.stream.stream import Stream
from waiting import until

RIG = check_rig(160, ladder=tuple(map(float, range(10, 129, 2))))
SCENE = Scene(
    "ball and wall",
    objects=(plane("wall", (0.0, 0.0, 1.8), (4.0, 3.0), turn(20)), Sphere("ball", (0.1, 0.0, 1.0), 0.15)),
    ambient=0.05,
)


def camera(noise: bool = True, pixel_format: str = "mono12", rate_hz: float = math.inf) -> VirtualCamera:
    return VirtualCamera(RIG, SCENE, noise=noise, pixel_format=pixel_format, rate_hz=rate_hz)  # type: ignore[arg-type]


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("pixel_format", ["mono12", "bayer_rg12"])
def test_a_camera_of_its_own_is_swept_to_its_buffers_depth(noise: bool, pixel_format: str) -> None:
    seen = camera(noise, pixel_format)
    seen.start()
    found = run_sweep(frames_of(seen), DepthSweep(RIG, seen.info.black_count))
    assert found is not None
    assert seen.buffers is not None
    error = depth_error(found, seen.buffers.projector_row, seen.buffers.inverse_depth)
    assert error is not None
    assert error.known_share > 0.98
    assert error.wrong_share < 1e-3
    assert error.p95_mm < 20
    seen.close()


def test_behind_a_stream_the_same_and_the_gate_comes_back() -> None:
    alone = camera(noise=False)
    alone.start()
    expected = run_sweep(frames_of(alone), DepthSweep(RIG, alone.info.black_count))
    assert expected is not None
    alone.close()
    own = gate(78.0, 1000.0, 500.0)
    told: list[float] = []
    with Stream(camera(noise=False)) as stream:
        stream.submit(own)
        with frames_behind(stream) as take:
            sweep = DepthSweep(RIG, 40.0)
            found = run_sweep(take, sweep, told=lambda now: told.append(now.share_done))
            with pytest.raises(ValueError, match="tap"), frames_behind(stream) as other:
                other(own)
        assert found is not None
        np.testing.assert_array_equal(found.projector_row, expected.projector_row)
        assert found.frames == expected.frames == len(told)
        until(lambda: (newest := stream.newest()) is not None and newest.stamp.asked == own)


def test_averaged_frames_see_into_the_dark() -> None:
    dim = Scene(
        "dim",
        objects=(
            plane(
                "wall",
                (0.0, 0.0, 1.8),
                (4.0, 3.0),
                turn(),
            ),
        ),
        ambient=0.0,
    )
    shares = []
    for repeats in (1, 8):
        seen = VirtualCamera(RIG, dim, SensorModel(counts_per_unit=180.0), rate_hz=math.inf)
        seen.start()
        found = run_sweep(frames_of(seen), DepthSweep(RIG, 40.0, SweepSettings(repeats=repeats)))
        assert found is not None
        shares.append(float(found.known.mean()))
        seen.close()
    assert shares[1] > shares[0]


def test_a_sweep_given_up_returns_nothing_and_lets_the_stream_go() -> None:
    with Stream(camera()) as stream:
        with frames_behind(stream, lambda: True) as take:
            assert run_sweep(take, DepthSweep(RIG, 40.0)) is None
        assert stream.tapped is None


def test_a_camera_without_such_a_frame_fails_with_a_sentence() -> None:
    class Stubborn(VirtualCamera):
        def configure(self, settings: GateSettings) -> GateSettings:
            super().configure(settings)
            return gate(1.0, 2.0, 3.0)

    seen = Stubborn(RIG, SCENE, rate_hz=math.inf)
    seen.start()
    ticks = iter(range(1000))
    with pytest.raises(CameraError, match="within 20 seconds"):
        run_sweep(frames_of(seen, lambda: float(next(ticks))), DepthSweep(RIG, 40.0))
    seen.close()


def test_the_alarm_judges_its_own_gate_and_keeps_the_frame_that_set_it_off() -> None:
    stream, watched = Stream(camera()), gate(78.0, 8333.0, 16_666.0)
    alarm = AlarmWatcher(AlarmZone(0, 0, 160, 120, 400.0, 0.02), watched)
    stream.submit(gate(78.0, 14_000.0, 200.0))
    stream.watch(alarm)
    with stream:
        until(lambda: alarm.held == "gate")
        assert alarm.alarm.frames == 0
        stream.submit(watched)
        until(lambda: alarm.alarm.trips > 0)
        (trip, caught), *_ = alarm.take()
        assert caught.stamp.sequence == trip.sequence
        assert np.count_nonzero(caught.image > 400) / caught.image.size == trip.share
        assert caught.stamp.settled
    assert "stopped" in alarm.failure


def some_map() -> DepthMap:
    inverse = np.zeros((120, 160), np.float32)
    inverse[10:60, 20:100] = np.linspace(0.4, 2.0, 80, dtype=np.float32)
    rows = np.where(inverse > 0, 100 * inverse, -1).astype(np.float32)
    disparity = np.where(inverse > 0, 100 * inverse, np.nan).astype(np.float32)
    return DepthMap(rows, inverse, disparity, 30, 338, 1.0, 100 * inverse, np.zeros_like(inverse))


def test_every_format_is_read_back(tmp_path: Path) -> None:
    found = some_map()
    for suffix in (".npy", ".tif", ".exr", ".png", ".ply"):
        save_depth(tmp_path / f"depth{suffix}", RIG, found, {"frames": 30})
    np.testing.assert_array_equal(np.load(tmp_path / "depth.npy"), found.depth_m)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "depth.tif"), found.depth_m)
    millimetres = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert millimetres.dtype == np.uint16
    np.testing.assert_allclose(millimetres[found.known], 1000 * found.depth_m[found.known], atol=0.51)
    assert np.all(millimetres[~found.known] == 0)
    for suffix in (".tif", ".exr", ".png"):
        assert read_settings(tmp_path / f"depth{suffix}") == {"frames": 30}
    cloud = trimesh.load(tmp_path / "depth.ply")
    np.testing.assert_allclose(cloud.vertices, points_m(RIG, found), atol=1e-6)
    assert not list(tmp_path.glob(".*"))


def test_standard_errors_are_kept_with_the_depths(tmp_path: Path) -> None:
    found = some_map()
    errors = np.where(found.known, 0.001 * found.depth_m**2, np.nan).astype(np.float32)
    for suffix in (".npy", ".tif", ".exr", ".png", ".ply"):
        save_depth(tmp_path / f"depth{suffix}", RIG, found, {"frames": 30}, errors_m=errors)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        *(f"depth{suffix}" for suffix in (".npy", ".tif", ".exr", ".png", ".ply")),
        *("depth_error.npy", "depth_error.tif", "depth_error.exr"),
    }
    np.testing.assert_array_equal(np.load(tmp_path / "depth_error.npy"), errors)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "depth_error.tif"), errors)
    assert read_settings(tmp_path / "depth_error.tif") == {"frames": 30}
    assert error_file(tmp_path / "far.png") == tmp_path / "far_error.tif", "whole millimetres would tell nothing"
    data = (tmp_path / "depth.ply").read_bytes()
    head, _, points = data.partition(b"end_header\n")
    assert b"property float standard_error\n" in head
    kind = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("r", "u1"), ("g", "u1"), ("b", "u1"), ("error", "<f4")]
    np.testing.assert_array_equal(np.frombuffer(points, kind)["error"], errors[found.known])
    np.testing.assert_allclose(trimesh.load(tmp_path / "depth.ply").vertices, points_m(RIG, found), atol=1e-6)


def test_points_are_where_the_camera_sees_them() -> None:
    found = some_map()
    points = points_m(RIG, found)
    column, row, depth = RIG.to_camera(points)
    rows, columns = np.nonzero(found.known)
    np.testing.assert_allclose(column, columns + 0.5, atol=1e-3)
    np.testing.assert_allclose(row, rows + 0.5, atol=1e-3)
    np.testing.assert_allclose(depth, found.depth_m[found.known], rtol=1e-5)


def test_the_grey_of_the_points_is_the_images(tmp_path: Path) -> None:
    found = some_map()
    counts = np.zeros((120, 160), np.uint16)
    counts[10:60, 20:60], counts[10:60, 60:100] = 100, 4000
    save_depth(tmp_path / "p.ply", RIG, found, {}, counts)
    grey = trimesh.load(tmp_path / "p.ply").visual.vertex_colors[:, 0]
    assert grey.min() < 70
    assert grey.max() == 255


def test_refusals_name_the_file(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"depth\.jpg"):
        save_depth(tmp_path / "depth.jpg", RIG, some_map(), {})
    with pytest.raises(StorageError, match="nowhere"):
        save_depth(tmp_path / "nowhere" / "depth.ply", RIG, some_map(), {})
