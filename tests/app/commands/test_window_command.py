"""`slopegate` as a process of its own: signals close its window as the user does, and it waits for nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import atexit, os, signal, sys, threading, time
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from slopegate.app.cli import program

atexit.register(lambda: print("taken to pieces"))
threading.Thread(target=time.sleep, args=(3600,)).start()  # as what is still computed
name, sys.argv = sys.argv[1], ["slopegate"]
application, timer = QApplication([]), QTimer()


def end_it() -> None:
    if any(widget.isVisible() for widget in application.topLevelWidgets()):
        timer.stop()
        os.kill(os.getpid(), getattr(signal, name))


timer.timeout.connect(end_it)
timer.start(20)
program()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a signal ends a Windows process at once")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_closes_the_window_and_keeps_what_was_set(tmp_path: Path, name: str) -> None:
    environment = {**os.environ, "XDG_CONFIG_HOME": str(tmp_path), "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", SCRIPT, name]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=250)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert json.loads((tmp_path / "slopegate" / "window.json").read_text("utf-8"))["workspace"] == "gate"
