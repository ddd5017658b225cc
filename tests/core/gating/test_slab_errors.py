"""Standard errors of a slab in closed form, against the rig drawn anew number by number, and drawn at random."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import ERRORS, FINE_LINES, bent, calibrated, check_rig, drawn, turned
from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan
from slopegate.core.gating.slab_errors import SlabErrors
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS, Calibration
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.uncertainty import numbers_of, really_made, spread, with_numbers

EIGHT = (-0.21, 0.09, 0.001, -0.002, 0.01, 0.02, -0.03, 0.01)
RIGS = {
    "ideal": check_rig(1600),
    "turned": turned(check_rig(1600)),
    "bent": bent(turned(check_rig(1600))),
    "bent with further coefficients": bent(turned(check_rig(1600)), EIGHT),
    "line times": turned(check_rig(1600, FINE_LINES)),
}
NAMES = [one.name for one in fields(SlabErrors)]


def read_outs(believed: Rig, gate: GateSettings, rig: Rig, late_us: float) -> Doubles:
    found = slab(rig, really_made(believed, gate, rig, late_us))
    return np.array([getattr(found, name) for name in NAMES], np.float64)


@settings(max_examples=30, deadline=None)
@given(
    kind=st.sampled_from(sorted(RIGS)),
    tilt=st.floats(-50, 50),
    distance=st.floats(0.5, 3.0),
    thickness=st.floats(0.01, 0.1),
    frame=st.integers(-1, 1),
    seed=st.integers(0, 1000),
)
def test_the_closed_form_is_the_rig_drawn_anew(
    kind: str, tilt: float, distance: float, thickness: float, frame: int, seed: int
) -> None:
    small = tuple(error / 100 for error in ERRORS)  # so that first order is all there is
    rig = calibrated(RIGS[kind], small, seed)
    gate = plan(rig, tilt, distance, thickness * distance)
    gate = replace(gate, delay_us=gate.delay_us + frame * rig.projector.period_us)
    expected = spread(rig, lambda one, late_us: read_outs(rig, gate, one, late_us))
    found = slab(rig, gate).errors
    assert found is not None
    assert expected is not None
    np.testing.assert_allclose([getattr(found, name) for name in NAMES], expected, rtol=2e-3)


@pytest.mark.parametrize("name", NUMBERS)
def test_every_number_has_its_own_share(name: str) -> None:
    rig = replace(RIGS["bent with further coefficients"], calibration=None)
    gate = plan(rig, 20.0, 1.2, 0.1)
    gate = replace(gate, delay_us=gate.delay_us + rig.projector.period_us)
    known = replace(rig, calibration=Calibration((name,), ((1e-10,),)))
    expected = spread(known, lambda one, late_us: read_outs(rig, gate, one, late_us))
    found = slab(known, gate).errors
    assert expected is not None
    scale = expected[0] + 1e-9
    np.testing.assert_allclose([getattr(found, one) for one in NAMES], expected, rtol=1e-3, atol=1e-4 * scale)


def test_rigs_that_are_drawn_scatter_as_much() -> None:
    rig = calibrated(RIGS["turned"])
    gate = plan(rig, 15.0, 1.05, 0.1)
    found, count, late = slab(rig, gate).errors, 800, NUMBERS.index("delay_offset_us")
    scattered = np.array(
        [
            read_outs(rig, gate, with_numbers(rig, one), float(numbers_of(rig)[late] - one[late]))
            for one in drawn(rig, count)
        ]
    ).std(axis=0)
    np.testing.assert_allclose([getattr(found, name) for name in NAMES], scattered, rtol=4 / np.sqrt(2 * count))


def test_what_has_no_value_has_no_error() -> None:
    rig = calibrated(RIGS["turned"])
    gate = plan(rig, 0.0, 1.0, 0.1)
    endless = replace(gate, exposure_us=6000.0)
    found = slab(rig, endless)
    assert found.far_m is None
    assert found.near_m is not None
    errors = found.errors
    assert errors is not None
    assert (errors.far_m, errors.thickness_m) == (None, None)
    assert errors.near_m is not None
    assert errors.near_m > 0
    plain = replace(rig, calibration=None)
    assert slab(plain, gate).errors is None
