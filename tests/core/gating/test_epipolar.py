"""A rig whose rows are epipolar: which exposure keeps all direct light, and what is kept by other gates."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import WIDE_LIMITS, bent, check_rig, turned
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.epipolar import MOST_SHARE, NEAREST_M, epipolar_gate, kept
from slopegate.core.gating.gate import (
    complement,
    discrete_weights,
    row_windows,
    slab_if_any,
    upright_line_time,
    weights,
)
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.gating.slices import tile_depths
from slopegate.core.measure.sweep import DepthSweep
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import Renderer
from slopegate.core.rig.axis import no_slab, no_slabs
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import Finish, box, plane, turn
from slopegate.core.search.search import begin
from slopegate.drivers.files.rig_files import load_rig

BESIDE = load_rig("beside")
SMALL = turned(check_rig(64), (0.0, 0.0, 0.0), (-0.1, 0.0, 0.0))
SCENE = Scene(
    "A box before a wall",
    objects=(
        box("box", (0.1, 0.0, 0.9), (0.3, 0.3, 0.3), turn(0, 20, 0), Finish()),
        plane("wall", (0.0, 0.0, 1.6), (3.0, 3.0), turn(10, 0, 0), Finish()),
    ),
)


def upright(rig: Rig, delay_us: float, exposure_us: float) -> GateSettings:
    return gate(upright_line_time(rig), delay_us, exposure_us)


def direct_kept(rig: Rig, settings: GateSettings, samples: int = 1) -> float:
    """Share of the direct light of `SCENE` that a gate keeps."""
    if samples > 1:
        whole = integrate(rig, SCENE, upright(rig, rig.projector.period_us / 2, rig.projector.period_us), samples)
        return float(integrate(rig, SCENE, settings, samples).sum(dtype=float) / whole.sum(dtype=float))
    seen = Renderer(rig, SCENE).at(0.0)[0]
    image = gated(seen.projector_row, seen.direct, seen.ambient, row_windows(rig, settings), 0.0)
    return float(image.sum(dtype=float) / seen.direct.sum(dtype=float))


def test_the_shipped_rig_keeps_all_direct_light_at_delay_0_and_none_in_the_complement() -> None:
    """Not 96 %: that was the share of all light, ambient light included, which a short exposure keeps little of."""
    found = epipolar_gate(BESIDE)
    assert found == upright(BESIDE, 0.0, 100.0)
    assert direct_kept(BESIDE, found) == 1.0
    assert direct_kept(BESIDE, complement(found, BESIDE.projector.period_us)) == 0.0
    assert epipolar_gate(load_rig(None)) is None


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75, 1.0, 1.5])
def test_one_line_time_is_what_all_of_a_pixels_direct_light_takes(share: float) -> None:
    """A camera row's area faces rows that are lit for one line time: less of it keeps as much less."""
    line_us = upright_line_time(SMALL)
    found = direct_kept(SMALL, upright(SMALL, 0.0, share * line_us), samples=8)
    # 8 rays down a pixel, each of which is kept or not
    assert found == pytest.approx(min(share, 1.0), abs=1 / 16)


def test_rows_lit_for_their_whole_time_take_two_row_times_more_at_most() -> None:
    """Discrete rows: every row that a camera row faces is lit for a row time, from before its area to after it."""
    rig, line_us = BESIDE, upright_line_time(BESIDE)
    speed = rig.projector.rows_per_us
    camera_rows = np.arange(rig.camera.lens.height)
    first = np.floor(camera_rows * line_us * speed + 1e-9).astype(int)
    last = np.ceil((camera_rows + 1) * line_us * speed - 1e-9).astype(int) - 1

    def least(exposure_us: float) -> float:
        settings = gate(line_us, 0.0, exposure_us)
        both = [discrete_weights(rig, settings, camera_rows, rows) for rows in (first, last)]
        return float(np.min(both))

    assert least(line_us + 2 / speed) == pytest.approx(1.0, abs=1e-9)
    assert least(2.2 / speed) == pytest.approx(1.0, abs=1e-6)  # these lenses: 5 camera rows to 3 projector rows
    assert least(2.1 / speed) == pytest.approx(0.95, abs=1e-6)


def test_what_gates_keep_is_told_in_rows() -> None:
    def told(delay_us: float, exposure_us: float) -> tuple[float, float, float, float]:
        found = kept(BESIDE, upright(BESIDE, delay_us, exposure_us))
        return found.direct_share, found.some_share, found.low_rows, found.high_rows

    row_us = 1 / BESIDE.projector.rows_per_us
    assert told(0.0, 4 * row_us) == pytest.approx((1.0, 1.0, -2.0, 2.0), abs=1e-6)
    assert told(10 * row_us, 4 * row_us) == pytest.approx((0.0, 0.0, 8.0, 12.0), abs=1e-6)
    assert told(BESIDE.projector.period_us - 10 * row_us, 2 * row_us) == pytest.approx((0, 0, -11, -9), abs=1e-6)
    # another clock crosses the facing row once, from row 0 on
    tilted = kept(BESIDE, gate(upright_line_time(BESIDE) * 1.1, 0.0, 400.0))
    assert 0.05 < tilted.direct_share < 0.2


@given(
    toe_deg=st.floats(-4, 4),
    roll_deg=st.floats(-0.5, 0.5),
    offset=st.tuples(st.floats(0.02, 0.3), st.floats(-3e-4, 3e-4), st.floats(-0.01, 0.01)),
    left=st.booleans(),
    lenses=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_rows_that_are_nearly_epipolar_still_have_a_gate_for_all_direct_light(toe_deg, roll_deg, offset, left, lenses):
    """A projector that is toed in, rolled, or a little above: the gate is longer, and misses nothing."""
    x, y, z = offset
    rig = turned(check_rig(64), (0.0, toe_deg, roll_deg), (-x if left else x, y, z))
    rig = replace(rig, camera=replace(rig.camera, shutter=WIDE_LIMITS))
    rig = bent(rig) if lenses else rig
    found = epipolar_gate(rig)
    if found is None:
        return
    assert found.exposure_us < MOST_SHARE * rig.projector.period_us + 2
    seen = Renderer(rig, SCENE).at(0.0)[0]
    lit = (seen.projector_row >= 0) & (seen.inverse_depth < 1 / NEAREST_M)
    recorded = weights(row_windows(rig, found), seen.projector_row) > 0
    # between the rays of the grid a bent lens may do what the row's margin does not hold
    assert recorded[lit].mean() > 0.999 if lenses else recorded[lit].all()


angles = st.floats(-180, 180) | st.sampled_from([0.0, 90.0, -90.0, 180.0])
places = st.floats(-0.3, 0.3) | st.sampled_from([0.0, 0.1, -0.1, 1e-6, 1e-12])


def posed(degrees: tuple[float, float, float], offset_m: tuple[float, float, float], lenses: bool) -> Rig:
    """A small rig of any pose; rolled about its axis last."""
    x, y, roll = degrees
    spin = cv2.Rodrigues(np.array([0.0, 0.0, np.radians(roll)]))[0] @ cv2.Rodrigues(np.radians([x, y, 0.0]))[0]
    rotation = tuple(tuple(map(float, row)) for row in spin)
    rig = replace(check_rig(48), projector_offset_m=offset_m, projector_rotation=rotation)
    return bent(rig) if lenses else rig


@given(
    degrees=st.tuples(st.floats(-30, 30) | angles, st.floats(-30, 30) | angles, angles),
    offset=st.tuples(places, places, places).filter(lambda offset: math.hypot(*offset) > 1e-6),
    line_us=st.floats(1, 500),
    delay_us=st.floats(-16_000, 33_000),
    exposure_us=st.floats(1, 50_000),
    lenses=st.booleans(),
)
@settings(max_examples=120, deadline=None)
def test_any_pose_gates_and_renders_and_what_needs_a_slab_says_so(
    degrees, offset, line_us, delay_us, exposure_us, lenses
) -> None:
    """Warnings are errors in the tests, so no NaN goes on to anywhere."""
    rig = posed(degrees, offset, lenses)
    asked = gate(line_us, delay_us, exposure_us)
    seen = Renderer(rig, SCENE).at(0.0)[0]
    image = gated(seen.projector_row, seen.direct, seen.ambient, row_windows(rig, asked), 1.0)
    assert np.isfinite(image).all()
    assert image.min() >= 0
    shares = kept(rig, asked)
    assert 0 <= shares.direct_share <= shares.some_share <= 1
    assert shares.low_rows < shares.high_rows
    read = slab_if_any(rig, asked)
    assert (read.slab is None) == bool(read.why)
    if read.slab is not None:
        assert not no_slab(rig, line_us)
        told = (read.slab.tilt_deg, read.slab.B, read.slab.inverse_near_per_m, read.slab.inverse_far_per_m)
        assert np.isfinite(told).all()
    reason = no_slabs(rig)
    assert not reason or read.why == reason
    for needs_slabs in (
        lambda: plan_on_hardware(rig, 0.0, 1.0, 0.1),
        lambda: tile_depths(rig, upright_line_time(rig), 0.5, 2.0, 2),
        lambda: DepthSweep(rig, 0.0),
        lambda: begin(rig),
    ):
        if reason:
            with pytest.raises(InputError) as refused:
                needs_slabs()
            assert str(refused.value) == reason
