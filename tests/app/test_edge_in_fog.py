"""The slanted edges in fog: what blurs them, and what a thin gate leaves of it, by the slanted-edge MTF."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import pytest

from halo_reference import square_by_walks
from slopegate.app import api
from slopegate.core.gating.gate import row_windows
from slopegate.core.light.part import PartName
from slopegate.core.measure.slanted_edge import slanted_edge_mtf
from slopegate.core.rig.arrays import Doubles, Singles

Box = tuple[int, int, int, int]

UPRIGHT: Box = (102, 98, 166, 162)
LEVEL: Box = (168, 32, 232, 96)
CAST: Box = (170, 100, 234, 164)
TARGET = 1.0, 0.16, math.radians(5), 0.06, 0.7
"""Distance, half the side, roll, and both albedos of the scene's square."""


def mtf50(image: Singles | Doubles, box: Box | None = None) -> float:
    x0, y0, x1, y1 = box or (0, 0, image.shape[1], image.shape[0])
    found = slanted_edge_mtf(image[y0:y1, x0:x1]).mtf50_cy_per_px
    assert found is not None
    return found


def seen(scene: api.OpenScene, gate: api.GateSettings, *parts: PartName, samples: int = 3) -> Singles:
    wanted: Collection[PartName] = parts
    return scene.light(gate, parts=wanted, samples=samples)


def alone(scene: api.OpenScene) -> api.GateSettings:
    return next(gate for name, gate in scene.gates.items() if name.endswith("alone"))


@pytest.mark.parametrize(("key", "boxes"), [("edge", (UPRIGHT, LEVEL)), ("edge_projected", (CAST,))])
def test_the_gate_keeps_more_of_both_edges_than_a_regular_image(key: str, boxes: tuple[Box, ...]) -> None:
    """And the lens alone keeps what it should. Lit but for multiple scattering, which the bake has."""
    scene = api.open_scene(key, rig="binned")
    clear = api.OpenScene(scene.rig, replace(scene.scene, fog=None))
    regular = seen(scene, scene.everything_lit, "direct", "scatter")
    gated = seen(scene, alone(scene), "direct", "scatter")
    for box in boxes:
        assert 0.21 < mtf50(seen(clear, clear.everything_lit, "direct"), box) < 0.25
        assert mtf50(gated, box) > 1.1 * mtf50(regular, box)


def test_a_veil_alone_leaves_the_mtf_as_it_was() -> None:
    scene = api.open_scene("edge", rig="binned")
    direct = seen(scene, scene.everything_lit, "direct")
    veiled = seen(scene, scene.everything_lit, "direct", "airlight")
    assert veiled.mean() > 1.02 * direct.mean()
    for box in (UPRIGHT, LEVEL):
        assert mtf50(veiled, box) == pytest.approx(mtf50(direct, box), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("box", [UPRIGHT, LEVEL])
def test_paths_through_the_fog_show_the_papers_loss_and_gain(box: Box) -> None:
    """Walks that turn any number of times: 0.14 cycles a pixel regular, and 1.44 times as much behind the gate.

    Behind the gate, which keeps little of what was turned more than once, the parts alone come to the same.
    """
    scene = api.open_scene("edge", rig="binned")
    fog = scene.scene.fog
    assert fog is not None
    found = {}
    for name, gate in (("regular", scene.everything_lit), ("gated", alone(scene))):
        windows = row_windows(scene.rig, gate)
        found[name] = mtf50(square_by_walks(scene.rig, TARGET, fog, windows, box, 4000))
    assert found["regular"] == pytest.approx(0.14, abs=0.01)
    assert found["gated"] > 1.44 * found["regular"]
    assert mtf50(seen(scene, alone(scene), "direct", "scatter"), box) == pytest.approx(found["gated"], rel=0.05)


@pytest.mark.slow
def test_the_whole_image_shows_the_papers_loss_and_gain() -> None:
    """All parts together, by 2048 paths a cell, whose noise is 1.9 % of the image."""
    scene = api.open_scene("edge", rig="binned")
    scene.bake(paths=2048)
    regular, gated = (scene.light(gate, samples=3) for gate in (scene.everything_lit, alone(scene)))
    for box in (UPRIGHT, LEVEL):
        assert mtf50(regular, box) == pytest.approx(0.14, abs=0.01)
        assert mtf50(gated, box) > 1.44 * mtf50(regular, box)
