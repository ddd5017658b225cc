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
from screen_camera import BLACK, ScreenCamera, turned_map
from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from two_screens import PROJECTOR

HERE = str(Path(__file__))
RASTER = Raster(1280, 720)
SETTLE_FRAMES = 20
"""So many that a busy machine's screen has surely copied the pattern by then."""
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first test of this file")


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert "2 passed" in two_screens.run_inside(HERE)


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


def test_the_maps_transport_lights_what_its_pictures_light() -> None:
    sees, grid = turned_map(RASTER), BlockGrid(RASTER, 8, 5)
    pattern = np.random.default_rng(9).random((5, 8))
    through = sees.transport(grid) @ pattern.ravel()
    np.testing.assert_allclose(through, sees.counts(grid.spread(pattern)), atol=1e-6)
    assert 0.5 < (through > 0).mean() < 1
