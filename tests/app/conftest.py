"""Windows of every test: small and quick to render, closed afterwards, with no thread or widget left behind."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, SignalInstance
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from pytestqt.wait_signal import SignalBlocker
from slopegate.app.loading import Progress
from slopegate.app.source import Options, Source, build_source
from slopegate.app.window import Window
from slopegate.core.rig import Camera, Lens, Projector, Rig, ideal_rig
from slopegate.core.scene import Preset, Scene
from slopegate.core.settings import LineTimes, PixelClocks, ShutterLimits, Steps, gate
from slopegate.core.shapes import plane, turn

LADDER = (*map(float, range(10, 50)), *map(float, range(50, 100, 2)), *map(float, range(100, 129, 4)))


PATIENCE_S = 30.0
"""Longest wait for what must come: a test that passes waits no longer than it takes, on a busy machine too."""


class PatientBot(QtBot):
    """Waits longer than the five seconds of `QtBot`."""

    def waitUntil(self, callback: Callable[[], bool | None], *, timeout: int = round(1000 * PATIENCE_S)) -> None:
        super().waitUntil(callback, timeout=timeout)

    def waitSignal(
        self, signal: SignalInstance, *, timeout: int = round(1000 * PATIENCE_S), **more: object
    ) -> SignalBlocker:
        return super().waitSignal(signal, timeout=timeout, **more)


@pytest.fixture
def qtbot(qapp: QApplication, request: pytest.FixtureRequest) -> QtBot:
    return PatientBot(request)


@pytest.fixture(autouse=True)
def _nothing_left_behind(qapp: QApplication) -> Iterator[None]:
    """A test fails that leaves a widget or a thread."""
    before = set(threading.enumerate())
    yield
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    gc.collect()
    end = time.monotonic() + PATIENCE_S
    while (left := set(threading.enumerate()) - before) and time.monotonic() < end:
        time.sleep(0.01)
    assert not left, f"threads left: {[thread.name for thread in left]}"
    shown = [widget for widget in QApplication.topLevelWidgets() if widget.isVisible()]
    for widget in shown:
        widget.close()
    assert not shown, f"widgets left open: {shown}"


def small_rig(lines: PixelClocks | LineTimes | None = None) -> Rig:
    """The check rig with a sensor of 320 x 240 pixels five times as large."""
    projector = Projector(Lens(1280, 720, 1000.0, 1000.0, 640.0, 360.0), 1e6 / 60, 0.92)
    focal = 1000.0 / 3
    clocks = 78 / (projector.rows_per_us * focal / 1000.0)
    limits = ShutterLimits(
        lines or PixelClocks(clocks, LADDER), Steps(-16667.0, 33334.0, 1.0), Steps(100.0, 50000.0, 1.0)
    )
    return ideal_rig(Camera(Lens(320, 240, focal, focal, 160.0, 120.0), limits), projector, 0.10, "small")


def small_scene(rig: Rig) -> Scene:
    """A wall at 2 m and a card at 1 m before its middle, with gates that light one or both."""
    level = rig.camera.shutter.line.nearest(rig.projector.lens.fy / (rig.projector.rows_per_us * rig.camera.lens.fy))
    from slopegate.core.plan import plan

    wall = plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn())
    card = plane("card", (0.0, 0.0, 1.0), (0.4, 0.3), turn())
    near, far = (plan(rig, 0.0, z, 0.2, level) for z in (1.0, 2.0))
    gates = (
        Preset("The card", gate(level, round(near.delay_us), round(near.exposure_us))),
        Preset("The wall", gate(level, round(far.delay_us), round(far.exposure_us))),
    )
    return Scene("A card before a wall", objects=(wall, card), gates=gates)


@pytest.fixture
def rig() -> Rig:
    return small_rig()


def make_source(rig: Rig, options: Options | None = None) -> Source:
    """The small scene, rendered."""
    quick = options or Options(noise=False, rate_hz=None)
    return build_source(Path("card.toml"), rig, small_scene(rig), quick, Progress(lambda share, text: None))


@pytest.fixture
def source(rig: Rig) -> Iterator[Source]:
    made = make_source(rig)
    yield made
    made.close()


@pytest.fixture
def window(qtbot: QtBot, rig: Rig, tmp_path: Path) -> Iterator[Window]:
    """The real window on the small scene, its first image on the screen."""
    made = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(made)
    made.resize(1280, 800)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitActive(made):
        made.activateWindow()
    with qtbot.waitSignal(made.ready):
        made.session.adopt(make_source(rig))
    yield made
    made.close()
