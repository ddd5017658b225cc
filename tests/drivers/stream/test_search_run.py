"""A search on a stream: settled frames only, the gate given back, an end whatever happens."""

from __future__ import annotations

import logging
import math
import threading
import time

import numpy as np
import pytest
from numpy.typing import NDArray

from search_card import SearchCard, search_card
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.search.search import begin
from slopegate.core.search.state import State
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.stream import stream as stream_module
from slopegate.drivers.stream.search_run import run_on_camera, run_search
from slopegate.drivers.stream.stream import Stream


@pytest.fixture(scope="module")
def card() -> SearchCard:
    return search_card(20.0, 0.9)


def test_a_camera_of_ones_own_repeats_to_the_last_frame(card: SearchCard) -> None:
    ends = []
    for seed in (3, 3, 4):
        camera = Unsettled(card.rig, card.scene, rate_hz=math.inf, seed=seed)
        camera.start()
        ends.append(run_on_camera(camera, begin(card.rig, card.target, black_count=40.0, max_frames=9)))
        camera.close()
    assert ends[0].outcome == ends[1].outcome
    assert ends[0].history == ends[1].history
    assert ends[0].history != ends[2].history
    assert len(ends[0].history) == 9


def test_a_camera_without_settled_frames_is_given_up(card: SearchCard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopegate.drivers.stream.search_run.TIMEOUT_S", 2.0)
    camera = Silent(card.rig, card.scene, rate_hz=math.inf)
    with pytest.raises(CameraError, match="No frame"):
        run_on_camera(camera, begin(card.rig, card.target))
    with Stream(camera) as stream, pytest.raises(CameraError, match="No frame"):
        run_search(stream, "mono12", begin(card.rig, card.target))


BEFORE = gate(39.0, 1000.0, 500.0)


class Unsettled(VirtualCamera):
    """Frames that have not settled are lies: bright where they should be dark."""

    lies = 0

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        stamp = super().read(buffer, timeout_s)
        if stamp is not None and not stamp.settled:
            buffer[:] = 4095 - buffer
            self.lies += 1
        return stamp


class Silent(VirtualCamera):
    """Makes no frame."""

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        return None


class Breaking(VirtualCamera):
    """Fails for good after some frames."""

    frames = 0

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        self.frames += 1
        if self.frames > 9:
            raise RuntimeError("the cable is off")
        return super().read(buffer, timeout_s)


def settled_frame(stream: Stream, wanted: GateSettings) -> FrameStamp:
    """Wait for a frame made with the gate wanted."""
    end = time.monotonic() + 100
    while time.monotonic() < end:
        frame = stream.newest()
        if frame is not None and frame.stamp.asked == wanted:
            return frame.stamp
        time.sleep(0.002)
    raise AssertionError("no frame with the gate from before")


@pytest.mark.parametrize("pixel_format", ["mono12", "bayer_rg12"])
def test_found_through_a_stream_whose_unsettled_frames_are_lies(card: SearchCard, pixel_format: str) -> None:
    camera = Unsettled(card.rig, card.scene, rate_hz=math.inf, pixel_format=pixel_format)  # type: ignore[arg-type]
    seen: list[State] = []
    with Stream(camera) as stream:
        stream.submit(BEFORE)
        start = begin(card.rig, card.target, black_count=camera.info.black_count)
        state = run_search(stream, camera.info.pixel_format, start, seen.append)
        settled_frame(stream, BEFORE)
    assert state.outcome is not None
    assert state.outcome.settings is not None
    assert card.overlap(state.outcome.settings) > 0.9
    assert [step.frames for step in seen] == list(range(1, state.frames + 1))
    assert camera.lies >= 10


def test_cancelling_gives_the_gate_back(card: SearchCard) -> None:
    camera = VirtualCamera(card.rig, card.scene, rate_hz=math.inf)
    stop = threading.Event()

    def watch(state: State) -> None:
        if state.frames == 5:
            stop.set()

    with Stream(camera) as stream:
        stream.submit(BEFORE)
        start = begin(card.rig, card.target, black_count=40.0)
        state = run_search(stream, "mono12", start, watch, stop.is_set)
        assert settled_frame(stream, BEFORE).asked == BEFORE
        assert state.outcome is not None
        assert (state.outcome.cause, state.outcome.frames) == ("cancelled", 5)
        # and another search may begin at once
        again = run_search(stream, "mono12", begin(card.rig, card.target, black_count=40.0, max_frames=2))
    assert again.outcome is not None
    assert again.outcome.cause == "frames used up"


def test_a_search_that_finds_nothing_gives_the_gate_back(card: SearchCard) -> None:
    camera = VirtualCamera(card.rig, card.scene, rate_hz=math.inf)
    with Stream(camera) as stream:
        stream.submit(BEFORE)
        state = run_search(stream, "mono12", begin(card.rig, (0, 440, 20, 460), black_count=40.0))
        settled_frame(stream, BEFORE)
    assert state.outcome is not None
    assert not state.outcome.found


def test_a_camera_that_fails_ends_the_search_with_a_sentence(
    card: SearchCard, monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.0,) * 5)
    camera = Breaking(card.rig, card.scene, rate_hz=math.inf)
    with Stream(camera) as stream, pytest.raises(CameraError, match="card failed inside the program"):
        run_search(stream, "mono12", begin(card.rig, card.target, black_count=40.0))
    bugs.clear()


def test_only_one_may_hold_the_gate(card: SearchCard) -> None:
    camera = VirtualCamera(card.rig, card.scene, rate_hz=math.inf)
    with Stream(camera) as stream:
        stop, started = threading.Event(), threading.Event()

        def watch(state: State) -> None:
            started.set()
            stop.wait(100)

        start = begin(card.rig, card.target, black_count=40.0)
        first = threading.Thread(target=run_search, args=(stream, "mono12", start, watch, stop.is_set))
        first.start()
        assert started.wait(100)
        with pytest.raises(ValueError, match="only one"):
            run_search(stream, "mono12", start)
        stop.set()
        first.join(100)
        assert not first.is_alive()
