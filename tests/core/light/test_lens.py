"""Parts of a picture behind blurred lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from halo_reference import slanted_edge
from rigs import check_rig
from slopegate.core.exposure.blur import blurred
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import row_windows
from slopegate.core.light.airlight import prepare_airlight
from slopegate.core.light.lens import SeenDirect, behind_lens, blurred_light, has_blur, integrate_blurred
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.integrate import integrate_parts, pixel_positions
from slopegate.core.render.render import NOWHERE, Buffers, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene

SCENE = Scene("edge", objects=(slanted_edge(20.0, 5.0, 1.5).mesh(),), ambient=0.2)
SETTINGS = gate(20.0, 3000.0, 900.0)


def rig_with(camera_px: float, projector_px: float = 0.0) -> Rig:
    rig = check_rig(80)
    camera, projector = replace(rig.camera, blur_px=camera_px), replace(rig.projector, blur_px=projector_px)
    return replace(rig, camera=camera, projector=projector)


def test_whether_there_is_blur() -> None:
    assert [has_blur(rig_with(*blur)) for blur in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5))] == [False, True, True]


def test_no_blur_is_the_plain_integral_by_other_rays() -> None:
    rig = rig_with(0.0)
    for found, expected in zip(
        integrate_blurred(rig, SCENE, SETTINGS, 4), integrate_parts(rig, SCENE, SETTINGS, 4), strict=True
    ):
        assert found.mean() == pytest.approx(expected.mean(), rel=6e-3)
        assert np.sqrt(((found - expected) ** 2).mean()) < 0.05 * expected.max()


def test_rays_are_blurred_one_by_one_and_averaged() -> None:
    rig = rig_with(1.0, 2.0)
    views = [render(rig, SCENE, offset=(float(c), float(r))) for c, r in pixel_positions(2)]
    singles = [blurred_light(rig, view, SETTINGS) for view in views]
    for found, each in zip(integrate_blurred(rig, SCENE, SETTINGS, 2), zip(*singles, strict=True), strict=True):
        assert found.max() > 0
        np.testing.assert_allclose(found, np.mean(each, axis=0), rtol=1e-5)


def test_parts_are_put_behind_the_lens_once() -> None:
    scene = replace(SCENE, fog=Fog(0.4, 0.0, 0.8))
    for rig, names in ((rig_with(0.0), ["airlight", "scatter"]), (rig_with(1.0), ["direct", "airlight", "scatter"])):
        view = SeenScene(rig, scene, render(rig, scene), "mono")
        parts = prepare_parts(view, {"direct", "airlight", "scatter", "ambient"})
        assert [part.name for part in parts] == names
    sharp = prepare_airlight(rig, scene, view.buffers, "mono")
    assert behind_lens(rig_with(0.0), sharp) is sharp
    windows, shape = row_windows(rig, SETTINGS), view.buffers.projector_row.shape
    plain, seen = np.zeros(shape, np.float32), np.ones(shape, np.float32)
    sharp.add(windows, plain)
    parts[1].add(windows, seen)
    np.testing.assert_allclose(seen, 1 + blurred(plain, 1.0), rtol=1e-6)


def test_direct_light_of_every_filter_follows_what_moves() -> None:
    rig = rig_with(0.8)
    view, windows = render(rig, SCENE), row_windows(rig, SETTINGS)
    shape = view.projector_row.shape
    rgb, _ = blurred_light(rig, view, SETTINGS)
    mosaic, grey = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    SeenDirect(rig, view, "bayer_rg").add(windows, mosaic)
    part = SeenDirect(rig, view, "mono")
    part.add(windows, grey)
    np.testing.assert_allclose(mosaic, bayer_rg(rgb), rtol=1e-6)
    np.testing.assert_allclose(grey, mono(rgb), rtol=1e-5, atol=1e-7)
    moved = Buffers(view.projector_row, view.projector_column, view.inverse_depth, 2 * view.direct, view.ambient)
    part.follow(moved, NOWHERE, 0.0)
    again = np.zeros(shape, np.float32)
    part.add(windows, again)
    np.testing.assert_allclose(again, 2 * grey, rtol=1e-5, atol=1e-7)


def test_a_pattern_lights_each_point_before_the_camera_s_lens_blurs_it() -> None:
    rig = rig_with(0.8)
    view, windows = render(rig, SCENE), row_windows(rig, SETTINGS)
    picture = np.random.default_rng(3).random((rig.projector.lens.height, rig.projector.lens.width), np.float32)
    places = view.projector_row, view.projector_column
    lit = replace(view, direct=patterned(view.direct, *places, picture))
    expected, _ = blurred_light(rig, lit, SETTINGS)
    found, room = blurred_light(rig, view, SETTINGS, picture)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(room, blurred_light(rig, view, SETTINGS)[1])
    part, shown = SeenDirect(rig, view, "rgb"), []
    for pattern in (picture, None):
        part.light_with(pattern)
        shown.append(np.zeros_like(found))
        part.add(windows, shown[-1])
    np.testing.assert_array_equal(shown[0], expected)
    np.testing.assert_array_equal(shown[1], blurred_light(rig, view, SETTINGS)[0])
    assert expected.sum() < 0.7 * shown[1].sum()


def test_each_ray_behind_blurred_lenses_looks_up_its_own_pixel() -> None:
    rig = rig_with(1.0, 2.0)
    picture = np.random.default_rng(3).random((rig.projector.lens.height, rig.projector.lens.width), np.float32)
    views = [render(rig, SCENE, offset=(float(c), float(r))) for c, r in pixel_positions(2)]
    expected = np.mean([blurred_light(rig, view, SETTINGS, picture)[0] for view in views], axis=0)
    found, _ = integrate_blurred(rig, SCENE, SETTINGS, 2, pattern=picture)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
