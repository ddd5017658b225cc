"""Figures of regions and lines against the plain definitions."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.measure.region import line_counts, mosaic_parts, region_counts

COUNTS = np.random.default_rng(3).integers(0, 4096, (60, 80)).astype(np.uint16)


@pytest.mark.parametrize("max_count", [4095, 65535])
def test_figures_are_those_of_numpy(max_count: int) -> None:
    counts = COUNTS.copy()
    counts[5:9, 7:12] = max_count
    inside = np.random.default_rng(4).random(counts.shape) < 0.3
    inside[5:9, 7:12] = True
    found, wanted = region_counts(counts, inside, max_count, 100), counts[inside].astype(np.float64)
    assert found is not None
    assert found.pixels == wanted.size
    assert found.mean == pytest.approx(wanted.mean(), rel=1e-12)
    assert found.std == pytest.approx(wanted.std(), rel=1e-9)
    assert (found.least, found.median, found.most) == (wanted.min(), np.median(wanted), max_count)
    assert found.saturated == (wanted == max_count).mean()
    assert found.dark == (wanted <= 100).mean()


def test_no_pixel_has_no_figures_and_all_pixels_need_no_mask() -> None:
    assert region_counts(COUNTS, np.zeros(COUNTS.shape, bool), 4095, 0) is None
    found = region_counts(COUNTS, None, 4095, 0)
    assert found is not None
    assert found.pixels == COUNTS.size
    assert found.mean == pytest.approx(COUNTS.mean())


def test_each_filter_of_a_mosaic_is_measured_by_itself() -> None:
    mosaic = np.zeros((6, 8), np.uint16)
    mosaic[0::2, 0::2], mosaic[0::2, 1::2], mosaic[1::2, 0::2], mosaic[1::2, 1::2] = 10, 20, 22, 30
    inside = np.zeros(mosaic.shape, bool)
    inside[:4] = True
    found = {
        key: region_counts(part, mask, 4095, 0) for key, (part, mask) in mosaic_parts(mosaic, inside, "RGGB").items()
    }
    figures = {key: (one.mean, one.pixels) for key, one in found.items() if one}
    assert figures == {
        "R": (10, 8),
        "G": (21, 16),
        "B": (30, 8),
    }


def test_a_line_along_pixel_centres_gives_their_counts_either_way() -> None:
    row = line_counts(COUNTS, (0.5, 10.5), (79.5, 10.5))
    np.testing.assert_allclose(row, COUNTS[10])
    np.testing.assert_allclose(line_counts(COUNTS, (79.5, 10.5), (0.5, 10.5)), row[::-1])
    np.testing.assert_allclose(line_counts(COUNTS, (3.5, 0.5), (3.5, 59.5)), COUNTS[:, 3])


def test_a_slanted_line_over_a_ramp_is_a_ramp_in_grey_and_in_colour() -> None:
    ramp = (3 * np.arange(80)[None] + 5 * np.arange(60)[:, None]).astype(np.uint16)
    found = line_counts(ramp, (10.5, 10.5), (50.5, 40.5))
    assert len(found) == 51
    np.testing.assert_allclose(found, np.linspace(3 * 10 + 5 * 10, 3 * 50 + 5 * 40, 51))
    colour = np.stack([ramp, 2 * ramp, 3 * ramp], axis=2)
    np.testing.assert_allclose(line_counts(colour, (10.5, 10.5), (50.5, 40.5)), found[:, None] * [1, 2, 3])


def test_a_wide_line_is_the_mean_of_lines_beside_one_another() -> None:
    np.testing.assert_allclose(line_counts(COUNTS, (0.5, 10.5), (79.5, 10.5), 3), COUNTS[9:12].mean(axis=0))


def test_a_line_of_no_length_and_one_beyond_the_image_have_counts() -> None:
    assert line_counts(COUNTS, (4.5, 4.5), (4.5, 4.5)).tolist() == [COUNTS[4, 4]] * 2
    assert line_counts(COUNTS, (80.0, 60.0), (79.0, 60.0)).tolist() == [COUNTS[59, 79]] * 1 + [
        pytest.approx((COUNTS[59, 78] + float(COUNTS[59, 79])) / 2)
    ]
