"""Figure 8 of the paper: the Cornell box in fog by a regular camera, by epipolar rows and by a sloped gate.

In small pictures, so that it does not take long, with all light: fog's single and multiple scattering, its blur, and
light between surfaces. Each picture is compared with what the same rig sees with everything lit and no fog.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

from slopegate.app import api
from slopegate.core.gating.epipolar import epipolar_gate
from slopegate.core.light.four_ways import SmallView, moved_scene
from slopegate.core.measure.quality import ncc
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.variants import beside_rig
from slopegate.core.scene.scene import Scene

BINNING = 8


@dataclass(frozen=True, eq=False)
class Box:
    """The box in fog and without, seen by the projector-above rig and by the projector-beside rig."""

    whole: GateSettings
    lit: GateSettings
    epipolar: GateSettings
    above: SmallView
    beside: SmallView
    clear_above: Singles
    clear_beside: Singles


@cache
def box() -> Box:
    opened = api.open_scene("cornell_fog")
    rig, lit = opened.rig, opened.everything_lit
    aside = beside_rig(rig)
    there = moved_scene(opened.scene, aside.camera_centre_m - rig.camera_centre_m)
    epipolar = epipolar_gate(aside)
    assert epipolar is not None
    clear, clear_there = replace(opened.scene, fog=None), replace(there, fog=None)
    pairs = ((rig, opened.scene), (aside, there), (rig, clear), (aside, clear_there))
    above, beside, clear_above, clear_beside = (refined(*pair) for pair in pairs)
    return Box(
        opened.gates["The whole box"],
        lit,
        epipolar,
        above,
        beside,
        clear_above.light(lit),
        clear_beside.light(lit),
    )


def refined(rig: Rig, scene: Scene) -> SmallView:
    view = SmallView(rig, scene, BINNING)
    while not view.refined:
        view.refine()
    return view


def test_a_sloped_gate_shows_more_of_the_box_than_epipolar_rows_and_these_than_a_regular_camera() -> None:
    found = box()
    sloped = ncc(found.above.light(found.whole), found.clear_above)
    epipolar = ncc(found.beside.light(found.epipolar), found.clear_beside)
    regular = ncc(found.beside.light(found.lit), found.clear_beside)
    assert sloped > 0.94
    assert sloped > epipolar + 0.15
    assert epipolar > regular + 0.01
    assert regular > ncc(found.above.light(found.lit), found.clear_above)
