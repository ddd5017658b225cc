"""Ctrl+C while a command still imports what it needs: it ends as it does later, and imports nothing more."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import sys


class Interrupting:
    def __init__(self, at):
        self.at, self.struck = at, False

    def find_spec(self, name, path=None, target=None):
        if self.struck and name.startswith(("slopegate.", "numba", "yaml")):
            print(f"{name} is imported after the interruption", file=sys.stderr)
        if name == self.at:
            self.struck = True
            raise KeyboardInterrupt


from slopegate.app.cli import main

sys.meta_path.insert(0, Interrupting(sys.argv[1]))
sys.exit(main(sys.argv[2:]))
"""
PLAN = ("--near-m", "1", "--far-m", "3", "--count", "3")
GATE = ("--clock-mhz", "76", "--delay-us", "1853", "--exposure-us", "400", "--frames", "2")
COMMANDS = {
    "capture": ("capture", "three_targets", *PLAN),
    "transport": ("transport", "acquire", "three_targets", *PLAN),
    "record": ("record", "three_targets", *GATE),
}


@pytest.mark.parametrize("at", ["yaml.resolver", "slopegate.app.api", "slopegate.app.transports"])
@pytest.mark.parametrize("command", COMMANDS)
def test_an_interrupted_import_is_an_interruption(command: str, at: str, tmp_path: Path) -> None:
    words = [sys.executable, "-c", RUN, at, *COMMANDS[command], "--out", str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 130, done.stderr
    assert done.stderr.strip().startswith("slopegate: interrupted"), done.stderr
    assert not (tmp_path / "out").exists()
