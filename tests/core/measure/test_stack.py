"""What a stack of slices tells: the sum, the overlay's colours, and depth within half a slice."""

from __future__ import annotations

import numpy as np
import pytest

from rigs import FINE_LINES, bent, check_rig, turned
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows
from slopegate.core.gating.slices import occupied_times, tile_times
from slopegate.core.measure.stack import Stack, accumulate, count_above, slice_colours
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.triangulate import triangulate
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn

RIG = check_rig(160, FINE_LINES)
BENT = bent(turned(RIG, (0.0, 0.0, 0.0), (0.01, -0.10, 0.005)), (0.05, -0.02, 0.0, 0.0), (-0.04, 0.01, 0.0, 0.0))
SCENE = Scene(
    "ball and wall",
    objects=(plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn(20.0)), Sphere("ball", (0.1, 0.0, 0.9), 0.2)),
)


@pytest.mark.parametrize("rig", [RIG, BENT], ids=["ideal", "general"])
def test_rows_give_back_the_depth_they_came_from(rig: Rig) -> None:
    buffers = render(rig, SCENE)
    lit = buffers.projector_row >= 0
    assert lit.mean() > 0.5
    found = triangulate(rig, buffers.projector_row)
    assert (found[~lit] == 0).all()
    # float32 rows: 2^-15 of a row near row 500, and 100 rows are one unit of inverse depth
    np.testing.assert_allclose(found[lit], buffers.inverse_depth[lit], atol=2e-5)


@pytest.mark.parametrize("line", [50.0, 127.75, 200.0])
def test_depth_is_right_within_half_a_slice_and_the_sum_is_the_floodlit_image(line: float) -> None:
    buffers = render(RIG, SCENE)
    times = occupied_times(RIG, line, buffers.projector_row)
    assert times is not None
    slices = tile_times(RIG, line, *times, 10)[::-1]
    stack = Stack(RIG, slices, 1e-6)
    direct = 1000 * mono(buffers.direct)
    for item in slices:
        stack.add(gated(buffers.projector_row, direct, np.zeros_like(direct), row_windows(RIG, item), 0.0))
    summary = stack.summary()
    assert (summary.total == direct).all()
    lit = buffers.projector_row >= 0
    assert ((summary.projector_row >= 0) == lit).all()
    half_rows = slices[0].exposure_us / 2 * RIG.projector.rows_per_us
    error = np.abs(summary.projector_row - buffers.projector_row)[lit]
    assert error.max() <= half_rows + 1e-3
    assert error.max() > half_rows / 2
    np.testing.assert_array_equal(summary.inverse_depth > 0, lit & (summary.inverse_depth > 0))
    inverse = np.abs(summary.inverse_depth - buffers.inverse_depth)[lit]
    assert inverse.max() <= half_rows / 100 + 1e-3


def test_the_overlay_has_the_colour_of_the_slice() -> None:
    slices = tile_times(RIG, 50.0, 0.0, 600.0, 3)[::-1]
    stack = Stack(RIG, slices, 1.0)
    for index in range(3):
        light = np.zeros((120, 160), np.float32)
        light[index] = 100.0
        stack.add(light)
    summary = stack.summary()
    for index, colour in enumerate(slice_colours(3)):
        np.testing.assert_allclose(summary.overlay[index], np.broadcast_to(100 * colour, (160, 3)), rtol=1e-6)
    blue, red = slice_colours(3)[0], slice_colours(3)[-1]
    assert blue[2] > blue[0]
    assert red[0] > red[2]


def test_light_in_two_neighbours_lies_between_them_and_dark_pixels_are_unknown() -> None:
    slices = tile_times(RIG, 50.0, 0.0, 600.0, 3)[::-1]
    stack = Stack(RIG, slices, 10.0)
    levels = np.array([[30.0, 5.0, 0.0], [10.0, 9.0, 20.0], [0.0, 0.0, 60.0]], np.float32)
    for row in levels:
        light = np.zeros((120, 160), np.float32)
        light[0, :3] = row
        stack.add(light)
    rows = stack.summary().projector_row
    assert rows[0, 1] == -1
    assert (rows[1:] == -1).all()
    first, second, third = (float(item.delay_us) for item in slices)
    expected = [0.75 * first + 0.25 * second, 0.25 * second + 0.75 * third]
    np.testing.assert_allclose(rows[0, [0, 2]], (np.array(expected) + 25) * RIG.projector.rows_per_us, rtol=1e-6)


def test_slices_out_of_order_are_refused() -> None:
    slices = tile_times(RIG, 50.0, 0.0, 600.0, 3)
    with pytest.raises(ValueError, match="order of their delays"):
        Stack(RIG, slices, 1.0)


def test_accumulate_adds_and_counts_saturation() -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 4096, (20, 30)).astype(np.uint16)
    image[0, :5] = 4095
    total = np.full((20, 30), 7, np.uint32)
    assert accumulate(image, total, 4095) == np.count_nonzero(image == 4095)
    np.testing.assert_array_equal(total, image.astype(np.uint32) + 7)


def test_count_above_compares_each_pixel_with_its_own_floor() -> None:
    image = np.array([[5, 6], [7, 8]], np.uint16)
    floor = np.array([[5.0, 5.5], [7.5, 2.0]], np.float32)
    assert count_above(image, floor) == 2
