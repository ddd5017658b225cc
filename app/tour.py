"""`slopegate demo`: the window shows what it can do by itself, and pictures of it stay behind."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QEventLoop, QTimer
from PySide6.QtWidgets import QApplication
from slopegate.app.commands.report import CommandError
from slopegate.app.search_panel import SearchPanel
from slopegate.app.window import Window
from slopegate.core.rig import Rig
from slopegate.drivers.scene_files import shipped_scenes

SIZES = ((1280, 800), (1920, 1080))
THEMES = ("light", "dark")
PATIENCE_S = 60.0
LOOK_MS = 700
"""How long a step stays in view: for the rates in the status line to settle, and for people watching."""


class Tour:
    """Drives one window; every step waits until what it asked for is on the screen."""

    def __init__(self, window: Window, folder: Path) -> None:
        self._window, self._folder = window, folder
        self._problem = ""
        self.files: list[Path] = []
        for said in (window.opener.failed, window.saver.failed):
            said.connect(self._note)

    def run(self) -> None:
        """All of it. Raises CommandError where a step does not come to its end."""
        window = self._window
        window.show()
        window.open_first(None)
        self._until(lambda: window.plots.slab is not None, "the first image")
        for theme in THEMES:
            window.set_theme(theme)
            for width, height in SIZES:
                window.resize(width, height)
                self._picture(f"window-{theme}-{width}x{height}")
        window.resize(*SIZES[0])
        window.plots.tabs.setCurrentIndex(1)
        self._picture("window-timing")
        window.plots.tabs.setCurrentIndex(0)
        scenes = shipped_scenes()
        for scene in scenes:
            self._show_scene(scene.key, scene.path)
        self._search(scenes[0].path)

    def _search(self, path: Path) -> None:
        self._open(path)
        panel = next(panel for panel in self._window.panels if isinstance(panel, SearchPanel))
        self._window.plots.tabs.setCurrentWidget(panel)
        panel.start()
        self._until(lambda: not panel.busy, "the search")
        self._picture("window-search")

    def _show_scene(self, key: str, path: Path) -> None:
        session = self._window.session
        self._open(path)
        assert session.source is not None
        for number, preset in enumerate(session.source.presets, 1):
            session.use(preset)
            self._until(self._settled, f"the gate {preset.name} of {key}")
            if number == 1:
                self._picture(f"scene-{key}")
            capture = self._folder / f"capture-{key}-{number}.png"
            self._window.save_frame(capture)
            self._until(lambda: not self._window.saver.busy, f"saving {capture.name}")
            self._window.messages.hide()
            self.files.append(capture)

    def _open(self, path: Path) -> None:
        window = self._window
        window.open(path)
        self._until(lambda: not window.opener.busy, f"the scene {path.stem}")

    def _settled(self) -> bool:
        frame, resolved = self._window.live.frame, self._window.session.resolved
        if frame is None or resolved is None:
            return False
        return frame.stamp.settled and frame.stamp.applied == resolved.sent

    def _picture(self, name: str) -> None:
        self._wait(LOOK_MS)
        path = self._folder / f"{name}.png"
        if not self._window.grab().save(str(path)):
            raise CommandError(f"{path} cannot be written")
        self.files.append(path)

    def _until(self, done: Callable[[], bool], what: str) -> None:
        give_up = time.monotonic() + PATIENCE_S
        while not done() or self._problem:
            if self._problem:
                raise CommandError(self._problem)
            if not self._window.isVisible():
                raise CommandError("the window was closed before the tour had ended")
            if time.monotonic() > give_up:
                raise CommandError(f"{what} did not come within {PATIENCE_S:.0f} s")
            self._wait(20)

    def _wait(self, milliseconds: int) -> None:
        loop = QEventLoop()
        QTimer.singleShot(milliseconds, loop.quit)
        loop.exec()

    def _note(self, sentence: str) -> None:
        self._problem = sentence


def run(rig: Rig, folder: Path) -> list[Path]:
    """Tour the window and return the pictures made. The user's own settings are neither read nor written."""
    application = QApplication.instance() or QApplication(sys.argv[:1])
    application.setApplicationName("slopegate")
    with tempfile.TemporaryDirectory() as scratch:
        window = Window(rig, Path(scratch) / "window.json")
        tour = Tour(window, folder)
        try:
            tour.run()
        finally:
            window.close()
    return tour.files
