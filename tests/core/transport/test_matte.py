"""Soft mattes from the light of slices."""

from __future__ import annotations

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import tile_depths
from slopegate.core.render.coverage import true_alpha
from slopegate.core.render.integrate import integrate_parts
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.core.transport.matte import matte_errors, slice_light, soft_matte
from slopegate.core.transport.sliced import SliceTransport

RIG = check_rig(96)


def ball_and_blades(front: float, back: float) -> tuple[Singles, Singles, Singles]:
    """Light (H, W) of a ball and thin blades, of the wall behind, and the true matte; 36 rays a pixel."""
    blades = [
        plane("blade", (-0.1 + 0.02 * k, -0.02, 0.8), (0.0012, 0.2), turn(roll_deg=5.0 * k), Finish((front,) * 3))
        for k in range(4)
    ]
    ball = Sphere("ball", (0.05, 0.0, 0.8), 0.08, (front,) * 3)
    wall = plane("wall", (0.0, 0.0, 1.3), (3.0, 3.0), turn(), Finish((back,) * 3))
    scene = Scene("s", objects=(ball, *blades, wall))
    line = upright_line_time(RIG)
    gates = tile_depths(RIG, line, 0.6, 1.0, 1) + tile_depths(RIG, line, 1.1, 1.6, 1)
    first, second = (mono(integrate_parts(RIG, scene, settings, 6)[0]) for settings in gates)
    return first, second, true_alpha(RIG, scene, ["ball", "blade"], 6)


@pytest.mark.parametrize(("front", "back"), [(0.2, 0.9), (0.9, 0.2), (0.5, 0.5)])
def test_it_is_near_the_true_matte_whatever_the_colours(front: float, back: float) -> None:
    near, far, truth = ball_and_blades(front, back)
    light = near + far
    ratio = np.divide(near, light, out=np.zeros_like(near), where=light > 0)
    mixed = np.count_nonzero((truth > 0) & (truth < 1))
    found = matte_errors(soft_matte(near, far), truth)
    assert found.sad < 0.15 * mixed
    assert found.mse < 0.6 * matte_errors(ratio, truth).mse


def test_an_edge_between_even_areas_is_exact() -> None:
    """Both covers are known beside the edge, so a mixed pixel's share is, whatever they are."""
    share = np.zeros((20, 30), np.float32)
    share[:, :14] = 1
    share[:, 14] = np.linspace(0.05, 0.95, 20)
    found = soft_matte(share * 0.2, (1 - share) * 3)
    assert np.abs(found - share).max() < 1e-5
    assert found.dtype == np.float32


def test_noise_moves_no_pure_pixel() -> None:
    share = np.zeros((40, 40), np.float32)
    share[10:30, 10:30] = 1
    generator = np.random.default_rng(0)
    near, far = (generator.normal(0, 0.01, share.shape).astype(np.float32) for _ in range(2))
    found = soft_matte(near + share * 0.3, far + (1 - share) * 0.3)
    assert matte_errors(found, share).sad < 2


def test_noise_in_the_dark_is_no_foreground() -> None:
    generator = np.random.default_rng(0)
    near, far = (generator.normal(0, 0.01, (40, 60)).astype(np.float32) for _ in range(2))
    far[:, :30] += 0.3
    assert soft_matte(near, far).mean() < 0.002


def test_shade_belongs_to_the_wall_and_the_front_keeps_its_own() -> None:
    """Rows from above: wall, front, its own shade, front, shade on the wall, wall."""
    near, far = np.zeros((60, 8), np.float32), np.zeros((60, 8), np.float32)
    far[:10], near[10:20], near[30:40], far[50:] = 1, 1, 1, 1
    column = soft_matte(near, far)[:, 4]
    assert (column[:10] == 0).all()
    assert (column[10:40] == 1).all()
    assert (column[40:] == 0).all()


def test_beyond_the_projectors_frame_the_nearest_lit_pixel_tells() -> None:
    near, far = np.zeros((20, 8), np.float32), np.zeros((20, 8), np.float32)
    near[5:15, :4], far[5:15, 4:] = 1, 1
    found = soft_matte(near, far)
    assert (found[:, :4] == 1).all()
    assert (found[:, 4:] == 0).all()


@pytest.mark.parametrize(("wall_below", "alpha"), [(True, 0.4), (False, 1.0)])
def test_a_dim_edge_is_partly_covered_only_where_shade_of_the_wall_begins(wall_below: bool, alpha: float) -> None:
    """The last lit row of the front has 0.4 of its light: half a pixel, or the end of the projector's frame."""
    near, far = np.zeros((40, 8), np.float32), np.zeros((40, 8), np.float32)
    near[5:20], near[20] = 1, 0.4
    if wall_below:
        far[30:] = 1
    assert soft_matte(near, far)[20] == pytest.approx(np.full(8, alpha), abs=1e-6)


def test_without_light_there_is_no_foreground() -> None:
    dark = np.zeros((6, 6), np.float32)
    assert not soft_matte(dark, dark).any()


def test_light_of_slices_is_their_sum() -> None:
    slices = [SliceTransport(np.full((4, 6), value, np.float32), ()) for value in (1, 2, 4)]
    assert (slice_light(slices, [0, 2]) == 5).all()
    with pytest.raises(InputError, match="slice"):
        slice_light(slices, [3])


def test_light_behind_a_mosaic_is_grey() -> None:
    raw = bayer_rg(np.broadcast_to(np.array([1, 2, 6], np.float32), (6, 8, 3)))
    assert np.allclose(slice_light([SliceTransport(raw, ())], [0], "RGGB"), 3)


def test_errors_are_sums_and_means() -> None:
    found = matte_errors(np.array([[0.5, 1.0]], np.float32), np.array([[0.0, 1.0]], np.float32))
    assert (found.sad, found.mse) == (0.5, 0.125)
    with pytest.raises(InputError, match="matte"):
        matte_errors(np.zeros((2, 2), np.float32), np.zeros((2, 3), np.float32))
