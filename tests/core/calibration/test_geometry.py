"""Lenses and pose from views of a chart: the truth is found, and the standard errors are right."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from chart_views import HiddenPair, hidden_pair, point_view, poses
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.chart_scene import held
from slopegate.core.calibration.geometry import ChartView, Geometry, calibrate, with_scale_error
from slopegate.core.rig.calibration import GEOMETRY
from slopegate.core.rig.checks import InputError

CHART = chart_from("9x7:22")
CAMERA, PROJECTOR = (640, 480), (512, 384)
VIEWS = 10


def views_of(pair: HiddenPair, seed: int, noise: int, count: int = VIEWS) -> list[ChartView]:
    rng = np.random.default_rng([seed, noise])
    held = poses(pair, CHART, count, seed)
    return [point_view(pair, CHART, pose, f"pose_{k:02d}", rng) for k, pose in enumerate(held)]


def found_of(views: list[ChartView], held_out: bool = False) -> Geometry:
    return calibrate(views, CAMERA, PROJECTOR, held_out)


def sigmas(cases: range) -> np.ndarray:
    """By how many of its standard errors each number of each hidden pair is missed, (cases, 24)."""
    missed = []
    for seed in cases:
        pair = hidden_pair(seed, CAMERA, PROJECTOR)
        found = found_of(views_of(pair, seed, 1))
        missed.append((found.values - pair.values) / found.standard_errors)
    return np.array(missed)


def test_hidden_pairs_are_found_within_their_standard_errors() -> None:
    missed = sigmas(range(20))
    assert (np.abs(missed) <= 3).mean() >= 0.98
    # neither too small nor too large: 480 numbers, though those of one case hang together
    assert 0.75 <= missed.std() <= 1.25
    assert (missed**2).mean(axis=0).max() < 3.5


@pytest.mark.slow
def test_each_number_alone_is_within_three_standard_errors_in_200_cases() -> None:
    missed = sigmas(range(200))
    within = dict(zip(GEOMETRY, (np.abs(missed) <= 3).mean(axis=0), strict=True))
    assert min(within.values()) >= 0.98, within
    assert (np.abs(missed.std(axis=0) - 1) < 0.2).all()


def test_standard_errors_are_those_of_repeated_noise() -> None:
    """One pair, the same poses, noise anew: what the numbers scatter by is what each fit says they do."""
    pair = hidden_pair(7, CAMERA, PROJECTOR)
    fits = [found_of(views_of(pair, 7, noise)) for noise in range(40)]
    scatter = np.std([fit.values for fit in fits], axis=0, ddof=1)
    told = np.mean([fit.standard_errors for fit in fits], axis=0)
    # forty draws tell a standard deviation to 11 %
    assert np.abs(scatter / told - 1).max() < 0.4
    assert np.median(scatter / told) == pytest.approx(1, abs=0.12)
    together = np.corrcoef(np.array([fit.values for fit in fits]).T)
    covariance = fits[0].covariance
    expected = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    strong = np.abs(expected) > 0.8
    assert np.abs(together - expected)[strong].max() < 0.25


def test_residuals_and_errors_by_view_are_what_the_noise_is() -> None:
    pair = hidden_pair(2, CAMERA, PROJECTOR)
    found = found_of(views_of(pair, 2, 1), held_out=True)
    assert found.camera_rms_px == pytest.approx(0.04 * np.sqrt(2), rel=0.1)
    assert found.projector_rms_px == pytest.approx(0.08 * np.sqrt(2), rel=0.1)
    assert found.rms_px == pytest.approx(np.sqrt((found.camera_rms_px**2 + found.projector_rms_px**2) / 2), rel=1e-3)
    assert [view.name for view in found.views] == [f"pose_{k:02d}" for k in range(VIEWS)]
    assert all(0.05 < view.held_out_px < 0.4 for view in found.views)
    assert found.outliers == ()


def test_a_view_that_does_not_fit_the_others_is_named_and_spoils_the_fit() -> None:
    pair = hidden_pair(3, CAMERA, PROJECTOR)
    views = views_of(pair, 3, 1)
    # as if camera or projector had been knocked before it
    views[4] = replace(views[4], projector=views[4].projector + np.array([1.5, -2.0]))
    found = found_of(views, held_out=True)
    assert found.outliers[0] == "pose_04"
    without = found_of([*views[:4], *views[5:]], held_out=True)
    assert without.outliers == ()
    assert without.projector_rms_px < 0.13 < found.projector_rms_px


def test_a_chart_of_unknown_size_leaves_lengths_unknown_and_nothing_else() -> None:
    found = found_of(views_of(hidden_pair(1, CAMERA, PROJECTOR), 1, 1))
    rough = with_scale_error(found, 0.05)
    grown = np.diag(rough.covariance) - np.diag(found.covariance)
    assert np.all(grown[:21] == 0)
    assert grown[21:] == pytest.approx((0.05 * np.array(found.offset_m)) ** 2)


def test_views_from_one_side_are_refused_and_the_side_is_told() -> None:
    pair = hidden_pair(5, CAMERA, PROJECTOR)
    turn, shift = poses(pair, CHART, 1, 5)[0]
    rng = np.random.default_rng(0)
    views = [
        point_view(pair, CHART, (turn, shift * far), f"pose_{k}", rng) for k, far in enumerate((1.0, 1.1, 1.2, 1.3))
    ]
    with pytest.raises(InputError, match=r"all 4 views show the chart at one angle, tilted by \d+ degrees \(its"):
        found_of(views)


@pytest.mark.parametrize(
    ("right_away", "top_away", "said"),
    [
        (30.0, 0.0, r"tilted by (29|3[01]) degrees \(its right edge (29|3[01]) away from the camera\)"),
        (-25.0, -20.0, r"tilted by 3[0-2] degrees \(its left edge 2[4-6] and its bottom edge 2[1-3] away"),
        (0.0, 0.0, "facing the camera"),
    ],
)
def test_one_pose_again_and_again_is_refused_with_its_angle(right_away: float, top_away: float, said: str) -> None:
    pair = hidden_pair(5, CAMERA, PROJECTOR)
    pose = held(CHART, (0.0, 0.0, 0.5), top_away, right_away)
    turn, shift = cv2.Rodrigues(np.array(pose.rotation))[0].ravel(), np.array(pose.shift_m)
    rng = np.random.default_rng(0)
    views = [point_view(pair, CHART, (turn, shift), f"pose_{k}", rng) for k in range(3)]
    with pytest.raises(InputError, match=f"all 3 views show the chart at one angle and in one place, {said}"):
        found_of(views)


def test_too_few_views_or_corners_are_refused() -> None:
    views = views_of(hidden_pair(5, CAMERA, PROJECTOR), 5, 1, 4)
    with pytest.raises(InputError, match="number of views that can be used is 2: it must be at least 3"):
        found_of(views[:2])
    few = replace(
        views[1], points_m=views[1].points_m[:7], camera=views[1].camera[:7], projector=views[1].projector[:7]
    )
    with pytest.raises(InputError, match="number of corners in pose_01 is 7: it must be at least 8"):
        found_of([views[0], few, *views[2:]])
