"""Which rows can record anything, against looking at every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import WIDE_LIMITS, bent, plain_rig, turned
from slopegate.core.gating.gate import (
    Reach,
    RowWindows,
    lit_rows,
    recorded_times,
    row_windows,
    seen_reach,
    weights,
    whole_reach,
)
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate

IDEAL = plain_rig(80, 60, 250 / 3, WIDE_LIMITS)
PERIOD_US = IDEAL.projector.period_us
LEVEL_US = 255.555
RIGS = {"ideal": IDEAL, "turned": turned(IDEAL), "bent": bent(turned(IDEAL))}


@pytest.fixture(params=list(RIGS))
def rig(request: pytest.FixtureRequest) -> Rig:
    return RIGS[request.param]


def projector_rows(rig: Rig, depth_m: float) -> NDArray[np.float32]:
    """(H, W), -1 unlit: a frontal wall at this distance from the origin."""
    lens = rig.camera.lens
    rays = rig.camera_rays(lens.column_centres, lens.row_centres[:, None])
    points = rig.camera_centre_m + rays * (min(depth_m, 1e9) - rig.camera_centre_m[2])
    column, row, ahead = rig.to_projector(points)
    with np.errstate(invalid="ignore"):
        lit = (ahead > 0) & (column >= 0) & (column < 1280) & (row >= 0) & (row < 720)
    return np.where(lit, row, -1).astype(np.float32)


def walls(rig: Rig, near_m: float, far_m: float) -> list[NDArray[np.float32]]:
    return [projector_rows(rig, 1 / w) for w in np.linspace(1 / near_m, max(1 / far_m, 1e-9), 25)]


def joined(reaches: list[Reach]) -> Reach:
    """What any of them reaches."""
    return Reach(np.min([one.low for one in reaches], axis=0), np.max([one.high for one in reaches], axis=0))


def test_rows_that_a_gate_can_light(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    kinds = []
    for _ in range(25 if rig is RIGS["bent"] else 100):
        settings = gate(rng.uniform(60, 900), rng.uniform(-20000, 40000), rng.uniform(20, 6000))
        near_m = rng.uniform(0.3, 2.0)
        far_m = near_m * rng.uniform(1.0, 1.5)
        windows = row_windows(rig, settings)
        scenes = walls(rig, near_m, far_m)
        first, last = lit_rows(windows, joined([seen_reach(rows) for rows in scenes]))
        recorded = np.zeros(rig.camera.lens.height, bool)
        for rows in scenes:
            recorded |= (weights(windows, rows) > 0).any(axis=1)
            exact = np.flatnonzero((weights(windows, rows) > 0).any(axis=1))
            assert lit_rows(windows, seen_reach(rows)) == ((exact[0], exact[-1] + 1) if len(exact) else (0, 0))
        assert not recorded[:first].any()
        assert not recorded[last:].any()
        assert lit_rows(windows, whole_reach(rig))[0] <= first or first == last
        kinds.append((last - first) / len(recorded))
    assert min(kinds) == 0
    assert max(kinds) > 0.9
    assert 0.05 < np.mean(kinds) < 0.9


EDGES = st.integers(0, 6)


@given(
    st.lists(EDGES, min_size=2, max_size=2, unique=True),
    st.sampled_from([(0, 1), (1, 0), (1, 2), (0, 0), (1, 1)]),
    EDGES,
    EDGES,
)
def test_a_range_is_lit_when_one_of_its_points_may_be(
    edges: list[int], times: tuple[int, int], low: int, high: int
) -> None:
    """`lit_rows` holds the law of single points, `recorded_times`, for ranges: no row that counts is left out."""
    window = RowWindows(*(np.array([float(edge)]) for edge in sorted(edges)), *(np.array([n], np.int32) for n in times))
    inside = np.arange(low, high + 0.25, 0.25)
    recorded = bool((recorded_times(window, np.zeros(len(inside), np.int64), inside) > 0).any())
    assert lit_rows(window, Reach(np.array([low * 1.0]), np.array([high * 1.0]))) == ((0, 1) if recorded else (0, 0))


def test_a_long_exposure_lights_all_and_its_complement_counts_too() -> None:
    reach = joined([seen_reach(rows) for rows in walls(IDEAL, 0.5, 2.0)])
    lit = np.flatnonzero(reach.low <= reach.high)
    every = int(lit[0]), int(lit[-1]) + 1
    assert every == (0, 56), "the projector does not reach what the last four rows see, even at 2 m"
    assert lit_rows(row_windows(IDEAL, gate(LEVEL_US, 0.0, 1.2 * PERIOD_US)), reach) == every
    nearly = gate(LEVEL_US, 2000.0, PERIOD_US - 100.0)  # a gap of 100 us, 4.7 projector rows: every row sees beside it
    assert lit_rows(row_windows(IDEAL, nearly), reach) == every


def test_a_steep_slab_lights_half_the_rows() -> None:
    """At half the clock of the upright slab a narrow range of depth crosses it in a part of the rows only."""
    settings = gate(2 * LEVEL_US, -3600.0, 400.0)
    reach = joined([seen_reach(rows) for rows in walls(IDEAL, 0.9, 1.1)])
    first, last = lit_rows(row_windows(IDEAL, settings), reach)
    assert 0 < first < last < 60
    assert last - first < 20
