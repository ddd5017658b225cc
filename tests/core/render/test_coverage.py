"""The true matte of a scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.render.coverage import true_alpha
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.checks import InputError
from slopegate.core.scene.materials import Glass
from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import plane, turn

RIG = check_rig(64)
BALL = Sphere("ball", (0.05, 0.02, 0.8), 0.08)
WALL = plane("wall", (0.0, 0.0, 1.3), (3.0, 3.0), turn())


def test_a_ball_covers_its_solid_angle() -> None:
    """Seen from the camera's centre: an ellipse of area pi f^2 a b with a cone about (x, y, z)."""
    alpha = true_alpha(RIG, Scene("s", objects=(BALL, WALL)), ["ball"], 8)
    x, y, z = np.array(BALL.centre_m) - RIG.camera_centre_m
    square, radius = x * x + y * y + z * z, BALL.radius_m
    # area of the outline in the plane z = 1 (a conic): pi r^2 sqrt(d^2 - r^2) / (z^2 - r^2)^1.5
    area = np.pi * radius**2 * np.sqrt(square - radius**2) / (z * z - radius**2) ** 1.5
    assert alpha.sum() == pytest.approx(area * RIG.camera.lens.fx**2, rel=2e-3)
    assert ((alpha > 0) & (alpha < 1)).any()


def test_all_objects_cover_everything_and_the_rest_is_what_is_left() -> None:
    scene = Scene("s", objects=(BALL, WALL))
    both = true_alpha(RIG, scene, ["ball", "wall"], 3)
    assert (both == 1).all()
    apart = true_alpha(RIG, scene, ["ball"], 3) + true_alpha(RIG, scene, ["wall"], 3)
    assert np.abs(apart - 1).max() < 1e-6


def test_what_is_hidden_covers_nothing() -> None:
    behind = Sphere("behind", (0.0, 0.0, 2.0), 0.1)
    assert not true_alpha(RIG, Scene("s", objects=(WALL, behind)), ["behind"], 2).any()


def test_glass_counts_as_what_it_is() -> None:
    glass = replace(BALL, material=Glass())
    clear = true_alpha(RIG, Scene("s", objects=(glass, WALL)), ["ball"], 2)
    assert (clear == true_alpha(RIG, Scene("s", objects=(BALL, WALL)), ["ball"], 2)).all()


def test_what_moves_is_where_it_is_then() -> None:
    away = KeyFrames(np.array([0.0, 1.0]), np.array([[0, 0, 0], [0, 0, 5.0]]), np.stack([np.eye(3)] * 2), (0, 0, 0))
    scene = Scene("s", objects=(replace(BALL, motion=away), WALL))
    assert true_alpha(RIG, scene, ["ball"], 1).any()
    assert not true_alpha(RIG, scene, ["ball"], 1, time_s=0.5).any()


def test_what_it_cannot_tell_is_refused() -> None:
    scene = Scene("s", objects=(BALL,))
    with pytest.raises(InputError, match="one of ball"):
        true_alpha(RIG, scene, ["cube"], 1)
    with pytest.raises(InputError, match="samples"):
        true_alpha(RIG, scene, ["ball"], 0)
    with pytest.raises(Cancelled):
        true_alpha(RIG, scene, ["ball"], 1, progress=lambda share: False)
