"""Of a scene that was looked at before the window keeps nothing: not the panels that are hidden, either."""

from __future__ import annotations

import gc
import math
import weakref
from dataclasses import replace
from pathlib import Path

from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from slopegate.app.panels.panels import PANELS
from slopegate.app.session.loading import Progress
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import make_source, small_scene


def indirectly_lit(rig: Rig) -> Source:
    """The small scene with a bake, which panels look at."""
    scene = replace(small_scene(rig), indirect=True)
    quick = Options(noise=False, rate_hz=math.inf)
    return build_source(Path("lit.toml"), rig, scene, quick, Progress(lambda share, text: None))


def kept_of(source: Source) -> dict[str, weakref.ref[object]]:
    """What of a source takes memory."""
    assert source.rendered is not None
    assert source.buffers is not None
    parts = {"source": source, "camera": source.rendered, "scene": source.scene, "buffers": source.buffers}
    parts |= {"depth": source.buffers.projector_row, "bake": source.rendered.baking}
    return {name: weakref.ref(part) for name, part in parts.items()}


def test_hidden_panels_keep_nothing_of_the_scene_before(qtbot: QtBot, window: Window, rig: Rig) -> None:
    window.session.adopt(indirectly_lit(rig))
    for spec in PANELS:
        panel = window.docks.bring(spec.key)
        if panel is not None:
            qtbot.waitUntil(lambda panel=panel: panel.isVisible() and not getattr(panel, "busy", False))
            QApplication.processEvents()  # what a timer of 0 ms draws
    source = window.session.source
    assert source is not None
    kept = kept_of(source)
    window.docks.bring("record")
    window.session.adopt(make_source(rig))
    del source

    def left() -> list[str]:
        gc.collect()
        return [name for name, part in kept.items() if part() is not None]

    qtbot.waitUntil(lambda: left() == [])
