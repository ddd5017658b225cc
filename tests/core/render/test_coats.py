"""Gloss and skin in direct light, against the formula written out for single rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render.coats import Looks, add_lobes
from slopegate.core.render.kernels import Hits, Pixels
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.materials import SKIN_LOBES, Gloss, Material, Skin
from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import Finish, box, plane, turn
from slow_rays import nearest

IDEAL = plain_rig(120, 90, 125.0, shutter(PixelClocks(1000.0, (78.0,))))
FIELDS = ("projector_row", "projector_column", "inverse_depth", "direct", "ambient")


def life(material: Material | None, motion: KeyFrames | None = None) -> Scene:
    """A wall, a box and a ball of this material, beside matt ones."""
    texture = np.random.default_rng(5).uniform(0.1, 0.9, (7, 11, 3)).astype(np.float32)
    wall = Finish(texture=texture, material=material)
    return Scene(
        "life",
        objects=(
            plane("wall", (0.0, 0.0, 1.6), (2.4, 2.0), turn(10, 20), wall),
            replace(box("box", (-0.2, 0.1, 1.1), (0.2, 0.3, 0.2), turn(0, 30), Finish((0.2, 0.3, 0.1))), motion=motion),
            Sphere("ball", (0.2, -0.05, 1.0), 0.12, (0.6, 0.1, 0.1), material=material, motion=motion),
            Sphere("dull", (0.05, 0.2, 1.2), 0.1, (0.5, 0.5, 0.5)),
        ),
        ambient=0.2,
    )


def assert_same(ours: Buffers, other: Buffers) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(ours, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_gloss_is_matt_light_and_a_lobe_about_the_mirrors_direction(rig: Rig) -> None:
    matt, gloss = life(None), Gloss(0.3, 40.0)
    plain, glossy = render(rig, matt), render(rig, life(gloss))
    for name in ("projector_row", "inverse_depth", "ambient"):
        np.testing.assert_array_equal(getattr(glossy, name), getattr(plain, name))
    lit = np.argwhere(plain.projector_row >= 0)
    rng, shown = np.random.default_rng(2), 0
    for row, column in lit[rng.choice(len(lit), 400, replace=False)]:
        ray = rig.camera_rays(column + 0.5, row + 0.5)
        depth, normal, _, material = nearest(life(gloss), rig.camera_centre_m, ray)
        beam = rig.camera_centre_m + depth * ray - rig.projector_centre_m
        z = float(rig.to_projector(rig.camera_centre_m + depth * ray)[2])
        back = -beam / np.linalg.norm(beam)
        mirrored = 2 * (normal @ back) * normal - back
        cosine = max(float(mirrored @ -ray) / np.linalg.norm(ray), 0.0)
        lobe = 0.3 * 42 / 2 * cosine**40 * abs(normal @ beam) / z**3 if material is gloss else 0.0
        added = glossy.direct[row, column] - plain.direct[row, column]
        np.testing.assert_allclose(added, lobe, rtol=2e-4, atol=1e-5)
        shown += lobe > 0.1
    assert shown > 20


def test_the_lobe_throws_its_share_of_light_that_falls_in_straight() -> None:
    """The integral of reflectance times cosine over all directions, by the kernel itself: the share."""
    rng, count = np.random.default_rng(1), 400_000
    views = -rng.normal(size=(count, 3))
    views[:, 2] = -np.abs(views[:, 2])
    views /= np.linalg.norm(views, axis=1)[:, None]
    normal, beams = np.tile([0.0, 0.0, 1.0], (count, 1)), np.tile([0.0, 0.0, -1.0], (count, 1))
    ones = np.ones(count)
    for exponent in (1.0, 10.0, 100.0):
        direct = np.zeros((count, 3), np.float32)
        out = Pixels(*np.zeros((3, count), np.float32), direct, direct.copy())
        looks = Looks(
            normal,
            np.ones((count, 3), np.float32),
            np.full((count, 3), 0.4, np.float32),
            np.full(count, exponent),
            np.zeros(count),
        )
        hits = Hits(ones, ones, np.zeros((count, 3), np.float32))
        q = np.tile([0.0, 0.0, 1.0], (count, 1))
        add_lobes(np.zeros(count, np.float32), q, beams, views, hits, looks, np.arange(count), out)
        # White shows 1 where its reflectance is 1 / pi; directions are spread over 2 pi.
        thrown = float(np.mean(direct[:, 0] / np.pi * -views[:, 2])) * 2 * np.pi
        assert thrown == pytest.approx(0.4, rel=0.02)


def test_light_from_behind_has_no_mirrors_direction() -> None:
    looks = Looks(
        np.array([[0.0, 0, 1]]), np.ones((1, 3), np.float32), np.ones((1, 3), np.float32), np.ones(1), np.zeros(1)
    )
    hits = Hits(np.ones(1), np.ones(1), np.ones((1, 3), np.float32))
    for towards, lit in ((-1.0, True), (1.0, False)):
        direct = np.zeros((1, 3), np.float32)
        out = Pixels(*np.zeros((3, 1), np.float32), direct, direct.copy())
        beam: Doubles = np.array([[0.1, 0, towards]])
        at, views = np.array([[0.0, 0, 1]]), np.array([[0.1, 0, -1.0]])
        add_lobes(np.zeros(1, np.float32), at, beam, views, hits, looks, np.arange(1), out)
        assert (direct > 0).all() == lit


def test_without_a_share_gloss_is_matt_to_the_last_bit() -> None:
    assert_same(render(IDEAL, life(Gloss(0.0))), render(IDEAL, life(None)))


def test_what_is_plain_beside_gloss_stays_what_it_was_to_the_last_bit() -> None:
    scene = life(None)
    only_ball = replace(
        scene, objects=(*scene.objects[:2], replace(scene.objects[2], material=Gloss(0.5)), scene.objects[3])
    )
    ours, plain = render(IDEAL, only_ball), render(IDEAL, scene)
    changed = (ours.direct != plain.direct).any(axis=2)
    _, rows, columns = (None, *np.indices(changed.shape))
    ray = IDEAL.camera_rays(columns.ravel() + 0.5, rows.ravel() + 0.5)
    hit = np.array([nearest(scene, IDEAL.camera_centre_m, one)[2][0] == 0.6 for one in ray[changed.ravel()]])
    assert changed.any()
    assert hit.all()


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_moving_gloss_and_skipped_rays_change_no_bit(rig: Rig) -> None:
    rotations = np.stack([turn(), turn(20, 70, 10), turn()])
    places = np.array([[-0.1, 0, 0], [0.15, 0.05, -0.2], [-0.1, 0, 0.0]])
    moving = life(Gloss(0.4, 20.0), KeyFrames(np.array([0.0, 1.0, 2.0]), places, rotations, (0.0, 0.0, 1.0)))
    renderer = Renderer(rig, moving)
    for time_s in (0.0, 0.4, 1.0, 1.3):
        ours, _ = renderer.at(time_s)
        whole = render(rig, moving, time_s)
        assert_same(ours, whole)
        assert_same(whole, render(rig, moving, time_s, skip=False))


def test_skin_throws_back_where_light_falls_what_its_lobes_leave_over() -> None:
    skin = Skin(SKIN_LOBES)
    ours, plain = render(IDEAL, life(skin)), render(IDEAL, life(None))
    np.testing.assert_array_equal(ours.ambient, plain.ambient)
    share = ours.direct / np.where(plain.direct > 0, plain.direct, np.float32(1))
    lit = plain.direct[..., 0] > 0
    on_skin = lit & (share[..., 0] < 0.99)
    np.testing.assert_allclose(share[on_skin], np.broadcast_to(skin.surface, share[on_skin].shape), rtol=1e-6)
    np.testing.assert_array_equal(ours.direct[~on_skin], plain.direct[~on_skin])
    assert on_skin.mean() > 0.2
