"""Slab, scene and recorded points as the plots get them: arrays."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import bent, calibrated, turned
from slopegate.app.views.slab_geometry import (
    EMPTY_DEPTHS_M,
    MAX_POINTS,
    NO_CLOUD,
    SECTION_POINTS,
    Cloud,
    cloud,
    depth_range,
    dragged,
    extent,
    fit_distance,
    floor_lines,
    gate_picture,
    length,
    read_out,
    recorded,
    remark,
    side_cloud,
    ticks,
    to_plot,
    view_axes,
)
from slopegate.core.gating.gate import row_windows, slab, weights
from slopegate.core.gating.plan import plan
from slopegate.core.gating.slab_mesh import bend_m
from slopegate.core.render.render import Buffers
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.drivers.files.rig_files import load_rig

FLAT_US = 996.66866 / 78
NUMBERS = st.floats(-10, 10)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(None)


def board(rig: Rig, z_m: float) -> Buffers:
    """A white board facing the camera, seen by all pixels, without its lower right quarter."""
    height, width = rig.camera.lens.height, rig.camera.lens.width
    columns, rows = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    points = rig.camera_centre_m + rig.camera_rays(columns, rows) * z_m
    column, row, _ = rig.to_projector(points)
    lit = (row >= 0) & (row < rig.projector.lens.height) & (column >= 0) & (column < rig.projector.lens.width)
    seen = ~((rows > height / 2) & (columns > width / 2))
    return Buffers(
        projector_row=np.where(lit & seen, row, -1).astype(np.float32),
        projector_column=np.where(lit & seen, column, -1).astype(np.float32),
        inverse_depth=np.where(seen, 1 / z_m, 0).astype(np.float32),
        direct=np.repeat((lit & seen)[..., None] / z_m**2, 3, axis=2).astype(np.float32),
        ambient=np.zeros((height, width, 3), np.float32),
    )


def test_plot_axes_are_right_handed_and_up_is_up() -> None:
    right, down, forward = to_plot(np.eye(3))
    np.testing.assert_array_equal(np.cross(right, forward), -down)
    assert down[2] == -1
    assert forward[1] == 1


def test_cloud_lies_on_the_surface_and_leaves_out_what_is_not_there(rig: Rig) -> None:
    points = cloud(rig, board(rig, 1.2))
    assert 0.6 * MAX_POINTS < len(points.positions) <= MAX_POINTS
    np.testing.assert_allclose(points.positions[:, 2], 1.2, rtol=1e-6)
    _, row, _ = rig.to_camera(points.positions)
    np.testing.assert_array_equal(np.floor(row), points.camera_row)
    assert not ((points.positions[:, 0] > 0.01) & (points.positions[:, 1] > rig.camera_centre_m[1] + 0.01)).any()
    assert points.colours.min() >= 0
    assert points.colours.max() <= 1


def test_the_side_view_shows_what_the_picture_shows(rig: Rig) -> None:
    """Off the axis, too; and as large a share of it recorded, to three standard deviations of so many points."""
    buffers, settings = board(rig, 1.2), gate(FLAT_US, 1774, 100)
    points = side_cloud(rig, buffers)
    seen = buffers.inverse_depth > 0
    assert len(points.positions) == pytest.approx(SECTION_POINTS * seen.mean(), rel=0.02)
    at_sides = np.percentile(points.positions[:, 0], (1, 99))
    assert at_sides[0] < -0.3
    in_picture = weights(row_windows(rig, settings), buffers.projector_row) > 0
    share = float(in_picture[seen].mean())
    assert float(recorded(rig, settings, points).mean()) == pytest.approx(share, abs=3 * (0.25 / SECTION_POINTS) ** 0.5)
    # no stripes: nearly every camera row of the picture has a point of its own
    assert np.unique(points.camera_row).size > 0.85 * rig.camera.lens.height


def test_an_unseen_scene_gives_no_points(rig: Rig) -> None:
    empty = Buffers.empty(1200, 1600)
    for points in (cloud(rig, empty), side_cloud(rig, empty)):
        assert len(points.positions) == len(points.colours) == 0
        assert not recorded(rig, gate(FLAT_US, 2000, 500), points).any()


@given(st.floats(3, 100), st.floats(-17000, 33000), st.floats(100, 50000), st.integers(0, 2**31))
def test_recorded_points_are_those_that_the_gate_weighs(
    line_us: float, delay_us: float, exposure_us: float, seed: int
) -> None:
    rig = load_rig(None)
    rng = np.random.default_rng(seed)
    camera_row, projector_row = rng.integers(0, 1200, 200), rng.uniform(-1, 720, 200)
    points = Cloud(np.zeros((200, 3)), np.zeros((200, 3), np.float32), camera_row, projector_row)
    wanted = gate(line_us, delay_us, exposure_us)
    windows = row_windows(rig, wanted)
    table = np.full((1200, 200), -1.0)
    table[camera_row, np.arange(200)] = projector_row
    expected = weights(windows, table)[camera_row, np.arange(200)] > 0
    near_edge = np.minimum(
        np.abs(projector_row - windows.low[camera_row]), np.abs(projector_row - windows.high[camera_row])
    )
    clear = near_edge > 1e-6
    np.testing.assert_array_equal(recorded(rig, wanted, points)[clear], expected[clear])


def test_depths_hold_the_scene_and_default_when_empty(rig: Rig) -> None:
    low, high = depth_range(rig, Scene("none"), NO_CLOUD)
    assert (low, high) == EMPTY_DEPTHS_M
    ball = Scene("ball", objects=(Sphere("ball", (0.0, 0.0, 2.0), 0.5),))
    low, high = depth_range(rig, ball, NO_CLOUD)
    assert low < 1.5
    assert high > 2.5
    low, high = depth_range(rig, ball, cloud(rig, board(rig, 0.8)))
    assert low < 0.8 < high < 1.0
    low, _ = depth_range(rig, ball, cloud(rig, board(rig, 1.7)))
    assert low <= rig.baseline_m  # a slab that waits at 0.6 m is drawn whole
    behind = Scene("behind", objects=(Sphere("ball", (0.0, 0.0, -2.0), 0.5),))
    assert depth_range(rig, behind, NO_CLOUD) == EMPTY_DEPTHS_M


def test_extent_holds_both_fields_of_view(rig: Rig) -> None:
    shown = extent(rig, Scene("none"), NO_CLOUD)
    assert shown.y_min <= -0.05 - 0.36 * shown.z_max + 1e-9
    assert shown.y_max >= 0.05 + 0.36 * shown.z_max - 1e-9


def test_floor_grid_is_flat_and_labelled_in_round_metres(rig: Rig) -> None:
    shown = extent(rig, Scene("none"), cloud(rig, board(rig, 1.2)))
    lines, depths, half = floor_lines(rig, shown)
    assert np.ptp(lines[..., 1]) == 0
    assert depths[0] == 0
    assert depths[-1] <= shown.z_max < depths[-1] + depths[1]
    assert half >= 0.48 * shown.z_max
    assert lines[: len(depths), 0, 2].tolist() == depths.tolist()


@given(st.floats(1e-3, 1e4))
def test_ticks_are_round_and_few(span: float) -> None:
    found = ticks(span)
    step = found[1]
    assert 3 <= len(found) <= 8
    assert found[-1] <= span * (1 + 1e-6)
    leading = step / 10.0 ** np.floor(np.log10(step) + 1e-9)
    assert min(abs(leading - nice) for nice in (1, 2, 5)) < 1e-6


@given(st.floats(-180, 180), st.floats(-90, 90), st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1), st.data())
def test_the_fit_shows_every_point(azimuth: float, elevation: float, points: list[Any], data: st.DataObject) -> None:
    half_width, half_height = data.draw(st.floats(0.1, 1.5)), data.draw(st.floats(0.1, 1.5))
    axes = view_axes(azimuth, elevation)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    at = np.array(points)
    distance = fit_distance(at, axes, half_width, half_height)
    right, up, towards = axes @ at.T
    depth = distance - towards
    assert np.all(np.abs(right) <= half_width * depth + 1e-9)
    assert np.all(np.abs(up) <= half_height * depth + 1e-9)


def test_lengths_read_well() -> None:
    assert [length(v) for v in (0.0123, 1.05, 12.34, 1234.5)] == ["12.3 mm", "1.050 m", "12 m", "1234 m"]


@pytest.mark.parametrize(
    ("delay_us", "exposure_us", "depths", "drawn", "expected"),
    [
        (2028.2, 300, (0.3, 3.0), True, ""),
        (100, 1000, (0.3, 3.0), True, "The slab reaches to infinity."),
        (-300, 300, (0.3, 3.0), False, "The slab lies behind the rig: nothing in front of it is recorded."),
        (500, 100, (0.3, 1.0), False, "The slab lies beyond the scene, from 3.872 m."),
        (2028.2, 300, (2.0, 3.0), False, "The slab lies in front of the scene, up to 1.134 m."),
    ],
)
def test_one_sentence_says_where_a_missing_slab_is(
    rig: Rig, delay_us: float, exposure_us: float, depths: tuple[float, float], drawn: bool, expected: str
) -> None:
    assert remark(slab(rig, gate(FLAT_US, delay_us, exposure_us)), drawn, depths) == expected


def test_read_outs(rig: Rig) -> None:
    found = slab(rig, gate(FLAT_US, 2028.2, 300))
    assert read_out(found) == "distance 1.050 m · thickness 0.156 m · tilt +0.0°"
    assert read_out(found, left_out=True) == "all but distance 1.050 m · thickness 0.156 m · tilt +0.0°"
    beyond = replace(found, distance_m=None, thickness_m=None)
    assert read_out(beyond) == "distance beyond infinity · thickness unlimited · tilt +0.0°"


def test_a_caption_tells_how_well_the_rig_knows_it(rig: Rig) -> None:
    known = calibrated(rig)
    found = slab(known, plan(known, 15.0, 1.05, 0.06))
    assert found.errors is not None
    distance, thickness = found.errors.distance_m, found.errors.thickness_m
    assert distance is not None
    assert thickness is not None
    assert read_out(found) == (
        f"distance 1.0500 ± {distance:.4f} m · thickness 60.00 ± {1000 * thickness:.2f} mm · "
        f"tilt +15.00 ± {found.errors.tilt_deg:.2f}°"
    )


def test_the_read_out_of_a_bent_slab_says_how_it_is_turned_and_bent(rig: Rig) -> None:
    wanted = gate(FLAT_US, 2028.2, 300)
    seen = gate_picture(turned(rig, (0.0, 0.0, 5.0), (0.05, -0.1, 0.0)), wanted, None, (0.3, 2.0))
    found = re.fullmatch(r"distance .* m · thickness .* · tilt .*° · turned ([+-][0-9.]+)°( · bend.*)?\n", seen.caption)
    assert found is not None
    normal = seen.slab.centre.normal if seen.slab else (0.0, 0.0, 1.0)
    assert float(found[1]) == pytest.approx(np.degrees(np.arctan2(normal[0], normal[2])), abs=0.05)
    distorted = gate_picture(bent(rig), wanted, None, (0.3, 2.0))
    by = bend_m(bent(rig), wanted, 0.3, 2.0)
    assert by is not None
    assert f" · bend {length(by)}" in distorted.caption
    assert "bend" not in gate_picture(rig, wanted, None, (0.3, 2.0)).caption


@given(st.floats(-80, 80), st.floats(0.2, 5), NUMBERS, NUMBERS)
def test_a_pulled_slab_goes_through_the_pointer(tilt: float, distance: float, dz: float, dy: float) -> None:
    wish, slope = np.array([tilt, distance, 0.1]), np.tan(np.radians(tilt))
    start = np.array([distance + 0.3 * slope, 0.3])
    now = start + np.array([dz, dy])
    found = dragged(wish, start, now, turning=False)
    through = found[1] + now[1] * slope
    assert through == pytest.approx(now[0]) or found[1] == pytest.approx(0.01 * distance)
    assert (found[0], found[2]) == (tilt, 0.1)


@given(st.floats(-80, 80), st.floats(-80, 80))
def test_a_turned_slab_points_at_the_pointer(before: float, after: float) -> None:
    def at(tilt: float) -> Any:
        return np.array([1.0 + 0.2 * np.tan(np.radians(tilt)), 0.2])

    found = dragged(np.array([before, 1.0, 0.1]), at(before), at(after), turning=True)
    np.testing.assert_allclose(found, [after, 1.0, 0.1], atol=1e-9)
