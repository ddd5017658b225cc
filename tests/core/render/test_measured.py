"""Captures: light from photo and depth, no light where depth is missing, shadows that noise does not speckle."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import bent, shutter, turned
from slopegate.core.render.integrate import integrate
from slopegate.core.render.measured import draw_net
from slopegate.core.render.render import Renderer, render
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import PixelClocks, gate
from slopegate.core.scene.scene import MeasuredScene, Mesh, Scene, Sphere

SHUTTER = shutter(PixelClocks(1000.0, (78.0,)))
PROJECTOR = RigProjector(Lens(1280, 720, 1100, 1100, 640, 360), 16666.7)
LENS = Lens(320, 240, 333.0, 333.0, 158.7, 121.2)
IDEAL = ideal_rig(RigCamera(LENS, SHUTTER), PROJECTOR, 0.1)
GENERAL = bent(turned(IDEAL, (3.0, -4.0, 9.0), (0.03, -0.1, 0.01)))


def capture_of(rig: Rig, inverse_depth: NDArray[Any], seed: int = 1) -> Scene:
    photo = np.random.default_rng(seed).uniform(0, 1, (*inverse_depth.shape, 3)).astype(np.float32)
    return Scene(
        "capture", capture=MeasuredScene(rig.camera.lens, inverse_depth.astype(np.float32), photo), ambient=0.3
    )


def floor(lens: Lens, height_m: float = 0.5, pitch_deg: float = 35.0) -> NDArray[np.float64]:
    """Inverse depth of a floor below a camera that looks down at it."""
    y = (np.arange(lens.height) + 0.5 - lens.cy) / lens.fy
    pitch = np.radians(pitch_deg)
    w = (np.sin(pitch) + y * np.cos(pitch)) / height_m
    return np.repeat(np.maximum(w, 0.0)[:, None], lens.width, axis=1)


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_light_is_photo_over_projector_depth_squared(rig: Rig) -> None:
    scene = capture_of(rig, np.full((240, 320), 0.6))
    assert scene.capture is not None
    buffers = render(rig, scene, offset=(0.2, 0.9))
    columns, rows = np.arange(320) + 0.2, np.arange(240)[:, None] + 0.9
    w = np.float64(np.float32(0.6))
    column, row, depth = rig.to_projector(rig.camera_rays(columns, rows) / w + rig.camera_centre_m)
    lit = (row >= 0) & (row < 720) & (column >= 0) & (column < 1280)
    assert 0.3 < lit.mean() < 1
    np.testing.assert_array_equal(buffers.projector_row >= 0, lit)
    np.testing.assert_allclose(buffers.projector_row[lit], row[lit], rtol=1e-6)
    np.testing.assert_allclose(buffers.projector_column[lit], column[lit], rtol=1e-6)
    np.testing.assert_array_equal(buffers.projector_column[~lit], -1)
    np.testing.assert_allclose(buffers.direct[lit], (scene.capture.photo / depth[..., None] ** 2)[lit], rtol=1e-6)
    np.testing.assert_array_equal(buffers.direct[~lit], 0)
    np.testing.assert_array_equal(buffers.inverse_depth, np.float32(0.6))
    np.testing.assert_array_equal(buffers.ambient, scene.capture.photo * np.float32(0.3))


def test_missing_depth_is_missing_light() -> None:
    w = floor(LENS)
    w[50:90, 100:200] = 0
    w[200, 10:14] = [np.nan, np.inf, -np.inf, -0.5]
    missing = ~(np.isfinite(w) & (w > 0))
    buffers = render(IDEAL, capture_of(IDEAL, w))
    np.testing.assert_array_equal(buffers.inverse_depth == 0, missing)
    assert (buffers.projector_row[missing] == -1).all()
    assert not buffers.direct[missing].any()
    assert not buffers.ambient[missing].any()
    assert (buffers.ambient[~missing].max(axis=1) > 0).all()
    for array in (buffers.projector_row, buffers.inverse_depth, buffers.direct, buffers.ambient):
        assert np.isfinite(array).all()


def solid_scene() -> Scene:
    corners = np.array([[-2, -1.5, 2.2], [2, -1.5, 2.2], [2, 1.5, 1.9], [-2, 1.5, 1.9]])
    box = np.array([[-0.5, -0.15, 1.3], [-0.2, -0.15, 1.3], [-0.2, 0.1, 1.3], [-0.5, 0.1, 1.3]])
    # Low enough that light passes behind it: its shadow on the wall lies apart from it.
    bar = np.array([[0.0, -0.2, 0.8], [0.3, -0.18, 0.8], [0.3, -0.16, 0.8], [0.0, -0.18, 0.8]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Scene("solid", objects=(Mesh("wall", corners, faces), Mesh("box", box, faces), Mesh("bar", bar, faces),
                                   Sphere("ball", (0.2, 0.2, 1.4), 0.2)))  # fmt: skip


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_shadows_are_those_of_the_solid_scene(rig: Rig) -> None:
    solid = render(rig, solid_scene())
    capture = render(rig, capture_of(rig, solid.inverse_depth))
    columns, rows = np.arange(320) + 0.5, np.arange(240)[:, None] + 0.5
    points = rig.camera_rays(columns, rows) / solid.inverse_depth[..., None].astype(float) + rig.camera_centre_m
    column, row, _ = rig.to_projector(points)
    framed = (row >= 0) & (row < 720) & (column >= 0) & (column < 1280)
    shadow, drawn = framed & (solid.projector_row < 0), framed & (capture.projector_row < 0)
    assert shadow.sum() > 1500
    # They differ by a pixel along outlines and where what casts the shadow is hidden from the camera.
    core = cv2.erode(shadow.astype(np.uint8), np.ones((3, 3))) > 0
    reach = cv2.dilate(shadow.astype(np.uint8), np.ones((3, 3))) > 0
    assert drawn[core].mean() > 0.95
    assert drawn[framed & ~reach].mean() < 1e-3


def test_a_square_of_the_net_fills_the_cells_whose_centres_it_covers() -> None:
    column, row = np.meshgrid([3.5, 8.5], [2.5, 6.5])
    net = np.stack([column, row, 1 + 0.01 * column + 0.02 * row], axis=2).astype(np.float32)
    drawn = np.zeros((10, 12), np.float32)
    draw_net(net, 1.0, 1.0, drawn)
    rows, columns = np.indices(drawn.shape) + 0.5
    expected = np.where((abs(columns - 6) < 3) & (abs(rows - 4.5) < 2.5), 1 + 0.01 * columns + 0.02 * rows, 0)
    np.testing.assert_allclose(drawn, expected, atol=1e-6)


@pytest.mark.parametrize("across", [0.02, 0.5, 0.98])
def test_a_shadow_of_the_ideal_rig_is_as_wide_as_the_pixels_that_cast_it(across: float) -> None:
    """Wherever in its pixel a ray starts, it meets the column of cells that the pixel was drawn into."""
    w = np.full((240, 320), 0.5)
    w[100:120, 130:170] = 1.0
    unlit = (w < 1) & (render(IDEAL, capture_of(IDEAL, w), offset=(across, 0.5)).projector_row < 0)
    near = unlit[70:150, 100:200]
    np.testing.assert_array_equal(100 + np.flatnonzero(near.any(axis=0)), np.arange(130, 170))
    assert near.any(axis=1).sum() >= 15


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_depth_noise_and_steps_of_a_real_sensor_cast_no_shadow(rig: Rig) -> None:
    w = floor(rig.camera.lens)
    noise = np.random.default_rng(2).normal(0, 0.002, w.shape)
    stepped = np.round((w + noise) / 0.003) * 0.003
    smooth, noisy = render(rig, capture_of(rig, w)), render(rig, capture_of(rig, stepped))
    lit = cv2.erode((smooth.projector_row >= 0).astype(np.uint8), np.ones((5, 5))) > 0
    assert lit.mean() > 0.3
    assert (noisy.projector_row[lit] >= 0).mean() > 0.9999


def test_many_rays_a_pixel_soften_the_edge_of_a_gate() -> None:
    scene = capture_of(IDEAL, np.full((240, 320), 0.6))
    # A camera that scans much slower than the projector: the window's edge crosses the rows of one picture.
    settings = gate(20.0, 4000.0, 3000.0)
    one, many = (integrate(IDEAL, scene, settings, samples) for samples in (1, 4))
    share = many[..., 0] / np.maximum(integrate(IDEAL, scene, gate(20.0, 0.0, 16666.7), 4)[..., 0], 1e-9)
    between = (share > 0.2) & (share < 0.8)
    assert between.any()
    assert abs(one.mean() - many.mean()) < 0.02 * many.mean()


def test_a_capture_is_rendered_once() -> None:
    scene = capture_of(IDEAL, floor(LENS))
    renderer = Renderer(IDEAL, scene)
    first, region = renderer.at(0.0)
    np.testing.assert_array_equal(first.direct, render(IDEAL, scene).direct)
    assert region == (slice(0, 240), slice(0, 320))
    assert renderer.at(1.0)[1] == (slice(0, 0), slice(0, 0))
    assert renderer.recast_pixels == 0


def test_a_capture_must_fit_the_camera() -> None:
    scene = capture_of(IDEAL, np.full((240, 320), 0.6))
    assert scene.capture is not None
    other = replace(IDEAL, camera=replace(IDEAL.camera, lens=replace(LENS, fx=300.0)))
    with pytest.raises(ValueError, match="lens"):
        render(other, scene)
    for capture in (
        replace(scene.capture, inverse_depth=np.ones((10, 10), np.float32)),
        replace(scene.capture, photo=np.ones((240, 320), np.float32)),
    ):
        with pytest.raises(ValueError, match="size"):
            render(IDEAL, replace(scene, capture=capture))
    with pytest.raises(ValueError, match="objects"):
        render(IDEAL, replace(scene, objects=(Sphere("ball", (0, 0, 1), 0.2),)))


@pytest.mark.parametrize("name", ["floor_bottles_chair", "osd_table_5objects", "osd_table_2cans", "redwood_chair"])
def test_measured_planes_are_lit_without_specks(name: str, shared: Any) -> None:
    folder: Path = shared(f"data/scenes/{name}")
    facts = json.loads((folder / "scene.json").read_text())
    depth_mm = cv2.imread(str(folder / "depth_mm.png"), cv2.IMREAD_UNCHANGED).astype(np.float64)
    w = np.divide(1000.0, depth_mm, out=np.zeros_like(depth_mm), where=depth_mm > 0)
    i = facts["intrinsics"]
    lens = Lens(w.shape[1], w.shape[0], i["fx"], i["fy"], i["cx"], i["cy"])
    rig = replace(
        IDEAL, camera=RigCamera(lens, SHUTTER), projector=replace(PROJECTOR, lens=Lens(1280, 720, 300, 300, 640, 360))
    )
    buffers = render(rig, capture_of(rig, w))
    fit = facts["planes"][0]["inverse_depth_per_px"]
    rows, columns = np.indices(w.shape)
    on_plane = (w > 0) & (np.abs(w - (fit["a_u"] * columns + fit["b_v"] * rows + fit["c"])) < 0.01 * w)
    inner = cv2.erode(on_plane.astype(np.uint8), np.ones((15, 15))) > 0
    unlit = inner & (buffers.projector_row < 0)
    count, _, stats, _ = cv2.connectedComponentsWithStats(unlit.astype(np.uint8))
    specks = sum(int(stats[k, cv2.CC_STAT_AREA] <= 4) for k in range(1, count))
    assert inner.sum() > 3000
    assert specks <= 3
