"""Light as pictures for the screen."""

from __future__ import annotations

import numpy as np

from slopegate.app.widgets.light_pictures import colour_picture, grey_picture, peaks_picture, shown_picture, white_level


def test_light_of_the_white_level_is_white_and_small_pictures_stay() -> None:
    dark = np.zeros((6, 8), np.float32)
    assert white_level(dark) == 1.0
    assert white_level(dark + np.float32(0.25)) == 0.25
    bright = grey_picture(dark + 5, 5.0, 4)
    assert bright.shape == (3, 4, 3)
    assert (bright == 255).all()
    assert colour_picture(np.stack([dark, dark + 1, dark], axis=2), 1.0, 800).tolist() == [[[0, 255, 0]] * 8] * 6


def test_a_single_lit_pixel_is_white_however_small_the_picture() -> None:
    light = np.zeros((33, 50), np.float32)
    light[32, 49] = 1e-6
    picture = peaks_picture(light, 10)
    assert picture.shape == (7, 10, 3)
    assert (picture[-1, -1] == 255).all()
    assert picture.sum() == 3 * 255
    assert not peaks_picture(np.zeros((4, 4), np.float32), 10).any()


def test_what_is_shown_already_is_only_made_smaller() -> None:
    grey = np.array([[10, 20], [30, 40]], np.uint8)
    assert shown_picture(grey, 2).tolist() == [[[10] * 3, [20] * 3], [[30] * 3, [40] * 3]]
    assert shown_picture(grey, 1).tolist() == [[[25] * 3]]
