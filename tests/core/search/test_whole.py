"""A target that is deeper than a gate along its best plane is found whole, and what surrounds it stays out."""

from __future__ import annotations

import numpy as np
import pytest

from rigs import check_rig
from search_card import SearchCard, finish, speckle
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.render import render
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Mesh, Scene
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.core.search.search import begin

WALL_Z_M = 1.8


def card_at(name: str, x_m: float, z_m: float, width_m: float, seed: int) -> Mesh:
    return plane(name, (x_m, -0.04, z_m), (width_m, 0.3), turn(), Finish(texture=speckle(seed)))


def steps(depths_m: tuple[float, ...], wall: bool = True) -> SearchCard:
    """Cards side by side, each at a depth of its own, before a wall as busy as they are."""
    rig = check_rig(640)
    cards = [card_at(f"step {k}", 0.08 * (k - 1.5) * z, z, 0.08 * z, k + 1) for k, z in enumerate(depths_m)]
    back = plane("wall", (0.0, 0.0, WALL_Z_M), (5.0, 4.0), turn(), Finish(texture=speckle(9)))
    scene = Scene("steps", objects=(*cards, back) if wall else tuple(cards), ambient=0.02)
    buffers = render(rig, scene)
    alone = render(rig, Scene("alone", objects=tuple(cards))).inverse_depth
    truth = (alone > 0) & (alone == buffers.inverse_depth)
    rows, columns = np.nonzero(truth)
    target = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    return SearchCard(rig, scene, buffers, truth, target)


def shown(card: SearchCard, settings: GateSettings) -> tuple[float, float]:
    """Shares of the target's lit pixels and of the others that the gate records."""
    recorded = weights(row_windows(card.rig, settings), card.buffers.projector_row) > 0
    lit = card.buffers.projector_row >= 0
    inside, outside = lit & card.truth, lit & ~card.truth
    return float(recorded[inside].mean()), float(recorded[outside].mean()) if outside.any() else 0.0


@pytest.mark.parametrize("depths_m", [(0.85, 1.0, 0.92, 1.15), (1.0, 1.0, 0.8, 0.9)])
def test_what_joins_on_in_depth_is_found_whole(depths_m: tuple[float, ...]) -> None:
    card = steps(depths_m)
    outcome = finish(begin(card.rig, card.target, black_count=40.0), card.camera()).outcome
    assert outcome is not None
    assert outcome.settings is not None, outcome.reason
    whole, wall = shown(card, outcome.settings)
    assert whole > 0.97
    assert wall < 0.05


def test_a_whole_image_ends_where_nothing_with_keypoints_joins_on() -> None:
    card = steps((0.95, 1.0, 1.04, 1.1), wall=False)
    outcome = finish(begin(card.rig, None, black_count=40.0), card.camera()).outcome
    assert outcome is not None
    assert outcome.settings is not None, outcome.reason
    assert shown(card, outcome.settings)[0] > 0.97
    assert outcome.settings.exposure_us < card.rig.projector.period_us / 8


def test_one_of_two_objects_of_a_whole_image_is_a_part_of_it() -> None:
    """A gap in depth ends what the gate shows; whichever is meant, half of the image is missing."""
    card = steps((0.8, 1.15, 0.8, 1.15), wall=False)
    frames = card.camera()
    outcome = finish(begin(card.rig, None, black_count=40.0), frames).outcome
    assert outcome is not None
    assert (outcome.cause, outcome.found) == ("part", False)
    assert outcome.settings is not None
    assert f"{outcome.kept} of {outcome.keypoints} keypoints; a rectangle about one object" in outcome.reason
    assert shown(card, outcome.settings)[0] < 0.7
