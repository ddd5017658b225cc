"""The slab's corner points against the planes and weights of `gate` and against plain projection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import bent, turned
from slopegate.core.gating.gate import row_windows, slab, weights
from slopegate.core.gating.slab_mesh import (
    Cut,
    Piece,
    bend_m,
    general_piece,
    ideal_piece,
    passes,
    piece_triangles,
    slab_pieces,
    window_rows,
)
from slopegate.core.rig.rig import (
    Lens,
    Rig,
    RigCamera,
    RigProjector,
    camera_rim,
    camera_view,
    ideal_rig,
    projector_rim,
    projector_view,
)
from slopegate.core.rig.settings import GateSettings, LineTimes, ShutterLimits, Steps, gate
from slopegate.core.rig.triangulate import inverse_depth

PERIOD_US = 16666.7
LIMITS = ShutterLimits(LineTimes(0.1, 1e6, 0.1), Steps(-1e6, 1e6, 1), Steps(1, 1e6, 1))
PROJECTOR = RigProjector(Lens(1280, 720, 1000, 1000, 640, 360), PERIOD_US, 0.92)
RIG = ideal_rig(RigCamera(Lens(1600, 1200, 5000 / 3, 5000 / 3, 800, 600), LIMITS), PROJECTOR, 0.10)
FLAT_US = 1000 / (PROJECTOR.rows_per_us * 5000 / 3)
DEPTHS = (0.3, 3.0)

gates = st.builds(
    gate,
    st.floats(0.5, 8.0).map(lambda ratio: ratio * FLAT_US),
    st.floats(-20000, 35000),
    st.floats(50, 16000),
)


def real_rig(distorted: bool) -> Rig:
    """Turned about all axes, moved sideways and forward, lenses distorted or not."""
    moved = turned(RIG, (4.0, -3.0, 1.5), (0.01, -0.11, 0.02))
    bend = (-0.08, 0.02, 0.001, -0.002, 0.0)
    return bent(moved, bend, bend) if distorted else moved


def late_us(rig: Rig, wanted: GateSettings, points: NDArray[np.float64], m: int) -> NDArray[np.float64]:
    """Time from the middle of the exposure of a point's camera row to the instant when pass m lights it."""
    camera_row = rig.to_camera(points)[1]
    projector_row = rig.to_projector(points)[1]
    lit = projector_row / rig.projector.rows_per_us + m * rig.projector.period_us
    return lit - wanted.delay_us - camera_row * wanted.line_time_us


@settings(max_examples=50)
@given(gates)
def test_every_corner_lies_on_a_bound_and_inside_the_others(wanted: GateSettings) -> None:
    tolerance = 1e-6
    for m in passes(RIG, wanted):
        piece = ideal_piece(Cut(RIG, wanted, 1 / DEPTHS[1], 1 / DEPTHS[0], None), m)
        if piece is None:
            continue
        for side, edge, depth in ((piece.far, -1, DEPTHS[1]), (piece.near, 1, DEPTHS[0])):
            late = late_us(RIG, wanted, side, m) / wanted.exposure_us
            column, row, z = RIG.to_projector(side)
            assert np.all(np.abs(late) <= 0.5 + tolerance)
            assert np.all((z >= DEPTHS[0] - tolerance) & (z <= DEPTHS[1] + tolerance))
            assert np.all((row >= -tolerance) & (row <= 720 + tolerance))
            assert np.all((column >= -tolerance) & (column <= 1280 + tolerance))
            on_edge = np.abs(late - edge * 0.5) < tolerance
            on_raster = np.abs(row - (0 if edge < 0 else 720)) < tolerance
            assert np.all(on_edge | on_raster | (np.abs(z - depth) < tolerance))


@settings(max_examples=50)
@given(gates)
def test_surfaces_are_the_planes_of_the_gate(wanted: GateSettings) -> None:
    found = slab(RIG, wanted)
    piece = ideal_piece(Cut(RIG, wanted, 1 / DEPTHS[1], 1 / DEPTHS[0], None), found.frame)
    if piece is None:
        return
    for side, plane, edge in ((piece.far, found.far, -0.5), (piece.near, found.near, 0.5)):
        on_edge = np.abs(late_us(RIG, wanted, side, found.frame) - edge * wanted.exposure_us) < 1e-6
        distance = side[on_edge] @ np.array(plane.normal) - plane.offset_m
        assert np.all(np.abs(distance) < 1e-8)


def test_the_whole_near_surface_is_the_near_plane_where_nothing_cuts_it() -> None:
    wanted = gate(FLAT_US, 2028.2, 300)
    (piece,) = slab_pieces(RIG, wanted, *DEPTHS)
    plane = slab(RIG, wanted).near
    inner = piece.near[:-1]
    assert len(inner) >= 2
    np.testing.assert_allclose(inner @ np.array(plane.normal), plane.offset_m, atol=1e-12)


def test_how_far_a_slab_is_bent_is_what_its_surface_leaves_its_plane_by() -> None:
    wanted = gate(FLAT_US, 2028.2, 300)
    assert bend_m(RIG, wanted, *DEPTHS) == 0
    rig = bent(turned(RIG, (0.0, 0.0, 5.0), (0.05, -0.11, 0.0)), (-0.1, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    plane = slab(rig, wanted).centre
    found = 0.0
    rows = np.linspace(0.5, 1199.5, 120)
    for column in np.linspace(0.5, 1599.5, 80):
        rays = rig.camera_rays(column, rows)
        lit = (wanted.delay_us + rows * wanted.line_time_us) * PROJECTOR.rows_per_us
        points = rig.camera_centre_m + rays / inverse_depth(rig, rays, lit)[0][:, None]
        projected, row, _ = rig.to_projector(points)
        z = points[:, 2] - rig.camera_centre_m[2]
        seen = (z > DEPTHS[0]) & (z < DEPTHS[1]) & (row > 0) & (row < 720) & (projected > 0) & (projected < 1280)
        off = np.abs(points @ np.array(plane.normal) - plane.offset_m)
        found = max(found, float(off.max(where=seen, initial=0.0)))
    assert found > 0.01
    assert bend_m(rig, wanted, *DEPTHS) == pytest.approx(found, rel=0.02)


def between(piece: Piece, rig: Rig, rows: NDArray[np.float64], w: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether inverse depths at camera rows lie in a piece of one column, read by linear interpolation."""
    at = rig.to_camera(piece.far[:, 0])[1]
    low, high = (
        np.interp(rows, at, 1 / (side[:, 0, 2] - rig.camera_centre_m[2]), left=np.nan, right=np.nan)
        for side in (piece.far, piece.near)
    )
    return (low <= w) & (w <= high)


@settings(max_examples=50)
@given(gates, st.integers(0, 2**31))
def test_pieces_hold_exactly_what_the_gate_records(wanted: GateSettings, seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = rng.integers(0, 1200, 300)
    w = rng.uniform(1 / DEPTHS[1], 1 / DEPTHS[0], 300)
    points = RIG.camera_centre_m + RIG.camera_rays(800.0, k + 0.5) / w[:, None]
    row = RIG.to_projector(points)[1]
    lit = np.where((row >= 0) & (row < 720), row, -1)
    table = np.full((1200, 300), -1.0)
    table[k, np.arange(300)] = lit
    recorded = weights(row_windows(RIG, wanted), table)[k, np.arange(300)] > 0
    inside = np.zeros(300, bool)
    for piece in slab_pieces(RIG, wanted, *DEPTHS, column=800.0):
        inside |= between(piece, RIG, k + 0.5, w)
    late = lit / PROJECTOR.rows_per_us - wanted.delay_us - (k + 0.5) * wanted.line_time_us
    edge = np.abs(np.mod(late + PERIOD_US / 2, PERIOD_US) - PERIOD_US / 2)
    clear = np.abs(edge - wanted.exposure_us / 2) > 1e-3
    np.testing.assert_array_equal(inside[clear & (lit >= 0)], recorded[clear & (lit >= 0)])


@settings(max_examples=50)
@given(gates)
def test_the_general_solid_agrees_with_the_exact_one(wanted: GateSettings) -> None:
    cut = Cut(RIG, wanted, 1 / DEPTHS[1], 1 / DEPTHS[0], 800.0)
    for m in passes(RIG, wanted):
        exact, sampled = ideal_piece(cut, m), general_piece(cut, m)
        if exact is None or sampled is None:
            # Slivers thinner than rounding may be kept by one of them only.
            kept = exact or sampled
            assert kept is None or np.ptp(RIG.to_camera(kept.far[:, 0])[1]) < 1e-6
            continue
        rows = [RIG.to_camera(piece.far[:, 0])[1] for piece in (exact, sampled)]
        assert abs(rows[0][0] - rows[1][0]) < 1e-6
        assert abs(rows[0][-1] - rows[1][-1]) < 1e-6
        for side in ("far", "near"):
            w = [1 / getattr(piece, side)[:, 0, 2] for piece in (exact, sampled)]
            np.testing.assert_allclose(np.interp(rows[1], rows[0], w[0]), w[1], atol=1e-7)


coefficients = st.tuples(st.floats(-0.3, 0.2), st.floats(-0.1, 0.1), *(st.floats(-0.002, 0.002),) * 2, st.just(0.0))
angles = st.tuples(*(st.floats(-6, 6),) * 3)
offsets = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.2, -0.08), st.floats(-0.03, 0.03))
straight_rigs = st.builds(lambda turn, move: turned(RIG, turn, move), angles, offsets)
bent_rigs = st.builds(bent, straight_rigs, coefficients, coefficients)


def pieces_of(rig: Rig, wanted: GateSettings) -> list[tuple[int, Cut, Piece]]:
    """The passes that reach in, each with its piece."""
    cut = Cut(rig, wanted, 1 / DEPTHS[1], 1 / DEPTHS[0], None)
    return [(m, cut, piece) for m in passes(rig, wanted) if (piece := general_piece(cut, m)) is not None]


@settings(max_examples=60)
@given(rig=straight_rigs | bent_rigs, wanted=gates)
@example(rig=turned(RIG, (0.0, -6.0, -3.0), (0.03125, -0.125, 0.0)), wanted=gate(2.0 * FLAT_US, 0.0, 50.0))
def test_every_corner_of_a_bent_slab_lies_on_the_law_or_on_a_bound(rig: Rig, wanted: GateSettings) -> None:
    for m, _, piece in pieces_of(rig, wanted):
        thick_m = np.abs(piece.far - piece.near).max(axis=-1)
        held = thick_m > 1e-9
        # each side has its own columns: where the slab is as thin as a hair, one side's row can be the other's by steps
        near_law_us = np.where(thick_m[held] < 1e-3, 0.5, 1e-3)
        for side in (piece.far[held], piece.near[held]):
            z = side[..., 2] - rig.camera_centre_m[2]
            assert np.all((z >= DEPTHS[0] - 1e-9) & (z <= DEPTHS[1] + 1e-9))
            column, row, _ = rig.to_projector(side)
            assert np.all((row >= -1e-3) & (row <= 720 + 1e-3))
            # the ends of the raster are sought by two steps; a strong lens bends them a little on
            assert np.all((column >= -3) & (column <= 1283))
            late = np.abs(late_us(rig, wanted, side, m)) - wanted.exposure_us / 2
            assert np.all(late <= near_law_us)
            on_law, on_raster = late > -1e-3, (row < 1e-3) | (row > 720 - 1e-3)
            assert np.all(on_law | on_raster | (z < DEPTHS[0] + 1e-9) | (z > DEPTHS[1] - 1e-9))


def off_between(cut: Cut, m: int, piece: Piece) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the middles of the drawn cells are off the exact surface, at right angles, as shares of the distance; and
    how large the cells are."""
    rig, found = cut.rig, []
    thick = (piece.far != piece.near).any(axis=-1)
    drawn = thick[:-1, 1:] | thick[1:, :-1] | thick[:-1, :-1] | thick[1:, 1:]
    for side, points in enumerate((piece.far, piece.near)):
        column, row, z = rig.to_camera((points[:-1, 1:] + points[1:, :-1]) / 2)
        rays = rig.camera_rays(column, row)
        edges = np.clip(np.stack(window_rows(rig, cut.settings, row, m)), 0, 720)
        w = np.sort(inverse_depth(rig, rays, edges)[0], axis=0)
        w = np.stack([np.maximum(w[0], cut.w_min), np.minimum(w[1], cut.w_max)])
        normal = np.cross(points[1:, 1:] - points[:-1, :-1], points[1:, :-1] - points[:-1, 1:])
        area = np.maximum(np.linalg.norm(normal, axis=-1), 1e-30)
        off = np.abs((1 / w[side] - z) / z * (normal * rays).sum(axis=-1) / area)
        found.append(np.stack([off, area])[:, drawn & (w[0] < w[1])])
    off, area = np.concatenate(found, axis=1)
    return off, area


@pytest.mark.parametrize(
    ("rigs", "mean", "most"), [(straight_rigs, 1e-3, 0.02), (bent_rigs, 2e-3, 0.05)], ids=["turned", "distorted"]
)
@settings(max_examples=40)
@given(data=st.data())
def test_between_its_corners_a_bent_slab_hardly_leaves_the_law(
    rigs: st.SearchStrategy[Rig], mean: float, most: float, data: st.DataObject
) -> None:
    rig = data.draw(rigs)
    for m, cut, piece in pieces_of(rig, data.draw(gates)):
        off, area = off_between(cut, m, piece)
        if off.size:
            assert off @ area < mean * area.sum()
            assert off.max() < most


@given(st.floats(0, 1600), st.floats(0, 1200), st.floats(0.3, 5), st.booleans())
def test_inverse_depth_undoes_projection(column: float, row: float, z: float, distorted: bool) -> None:
    rig = real_rig(distorted)
    point = rig.camera_centre_m + rig.camera_rays(column, row) * z
    projected = rig.to_projector(point)[1]
    found, met = inverse_depth(rig, rig.camera_rays(column, row), projected)
    assert met
    assert float(found) == pytest.approx(1 / z, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("rig", [RIG, real_rig(False), real_rig(True)], ids=["ideal", "turned", "distorted"])
@pytest.mark.parametrize(
    "wanted",
    [
        gate(FLAT_US, 2028.2, 1e-3),
        gate(FLAT_US, -3000, 100),
        gate(FLAT_US, 1e6, 50),
        gate(FLAT_US, 0, PERIOD_US),
        gate(FLAT_US, 0, 50000),
        gate(FLAT_US, 0, 16400),
        gate(FLAT_US * 1e-6, 5000, 500),
        gate(FLAT_US * 8, 5000, 500),
        gate(FLAT_US * 1e4, 5000, 500),
        gate(FLAT_US, 0, 2 * 1e-9),
    ],
)
def test_odd_gates_give_finite_points_or_nothing(rig: Rig, wanted: GateSettings) -> None:
    for column in (None, 800.0):
        for piece in slab_pieces(rig, wanted, *DEPTHS, column=column):
            assert np.isfinite(piece.far).all()
            assert np.isfinite(piece.near).all()
            assert piece.far.shape == piece.near.shape


def test_a_whole_period_is_the_common_space_as_one_piece() -> None:
    (piece,) = slab_pieces(RIG, gate(FLAT_US, 123, PERIOD_US), *DEPTHS)
    rows = RIG.to_projector(np.stack([piece.far, piece.near]))[1]
    assert piece.far[..., 2].max() == pytest.approx(3.0)
    assert piece.near[..., 2].min() == pytest.approx(0.3)
    assert np.all((rows > -1e-6) & (rows < 720 + 1e-6))


def test_a_slab_behind_the_rig_is_nothing() -> None:
    assert slab_pieces(RIG, gate(FLAT_US, -800, 300), *DEPTHS) == ()


@pytest.mark.parametrize("depths", [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (0.5, float("inf")), (float("nan"), 1.0)])
def test_depths_must_be_an_interval(depths: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="z_max_m is"):
        slab_pieces(RIG, gate(FLAT_US, 2028, 300), *depths)


@pytest.mark.parametrize("rig", [RIG, real_rig(True)], ids=["ideal", "distorted"])
def test_triangles_close_the_solid(rig: Rig) -> None:
    (piece,) = slab_pieces(rig, gate(FLAT_US, 2028.2, 300), *DEPTHS)
    vertices = np.concatenate([piece.far.reshape(-1, 3), piece.near.reshape(-1, 3)])
    _, same = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    edges: dict[tuple[int, int], int] = {}
    for triangle in same.ravel()[piece_triangles(piece)].tolist():
        if len(set(triangle)) == 3:
            for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
                edges[min(a, b), max(a, b)] = edges.get((min(a, b), max(a, b)), 0) + 1
    assert edges
    assert {count % 2 for count in edges.values()} == {0}


@pytest.mark.parametrize("rig", [RIG, real_rig(True)], ids=["ideal", "distorted"])
def test_fields_of_view_end_at_the_corners_of_the_rasters(rig: Rig) -> None:
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    camera, projector = rig.camera.lens, rig.projector.lens
    seen = rig.to_camera(camera_view(rig, 2.0)[1:])
    lit = rig.to_projector(projector_view(rig, 2.0)[1:])
    np.testing.assert_allclose(np.stack(seen[:2], -1), np.array(corners) * [camera.width, camera.height], atol=1e-6)
    np.testing.assert_allclose(
        np.stack(lit[:2], -1), np.array(corners) * [projector.width, projector.height], atol=1e-6
    )
    np.testing.assert_allclose(seen[2], 2.0)
    np.testing.assert_allclose(lit[2], 2.0)


def test_the_rim_of_a_distorted_view_is_the_rim_of_its_raster() -> None:
    rig = real_rig(True)
    for rim, lens, project in (
        (camera_rim(rig, 2.0), rig.camera.lens, rig.to_camera),
        (projector_rim(rig, 2.0), rig.projector.lens, rig.to_projector),
    ):
        column, row, _ = project(rim)
        assert rim.shape[1] > 4
        for seen, wanted in ((row[0], 0), (column[1], lens.width), (row[2], lens.height), (column[3], 0)):
            np.testing.assert_allclose(seen, wanted, atol=1e-6)
        np.testing.assert_allclose(column[0, rim.shape[1] // 2], lens.width / 2, atol=1e-6)
    assert camera_rim(RIG, 2.0).shape == (4, 2, 3)
