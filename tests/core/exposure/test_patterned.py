"""Direct light under a projector's picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import LADDER, plain_rig, shutter
from slopegate.core.exposure.patterned import check_pattern, patterned, shares, thrown
from slopegate.core.exposure.sensor import Plates, SensorModel
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks

RASTER = Raster(13, 7)


def picture() -> NDArray[np.float32]:
    return np.random.default_rng(2).uniform(0, 1, (7, 13)).astype(np.float32)


def places(count: tuple[int, ...] = (40, 50)) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows and columns all over the raster up to its last float32, every tenth place unlit."""
    rng = np.random.default_rng(3)
    row, column = (rng.uniform(0, length, count).astype(np.float32) for length in (7, 13))
    row[0, :2], column[0, :2] = np.nextafter(np.float32(7), np.float32(0)), np.nextafter(np.float32(13), np.float32(0))
    unlit = rng.random(count) < 0.1
    row[unlit] = column[unlit] = -1
    return row, column


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


def test_colours_are_lit_alike_and_all_on_is_the_light_itself() -> None:
    row, column = places()
    direct = np.random.default_rng(4).uniform(0, 1, (40, 50, 3)).astype(np.float32)
    lit = patterned(direct, row, column, picture())
    for c in range(3):
        np.testing.assert_array_equal(lit[..., c], patterned(direct[..., c], row, column, picture()))
    assert patterned(direct, row, column, None) is direct


def test_plates_show_what_the_light_of_the_pattern_would_make_of_them() -> None:
    row, column = places()
    direct = np.random.default_rng(4).uniform(0, 3, row.shape).astype(np.float32)
    dark, sensor = np.zeros_like(direct), SensorModel()
    plates = Plates(row, direct, dark, sensor)
    full = plates.planes.direct.copy()
    plates.light_with(direct, column, picture())
    asked = Plates(row, patterned(direct, row, column, picture()), dark, sensor)
    np.testing.assert_array_equal(plates.planes.direct, asked.planes.direct)
    plates.light_with(direct, column, None)
    np.testing.assert_array_equal(plates.planes.direct, full)


def blurred_rig(blur_px: float) -> Rig:
    rig = plain_rig(64, 48, 66.7, shutter(PixelClocks(996.67, LADDER)))
    return replace(rig, projector=replace(rig.projector, blur_px=blur_px))


def test_a_sharp_lens_throws_the_picture_itself_and_a_blurred_one_its_neighbourhood() -> None:
    one = np.zeros((720, 1280), np.float32)
    one[300, 500] = 1
    assert thrown(blurred_rig(0.0), one) is one
    soft = thrown(blurred_rig(1.5), one)
    assert soft.sum() == pytest.approx(1, rel=1e-3)
    rows, columns = np.indices(one.shape)
    spread = np.sqrt((soft * (rows - 300) ** 2).sum()), np.sqrt((soft * (columns - 500) ** 2).sum())
    assert spread == pytest.approx((1.5, 1.5), rel=0.02)
    everything = thrown(blurred_rig(1.5), np.ones_like(one))
    np.testing.assert_allclose(everything, 1, atol=1e-6)


@pytest.mark.parametrize("wrong", [np.ones((13, 7), np.float32), np.ones((7, 13), np.float64)])
def test_a_picture_that_does_not_fit_is_refused(wrong: NDArray[np.float32]) -> None:
    with pytest.raises(ValueError, match="is not one of a projector of 13 x 7 pixels"):
        check_pattern(wrong, RASTER)
    check_pattern(picture(), RASTER)
