"""Copies of a large mesh are one body at several places, and look as if they were not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import plain_rig, shutter
from slopegate.core.render import copies
from slopegate.core.render.copies import find_copies, rigid_motion
from slopegate.core.render.render import render
from slopegate.core.render.tracing import Tracer
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.materials import Gloss
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene
from slopegate.core.scene.shapes import turn

RIG = plain_rig(64, 48, 66.7, shutter(PixelClocks(1000.0, (78.0,))))
MIRROR = np.diag([-1.0, 1.0, 1.0])
PLACES = [(np.eye(3), (-0.3, 0, 1.2)), (turn(20, 40, 60), (0, 0.1, 1.5)), (MIRROR @ turn(yaw_deg=30), (0.3, 0, 1.0))]


@pytest.fixture(autouse=True)
def _small_meshes_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copies, "MIN_TRIANGLES", 2)


def blob() -> Mesh:
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(40, 1, 3)) * 0.08 + rng.normal(size=(40, 3, 3)) * 0.05
    texture = rng.uniform(0.1, 0.9, (8, 8, 3)).astype(np.float32)
    faces = np.arange(120, dtype=np.int32).reshape(-1, 3)
    return Mesh("blob", corners.reshape(-1, 3), faces, uv=rng.uniform(0, 1, (120, 2)), texture=texture)


def placed(mesh: Mesh, rotation: Doubles, position: tuple[float, float, float]) -> Mesh:
    return replace(mesh, vertices=mesh.vertices @ rotation.T + position)


def test_copies_show_and_shade_as_meshes_of_their_own_do() -> None:
    shared = Scene("shared", objects=tuple(placed(blob_, *place) for blob_ in [blob()] for place in PLACES))
    apart = replace(shared, objects=tuple(replace(item, faces=item.faces.copy()) for item in shared.objects))  # type: ignore[type-var,union-attr]
    assert [len(Tracer(RIG, scene).still()) for scene in (shared, apart)] == [4, 1]
    assert len({id(placed.body) for placed in Tracer(RIG, shared).still()}) == 2
    one, other = render(RIG, shared), render(RIG, apart)
    for name in ("projector_row", "inverse_depth", "direct", "ambient"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-5, atol=1e-6, err_msg=name)
    assert (one.inverse_depth > 0).mean() > 0.05


def test_what_looks_otherwise_is_larger_or_moves_is_no_copy() -> None:
    mesh = placed(blob(), *PLACES[0])
    moving = KeyFrames(np.zeros(1), np.zeros((1, 3)), np.eye(3)[None], (0.0, 0.0, 0.0))
    others = [
        replace(mesh, albedo=(0.1, 0.2, 0.3)),
        replace(mesh, material=Gloss(0.5, 20.0)),
        replace(mesh, vertices=mesh.vertices * 1.01),
        replace(mesh, faces=mesh.faces.copy()),
    ]
    for other in others:
        rest, found = find_copies(Scene("", objects=(mesh, other)))
        assert (len(rest), len(found)) == (2, 0)
    assert len(find_copies(Scene("", objects=(mesh, *others, mesh)))[1]) == 1
    ball = replace(blob(), motion=moving)
    assert find_copies(Scene("", objects=(mesh, mesh, ball)))[1] == []


def test_a_motion_is_found_whatever_it_is_and_flat_meshes_have_one() -> None:
    points = blob().vertices
    for group in (points, points * (1, 1, 0)):
        for rotation, position in PLACES:
            found = rigid_motion(group, group @ rotation.T + position)
            assert found is not None
            np.testing.assert_allclose(group @ found[0].T + found[1], group @ rotation.T + position, atol=1e-12)
            np.testing.assert_allclose(found[0] @ found[0].T, np.eye(3), atol=1e-12)
    assert rigid_motion(points, points * (1, 1, 1.001)) is None
    assert rigid_motion(points, points[:-1]) is None
