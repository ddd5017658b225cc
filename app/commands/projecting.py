"""Patterns on a screen for a command: a window covers the projector's screen while the work goes on beside it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from PySide6.QtCore import QTimer
from PySide6.QtGui import QGuiApplication, QScreen
from PySide6.QtWidgets import QApplication

from slopegate.app.commands.report import CommandError, print_warnings
from slopegate.app.commands.window import has_display
from slopegate.app.devices.projector_screens import facts, objections
from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector
from slopegate.core.rig.rig import Rig
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.files.workers import Worker

LISTEN_MS = 200

Made = TypeVar("Made")


def project(
    screen: str | None, settle_frames: int, rig: Rig, work: Callable[[Projector, Callable[[], bool]], Made]
) -> Made:
    """Cover the screen of this name and do `work` in a thread of its own; what it returns, or raises.

    `work` gets the projector, and a function that says whether it was interrupted (Ctrl+C) and shall end. To be called
    in the main thread, which draws. Raises CommandError without a display or such a screen.
    """
    if not has_display():
        raise CommandError("there is no display to show patterns on: start it on the desktop that has the projector")
    application = QApplication.instance() or QApplication(sys.argv[:1])
    chosen = _screen(screen)
    others = [facts(other) for other in QGuiApplication.screens() if other is not chosen]
    print_warnings(objections(facts(chosen), others, rig.projector))
    window = ProjectorWindow()
    window.cover(chosen)
    projector = ScreenProjector(window, settle_frames)
    stopped = threading.Event()
    made: list[Made] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            made.append(work(projector, stopped.is_set))
        except BaseException as error:
            failed.append(error)

    with _interrupts(stopped.set):
        worker = Worker(run, "acquisition")
        worker.start()
        _draw_while(application, worker)
        worker.wait()
    window.close()
    if failed:
        raise failed[0]
    if stopped.is_set():
        raise KeyboardInterrupt
    return made[0]


def _screen(name: str | None) -> QScreen:
    screens = {screen.name(): screen for screen in QGuiApplication.screens()}
    there = "; ".join(str(facts(screen)) for screen in screens.values())
    if name is None:
        raise CommandError(f"patterns need a screen: give --screen with the name of one of these: {there}")
    if name not in screens:
        raise CommandError(f"--screen is {name!r}: it must be the name of one of these: {there}")
    return screens[name]


def _draw_while(application: object, worker: Worker) -> None:
    """Qt's events, until the work has ended; the timer also lets Python hear of Ctrl+C."""
    assert isinstance(application, QApplication)
    timer = QTimer()
    timer.timeout.connect(lambda: None if worker.running else application.quit())
    timer.start(LISTEN_MS)
    application.exec()
    timer.stop()


@contextmanager
def _interrupts(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl+C ends the work at its next pattern, so that what was taken is kept."""
    before = signal.signal(signal.SIGINT, lambda *_: stop())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
