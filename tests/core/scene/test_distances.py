from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rigs import plain_rig, shutter
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.distances import in_view, nearest_m
from slopegate.core.scene.scene import KeyFrames, Mesh, Sphere
from slopegate.core.scene.shapes import plane, turn

LENS = plain_rig(64, 48, 66.7, shutter(PixelClocks(1000.0, (78.0,)))).camera.lens
ORIGIN = np.zeros(3)


def card(x: float, y: float, z: float, size: float = 1.0, yaw_deg: float = 0.0) -> Mesh:
    return plane("card", (x, y, z), (size, size), turn(yaw_deg=yaw_deg))


@pytest.mark.parametrize(
    ("item", "distance"),
    [
        (card(0, 0, 1050, 400), 1050),
        (card(0, 0, 300, 1e5), 300),
        (card(200, 0, 0, 1), 199.5),
        (card(0, 0, 300, 1e4, 45), 300 * math.sqrt(0.5)),
        (card(3, 4, 0.0005, 20), 0.0005),
        (Sphere("ball", (0, 0, 500), 100), 400),
        (Sphere("around", (0, 0, 0), 0.0004), 0.0004),
    ],
)
def test_the_nearest_surface_is_found_where_it_matters(item: Mesh | Sphere, distance: float) -> None:
    assert nearest_m([item], ORIGIN, 1e-3, 100.0) == pytest.approx(distance, rel=1e-9)


def _by_hand(item: Mesh) -> float:
    """The distance by trying many points of every triangle."""
    u, v = np.meshgrid(np.linspace(0, 1, 400), np.linspace(0, 1, 400))
    share = np.stack([1 - u, u * (1 - v), u * v], axis=-1)
    return min(float(np.linalg.norm(share @ item.vertices[face], axis=-1).min()) for face in item.faces)


def test_it_is_the_distance_that_trying_many_points_gives() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        vertices = rng.normal(size=(3, 3)) * 50 + rng.normal(size=3) * 100
        mesh = Mesh("one", vertices, np.array([[0, 1, 2]], np.int32))
        exact = nearest_m([mesh], ORIGIN, 1e-3, 0.0)
        assert exact <= _by_hand(mesh) <= exact + 0.5


def test_ordinary_scenes_need_no_exact_answer_but_a_motion_counts_all_the_way() -> None:
    assert 1 <= nearest_m([card(0, 0, 1), card(0, 0, 900)], ORIGIN, 1e-3, 100.0) < 2
    offsets = np.array([[0, 0, 0], [0, 0, -999.0]])
    there = KeyFrames(np.array([0.0, 1.0]), offsets, np.tile(np.eye(3), (2, 1, 1)), (0, 0, 0))
    assert nearest_m([replace(card(0, 0, 1000), motion=there)], ORIGIN, 1e-3, 100.0) < 2


@pytest.mark.parametrize(
    ("item", "seen"),
    [
        (card(0, 0, 1), True),
        (card(0, 0, -1), False),
        (card(5, 0, 1), False),
        (card(0, -5, 1), False),
        (card(5, 0, 1, 20), True),
        (Sphere("ball", (0, 0, -1), 0.5), False),
        (Sphere("ball", (2, 0, 1), 0.5), False),
        (Sphere("ball", (0.6, 0, 1), 0.5), True),
    ],
)
def test_what_lies_behind_or_beside_the_camera_is_not_in_view(item: Mesh | Sphere, seen: bool) -> None:
    assert in_view([item], LENS) is seen
    assert in_view([card(0, 0, -1), item], LENS) is seen
