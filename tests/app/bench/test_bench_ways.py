"""Every way to make a frame that exists for the bench only does what it says."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.app.bench import baselines, edges, number_types, scaling
from slopegate.app.bench.number_types import FramePath, default_path, tile_table
from slopegate.app.bench.number_types import number_types as all_types
from slopegate.app.bench.subject import Subject, make_subject, scaled_rig, to_counts
from slopegate.app.bench.variant import FINE, Variant
from slopegate.core.exposure.edges import make_planes
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

ROUNDING = 0.5 / FINE + 1e-3
LIGHT_STEP = 0.5 / 8
"""Half a step of the program's fixed-point light."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(None)


@pytest.fixture(scope="module")
def subject(rig: Rig) -> Subject:
    rig, scene = open_scene(scene_path("three_targets"), scaled_rig(rig, 200))
    return make_subject("three_targets", rig, scene)


@pytest.fixture(scope="module")
def capture(rig: Rig) -> Subject:
    rig, scene = open_scene(scene_path("aloe"), rig)
    return make_subject("aloe", rig, scene)


def by_name(variants: list[Variant], name: str) -> Variant:
    return next(item for item in variants if item.name == name)


def off(subject: Subject, variant: Variant) -> NDArray[np.float64]:
    assert variant.counts is not None
    return np.array([variant.counts(g) - subject.exact_counts(g) for g in range(len(subject.gates))])


def test_the_exact_rows_round_to_the_program_s_own(subject: Subject) -> None:
    buffers = render(subject.rig, subject.scene)
    row = subject.sight.row
    np.testing.assert_array_equal(row < 0, buffers.projector_row < 0)
    np.testing.assert_allclose(row, buffers.projector_row, atol=3.1e-5)
    assert np.mean(row.astype(np.float32) == buffers.projector_row) > 0.99
    np.testing.assert_allclose(subject.sight.direct, mono(buffers.direct), rtol=1e-6)


def test_gates_cross_what_they_measure(subject: Subject) -> None:
    assert len(subject.gates) == 9
    for index in range(9):
        lit = subject.exact_counts(index) > subject.exact_counts(index).min() + 1
        leaning = index % 3 > 0
        assert (0.01 if leaning else 0) <= lit.mean() < 0.9, index


def test_area_counts_are_those_of_integrate(subject: Subject) -> None:
    pixels = subject.lattice(3000)
    area = subject.area_counts(pixels, 3)
    for index in (0, 4, 8):
        light = mono(integrate(subject.rig, subject.scene, subject.gates[index].settings, 3))
        expected = to_counts(light.reshape(-1)[pixels].astype(np.float64), subject.sensor)
        np.testing.assert_allclose(area.counts[index], expected, atol=2e-3)


def test_the_lattice_covers_columns_and_rows(subject: Subject) -> None:
    pixels = subject.lattice(1000)
    rows, columns = np.divmod(pixels, subject.shape[1])
    assert len(pixels) >= 900
    assert len(np.unique(columns)) == subject.shape[1]
    assert np.ptp(rows) > 0.97 * subject.shape[0]


def test_wide_numbers_are_exact_and_narrow_ones_are_not(subject: Subject) -> None:
    found = number_types.variants(subject)
    assert np.abs(off(subject, by_name(found, "rows as float64"))).max() <= LIGHT_STEP + ROUNDING
    assert np.abs(off(subject, by_name(found, "light as float32"))).max() <= ROUNDING
    halves = np.abs(off(subject, by_name(found, "rows as float16")))
    assert halves.max() > 100
    assert np.mean(halves > 1) < 0.05
    assert np.mean(np.abs(off(subject, by_name(found, "rows as uint16 fixed point"))) > 1) < 1e-3
    sizes = {item.name: item.kept_bytes for item in found}
    assert sizes["rows as float64"] > sizes["rows as float16"]


@pytest.mark.parametrize("index", range(4))
def test_an_edge_lies_where_it_is_said_to(index: int) -> None:
    kind = all_types(720)[index]
    rng = np.random.default_rng(index)
    rows, edge = rng.uniform(0, 720, 20_000), rng.uniform(0, 720, 20_000)
    near = rng.random(20_000) < 0.7
    rows[near] = np.clip(edge[near] + rng.normal(0, 1e-4 if kind.name == "float32" else 0.3, near.sum()), 0, 719.99)
    decided = kind.rows(rows) >= kind.edges(edge)
    drawn = kind.drawn(edge)
    clear = np.abs(rows - drawn) > 1e-9
    np.testing.assert_array_equal(decided[clear], (rows >= drawn)[clear])
    assert decided.mean() == pytest.approx(0.5, abs=0.1)


def test_edges_lie_off_by_what_the_type_holds(subject: Subject) -> None:
    widest = [number_types.edge_error(subject, kind.drawn)[0] for kind in all_types(720)]
    per_row = subject.rig.camera.lens.fy / subject.rig.projector.lens.fy
    assert widest[0] == 0
    assert 0 < widest[1] <= 3.1e-5 * per_row
    assert 0.1 * per_row < widest[2] <= 0.25 * per_row
    assert 0.003 * per_row < widest[3] <= 0.5 / (65535 / 720) * per_row


def test_tiles_are_the_kernel_s_own(subject: Subject) -> None:
    rows = subject.sight.row.astype(np.float32)
    planes = make_planes(rows, subject.sight.direct, subject.sight.ambient)
    low, high = tile_table(rows, rows >= 0)
    np.testing.assert_array_equal(low, planes.tile_low)
    np.testing.assert_array_equal(high, planes.tile_high)


@pytest.mark.parametrize("kind", range(4))
def test_without_tiles_nothing_changes(subject: Subject, kind: int) -> None:
    path = number_types.frame_path(subject, all_types(720)[kind])
    for index in range(9):
        path.run(index)
        skipped = path.out.copy()
        path.without_tiles().run(index)
        np.testing.assert_array_equal(path.out, skipped)


def test_two_threads_make_the_same_frame(subject: Subject) -> None:
    path = default_path(subject)
    with ThreadPoolExecutor(2) as pool:
        for count in (2, 3):
            for index in (0, 5):
                path.run(index)
                alone = path.out.copy()
                path.out[:] = 0
                scaling.threaded(path, pool, count)(index)
                np.testing.assert_array_equal(path.out, alone)


def test_baselines_give_the_same_frame(subject: Subject) -> None:
    for variant in (baselines.plain_numpy(subject), baselines.opencv_only(subject)):
        wrong = np.abs(off(subject, variant))
        assert np.mean(wrong > 0.01) < 1e-5, variant.name


def test_opencv_s_frame_is_numpy_s(subject: Subject) -> None:
    frame = baselines.OpenCvFrame(subject)
    for index in range(9):
        frame.run(index)
        other = baselines.plain_numpy(subject).run(index)
        assert np.mean(frame.frame != other) < 1e-3


def test_casting_every_frame_gives_the_same_frame(subject: Subject) -> None:
    wrong = np.abs(off(subject, baselines.cast_every_frame(subject)))
    assert np.mean(wrong > LIGHT_STEP + ROUNDING) < 1e-5


def test_row_by_row_in_full_is_its_closed_form(rig: Rig) -> None:
    rig, scene = open_scene(scene_path("three_targets"), scaled_rig(rig, 32))
    small = make_subject("small", rig, scene)
    variant = by_name(baselines.row_by_row_variants(small), "row by row")
    assert variant.counts is not None
    rows = range(rig.projector.lens.height)
    for index in (1,):
        gate = small.gates[index]
        light = baselines.row_by_row(rig, scene, gate.settings, rows) + gate.periods * small.sight.ambient
        np.testing.assert_allclose(variant.counts(index), to_counts(light, small.sensor), atol=1e-6)
        total = np.zeros(small.shape)
        baselines.add_rows(gate.windows, small.sight.direct, small.sight.row.astype(np.float32), rows, total)
        np.testing.assert_allclose(total + gate.periods * small.sight.ambient, light, rtol=1e-6, atol=1e-9)
    assert variant.share == 1 / len(rows)


def test_row_by_row_draws_edges_at_whole_rows(subject: Subject) -> None:
    gate = subject.gates[1]
    shares = np.array([baselines.row_weights(gate.windows, row) for row in range(720)])
    widths = shares.sum(axis=0)
    inside = (gate.windows.low > 1) & (gate.windows.high < 719) & (gate.windows.inside == 1)
    assert np.abs(widths - (gate.windows.high - gate.windows.low))[inside].max() <= 1


def slow_trapezoid(path: FramePath, index: int) -> NDArray[np.float64]:
    subject = path.subject
    gate, row = subject.gates[index], subject.sight.row
    reach = subject.rig.projector.lens.fy / subject.rig.camera.lens.fy / 2
    low, high = gate.windows.low[:, None], gate.windows.high[:, None]
    share = np.clip(np.minimum(row + reach, high) - np.maximum(row - reach, low), 0, None) / (2 * reach)
    weight = gate.windows.outside[:, None] + (gate.windows.inside - gate.windows.outside)[:, None] * share
    light = np.where(row < 0, 0, weight) * subject.sight.direct + gate.periods * subject.sight.ambient
    return to_counts(light, subject.sensor)


def test_the_trapezoid_is_the_share_of_a_frontal_pixel(subject: Subject) -> None:
    path, variant = default_path(subject), edges.trapezoid(subject)
    every = np.arange(subject.sight.row.size)
    assert variant.at is not None
    for index in range(9):
        found = variant.at(index, every).reshape(subject.shape)
        np.testing.assert_allclose(found, slow_trapezoid(path, index), atol=LIGHT_STEP + ROUNDING + 0.6)


@pytest.mark.parametrize("count", [2, 8])
def test_sub_rows_are_the_mean_of_their_rays(subject: Subject, count: int) -> None:
    variant, stack = edges.stacked(subject, count), edges.cast_stack(subject, count)
    every = np.arange(subject.sight.row.size)
    assert variant.at is not None
    step = 2.0 * (subject.sensor.max_count + 1) / 65536
    for index in range(9):
        windows = row_windows(subject.rig, subject.gates[index].settings)
        rows = stack.rows.astype(np.float64)
        hit = (rows >= windows.low[:, None, None]) & (rows < windows.high[:, None, None])
        weight = np.where(hit, windows.inside[:, None, None], windows.outside[:, None, None])
        counts = (weight * stack.direct * step).mean(axis=1) + subject.sensor.black_count
        counts += subject.gates[index].periods * subject.sight.ambient * subject.sensor.counts_per_unit
        found = variant.at(index, every).reshape(subject.shape)
        wrong = np.abs(found - np.minimum(counts, subject.sensor.max_count)) > LIGHT_STEP + ROUNDING
        assert wrong.mean() < 1e-4


def test_more_rays_come_nearer_to_the_area(subject: Subject) -> None:
    area = subject.area_counts(subject.lattice(5000), 12)

    def rms(variant: Variant) -> float:
        seen = [
            variant.counts(g).reshape(-1)[area.pixels] if variant.counts else variant.at(g, area.pixels)  # type: ignore[misc]
            for g in range(9)
        ]
        return float(np.sqrt(np.mean((np.array(seen) - np.array(area.counts)) ** 2)))

    hard = rms(by_name(number_types.variants(subject), "cached float32 rows, hard edges"))
    by_rays = [rms(edges.cast_area(subject, count)) for count in (2, 4)]
    assert rms(edges.trapezoid(subject)) < 0.8 * hard
    assert rms(edges.stacked(subject, 4)) < 0.8 * hard
    assert by_rays[1] < 0.5 * by_rays[0] < 0.3 * hard


def test_a_thinned_camera_looks_at_the_whole_scene(subject: Subject, capture: Subject) -> None:
    for item in (subject, capture):
        rig, scene = edges.thinned(item.rig, item.scene, 4)
        buffers = render(rig, scene)
        assert buffers.projector_row.shape == (item.shape[0] // 4, item.shape[1])
        lit = (item.sight.row >= 0).mean()
        assert (buffers.projector_row >= 0).mean() == pytest.approx(lit, abs=0.02)


def test_a_scaled_camera_sees_the_same(rig: Rig, subject: Subject) -> None:
    large = make_subject("large", scaled_rig(subject.rig, 400), subject.scene)
    assert (large.sight.row >= 0).mean() == pytest.approx((subject.sight.row >= 0).mean(), abs=0.01)
    for one, other in zip(subject.gates, large.gates, strict=True):
        assert other.settings.delay_us == pytest.approx(one.settings.delay_us, abs=30)
        assert other.settings.line_time_us == pytest.approx(one.settings.line_time_us / 2, rel=0.01)


def test_clutter_hides_as_much_whatever_its_number(rig: Rig) -> None:
    small = scaled_rig(rig, 160)
    shares = []
    for count in (10, 100, 1000):
        scene = scaling.clutter(count)
        assert len(scene.objects) == count + 1
        shares.append((make_subject("", small, scene).sight.inverse_depth > 1.01 / scaling.WALL_M).mean())
    assert max(shares) < 2 * min(shares)
    assert min(shares) > 0.1


def test_nothing_lit_is_refused(subject: Subject) -> None:
    dark = replace(subject.scene, objects=())
    with pytest.raises(ValueError, match="lights nothing"):
        make_subject("dark", subject.rig, dark)


def test_exponents() -> None:
    assert scaling.exponent([1, 10, 100], [3, 30, 300]) == pytest.approx(1)
    assert scaling.exponent([1, 4, 16], [5, 5, 5]) == pytest.approx(0)
