"""Which rows can record anything, against looking at every row and depth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.reach import lit_rows, row_reach, seen_reach, whole_reach
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import LineTimes, ShutterLimits, Steps, gate

PERIOD_US = 16666.7
SHUTTER = ShutterLimits(LineTimes(1.0, 2000.0, 0.01), Steps(-40000, 40000, 1), Steps(1, 60000, 1))
IDEAL = ideal_rig(
    RigCamera(Lens(80, 60, 250 / 3, 250 / 3, 40, 30), SHUTTER),
    RigProjector(Lens(1280, 720, 1000, 1000, 640, 360), PERIOD_US),
    0.1,
)
LEVEL_US = 255.555


def turned() -> Rig:
    rotation = np.asarray(cv2.Rodrigues(np.radians([4.0, -3.0, 2.0]))[0])
    return Rig(IDEAL.camera, IDEAL.projector, (0.02, -0.11, 0.015), tuple(map(tuple, rotation.tolist())))  # type: ignore[arg-type]


def bent() -> Rig:
    rig = turned()
    camera = replace(rig.camera, lens=replace(rig.camera.lens, distortion=(-0.21, 0.09, 0.001, -0.002, 0.01)))
    projector = replace(rig.projector, lens=replace(rig.projector.lens, distortion=(-0.08, 0.05, 0.0005, 0.001)))
    return replace(rig, camera=camera, projector=projector)


RIGS = {"ideal": IDEAL, "turned": turned(), "bent": bent()}


@pytest.fixture(params=list(RIGS))
def rig(request: pytest.FixtureRequest) -> Rig:
    return RIGS[request.param]


def projector_rows(rig: Rig, depth_m: float) -> NDArray[np.float32]:
    """(H, W), -1 unlit: a frontal wall at this distance from the origin."""
    lens = rig.camera.lens
    rays = rig.camera_rays(np.arange(lens.width) + 0.5, np.arange(lens.height)[:, None] + 0.5)
    points = rig.camera_centre_m + rays * (min(depth_m, 1e9) - rig.camera_centre_m[2])
    column, row, ahead = rig.to_projector(points)
    with np.errstate(invalid="ignore"):
        lit = (ahead > 0) & (column >= 0) & (column < 1280) & (row >= 0) & (row < 720)
    return np.where(lit, row, -1).astype(np.float32)


def walls(rig: Rig, near_m: float, far_m: float) -> list[NDArray[np.float32]]:
    return [projector_rows(rig, 1 / w) for w in np.linspace(1 / near_m, max(1 / far_m, 1e-9), 25)]


@pytest.mark.parametrize(("near_m", "far_m"), [(0.5, 0.9), (1.0, 1.0), (0.25, np.inf)])
def test_the_reach_holds_every_wall_and_little_else(rig: Rig, near_m: float, far_m: float) -> None:
    reach = row_reach(rig, near_m, far_m)
    found = [seen_reach(rows) for rows in walls(rig, near_m, far_m)]
    low, high = np.min([one.low for one in found], axis=0), np.max([one.high for one in found], axis=0)
    assert (reach.low <= low).all()
    assert (reach.high >= high).all()
    # half a camera row, 6 projector rows, on either side, what lies between two walls, and corners beyond the columns
    slack = 6.1 + 100 * (1 / near_m - 1 / far_m) / 24 + (0 if rig is IDEAL else 30)
    lit = low <= high
    assert lit.sum() > 30
    assert (low[lit] - reach.low[lit]).max() < slack
    assert (reach.high[lit] - high[lit]).max() < slack


def test_rows_that_a_gate_can_light(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    kinds = []
    for _ in range(25 if rig is RIGS["bent"] else 100):
        settings = gate(rng.uniform(60, 900), rng.uniform(-20000, 40000), rng.uniform(20, 6000))
        near_m = rng.uniform(0.3, 2.0)
        far_m = near_m * rng.uniform(1.0, 1.5)
        windows = row_windows(rig, settings)
        first, last = lit_rows(windows, row_reach(rig, near_m, far_m))
        recorded = np.zeros(rig.camera.lens.height, bool)
        for rows in walls(rig, near_m, far_m):
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


def test_a_long_exposure_lights_all_and_its_complement_counts_too() -> None:
    reach = row_reach(IDEAL, 0.5, 2.0)
    lit = np.flatnonzero(reach.low <= reach.high)
    every = int(lit[0]), int(lit[-1]) + 1
    assert every == (0, 56), "the projector does not reach what the last four rows see, even at 2 m"
    assert lit_rows(row_windows(IDEAL, gate(LEVEL_US, 0.0, 1.2 * PERIOD_US)), reach) == every
    nearly = gate(LEVEL_US, 2000.0, PERIOD_US - 100.0)  # a gap of 100 us, 4.7 projector rows: every row sees beside it
    assert lit_rows(row_windows(IDEAL, nearly), reach) == every


def test_a_steep_slab_lights_half_the_rows() -> None:
    """At half the clock of the upright slab a narrow range of depth crosses it in a part of the rows only."""
    settings = gate(2 * LEVEL_US, -3600.0, 400.0)
    first, last = lit_rows(row_windows(IDEAL, settings), row_reach(IDEAL, 0.9, 1.1))
    assert 0 < first < last < 60
    assert last - first < 20


def test_nothing_is_known_of_what_lies_behind_the_projector() -> None:
    away = replace(IDEAL, projector_rotation=((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)))
    assert (row_reach(away, 0.5, 1.0).high >= 0).all()


@pytest.mark.parametrize(
    ("near_m", "far_m"), [(0.0, 1.0), (-1.0, 1.0), (float("nan"), 1.0), (2.0, 1.0), (1.0, float("nan"))]
)
def test_impossible_depths_are_named(near_m: float, far_m: float) -> None:
    with pytest.raises(ValueError, match=r"near_m|far_m"):
        row_reach(IDEAL, near_m, far_m)
