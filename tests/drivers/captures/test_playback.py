"""A capture played back goes the way of live frames, and recording it again gives the same capture."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from slopegate.core.render.render import Cancelled
from slopegate.core.rig.settings import gate
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.captures.storage import CaptureFolder, create_capture, make_manifest, open_capture
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.stream.stream import Stream
from small_capture import COUNT, RIG, camera, record
from waiting import next_frame

from .test_storage import manifest


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> CaptureFolder:
    return record(tmp_path_factory.mktemp("playback") / "c", noise=True, frames=1, dark=True)[0]


def test_recorded_again_through_the_stream_it_is_the_same_capture(capture: CaptureFolder, tmp_path: Path) -> None:
    player = PlaybackCamera(capture, rate_hz=math.inf)
    asked = [item.asked.settings() for item in capture.records().values()]
    again = create_capture(tmp_path / "c", make_manifest("again", RIG, player.info, asked, 1, False, False))
    stream = Stream(player)
    recorder = Recorder(stream, again)
    recorder.start()
    with stream:
        assert recorder.wait(240)
    assert recorder.progress.state == "done", recorder.progress.doing
    for index in range(COUNT):
        np.testing.assert_array_equal(again.total(index), capture.total(index))


def test_only_a_capture_that_is_played_without_a_pace_makes_frames_on_demand(capture: CaptureFolder) -> None:
    assert PlaybackCamera(capture, rate_hz=math.inf).info.modes.on_demand
    assert not PlaybackCamera(capture, rate_hz=20.0).info.modes.on_demand


def test_the_nearest_gate_is_shown_with_what_was_applied(capture: CaptureFolder) -> None:
    records = capture.records()
    with Stream(PlaybackCamera(capture, rate_hz=math.inf)) as stream:
        for index in (3, 0, 5):
            applied = records[index].applied.settings()
            near = gate(applied.line_time_us + 0.5, applied.delay_us + 40.0, applied.exposure_us)
            stream.submit(near)
            frame = next_frame(stream)
            while frame.stamp.asked != near:
                frame = next_frame(stream)
            assert frame.stamp.applied == applied
            np.testing.assert_array_equal(frame.image, capture.total(index))


def test_the_first_frame_of_another_slice_is_flagged(capture: CaptureFolder) -> None:
    player = PlaybackCamera(capture, rate_hz=math.inf)
    player.start()
    image = np.zeros((60, 80), np.uint16)

    def settled() -> bool:
        stamp = player.read(image, 1.0)
        assert stamp is not None
        return stamp.settled

    assert settled()
    player.configure(player.settings[4])
    assert [settled(), settled()] == [False, True]
    player.configure(player.settings[4])
    assert settled()


def test_it_keeps_its_rate_by_the_clock(capture: CaptureFolder) -> None:
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    player = PlaybackCamera(capture, rate_hz=10.0, clock=lambda: now[0], sleep=sleep)
    player.start()
    image = np.zeros((60, 80), np.uint16)
    times = []
    for _ in range(5):
        stamp = player.read(image, 1.0)
        assert stamp is not None
        times.append(stamp.time_s)
    np.testing.assert_allclose(np.diff(times), 0.1)
    assert player.read(image, 0.03) is None
    assert now[0] == pytest.approx(0.43)


def test_stop_wakes_a_waiting_read(capture: CaptureFolder) -> None:
    player = PlaybackCamera(capture, rate_hz=0.001)
    player.start()
    image = np.zeros((60, 80), np.uint16)
    assert player.read(image, 1.0) is not None
    threading.Timer(0.05, player.stop).start()
    begun = time.monotonic()
    assert player.read(image, 200.0) is None
    assert time.monotonic() - begun < 100
    assert player.read(image, 0.0) is None


def test_depth_and_light_of_the_whole_capture(capture: CaptureFolder) -> None:
    player = PlaybackCamera(capture)
    assert player.buffers is None
    player.prepare(lambda _: True)
    truth = camera().buffers
    assert truth is not None
    found = player.buffers
    assert found is not None
    assert player.summary is not None
    lit = (truth.projector_row >= 0) & (truth.direct[:, :, 0] > 0.05)
    known = found.projector_row >= 0
    assert (known & lit).sum() > 0.98 * lit.sum()
    assert (known & (truth.projector_row < 0)).mean() < 0.01
    half_slice = capture.records()[0].applied.exposure_us / 2 * RIG.projector.rows_per_us / 100
    error = np.abs(found.inverse_depth - truth.inverse_depth)[lit & known]
    assert np.percentile(error, 98) < half_slice + 0.01
    assert (found.direct[~known] == 0).all()
    assert player.summary.overlay.shape == (60, 80, 3)
    with pytest.raises(Cancelled):
        PlaybackCamera(capture).prepare(lambda _: False)


def test_faults_are_sentences(capture: CaptureFolder, tmp_path: Path) -> None:
    empty = create_capture(tmp_path / "c", manifest())
    with pytest.raises(StorageError, match="has no slice yet: there is nothing to play"):
        PlaybackCamera(empty)
    with pytest.raises(ValueError, match="rate_hz is 0"):
        PlaybackCamera(capture, rate_hz=0.0)
    player = PlaybackCamera(open_capture(capture.path), rate_hz=math.inf)
    player.start()
    with pytest.raises(ValueError, match="buffer"):
        player.read(np.zeros((4, 4), np.uint16), 1.0)


def test_a_slice_that_has_gone_is_a_camera_error(tmp_path: Path) -> None:
    folder, _ = record(tmp_path / "c")
    player = PlaybackCamera(folder, rate_hz=math.inf)
    for path in folder.path.glob("slice_*"):
        path.unlink()
    player.start()
    with pytest.raises(CameraError, match="has no slice"):
        player.read(np.zeros((60, 80), np.uint16), 1.0)
