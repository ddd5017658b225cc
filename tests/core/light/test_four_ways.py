"""Four small pictures of a scene: against the full picture, and the same camera in front of both rigs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows, upright_line_time
from slopegate.core.gating.plan import plan, whole_period
from slopegate.core.light.four_ways import (
    WAYS,
    SmallView,
    binned_scene,
    four_views,
    gate_of,
    moved_scene,
    picture,
    upright_gate_of,
)
from slopegate.core.render.render import Cancelled, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.variants import beside_rig, binned_lens
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import KeyFrames, MeasuredScene, Scene, Sphere
from slopegate.core.scene.shapes import plane, turn

RIG = check_rig(1200, height=900)


def scene() -> Scene:
    wall = plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn())
    card = plane("card", (0.0, 0.0, 1.0), (0.4, 0.3), turn(20.0))
    return Scene("card", objects=(wall, card, Sphere("ball", (0.3, 0.1, 1.2), 0.1)), ambient=0.05)


def test_small_pictures_are_the_means_of_the_full_ones() -> None:
    settings = plan(RIG, 20.0, 1.0, 0.2)
    view = SmallView(RIG, scene(), 3)
    buffers = render(RIG, scene())
    periods = settings.exposure_us / RIG.projector.period_us
    full = gated(
        buffers.projector_row, mono(buffers.direct), mono(buffers.ambient), row_windows(RIG, settings), periods
    )
    small = view.light(settings)
    assert small.shape == (300, 400)
    means = full.reshape(300, 3, 400, 3).mean(axis=(1, 3))
    assert small.mean() == pytest.approx(means.mean(), rel=0.01)
    assert (np.abs(small - means) < 0.02 * means.max()).mean() > 0.97


def test_all_four_are_there_and_only_one_needs_the_other_rig() -> None:
    views = four_views(RIG, scene(), lambda share: True)
    settings = plan(RIG, 20.0, 1.0, 0.2)
    pictures = {way: picture(views, way, settings) for way in WAYS}
    for way, got in pictures.items():
        assert got is not None, way
        assert got[0].shape == got[1].shape == (300, 400)
    # without fog everything lit is the reference itself, and an epipolar gate keeps all direct light
    assert np.array_equal(*pictures["regular"])
    light, clear = pictures["epipolar"]
    assert float(light.mean()) == pytest.approx(float(clear.mean()) - 0.05 * 0.8, rel=0.05)
    level = gate_of(views, "upright", settings)
    assert level.line_time_us == upright_line_time(RIG)
    assert level.exposure_us == settings.exposure_us
    assert level == upright_gate_of(RIG, settings)
    assert gate_of(views, "regular", settings) == whole_period(RIG, settings.line_time_us)


def test_indirect_light_is_added_pass_by_pass() -> None:
    small = check_rig(160)
    room = replace(scene(), indirect=True)
    views = four_views(small, room, lambda share: True)
    settings = whole_period(small, upright_line_time(small))
    assert not views.refined
    before = views.own.light(settings)
    views.refine(lambda share: True)
    first, paths = views.own.light(settings), views.own.paths
    assert first.mean() > before.mean()
    with pytest.raises(Cancelled):
        views.refine(lambda share: False)
    assert np.array_equal(views.own.light(settings), first)
    views.refine(lambda share: True)
    assert views.own.paths > paths
    assert np.array_equal(*picture(views, "regular", settings))  # no fog: it is the reference
    assert four_views(small, scene(), lambda share: True).refined


def test_a_rig_without_slabs_has_no_upright_gate() -> None:
    assert upright_gate_of(beside_rig(RIG), whole_period(RIG, 10.0)) is None


def seen_by(rig: Rig, what: Scene) -> np.ndarray:
    return render(rig, what).inverse_depth


def test_the_camera_stays_where_it_is_before_both_rigs() -> None:
    rig = check_rig(160)
    aside = beside_rig(rig)
    still = np.stack([np.eye(3)] * 2)
    move = KeyFrames(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [0.1, 0, 0]]), still, (0.0, 0.0, 1.0))
    first = scene()
    moving = replace(first, objects=(first.objects[0], replace(first.objects[1], motion=move), first.objects[2]))
    there = moved_scene(moving, aside.camera_centre_m - rig.camera_centre_m)
    here, other = render(rig, moving, 0.5).inverse_depth, render(aside, there, 0.5).inverse_depth
    assert (np.abs(here - other) < 1e-5).mean() > 0.998  # float32 at the edges of things
    fog = moved_scene(replace(first, fog=Fog(1.0, lo_m=(0, 0, 1), hi_m=(1, 1, 2))), np.array([0.1, 0.2, 0.0])).fog
    assert fog.lo_m == (0.1, 0.2, 1.0)
    assert fog.hi_m == (1.1, 1.2, 2.0)


def test_a_measured_scene_is_binned_with_its_camera() -> None:
    lens = check_rig(40).camera.lens
    photo = np.random.default_rng(1).random((30, 40, 3)).astype(np.float32)
    depth = np.ones((30, 40), np.float32)
    seen = binned_scene(Scene("photo", capture=MeasuredScene(lens, depth, photo)), 4).capture
    assert seen.lens == binned_lens(lens, 4)
    assert seen.photo.shape == (7, 10, 3)
    assert seen.inverse_depth.shape == (7, 10)
    assert seen.photo[0, 0] == pytest.approx(photo[:4, :4].mean(axis=(0, 1)), rel=1e-5)


def test_another_fog_keeps_what_is_seen_without_fog() -> None:
    small, first = check_rig(160), scene()
    clear = four_views(small, first, lambda share: True)
    foggy = four_views(small, replace(first, fog=Fog(1.0)), lambda share: True, clear)
    assert foggy.own_clear is clear.own_clear
    assert foggy.beside_clear is clear.beside_clear
    lit = whole_period(small, upright_line_time(small))
    fresh = four_views(small, replace(first, fog=Fog(1.0)), lambda share: True)
    for kept, made in zip(picture(foggy, "regular", lit), picture(fresh, "regular", lit), strict=True):
        assert np.array_equal(kept, made)
    other = four_views(small, replace(first, ambient=0.5), lambda share: True, clear)
    assert other.own_clear is not clear.own_clear


def test_preparing_can_be_given_up() -> None:
    with pytest.raises(Cancelled):
        four_views(RIG, scene(), lambda share: share < 0.3)
