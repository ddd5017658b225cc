"""`slopegate bake`: what it prepares is found again, for patterns and for everything lit each by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rigs import check_rig
from slopegate.app.cli import main
from slopegate.drivers.files.rig_files import rig_to_toml

Capture = pytest.CaptureFixture[str]

CORNER = """
title = "Corner"
indirect = true
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 1.5]
width_m = 3.0
height_m = 3.0
[[objects]]
name = "ball"
type = "sphere"
centre_m = [0.1, 0.0, 1.1]
radius_m = 0.2
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "corner.toml").write_text(CORNER, "utf-8")
    (tmp_path / "rig.toml").write_text(rig_to_toml(check_rig(48)), "utf-8")
    return tmp_path


def baked(capsys: Capture, home: Path, *more: str) -> dict[str, Any]:
    place = [str(home / "corner.toml"), "--rig", str(home / "rig.toml"), "--paths", "16", "--json"]
    assert main(["bake", *place, *more]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_a_bake_for_patterns_is_another_and_is_found_again(capsys: Capture, home: Path) -> None:
    first = baked(capsys, home, "--patterns")
    assert not first["cached"]
    assert first["paths"] >= 16
    assert not baked(capsys, home)["cached"]
    assert baked(capsys, home, "--patterns")["cached"]
    assert baked(capsys, home)["cached"]


def test_render_takes_the_bake_for_patterns(capsys: Capture, home: Path) -> None:
    baked(capsys, home, "--patterns")
    images = []
    for level in (255, 0):
        picture = home / "pattern.png"
        cv2.imwrite(str(picture), np.full((2, 2), level, np.uint8))
        place = [str(home / "corner.toml"), "--rig", str(home / "rig.toml"), "--exposure-us", "16666.7"]
        gate = ["--clock-mhz", "78", "--delay-us", "0", "--parts", "indirect", "--paths", "16"]
        out = ["--pattern", str(picture), "--out", str(home / "image.npy"), "--overwrite", "--json"]
        assert main(["render", *place, *gate, *out]) == 0
        images.append(np.load(home / "image.npy"))
    assert images[0].max() > 0
    assert not images[1].any()
