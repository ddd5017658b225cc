"""Light that fog turns several times beside light that it turns once, against random walks."""

from __future__ import annotations

import numpy as np
import pytest

from halo_reference import landed_by_walks
from rigs import check_rig
from slopegate.core.light.halo import HALO_RADIUS, MOST_TURNS, SMALL_COSINE
from slopegate.core.light.scatter import make_sink, make_source, make_turns
from slopegate.core.light.scatter_kernels import ANGLE_STEP, ANGLES, halo
from slopegate.core.light.several_turns import WIDEST_ANGLE, make_several, several_by_one
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.render import render
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh, Scene

RINGS = np.array([0.0, 0.005, 0.01, 0.02, 0.03, HALO_RADIUS])
SLAB = 0.7


def fog_before(thickness: float, g: float, near: float) -> tuple[Fog, Medium]:
    """Fog of this optical thickness from `near` to a wall at 1 m."""
    inf = np.inf
    fog = Fog(thickness / (1 - near), 0.0, g, (-inf, -inf, near if near else -inf), (inf, inf, inf))
    medium = medium_of(fog)
    assert medium is not None
    return fog, medium


def light_in_rings(medium: Medium, near: float, most_turns: int) -> np.ndarray:
    """Means of the halo's law over the rings, with what the fog takes."""
    turns = make_turns(medium.g, medium.extinction * WIDEST_ANGLE)
    several = several_by_one(medium, turns, (1.0, near, np.inf), most_turns)
    angles = (np.arange(2000) + 0.5) * HALO_RADIUS / 2000
    sines, thickness = np.sin(angles), medium.extinction * (1 - near)
    once = [halo(turns, medium.extinction, 1.0, s, np.sqrt(1 - s * s), 0.0, near, np.inf) for s in sines]
    value = np.array(once) * medium.scattering * np.exp(-thickness / np.cos(angles))
    value *= np.interp(sines, np.arange(ANGLES) * ANGLE_STEP, several)
    ring = np.searchsorted(RINGS, angles) - 1
    return np.asarray(np.bincount(ring, value * sines) / np.bincount(ring, sines))


@pytest.mark.parametrize("near", [0.0, SLAB])
@pytest.mark.parametrize(
    ("thickness", "g", "slack"),
    [(0.3, 0.85, 0.02), (1.5, 0.85, 0.02), (0.3, 0.5, 0.02), (1.5, 0.5, 0.02), (3, 0.85, 0.05)],
)
def test_turns_add_up_as_walks_say(near: float, thickness: float, g: float, slack: float) -> None:
    """In all rings together, and in each of them as well as the walks know it (4 of their errors)."""
    fog, medium = fog_before(thickness, g, near)
    expected, error = landed_by_walks(fog, RINGS, (MOST_TURNS, SMALL_COSINE), 1_000_000)
    found, area = light_in_rings(medium, near, MOST_TURNS), -np.diff(np.cos(RINGS))
    whole = (expected * area).sum()
    noise = np.sqrt(((error * area) ** 2).sum()) / whole
    assert (found * area).sum() / whole == pytest.approx(1, abs=slack + 2 * noise)
    assert (np.abs(found - expected) < 1.5 * slack * expected + 4 * error).all()
    # One turn alone is far from that where fog is thick.
    if thickness >= 1.5 and g > 0.8:
        assert (light_in_rings(medium, near, 1) * area).sum() < 0.85 * whole


@pytest.mark.parametrize("g", [0.0, -0.5])
def test_where_fog_turns_light_widely_little_is_added(g: float) -> None:
    """What light that turned by wide angles would add is left to the bake, and what is left here is right."""
    fog, medium = fog_before(1.5, g, SLAB)
    expected, error = landed_by_walks(fog, RINGS, (MOST_TURNS, SMALL_COSINE), 1_000_000)
    found, area = light_in_rings(medium, SLAB, MOST_TURNS), -np.diff(np.cos(RINGS))
    noise = np.sqrt(((error * area) ** 2).sum())
    assert abs(((found - expected) * area).sum()) < 0.01 * (expected * area).sum() + 4 * noise
    one = light_in_rings(medium, SLAB, 1)
    assert ((found - one) * area).sum() < 0.05 * (one * area).sum()


def test_distances_between_those_of_the_table_are_as_good() -> None:
    """A floor from near to far: within 0.2 % of what is worked out for a distance itself."""
    rig = check_rig(80)
    corners = np.array([[-9, 0.3, 0.2], [9, 0.3, 0.2], [9, 0.3, 6], [-9, 0.3, 6]], float)
    scene = Scene("floor", objects=(Mesh("floor", corners, np.array([[0, 2, 1], [0, 3, 2]], np.int32)),))
    medium = medium_of(Fog(0.5, 0.02, 0.85))
    assert medium is not None
    source = make_source(rig.camera.lens, render(rig, scene).inverse_depth)
    turns = make_turns(medium.g, 6 * medium.extinction * WIDEST_ANGLE)
    several = make_several(medium, turns, source, make_sink(rig, medium, source), MOST_TURNS)
    for place in (3.5, 10.5, 20.5):
        reach = float(np.exp(several.low + place * several.step))
        exact = several_by_one(medium, turns, (reach, 0.0, np.inf), MOST_TURNS)
        between = several.table[int(place) : int(place) + 2].mean(axis=0)
        np.testing.assert_allclose(between, exact, rtol=2e-3)
    assert several.table[-1, -1] > several.table[0, -1] > 1
    assert (several.table[:, 0] == 1).all()


def test_one_turn_alone_and_clear_views_change_nothing() -> None:
    rig = check_rig(40)
    medium = medium_of(Fog(0.5, 0.0, 0.85))
    assert medium is not None
    turns = make_turns(medium.g, WIDEST_ANGLE)
    _, before = fog_before(1.0, 0.85, 0.5)
    assert (several_by_one(before, turns, (0.4, 0.5, np.inf), MOST_TURNS) == 1).all()
    source = make_source(rig.camera.lens, render(rig, Scene("nothing")).inverse_depth)
    assert (make_several(medium, turns, source, make_sink(rig, medium, source), MOST_TURNS).table == 1).all()
