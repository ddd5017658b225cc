"""A small rig file with the projector beside the camera, and a scene file whose gates are given both ways."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rigs import check_rig, turned
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import rig_to_toml

SCENE = """
title = "Cards"
ambient = 0.02
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 2.0]
width_m = 8.0
height_m = 6.0
[[objects]]
name = "card"
type = "plane"
centre_m = [0.0, 0.0, 0.8]
width_m = 0.25
height_m = 0.2
[[gates]]
name = "The card"
tilt_deg = 0.0
distance_m = 0.8
thickness_m = 0.1
[[gates]]
name = "Forty rows down"
clock_mhz = 78.0
delay_us = 850.0
exposure_us = 100.0
"""


def beside_rig(width: int = 160) -> Rig:
    """The check rig of so many columns with its projector 10 cm to the left of the camera."""
    return replace(turned(check_rig(width), (0.0, 0.0, 0.0), (-0.1, 0.0, 0.0)), name="beside, small")


def write_beside(folder: Path, width: int = 160) -> tuple[Path, Path]:
    """Write a rig file and a scene file; their paths."""
    rig, scene = folder / "beside_small.toml", folder / "cards.toml"
    rig.write_text(rig_to_toml(beside_rig(width)), "utf-8")
    scene.write_text(SCENE, "utf-8")
    return rig, scene
