"""The tour of `slopegate demo`: the window shows what it can do by itself, and pictures of it stay behind."""

from __future__ import annotations

import errno
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from PySide6.QtCore import QEventLoop, QTimer
from PySide6.QtGui import QImageWriter
from PySide6.QtWidgets import QApplication

from slopegate.app.commands.report import CommandError, say_line
from slopegate.app.panels.calibrate import RESULT, CalibratePanel
from slopegate.app.panels.capture import CapturePanel
from slopegate.app.panels.capture_view import MODES, CaptureView
from slopegate.app.panels.mask import MaskPanel
from slopegate.app.panels.panel import Panel
from slopegate.app.panels.search import SearchPanel
from slopegate.app.widgets.paint import level_table
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.durable import replacing
from slopegate.drivers.files.images import save_image
from slopegate.drivers.scenes.scene_files import shipped_scenes

SIZES = ((1280, 800), (1920, 1080))
THEMES = ("light", "dark")
PATIENCE_S = 600.0
"""A scene in fog takes a minute on a slow or busy computer."""
HIDDEN = (640, 240, 960, 790)
"""The middle one of three targets, in the first scene's image."""
SLICED, SLICES, LOOKED_AT = "spot", 16, (705, 430)
"""What is captured slice by slice, in how many, and the pixel whose light is plotted."""
POSES_TAKEN = 4
"""Of the chart, in the calibration."""
LOOK_MS = 700
"""How long a step stays in view: for the rates in the status line to settle, and for people watching."""

Kind = TypeVar("Kind", bound=Panel)


class Tour:
    """Drives one window; every step waits until what it asked for is on the screen."""

    def __init__(self, window: Window, folder: Path, scratch: Path) -> None:
        """Pictures go to `folder`; `scratch` is for what the window needs and nobody keeps."""
        self._window, self._folder, self._scratch = window, folder, scratch
        self._problem = ""
        self.files: list[Path] = []
        for said in (window.opener.failed, window.saver.failed):
            said.connect(self._note)

    def run(self) -> None:
        """All of it. Raises CommandError where a step does not come to its end."""
        window = self._window
        window.show()
        window.open_first(None)
        self._until(lambda: window.docks.made, "the first image and its panels")
        for theme in THEMES:
            window.set_theme(theme)
            for width, height in SIZES:
                window.resize(width, height)
                self._picture(f"window-{theme}-{width}x{height}")
        window.resize(*SIZES[0])
        window.docks.bring("timing")
        self._picture("window-timing")
        window.docks.bring("section")
        scenes = shipped_scenes()
        for number, scene in enumerate(scenes, 1):
            say_line(f"scene {number} of {len(scenes)}: {scene.title}")
            self._show_scene(scene.key, scene.path)
        say_line("")
        self._mask(scenes[0].path)
        self._search(scenes[0].path)
        self._calibrate()
        self._slices(next((scene for scene in scenes if scene.key == SLICED), scenes[0]).path)

    def _mask(self, path: Path) -> None:
        """Hide what lies in a rectangle, and show how it was before."""
        self._open(path)
        panel = self._panel("mask", MaskPanel)
        panel.hide_it.setChecked(True)
        panel.rectangle.chosen.emit(*HIDDEN)
        panel.find_gate()
        self._until(lambda: not panel.busy, "the gate that hides a target")
        panel.wipe.setChecked(True)
        self._until(self._settled, "that gate's image")
        self._picture("window-mask")
        panel.wipe.setChecked(False)

    def _search(self, path: Path) -> None:
        self._open(path)
        panel = self._panel("search", SearchPanel)
        panel.start()
        self._until(lambda: not panel.busy, "the search")
        self._picture("window-search")

    def _slices(self, path: Path) -> None:
        """Record a scene slice by slice, and look at the capture."""
        self._open(path)
        panel, capture = self._panel("slices", CapturePanel), self._scratch / "slices"
        panel.where.setText(str(capture))
        panel.plan.count.setValue(SLICES)
        panel.start.click()
        self._until(lambda: not panel.run.busy, "the capture")
        self._open(capture)
        view = self._panel("capture", CaptureView)
        self._until(view.mode.isVisible, "the slices")
        view.picture.pick(*LOOKED_AT)
        view.slider.setValue(view.slider.maximum() - int(view.plot.light.argmax()))
        view.mode.setCurrentIndex(MODES.index("overlay"))
        self._until(self._settled, "the slice in front")
        self._picture("window-slices")

    def _calibrate(self) -> None:
        """Calibrate a practice rig, and look at what was found."""
        panel = self._panel("calibrate", CalibratePanel)
        panel.chart.place.where.setText(str(self._scratch / "calibration"))
        panel.chart.begin.click()
        self._until(lambda: panel.run.work is not None and not panel.run.busy, "the practice rig")
        for _ in range(POSES_TAKEN):
            panel.poses.go_there.click()
            self._until(lambda: panel.poses.there, "the chart where it is wanted")
            panel.poses.take.click()
            self._until(lambda: not panel.run.busy, "a pose of the chart")
        self._picture("window-calibrate-poses")
        panel.steps[RESULT].click()
        self._picture("window-calibrate-result")

    def _panel(self, key: str, kind: type[Kind]) -> Kind:
        """Bring this panel to the front."""
        panel = self._window.docks.bring(key)
        assert isinstance(panel, kind)
        return panel

    def _show_scene(self, key: str, path: Path) -> None:
        session = self._window.session
        self._open(path)
        assert session.source is not None
        for number, preset in enumerate(session.source.presets, 1):
            session.use(preset)
            self._until(self._settled, f"the gate {preset.name} of {key}")
            if number == 1:
                self._picture(f"scene-{key}")
            self._capture(self._folder / f"capture-{key}-{number}")

    def _capture(self, path: Path) -> None:
        """The frame on show twice: its counts, which ordinary viewers show nearly black, and as it looks here."""
        live, counts, looks = self._window.live, path.with_suffix(".tif"), path.with_suffix(".png")
        self._window.save_frame(counts)
        self._until(lambda: not self._window.saver.busy, f"saving {counts.name}")
        self._window.messages.hide()
        frame, levels = live.copy_frame(), live.levels
        assert frame is not None
        table = level_table(levels.black.value(), levels.white.value(), levels.srgb.isChecked())
        save_image(looks, table[frame.image])
        self.files += [counts, looks]

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
        with replacing(path) as part:
            writer = QImageWriter(str(part), b"png")
            if not writer.write(self._window.grab().toImage()):
                raise OSError(errno.EIO, writer.errorString())
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


def tour(rig: Rig, folder: Path) -> list[Path]:
    """Tour the window and return the pictures made. The user's own settings are neither read nor written."""
    application = QApplication.instance() or QApplication(sys.argv[:1])
    application.setApplicationName("slopegate")
    with tempfile.TemporaryDirectory() as scratch:
        window = Window(rig, Path(scratch) / "window.json")
        guide = Tour(window, folder, Path(scratch))
        try:
            guide.run()
        finally:
            window.close_unasked()
    return guide.files
