"""Captures of a plane through several gates of several clocks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise
from slopegate.drivers.captures.capture_run import run_capture
from slopegate.drivers.captures.storage import CaptureFolder, create_capture, make_manifest, open_capture
from timed_scenes import HiddenPlane

CLOCKS = (62.0, 74.0, 96.0, 108.0, 124.0)


def gates_of(rig: Rig, clocks: Sequence[float] = CLOCKS, exposure_us: float = 5000.0) -> list[GateSettings]:
    """Six of each clock, which cover a period between them."""
    line, period_us = rig.camera.shutter.line, rig.projector.period_us
    assert isinstance(line, PixelClocks)
    found = []
    for number, clock in enumerate(clocks):
        for delay_us in period_us * (np.arange(6) + number / len(clocks)) / 6:
            asked = gate(line.line_time_us(clock), float(delay_us), exposure_us)
            found.append(quantise(rig.camera.shutter, asked, period_us))
    return found


def captured(path: Path, hidden: HiddenPlane, gates: Sequence[GateSettings], dark: bool = False) -> CaptureFolder:
    bench = hidden.bench(faults=None)
    rig = hidden.believed
    manifest = make_manifest("A plane", rig, bench.camera.info, gates, 2, dark, False)
    folder = create_capture(path, manifest)
    bench.camera.stop()
    run_capture(bench.camera, folder, lambda stream, recorder: lambda: None, print)
    return open_capture(path)
