"""Small scenes as text, and a folder with one of them and its rig."""

from __future__ import annotations

from pathlib import Path

from slopegate.drivers.files.rig_files import rig_to_toml
from small_window import small_rig

A_WALL = """
title = "A wall"

[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 1.5]
width_m = 4.0
height_m = 3.0
"""

CARD_AND_WALL = """
title = "Card and wall"
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 4.0
[[objects]]
name = "card"
type = "plane"
centre_m = [0.0, 0.0, 1.0]
width_m = 0.4
height_m = 0.3
"""

GATE_OF_CARD = """
[[gates]]
name = "The card"
tilt_deg = 0
distance_m = 1.0
thickness_m = 0.1
"""


def card_home(folder: Path, scene: str = CARD_AND_WALL) -> Path:
    """The folder, with the small rig in rig.toml and this scene in card.toml."""
    (folder / "rig.toml").write_text(rig_to_toml(small_rig()), "utf-8")
    (folder / "card.toml").write_text(scene, "utf-8")
    return folder
