"""Standard errors of a swept depth, against rigs that are drawn by their covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import bent, calibrated, check_rig, drawn, turned
from slopegate.core.gating.gate import phase_us, rows_at_phase, upright_line_time
from slopegate.core.measure.depth_errors import ACCURACY, depth_errors, variances
from slopegate.core.measure.sweep import DepthMap
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.calibration import NUMBERS, Calibration
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import LineTimes, gate
from slopegate.core.rig.triangulate import inverse_depth, projector_rows
from slopegate.core.rig.uncertainty import numbers_of, really_made, spread, with_numbers

RIGS = {
    "ideal": check_rig(400),
    "turned": turned(check_rig(400)),
    "bent": bent(turned(check_rig(400))),
    "line times": turned(check_rig(400, LineTimes(1.0, 500.0, 0.25))),
}
LATE = NUMBERS.index("delay_offset_us")


def swept(rig: Rig, seed: int = 3, rows: float = 1.0) -> DepthMap:
    """A map of depths from 0.4 to 3 m, anywhere in the picture, and a few pixels without one."""
    lens, rng = rig.camera.lens, np.random.default_rng(seed)
    inverse = (1 / rng.uniform(0.4, 3.0, (lens.height, lens.width))).astype(np.float32)
    inverse[rng.random(inverse.shape) < 0.05] = 0.0
    none = np.zeros_like(inverse)
    return DepthMap(none, inverse, none, 1, 1, rows, none, none)


def some_pixels(found: DepthMap, count: int = 60) -> tuple[Doubles, Doubles, Doubles]:
    """Columns, rows and inverse depths of some of the known pixels, the corners among them."""
    height, width = found.inverse_depth.shape
    places = np.flatnonzero(found.known.ravel())
    rows, columns = np.unravel_index(np.random.default_rng(5).choice(places, count), (height, width))
    return columns + 0.5, rows + 0.5, found.inverse_depth[rows, columns].astype(np.float64)


def at(values: Singles, columns: Doubles, rows: Doubles) -> Singles:
    return values[rows.astype(int), columns.astype(int)]


def depths_of(believed: Rig, columns: Doubles, rows: Doubles, inverse: Doubles, rig: Rig, late_us: float) -> Doubles:
    """What depth the pixels really have on `rig` whose times were taken for those depths on the believed one."""
    line_us = upright_line_time(believed)
    lit = projector_rows(believed, believed.camera_rays(columns, rows), inverse)
    times = phase_us(believed, line_us, rows, lit)
    really_us = really_made(believed, gate(line_us, 0.0, 100.0), rig, late_us).line_time_us
    really_lit = rows_at_phase(rig, really_us, rows, times + late_us)
    found, met = inverse_depth(rig, rig.camera_rays(columns, rows), really_lit)
    assert met.all()
    return 1 / found


@pytest.mark.parametrize("kind", RIGS)
def test_rigs_that_are_drawn_scatter_by_the_map(kind: str) -> None:
    rig = calibrated(RIGS[kind])
    found = swept(rig)
    errors = depth_errors(rig, found)
    assert errors is not None
    columns, rows, inverse = some_pixels(found)
    count = 800
    scattered = [
        depths_of(rig, columns, rows, inverse, with_numbers(rig, one), float(numbers_of(rig)[LATE] - one[LATE]))
        for one in drawn(rig, count)
    ]
    told = at(errors.rig_m, columns, rows)
    # beyond first order, a depth that is known to a tenth of itself scatters a little more
    near = told < 0.02 / inverse
    assert near.sum() > 20
    np.testing.assert_allclose(told[near], np.std(scattered, axis=0)[near], rtol=4.5 / np.sqrt(2 * count))


@pytest.mark.parametrize("name", NUMBERS)
def test_every_number_has_its_own_share(name: str) -> None:
    """Against the rig drawn anew, number by number."""
    rig = replace(RIGS["bent"], calibration=Calibration((name,), ((1e-10,),)))
    columns, rows, inverse = some_pixels(swept(rig))
    expected = spread(rig, lambda one, late_us: depths_of(rig, columns, rows, inverse, one, late_us))
    assert expected is not None
    found = np.sqrt(variances(rig, columns, rows, inverse)[0]) / inverse**2
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-3 * float(expected.max()) + 1e-12)


@pytest.mark.parametrize("kind", RIGS)
def test_interpolating_costs_what_is_stated(kind: str) -> None:
    rig = calibrated(RIGS[kind])
    found = swept(rig)
    errors = depth_errors(rig, found)
    assert errors is not None
    columns, rows, inverse = some_pixels(found, 3000)
    by_rig, _ = variances(rig, columns, rows, inverse)
    np.testing.assert_allclose(at(errors.rig_m, columns, rows), np.sqrt(by_rig) / inverse**2, rtol=ACCURACY)
    assert np.isnan(errors.rig_m[~found.known]).all()
    assert np.isnan(errors.total_m[~found.known]).all()


def test_the_sweeps_steps_are_an_interval_of_projector_rows() -> None:
    """Pixels that lie anywhere in it scatter by its length over the root of twelve."""
    rig = calibrated(RIGS["bent"])
    found = swept(rig, rows=0.5)
    errors = depth_errors(rig, found)
    assert errors is not None
    columns, rows, inverse = some_pixels(found)
    rays = rig.camera_rays(columns, rows)
    lit = projector_rows(rig, rays, inverse)
    places = np.linspace(-0.25, 0.25, 2001)[:, None]
    anywhere = 1 / inverse_depth(rig, rays, lit + places)[0]
    np.testing.assert_allclose(at(errors.sweep_m, columns, rows), anywhere.std(axis=0), rtol=5e-3)
    both = np.hypot(errors.rig_m, errors.sweep_m)
    np.testing.assert_array_equal(errors.total_m, both)


def test_nodes_beside_the_projector_are_gone_round() -> None:
    """A projector that looks far aside: parts of the picture lie behind it, but none that it lit."""
    rig = calibrated(turned(check_rig(64, height=48), (0.0, -75.0, 0.0), (0.02, -0.11, 0.015)))
    found = swept(rig)
    ahead = found.inverse_depth
    columns, rows = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    by_rig, _ = variances(rig, columns.ravel(), rows.ravel(), ahead.ravel().astype(np.float64))
    seen = np.isfinite(by_rig).reshape(ahead.shape)
    assert 0.1 < seen.mean() < 0.95
    part = replace(found, inverse_depth=np.where(seen, ahead, 0).astype(np.float32))
    errors = depth_errors(rig, part)
    assert errors is not None
    known = part.known
    expected = np.sqrt(by_rig.reshape(ahead.shape)[known]) / ahead[known].astype(np.float64) ** 2
    np.testing.assert_allclose(errors.rig_m[known], expected, rtol=1e-5)


def test_without_a_calibration_or_without_a_depth_there_is_none() -> None:
    rig = check_rig(64)
    assert depth_errors(rig, swept(rig)) is None
    nothing = replace(swept(rig), inverse_depth=np.zeros((48, 64), np.float32))
    errors = depth_errors(calibrated(rig), nothing)
    assert errors is not None
    assert np.isnan(errors.total_m).all()
    one = np.zeros((48, 64), np.float32)
    one[10, 20] = 0.8
    errors = depth_errors(calibrated(rig), replace(nothing, inverse_depth=one))
    assert errors is not None
    assert np.isfinite(errors.total_m[10, 20])
