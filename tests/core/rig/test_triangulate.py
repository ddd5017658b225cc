"""Depth from projector rows: the way back from projecting points, for any rig."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector
from slopegate.core.rig.settings import PixelClocks, ShutterLimits, Steps
from slopegate.core.rig.triangulate import depth_m, projector_rows, triangulate

SHUTTER = ShutterLimits(PixelClocks(1000.0, (78.0,)), Steps(-1e5, 1e5, 1.0), Steps(1.0, 1e5, 1.0))


def some_rig(seed: int, camera_bend: float, projector_bend: float) -> Rig:
    """40 x 30 camera pixels, a projector above it and to the side, turned by up to 5 degrees, lenses bent as told."""
    rng = np.random.default_rng(seed)
    bend = (camera_bend, -camera_bend / 3, camera_bend / 20, -camera_bend / 30)
    camera = RigCamera(Lens(40, 30, 40.0, 41.0, 20.5, 14.5, bend), SHUTTER)
    bend = (projector_bend, -projector_bend / 3, -projector_bend / 20, projector_bend / 30)
    projector = RigProjector(Lens(1280, 720, 1000.0, 1010.0, 630.0, 350.0, bend), 16666.7)
    turn = np.asarray(cv2.Rodrigues(rng.uniform(-0.09, 0.09, 3))[0], np.float64)
    rotation = tuple(tuple(map(float, row)) for row in turn)
    offset = (float(rng.uniform(-0.02, 0.02)), -0.1, float(rng.uniform(-0.02, 0.02)))
    return Rig(camera, projector, offset, rotation)  # type: ignore[arg-type]


@given(seed=st.integers(0, 10_000), bends=st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12)))
def test_projected_points_come_back(seed: int, bends: tuple[float, float]) -> None:
    rig = some_rig(seed, *bends)
    rng = np.random.default_rng(seed + 1)
    depth = rng.uniform(0.4, 4.0, (30, 40))
    columns, rows = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    points = rig.camera_rays(columns, rows) * depth[..., None] + rig.camera_centre_m
    column, row, ahead = rig.to_projector(points)
    inside = (ahead > 0) & (row >= 0) & (row < 720) & (column >= 0) & (column < 1280)
    found = triangulate(rig, np.where(inside, row, -1).astype(np.float32))
    # float32 rows are good to 3e-5 rows, that is 3e-7 of inverse depth
    np.testing.assert_allclose(found[inside], 1 / depth[inside], atol=3e-6)
    assert np.all(found[~inside] == 0)


@given(seed=st.integers(0, 10_000), bends=st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12)))
def test_rows_on_rays_are_those_of_points(seed: int, bends: tuple[float, float]) -> None:
    rig = some_rig(seed, *bends)
    rng = np.random.default_rng(seed + 1)
    w = rng.uniform(-4.0, 4.0, (30, 40))
    rays = rig.camera_rays(rig.camera.lens.column_centres, rig.camera.lens.row_centres[:, None])
    _, row, ahead = rig.to_projector(rays / w[..., None] + rig.camera_centre_m)
    front = (ahead > 0) & (w > 0)
    np.testing.assert_allclose(projector_rows(rig, rays, w)[front], row[front], rtol=1e-11, atol=1e-9)


def test_rows_are_finite_at_infinity_and_nothing_behind_the_projector() -> None:
    rig = some_rig(1, 0.0, 0.0)
    rays = rig.camera_rays(np.array([20.5]), np.array([14.5]))
    at_infinity = projector_rows(rig, rays, 0.0)
    np.testing.assert_allclose(at_infinity, projector_rows(rig, rays, 1e-13), rtol=0, atol=1e-9)
    away = replace(rig, projector_rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)))
    assert np.isnan(projector_rows(away, rays, [0.0, 1.0])).all()


def test_unknown_and_impossible_rows_have_no_depth() -> None:
    rig = some_rig(1, 0.0, 0.0)
    rows = np.full((30, 40), -1, np.float32)
    rows[0, 0] = 700.0
    rows[29, 0] = 0.0
    found = triangulate(rig, rows)
    assert found[0, 0] > 0
    assert found[29, 0] == 0
    assert np.count_nonzero(found) == 1
    metres = depth_m(found)
    assert np.isnan(metres).sum() == 30 * 40 - 1
    assert metres[0, 0] == pytest.approx(1 / found[0, 0])


def test_another_shape_is_refused() -> None:
    rig = replace(some_rig(1, 0.0, 0.0), name="x")
    with pytest.raises(ValueError, match="projector_row"):
        triangulate(rig, np.zeros((2, 2), np.float32))
