from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.film import create_film, make_film_manifest
from slopegate.drivers.captures.film_recorder import FilmRecorder
from slopegate.drivers.stream.stream import Stream

SECONDS = 4.0
Note = Callable[[str, str, str], None]


@pytest.fixture
def stream(bench: SimpleNamespace, request: pytest.FixtureRequest) -> Stream:
    camera = VirtualCamera(bench.rig, bench.scene, rate_hz=request.param)
    camera.prepare(lambda share: True)
    camera.configure(bench.settings)
    return Stream(camera)


def watch(stream: Stream, seconds: float) -> tuple[float, float]:
    """Pull frames like the window does, scale each to a view, and return frames made and shown a second."""
    view = np.empty((750, 1000), np.uint16)
    start_s, before, shown = time.perf_counter(), stream.counters, 0
    while time.perf_counter() - start_s < seconds:
        frame = stream.newest()
        if frame is None:
            time.sleep(0.002)
        else:
            cv2.resize(frame.image, (1000, 750), dst=view, interpolation=cv2.INTER_LINEAR)
            shown += 1
    lasted_s, after = time.perf_counter() - start_s, stream.counters
    return (after.made - before.made) / lasted_s, shown / lasted_s


@pytest.mark.parametrize("stream", [60.0, math.inf], indirect=True, ids=["60 Hz", "free-running"])
def test_stream(stream: Stream, note: Note, request: pytest.FixtureRequest) -> None:
    with stream:
        watch(stream, 0.3)
        made, shown = watch(stream, SECONDS)
        assert stream.error is None
    name = request.node.callspec.id
    note(f"stream at 1600x1200, {name}: made and scaled to a view", f"{made:.1f} and {shown:.1f} a second", "60")
    assert threading.active_count() < 10


@pytest.mark.parametrize("stream", [60.0, 20.0], indirect=True, ids=["60 Hz", "20 Hz"])
def test_settings_to_frame(stream: Stream, bench: SimpleNamespace, note: Note, request: pytest.FixtureRequest) -> None:
    delays_s: list[float] = []
    rng = np.random.default_rng(0)
    with stream:
        for index in range(60):
            time.sleep(rng.uniform(0, 0.05))
            wanted = replace(bench.settings, exposure_us=1000.0 + index)
            start_s = time.perf_counter()
            stream.submit(wanted)
            while (frame := stream.newest()) is None or frame.stamp.asked != wanted:
                time.sleep(0.0005)
            delays_s.append(time.perf_counter() - start_s)
    middle, late = np.percentile(np.array(delays_s) * 1e3, (50, 95))
    name = request.node.callspec.id
    note(
        f"settings submitted to frame in hand, camera at {name}",
        f"{middle:.0f} ms, 95 %: {late:.0f} ms",
        "33 ms with paint",
    )


@pytest.mark.parametrize("stream", [60.0, math.inf], indirect=True, ids=["60 Hz", "free-running"])
def test_recording(
    stream: Stream, bench: SimpleNamespace, note: Note, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Frames that reach the disk while the window is served; what is lost is counted, and memory stays."""
    info = stream._camera.info
    made = create_film(tmp_path / "film", make_film_manifest("bench", bench.rig, info, bench.settings))
    recorder = FilmRecorder(stream, made)
    stream.submit(bench.settings)
    recorder.start()
    grown = []
    with stream:
        watch(stream, 1.0)
        before, start_s = recorder.progress, time.perf_counter()
        for _ in range(4):
            watch(stream, SECONDS / 4)
            grown.append(_resident_mb())
        after, lasted_s = recorder.progress, time.perf_counter() - start_s
        recorder.hurry()
        assert recorder.wait(60)
    kept, lost = after.frames - before.frames, after.lost_by_disk - before.lost_by_disk
    name = request.node.callspec.id
    wrote_mb = (after.bytes - before.bytes) / 1e6
    value = f"{kept / lasted_s:.1f} a second, {wrote_mb / lasted_s:.0f} MB/s, {lost} lost"
    note(f"recording at 1600x1200, {name}, {grown[-1] - grown[0]:+.0f} MB over {kept} frames", value, "60, none lost")


def _resident_mb() -> float:
    """Memory of this process in use."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
