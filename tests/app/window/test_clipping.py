"""Nothing is cut, at any size of the window, in any workspace and panel, in either theme and at scale 2."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from PySide6.QtCore import QSize
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from clipping import beyond_screen, clipped, settle
from slopegate.app.panels.panels import PANELS
from slopegate.app.views.histogram import HistogramView
from slopegate.app.window.window import Window

LARGE = QSize(1920, 1080)
USUAL = QSize(1280, 800)


def _lasting(window: Window) -> list[str]:
    """What is cut, and stays so: a text that comes from a worker is laid out a moment later."""
    found: list[str] = []
    for _ in range(50):
        settle()
        found = [*clipped(window), *beyond_screen(window)]
        if not found:
            break
        QTest.qWait(20)
    return found


def faults(window: Window, sizes: list[QSize]) -> list[str]:
    """What is cut in any panel at these sizes, and at the least that the window can have."""
    found = []
    for size in (window.minimumSizeHint(), *sizes):
        window.resize(size)
        for spec in PANELS:
            window.docks.bring(spec.key)
            here = f"{spec.title}, window {window.width()} x {window.height()}"
            found += [f"{here}: {fault}" for fault in _lasting(window)]
    return found


def test_the_faults_of_a_layout_are_found(qtbot: QtBot) -> None:
    box = QWidget()
    qtbot.addWidget(box)
    row = QHBoxLayout(box)
    row.setContentsMargins(0, 0, 0, 0)
    for widget in (QLabel("a label that is cut"), QPushButton("a button that is cut"), QCheckBox("a box that is cut")):
        widget.setFixedWidth(40)
        row.addWidget(widget)
    high = QLabel("many words in lines that are not all to be seen")
    high.setWordWrap(True)
    high.setFixedSize(70, 15)
    narrow = HistogramView()
    narrow.setFixedSize(0, 48)
    row.addWidget(high)
    row.addWidget(narrow)
    outside = QPushButton("out", box)
    outside.move(-30, 0)
    box.show()
    settle()
    found = "\n".join(clipped(box))
    for fault in ("label that is cut", "button that is cut", "box that is cut", "px high", "has no size", "not inside"):
        assert fault in found


def test_nothing_is_cut_at_the_least_size(window: Window) -> None:
    assert faults(window, []) == []


@pytest.mark.slow
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_nothing_is_cut_at_any_size(window: Window, theme: str) -> None:
    window.set_theme(theme)
    found = faults(window, [USUAL, LARGE])
    window.set_theme("light")
    assert found == []


@pytest.mark.slow
def test_nothing_is_cut_at_scale_2() -> None:
    this = [str(Path(__file__)), "-k", "any_size"]
    words = [sys.executable, "-m", "pytest", "-n0", "-p", "no:cacheprovider", *this]
    done = subprocess.run(
        words, env={**os.environ, "QT_SCALE_FACTOR": "2"}, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith("..")  # none was skipped
