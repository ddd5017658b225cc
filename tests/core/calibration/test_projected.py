"""A corner's place in the projector from the decoded pixels round it."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.calibration.projected import projected


def decoded(shape: tuple[int, int], whole: bool) -> tuple[np.ndarray, np.ndarray]:
    """Places that a homography gives to pixels, to whole pixels and a half where asked; and the homography."""
    matrix = np.array([[0.5, 0.06, 30.0], [-0.04, 0.55, 12.0], [1e-4, 2e-4, 1.0]])
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    across = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ matrix.T
    place = across[..., :2] / across[..., 2:]
    return (np.floor(place) + 0.5 if whole else place).astype(np.float32), matrix


def at(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    across = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return across[:, :2] / across[:, 2:]


POINTS = np.array([[30.2, 40.7], [61.5, 22.1], [75.9, 70.3]])


@pytest.mark.parametrize(("whole", "within"), [(False, 1e-4), (True, 0.06)])
def test_corners_are_placed_far_below_a_pixel(whole: bool, within: float) -> None:
    place, matrix = decoded((100, 110), whole)
    found = projected(POINTS, place, 14)
    assert np.abs(found.points - at(matrix, POINTS)).max() < within
    assert (found.error_px <= (0.42 if whole else 1e-4)).all()


def test_pixels_that_are_wrong_do_not_count() -> None:
    place, matrix = decoded((100, 110), whole=True)
    rng = np.random.default_rng(0)
    wrong = rng.uniform(size=place.shape[:2]) < 0.1
    place[wrong] += rng.uniform(20, 60, (int(wrong.sum()), 2)).astype(np.float32)
    place[rng.uniform(size=place.shape[:2]) < 0.3] = np.nan
    found = projected(POINTS, place, 14)
    assert np.abs(found.points - at(matrix, POINTS)).max() < 0.15


def test_a_corner_with_nothing_to_one_side_has_no_place() -> None:
    place, _ = decoded((100, 110), whole=True)
    place[:, 30:] = np.nan
    found = projected(POINTS, place, 14)
    assert np.isnan(found.points).all()
    assert np.isnan(found.error_px).all()


def test_a_bent_lens_does_not_shift_corners() -> None:
    """A large sensor's pixels about a corner at the side of the picture, seen by a lens that bends 0.12 r^2."""
    focal, shape = 1600.0, (200, 200)
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5

    def bent(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = x / focal + 0.4, y / focal + 0.3
        return np.stack([x, y], axis=-1) * (1 + 0.12 * (x * x + y * y))[..., None] * 1000.0

    corners = np.array([[99.3, 100.4], [80.8, 110.1]])
    found = projected(corners, bent(columns, rows).astype(np.float32), 40)
    assert np.abs(found.points - bent(*corners.T)).max() < 2e-3
