"""What a frame tells of a keypoint agrees with the gate itself, and planes are found among outliers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import check_rig
from slopegate.core.gating.gate import row_windows, upright_line_time, weights
from slopegate.core.gating.plan import gate_around
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.search.evidence import (
    SOFT_ROWS,
    SPREAD,
    WORST,
    CandidatePlanes,
    Evidence,
    agreeing,
    best_cut,
    frame_of,
    lit_bounds,
    unknown,
    vote,
)

RIG = check_rig(640)
PERIOD = RIG.projector.period_us


@given(line=st.floats(20, 60), delay=st.floats(-16667, 33334), exposure=st.floats(100, 16000), seed=st.integers(0, 999))
def test_bounds_agree_with_the_gate(line: float, delay: float, exposure: float, seed: int) -> None:
    settings = gate(line, delay, exposure)
    camera_rows = np.arange(480)
    ahead = np.random.default_rng(seed).uniform(0, 720, 480)
    recorded = weights(row_windows(RIG, settings), ahead)
    least, most = lit_bounds(RIG, settings, camera_rows + 0.5, ahead)
    assert (least <= recorded).all()
    assert (recorded <= most).all()
    unsure = least < most
    # at most two edges, each unsure by SOFT_ROWS to either side, of a period of 783 rows
    assert unsure.mean() < 5 * 4 * SOFT_ROWS / 783 + 0.05


def test_a_frame_speaks_by_the_square_of_how_far_off_it_is_up_to_a_limit() -> None:
    """Log-likelihood of a normal spread (`SPREAD` and the frame's noise together) where the gate is certain."""
    settings, rows = gate(upright_line_time(RIG), 3000.0, 4000.0), np.array([200.5])
    least, most = lit_bounds(RIG, settings, rows[:, None], np.arange(720) + 0.5)
    dark, lit = (least == most)[0] & (most[0] == 0), (least == most)[0] & (least[0] == 1)
    assert dark.sum() > 300
    assert lit.sum() > 100
    share, noise = np.array([0.7]), np.array([0.2])
    log = Evidence(np.zeros((1, 720), np.float32)).updated(RIG, rows, settings, share, noise).log[0]
    spread = math.hypot(SPREAD, 0.2)
    np.testing.assert_allclose(log[lit].mean() - log[dark].mean(), (0.7**2 - 0.3**2) / 2 / spread**2, rtol=1e-5)
    certain = Evidence(np.zeros((1, 720), np.float32)).updated(RIG, rows, settings, np.array([1.0]), np.array([0.0]))
    assert certain.log[0][lit].max() - certain.log[0][dark].min() == pytest.approx(WORST)


def cut_frame(start_us: float) -> GateSettings:
    return gate(upright_line_time(RIG), start_us + PERIOD / 4, PERIOD / 2)


@pytest.mark.parametrize("clutter", [0.0, 0.3])
def test_cuts_find_a_plane_among_outliers(clutter: float) -> None:
    rng = np.random.default_rng(4)
    columns, rows = rng.uniform(200, 400, 150), rng.uniform(80, 300, 150)
    frame = frame_of(columns, rows, (0.4, 6.0), 3.0)
    where = frame.places(columns, rows)
    true = np.array([380.0, 150.0, -12.0])
    ahead = where @ true
    outside = rng.random(150) < clutter
    ahead[outside] = (where @ (true - [70.0, 20.0, 0.0]))[outside]
    evidence = unknown(np.full(150, 50.0), 720)
    planes: CandidatePlanes | None = None
    for turn in range(14):
        planes = vote(evidence, where, frame, planes, np.random.default_rng(turn))
        start = best_cut(RIG, planes, evidence, where, rows, upright_line_time(RIG))
        settings = cut_frame(start)
        share = lit_exactly(settings, rows, ahead) + rng.normal(0, 0.05, 150)
        evidence = evidence.updated(RIG, rows, settings, share, np.full(150, 0.05))
    assert planes is not None
    found = planes.mean() @ where.T
    assert np.abs(found - where @ true)[~outside].mean() < 2.5
    # a thin gate along the plane shows what does not lie on it
    line_time = planes.mean()[1] / frame.half_height / RIG.projector.rows_per_us
    along = gate_around(RIG, rows - 0.5, found, line_time, keep=1.0)
    along = replace(along, exposure_us=along.exposure_us + 6 / RIG.projector.rows_per_us)
    share = lit_exactly(along, rows, ahead)
    on = agreeing(evidence.updated(RIG, rows, along, share, np.full(150, 0.05)), found)
    assert on[~outside].mean() > 0.9
    assert on[outside].mean() < 0.3 if clutter else True


def lit_exactly(settings: GateSettings, rows: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    start = settings.delay_us - settings.exposure_us / 2
    since = np.mod(ahead / RIG.projector.rows_per_us - start - settings.line_time_us * rows, PERIOD)
    return (since < settings.exposure_us).astype(np.float64)


def test_the_first_cut_halves_what_is_possible() -> None:
    columns, rows = np.full(50, 300.0), np.linspace(100, 200, 50)
    where = frame_of(columns, rows, (0.4, 6.0), 3.0).places(columns, rows)
    line = upright_line_time(RIG)
    # planes of one slope, upright for this line time, evenly over 300 rows
    slope = line * RIG.projector.rows_per_us * 50
    coefficients = np.stack([np.linspace(200, 500, 61), np.full(61, slope), np.zeros(61)], axis=1)
    planes = CandidatePlanes(coefficients, np.full(61, 1 / 61))
    nothing = Evidence(np.zeros((50, 720), np.float32))
    settings = cut_frame(best_cut(RIG, planes, nothing, where, rows, line))
    lit = np.array([lit_exactly(settings, rows, where @ plane).mean() for plane in coefficients])
    assert set(lit.round()) == {0.0, 1.0}
    assert lit.mean() == pytest.approx(0.5, abs=0.03)
