"""Prints how long one turn of the window's event loop lasts at most after the first image, in ms: by the clock, and
busy. A program of its own, for what a start does once a process, and without what tests bring along."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication

from slopegate.app.window.window import Window
from slopegate.drivers.files.rig_files import load_rig

AFTER_MS = 5000
"""What comes some time after the first image belongs to the start."""


def main(preferences: Path) -> None:
    application = QApplication(sys.argv[:1])
    window = Window(load_rig(None), preferences)
    window.resize(1280, 800)
    turns: list[tuple[float, float]] = []
    timer = QTimer()
    timer.timeout.connect(lambda: turns.append((time.perf_counter(), time.thread_time())))
    window.live.first_image.connect(lambda: timer.start(0))
    window.live.first_image.connect(lambda: QTimer.singleShot(AFTER_MS, application.quit))
    window.show()
    window.open_first("three_targets")
    application.exec()
    window.close()
    print(*(1000 * np.diff(np.array(turns), axis=0).max(axis=0)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
