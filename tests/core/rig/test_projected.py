"""What a picture on the projector sends where."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from projected_places import RASTER, picture, places
from slopegate.core.rig.projected import check_picture_of, shares


def test_every_place_has_the_light_of_its_own_pixel() -> None:
    row, column = places()
    found, seen = shares(picture(), row, column), picture()
    for index in np.ndindex(row.shape):
        expected = 0 if row[index] < 0 else seen[int(row[index]), int(column[index])]
        assert found[index] == expected


def test_views_of_a_region_are_looked_up_alike() -> None:
    row, column = places()
    whole = shares(picture(), row, column)
    np.testing.assert_array_equal(shares(picture(), row[3:9, 5:20], column[3:9, 5:20]), whole[3:9, 5:20])


@pytest.mark.parametrize("wrong", [np.ones((13, 7), np.float32), np.ones((7, 13), np.float64)])
def test_a_picture_that_does_not_fit_is_refused(wrong: NDArray[np.float32]) -> None:
    with pytest.raises(ValueError, match="is not one of a projector of 13 x 7 pixels"):
        check_picture_of(wrong, RASTER)
    check_picture_of(picture(), RASTER)
