"""Keypoints are judged where they were found: by their light and by what they look like."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from search_card import speckle
from slopegate.core.search.keypoints import (
    PATCH,
    Keypoints,
    detect,
    light,
    lit,
    matches,
    repeated,
    visible,
    without_ambient,
)

BLACK = 40.0
WHOLE = (0, 0, 512, 384)


def photo(seed: int = 3, gain: float = 1500.0) -> np.ndarray:
    return gain * cv2.resize(speckle(seed)[:, :, 0], (512, 384), interpolation=cv2.INTER_CUBIC).astype(np.float64)


def counts(signal: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noisy = signal + rng.normal(0, np.sqrt(np.maximum(signal, 0) / 2 + 16))
    return np.clip(np.rint(noisy + BLACK), 0, 4095).astype(np.uint16)


@pytest.fixture(scope="module")
def found() -> Keypoints:
    first, second = counts(photo(), 1), counts(photo(), 2)
    return repeated(detect(first, BLACK, WHOLE, 500), first, second)


def test_nearly_all_keypoints_are_seen_again_through_noise(found: Keypoints) -> None:
    assert len(found) > 100
    assert visible(found, counts(photo(), 3), 1.0).mean() > 0.95


def test_a_moved_picture_is_lit_but_not_visible(found: Keypoints) -> None:
    moved = counts(np.roll(photo(), (23, 31), axis=(0, 1)), 4)
    assert lit(found, moved, 1.0).mean() > 0.5
    assert visible(found, moved, 1.0).mean() < 0.02


def test_in_the_dark_nothing_is_lit(found: Keypoints) -> None:
    dark = counts(np.zeros((384, 512)), 5)
    assert not lit(found, dark, 1.0).any()
    assert np.abs(light(found, dark)).max() < 4 * 4 / (2 * PATCH + 1) + 0.5


def test_half_a_picture_shows_the_keypoints_of_that_half(found: Keypoints) -> None:
    half = photo()
    half[:, 256:] = 0
    seen = visible(found, counts(half, 6), 1.0)
    clear = np.abs(found.columns - 256) > 60
    assert seen[clear & (found.columns < 256)].mean() > 0.95
    assert not seen[clear & (found.columns > 256)].any()


def test_ambient_light_is_told_from_the_projectors() -> None:
    direct, ambient = photo(3, 900.0), photo(7, 400.0)
    first, second = counts(direct + ambient, 1), counts(direct + ambient, 2)
    points = without_ambient(
        repeated(detect(first, BLACK, WHOLE, 500), first, second), counts(0.25 * ambient, 3), periods=0.25
    )
    rows, columns = points.rows.astype(int), points.columns.astype(int)
    blurred = cv2.blur(direct, (2 * PATCH + 1, 2 * PATCH + 1))[rows, columns]
    assert np.abs(points.direct - blurred).mean() < 15
    # half the exposure, all of the direct light or none of it
    assert lit(points, counts(direct + 0.5 * ambient, 4), 0.5)[points.direct > 100].mean() > 0.99
    assert not lit(points, counts(0.5 * ambient, 5), 0.5)[points.direct > 100].any()


def test_keypoints_stay_inside_the_target_and_are_spread_over_it() -> None:
    target = (100, 80, 420, 300)
    picture = photo()
    picture[:, 260:] = 300 + 0.5 * picture[:, 260:]  # faint on the right
    points = detect(counts(picture, 1), BLACK, target, 500)
    assert points.columns.min() >= 100
    assert points.columns.max() <= 420
    assert points.rows.min() >= 80
    assert points.rows.max() <= 300
    cells = np.floor((points.columns - 100.5) / 40) + 8 * np.floor((points.rows - 80.5) / 27.5)
    assert np.unique(cells, return_counts=True)[1].max() <= 500 // 64
    assert (points.columns > 280).sum() > 20


def test_noise_of_a_patch_is_measured(found: Keypoints) -> None:
    expected = np.sqrt(found.direct / 2 + 16) / (2 * PATCH + 1)
    assert np.median(found.noise / expected) == pytest.approx(1.0, abs=0.15)


def test_without_keypoints_nothing_matches() -> None:
    none = detect(counts(np.full((384, 512), 500.0), 1), BLACK, WHOLE, 500)
    assert len(none) == 0
    assert matches(none, counts(photo(), 1)).shape == (0,)
