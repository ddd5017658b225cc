"""The projector's window on a second virtual screen, filmed by a camera whose light transport is known in advance."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtGui import QGuiApplication
from pytestqt.qtbot import QtBot

import two_screens
from rigs import LADDER, plain_rig, shutter
from screen_camera import BLACK, ScreenCamera, turned_map
from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.transport.sliced import relit
from slopegate.drivers.stream.stream import Stream
from slopegate.drivers.transports.run import AcquireProgress, run_acquisition
from slopegate.drivers.transports.shots import shots_behind
from slopegate.drivers.transports.storage import create_transport, make_transport
from two_screens import PROJECTOR

HERE = str(Path(__file__))
RASTER = Raster(1280, 720)
SETTLE_FRAMES = 20
"""So many that a busy machine's screen has surely copied the pattern by then."""
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first test of this file")


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert "3 passed" in two_screens.run_inside(HERE)


@pytest.fixture
def projector(qapp: object, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScreenProjector]:
    monkeypatch.setattr("slopegate.app.devices.projector_window.DRAW_TIMEOUT_S", 60.0)
    window = ProjectorWindow()
    window.cover(next(screen for screen in QGuiApplication.screens() if screen.name() == PROJECTOR[0]))
    qtbot.waitUntil(window.isExposed)
    yield ScreenProjector(window, SETTLE_FRAMES)
    window.uncover()
    window.close()


@needs_two_screens
def test_a_frame_that_is_certain_sees_the_pattern_through_the_map(qtbot: QtBot, projector: ScreenProjector) -> None:
    sees, pictures = turned_map(RASTER), np.random.default_rng(8).integers(0, 256, (3, 720, 1280), dtype=np.uint8)
    frames: list[np.ndarray] = []

    def work() -> None:
        camera = ScreenCamera(sees)
        camera.start()
        projector.load(list(pictures))
        buffer = np.zeros((48, 64), np.uint16)
        for index in (2, 0, 1):
            showing, stamp = projector.show(index), None
            while stamp is None or not showing.certainly_in(stamp, 0.0):
                stamp = camera.read(buffer, 1.0)
            frames.append(buffer.copy())
        camera.close()

    thread = threading.Thread(target=work)
    thread.start()
    qtbot.waitUntil(lambda: not thread.is_alive(), timeout=100_000)
    assert len(frames) == 3
    for index, frame in zip((2, 0, 1), frames, strict=True):
        np.testing.assert_array_equal(frame, np.rint(BLACK + sees.counts(pictures[index] / 255)))
    assert np.ptp(frames[0].astype(int) - frames[1]) > 1000


@needs_two_screens
def test_the_transport_that_is_acquired_behind_a_running_stream_is_the_map(
    qtbot: QtBot, projector: ScreenProjector, tmp_path: Path
) -> None:
    sees, grid = turned_map(RASTER), BlockGrid(RASTER, 8, 5)
    camera = ScreenCamera(sees)
    rig = plain_rig(64, 48, 66.7, shutter(PixelClocks(996.67, LADDER)))
    manifest = make_transport("a screen", rig, camera.info, grid, "hadamard", [None], settle_frames=SETTLE_FRAMES)
    folder = create_transport(tmp_path / "screen", manifest)
    ended: list[AcquireProgress] = []

    def work() -> None:
        with Stream(camera) as stream, shots_behind(stream, camera.info) as shots:
            ended.append(run_acquisition(projector, shots, folder))

    thread = threading.Thread(target=work)
    thread.start()
    qtbot.waitUntil(lambda: not thread.is_alive(), timeout=250_000)
    assert [progress.state for progress in ended] == ["done"]
    transport, exact = folder.slice(0), sees.transport(grid)
    np.testing.assert_allclose(transport.total, exact.sum(axis=2), atol=1)
    lit = np.zeros(grid.count, np.float32)
    for block in range(grid.count):
        lit[:] = np.arange(grid.count) == block
        found = relit(transport, grid.spread(lit.reshape(grid.rows, grid.columns)))
        np.testing.assert_allclose(found, exact[..., block], atol=2)
    assert exact.max() > 1000


def test_the_maps_transport_lights_what_its_pictures_light() -> None:
    sees, grid = turned_map(RASTER), BlockGrid(RASTER, 8, 5)
    pattern = np.random.default_rng(9).random((5, 8))
    through = sees.transport(grid) @ pattern.ravel()
    np.testing.assert_allclose(through, sees.counts(grid.spread(pattern)), atol=1e-6)
    assert 0.5 < (through > 0).mean() < 1
