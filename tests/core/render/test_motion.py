"""Casting anew only what moved must give the picture of a full render, to the last bit."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere

IDEAL = plain_rig(160, 120, 167.0, shutter(PixelClocks(1000.0, (78.0,))))
FIELDS = ("projector_row", "projector_column", "inverse_depth", "direct", "ambient")


def turn(x_deg: float, y_deg: float, z_deg: float) -> NDArray[np.float64]:
    return np.asarray(cv2.Rodrigues(np.radians([x_deg, y_deg, z_deg]))[0], np.float64)


def path(times: list[float], positions: list[list[float]], turns: list[list[float]], *, loop: bool = True) -> KeyFrames:
    rotations = np.stack([turn(*angles) for angles in turns])
    return KeyFrames(np.array(times), np.array(positions, float), rotations, (0.0, 0.0, 1.0), loop)


def wall(motion: KeyFrames | None = None, depth: float = 2.0, size: float = 1.2) -> Mesh:
    corners = np.array([[-size, -size, depth], [size, -size, depth], [size, size, depth], [-size, size, depth]])
    texture = np.random.default_rng(3).uniform(0.1, 0.9, (5, 7, 3)).astype(np.float32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh("wall", corners, faces, uv=uv, texture=texture, motion=motion)


def blob(motion: KeyFrames) -> Mesh:
    rng = np.random.default_rng(8)
    corners = rng.normal(size=(40, 1, 3)) * 0.08 + rng.normal(size=(40, 3, 3)) * 0.04 + [0, 0, 1.0]
    return Mesh("blob", corners.reshape(-1, 3), np.arange(120, dtype=np.int32).reshape(-1, 3), motion=motion)


def busy_scene() -> Scene:
    across = path([0, 1, 2], [[-0.9, 0, 0], [0.9, 0.1, 0.3], [-0.9, 0, 0]], [[0, 0, 0], [30, 100, -50], [0, 0, 0]])
    towards = path([0, 1, 1.5], [[0, 0, 0.6], [0.1, 0, -0.9], [0, 0, -2.5]], [[0, 0, 0]] * 3, loop=False)
    bob = path([0, 0.7], [[0.2, -0.3, 0], [0.2, 0.3, 0]], [[0, 0, 0], [0, 0, 180]])
    return Scene(
        "busy",
        objects=(
            wall(),
            Sphere("fixed", (-0.3, 0.2, 1.5), 0.15),
            blob(across),
            Sphere("coming", (0.1, 0, 1.0), 0.15, (0.9, 0.2, 0.1), motion=towards),
            wall(bob, 0.9, 0.06),
        ),
        ambient=0.2,
    )


def assert_identical(ours: Buffers, full: Buffers) -> None:
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(ours, field), getattr(full, field), err_msg=field)


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_what_is_cast_anew_makes_the_full_picture(rig: Rig) -> None:
    scene = busy_scene()
    renderer = Renderer(rig, scene)
    for time_s in (0.0, 0.05, 0.1, 0.4, 0.95, 1.0, 1.2, 1.45, 1.9, 2.3, 17.0, 0.3, -1.0):
        assert_identical(renderer.at(time_s)[0], render(rig, scene, time_s))


def test_the_region_holds_all_changes_and_little_else_is_cast() -> None:
    scene = Scene("ball", objects=(wall(), Sphere("ball", (-0.3, 0, 1.0), 0.1, motion=path(
        [0, 1], [[0, 0, 0], [0.6, 0, 0]], [[0, 0, 0]] * 2))))  # fmt: skip
    renderer = Renderer(IDEAL, scene)
    before = renderer.at(0.0)[0].copy()
    assert renderer.recast_pixels >= 160 * 120
    for time_s in (0.1, 0.5, 0.55):
        buffers, region = renderer.at(time_s)
        changed = np.zeros((120, 160), bool)
        for field in FIELDS:
            difference = getattr(buffers, field) != getattr(before, field)
            changed |= difference if difference.ndim == 2 else difference.any(axis=2)
        outside = changed.copy()
        outside[region.rows, region.columns] = False
        assert changed.any()
        assert not outside.any()
        # The ball covers pi (167 * 0.1)^2 = 876 pixels and shades about as many; rays are cast at a square round it.
        assert 700 < renderer.recast_pixels < 3000
        before = buffers.copy()


def test_nothing_is_cast_while_nothing_moves() -> None:
    rest = path([0, 1], [[0, 0, 0], [0.2, 0, 0]], [[0, 0, 0]] * 2, loop=False)
    renderer = Renderer(IDEAL, Scene("rest", objects=(wall(), blob(rest))))
    renderer.at(1.0)
    for time_s in (1.5, 4.0):
        buffers, region = renderer.at(time_s)
        assert renderer.recast_pixels == 0
        assert region.rows.start == region.rows.stop
    assert_identical(buffers, render(IDEAL, Scene("rest", objects=(wall(), blob(rest))), 4.0))
    still = Renderer(IDEAL, Scene("still", objects=(wall(),)))
    assert still.at(0.0)[1].rows == slice(0, 120)
    assert still.at(3.0)[1].rows == slice(0, 0)


def test_an_object_out_of_sight_costs_nothing() -> None:
    gone = path([0, 1, 2], [[0, 0, 0], [5, 0, 0], [0, 0, -5]], [[0, 0, 0]] * 3, loop=False)
    scene = Scene("gone", objects=(wall(), Sphere("ball", (0, 0, 1.0), 0.1, motion=gone)))
    renderer = Renderer(IDEAL, scene)
    empty = render(IDEAL, Scene("empty", objects=(wall(),)))
    renderer.at(0.0)
    buffers, region = renderer.at(1.0)
    assert renderer.recast_pixels == 0
    assert region.rows.stop > region.rows.start
    assert_identical(buffers, empty)
    assert_identical(renderer.at(2.0)[0], empty)
    assert renderer.recast_pixels == 0
