from __future__ import annotations

import numpy as np
import pytest

from rigs import WIDE_LIMITS, plain_rig
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.integrate import integrate, pixel_positions, pixel_shifts
from slopegate.core.render.render import render
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Mesh, Scene

RIG = plain_rig(80, 60, 250 / 3, WIDE_LIMITS)
PERIOD_US = RIG.projector.period_us


def wall(depth_m: float, tilt: float = 0.0) -> Scene:
    """Falls away towards the lower right."""
    corners = np.array([[-2, -2, depth_m - tilt], [2, -2, depth_m], [2, 2, depth_m + tilt], [-2, 2, depth_m]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Scene("wall", objects=(Mesh("wall", corners, faces, albedo=(0.9, 0.5, 0.2)),), ambient=0.3)


SETTINGS = gate(255.5, 2028.2, 900.0)


def test_colour_and_grey_follow_the_weights() -> None:
    buffers = render(RIG, wall(1.05, 0.8))
    windows = row_windows(RIG, SETTINGS)
    count = weights(windows, buffers.projector_row).astype(np.float32)
    assert 0 < count.mean() < 1
    colour = gated(buffers.projector_row, buffers.direct, buffers.ambient, windows, 0.054)
    expected = count[:, :, None] * buffers.direct + np.float32(0.054) * buffers.ambient
    np.testing.assert_allclose(colour, expected, rtol=1e-6)
    green = [np.ascontiguousarray(plane[..., 1]) for plane in (buffers.direct, buffers.ambient)]
    np.testing.assert_array_equal(gated(buffers.projector_row, *green, windows, 0.054), colour[..., 1])


def test_one_period_is_the_fully_lit_image() -> None:
    buffers = render(RIG, wall(1.2))
    lit = integrate(RIG, wall(1.2), gate(255.5, 777.0, PERIOD_US), 1)
    np.testing.assert_allclose(lit, buffers.direct + buffers.ambient, rtol=1e-6)
    twice = integrate(RIG, wall(1.2), gate(255.5, 777.0, 2 * PERIOD_US), 1)
    np.testing.assert_allclose(twice, 2 * lit, rtol=1e-6)


def test_one_sample_is_the_ray_through_the_middle() -> None:
    scene = wall(1.05, 0.8)
    buffers = render(RIG, scene)
    periods = SETTINGS.exposure_us / PERIOD_US
    middle = gated(buffers.projector_row, buffers.direct, buffers.ambient, row_windows(RIG, SETTINGS), periods)
    np.testing.assert_allclose(integrate(RIG, scene, SETTINGS, 1), middle, rtol=1e-6)


def test_more_samples_soften_the_edges_and_keep_the_light() -> None:
    scene = wall(1.05, 0.8)
    one, four, eight = (integrate(RIG, scene, SETTINGS, samples)[..., 0] for samples in (1, 4, 8))
    shares = eight / integrate(RIG, scene, gate(255.5, 0.0, PERIOD_US), 1)[..., 0]
    assert ((shares > 0.2) & (shares < 0.8)).sum() > 20
    assert np.abs(four - eight).mean() < np.abs(one - eight).mean() / 2
    assert four.mean() == pytest.approx(eight.mean(), rel=0.01)


def test_each_ray_is_tested_against_its_rows_own_window() -> None:
    scene = wall(1.05, 0.8)
    total = np.zeros((60, 80))
    windows = row_windows(RIG, SETTINGS)
    rows, columns = np.indices(total.shape)
    aside, down = (part.reshape(total.shape) for part in pixel_shifts(2, columns.ravel(), rows.ravel()))
    for column, row in pixel_positions(2):
        for kind in range(16):
            across, along = divmod(kind, 4)
            offset = ((column + aside[along, across]) % 1, (row + down[along, across]) % 1)
            sub = render(RIG, scene, offset=offset)
            light = weights(windows, sub.projector_row) * sub.direct[..., 0] + 0.054 * sub.ambient[..., 0]
            total += np.where((columns % 4 == across) & (rows % 4 == along), light, 0)
    periods = SETTINGS.exposure_us / PERIOD_US
    found = integrate(RIG, scene, SETTINGS, 2)[..., 0]
    np.testing.assert_allclose(found, total / 4 + (periods - 0.054) * 0.3 * 0.9, rtol=1e-4)


def test_wrong_shapes_are_named() -> None:
    rows, windows = np.zeros((60, 80), np.float32), row_windows(RIG, SETTINGS)
    with pytest.raises(ValueError, match="direct"):
        gated(rows, np.zeros((60, 81), np.float32), np.zeros((60, 81), np.float32), windows, 1.0)
    with pytest.raises(ValueError, match="ambient"):
        gated(rows, np.zeros((60, 80), np.float32), np.zeros((60, 80, 3), np.float32), windows, 1.0)
    with pytest.raises(ValueError, match="samples"):
        integrate(RIG, wall(1.0), SETTINGS, 0)


def test_rays_of_a_pixel_have_rows_and_columns_of_their_own() -> None:
    for samples in (1, 2, 5):
        positions = pixel_positions(samples)
        even = (np.arange(samples**2) + 0.5) / samples**2
        for axis in (0, 1):
            np.testing.assert_allclose(np.sort(positions[:, axis]), even)


def test_an_edge_in_any_direction_is_met_better_by_pixels_that_look_elsewhere() -> None:
    rows, columns = (axis.ravel() for axis in np.indices((4, 4)))
    fine = (np.stack(np.meshgrid(np.arange(200), np.arange(200)), axis=-1).reshape(-1, 2) + 0.5) / 200
    for samples in (2, 3, 4):
        aside, down = pixel_shifts(samples, columns, rows)
        alike = pixel_positions(samples)
        places = (alike + np.stack([aside, down], axis=1)[:, None]) % 1
        errors = []
        for angle in np.linspace(0.013, np.pi, 73):
            across = np.array([np.cos(angle), np.sin(angle)])
            for share in (0.1, 0.35, 0.5, 0.8):
                edge = np.quantile(fine @ across, share)
                errors.append([(each @ across < edge).mean() - share for each in (places, alike)])
        ours, one_grid = np.sqrt(np.mean(np.square(errors), axis=0))
        assert ours < 0.4 * one_grid
        assert ours < 0.15 / samples**2 + 0.01
    assert not np.any(pixel_shifts(1, columns, rows))
