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

from slopegate.app.session.source import Source
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import make_source, small_rig

PATIENCE_S = 60.0
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


def _threads() -> set[threading.Thread]:
    """All but those in which zarr waits for files: it starts them once, for good."""
    return {thread for thread in threading.enumerate() if not thread.name.startswith(("zarr_io", "asyncio_"))}


@pytest.fixture(autouse=True)
def _nothing_left_behind(qapp: QApplication) -> Iterator[None]:
    """A test fails that leaves a widget or a thread."""
    before = _threads()
    yield
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    gc.collect()
    end = time.monotonic() + PATIENCE_S
    while (left := _threads() - before) and time.monotonic() < end:
        time.sleep(0.01)
    assert not left, f"threads left: {[thread.name for thread in left]}"
    shown = [widget for widget in QApplication.topLevelWidgets() if widget.isVisible()]
    for widget in shown:
        widget.close()
    assert not shown, f"widgets left open: {shown}"


@pytest.fixture
def rig() -> Rig:
    return small_rig()


@pytest.fixture
def source(rig: Rig) -> Iterator[Source]:
    made = make_source(rig)
    yield made
    made.close()


@pytest.fixture
def window(qtbot: QtBot, rig: Rig, tmp_path: Path) -> Iterator[Window]:
    """The real window on the small scene, its first image on the screen."""
    made = Window(rig, tmp_path / "config" / "window.json")
    # pytest-qt closes it before the line after the yield: nobody is there to answer whether a sweep may be ended
    qtbot.addWidget(made, before_close_func=Window.close_unasked)
    made.resize(1280, 800)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitActive(made):
        made.activateWindow()
    with qtbot.waitSignal(made.ready):
        made.session.adopt(make_source(rig))
    yield made
    made.close_unasked()
