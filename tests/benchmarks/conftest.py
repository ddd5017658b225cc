"""Speed as ratios within one run: wall times are printed, never asserted."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Final

import numpy as np
import pytest

from slopegate.core.render.render import Renderer
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, shipped_scenes

ROUNDS: Final = 150
LINES: Final = pytest.StashKey[list[str]]()


@pytest.fixture
def note(request: pytest.FixtureRequest) -> Callable[[str, str, str], None]:
    """note(what, value, aim): a line for the end of the run."""
    lines = request.config.stash.setdefault(LINES, [])
    return lambda what, value, aim: lines.append(f"{what:<62} {value:>34}   {aim}".rstrip())


@pytest.fixture
def compare(note: Callable[[str, str, str], None]) -> Callable[..., None]:
    """compare(what, subject, reference, aim): how much longer the subject takes than the reference.

    Both run in turn, so that they suffer alike from whatever else the machine does. The ratio is of the medians, and in
    brackets of the quietest runs.
    """

    def run(
        what: str, subject: Callable[[], object], reference: Callable[[], object], aim: str, rounds: int = ROUNDS
    ) -> None:
        times_s = np.empty((2, rounds))
        for index in range(-2, rounds):
            for which, function in enumerate((subject, reference)):
                start_s = time.perf_counter()
                function()
                times_s[which, index] = time.perf_counter() - start_s
        (middle, base), (quiet, quiet_base) = np.median(times_s, axis=1) * 1e3, times_s.min(axis=1) * 1e3
        note(what, f"{middle:.2f} / {base:.2f} ms = {middle / base:.3g}x ({quiet / quiet_base:.3g}x)", aim)

    return run


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what the benchmarks found."""
    lines = terminalreporter.config.stash.get(LINES, [])
    if lines:
        terminalreporter.section("in one run: medians (quietest), and the aim")
        for line in lines:
            terminalreporter.write_line(line)


@pytest.fixture(scope="session")
def bench() -> SimpleNamespace:
    """rig (check rig, 1600x1200), scene (the shipped three targets), buffers, settings (the upright target's gate)."""
    path = next(entry.path for entry in shipped_scenes() if entry.key == "three_targets")
    rig, scene = open_scene(path, load_rig(None))
    settings = next(preset.settings for preset in scene.gates if preset.name == "Only the 0 target")
    return SimpleNamespace(rig=rig, scene=scene, buffers=Renderer(rig, scene).at(0.0)[0], settings=settings)
