"""Leaving work out, as users meet it: a switch on the command line and a tick in the camera menu."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from slopegate.app.cli import main
from slopegate.app.session.source import Options
from slopegate.app.window.window import Window
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml

SCENE = """
title = "Steps"
ambient = 0.1
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 1.6]
width_m = 5.0
height_m = 5.0
[[objects]]
name = "box"
type = "box"
centre_m = [0.1, 0.1, 1.1]
size_m = [0.3, 0.2, 0.3]
yaw_deg = 30
[[objects]]
name = "ball"
type = "sphere"
centre_m = [-0.2, 0.0, 1.0]
radius_m = 0.1
"""


def small_rig_text(rig: Rig) -> str:
    text = rig_to_toml(rig)
    for old, new in {
        "width = 1600": "width = 200",
        "height = 1200": "height = 150",
        "= 1666.6666666666667": "= 208.33333333333334",
        "cx = 800.0": "cx = 100.0",
        "cy = 600.0": "cy = 75.0",
        "= 996.66866": f"= {996.66866 * 8!r}",
    }.items():
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize("more", [["--samples", "2"], ["--colour"], ["--noise"]], ids=["area", "colour", "noise"])
def test_render_without_skipping_writes_the_same_file(tmp_path: Path, more: list[str]) -> None:
    (tmp_path / "rig.toml").write_text(small_rig_text(load_rig(None)), "utf-8")
    (tmp_path / "steps.toml").write_text(SCENE, "utf-8")
    files = []
    for switch in ([], ["--no-skip"]):
        out = tmp_path / f"out{len(switch)}.npy"
        command = ["render", str(tmp_path / "steps.toml"), "--rig", str(tmp_path / "rig.toml"), "--clock-mhz", "78"]
        gate = ["--delay-us", "2000", "--exposure-us", "900", "--out", str(out)]
        assert main([*command, *gate, *more, *switch]) == 0
        files.append(np.load(out))
    assert (files[0] > 0).any()
    np.testing.assert_array_equal(*files)


def test_only_lit_rows_are_read_when_ticked(window: Window, qtbot: QtBot) -> None:
    session = window.session
    assert session.source is not None
    assert session.source.options.lit_rows is False
    with qtbot.waitSignal(window.live.first_image):
        window.menus.lit_rows.trigger()
    source = session.source
    assert source.options == Options(noise=False, rate_hz=math.inf, lit_rows=True)
    assert window.menus.lit_rows.isChecked()
    assert session.use(source.presets[0])
    held = session.resolved
    assert held is not None
    lit = weights(row_windows(source.rig, held.sent), source.buffers.projector_row) > 0
    rows = np.flatnonzero(lit.any(axis=1))
    assert 10 < len(rows) < 120
    assert source.rows(held.sent) == (rows[0], rows[-1] + 1)

    def read() -> None:
        frame = window.live.copy_frame()
        assert frame is not None
        assert frame.stamp.rows is not None
        first, last = frame.stamp.rows
        assert first <= rows[0] < first + 4
        assert last - 4 < rows[-1] + 1 <= last
        assert (frame.image[:first] == source.camera.info.black_count).all()

    qtbot.waitUntil(lambda: read() is None)
    with qtbot.waitSignal(window.live.first_image):
        window.menus.lit_rows.trigger()
    assert session.source.rows(held.sent) is None
