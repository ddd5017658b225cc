"""The baselines: keying by colour, GrabCut, a clean plate."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.checks import InputError
from slopegate.core.transport.keying import clean_plate, grab_cut, hsv_key

GREEN, RED, GREY = (60, 190, 80), (200, 40, 30), (128, 128, 128)


def patch_before_green(colour: tuple[int, int, int]) -> Bytes:
    photo = np.empty((40, 60, 3), np.uint8)
    photo[:] = GREEN
    photo[10:30, 20:40] = colour
    return photo


@pytest.mark.parametrize(("colour", "kept"), [(RED, 1.0), (GREY, 1.0), ((70, 200, 60), 0.0)])
def test_keying_takes_the_screens_colour_whoever_has_it(colour: tuple[int, int, int], kept: float) -> None:
    alpha = hsv_key(patch_before_green(colour))
    assert (alpha[10:30, 20:40] == kept).all()
    assert not alpha[:10].any()


def test_keys_soften_towards_the_end_of_their_range() -> None:
    """A hue 5 degrees beyond the range is half a screen."""
    photo = np.array([[[255, 204, 51]]], np.uint8)  # hue 45 degrees
    assert hsv_key(photo, (50.0, 100.0))[0, 0] == pytest.approx(0.5, abs=0.02)


def test_grab_cut_finds_what_stands_out_and_finds_it_again() -> None:
    photo = patch_before_green(RED) + np.random.default_rng(0).integers(0, 5, (40, 60, 3)).astype(np.uint8)
    alpha = grab_cut(photo, (15, 5, 45, 35))
    truth = np.zeros((40, 60), np.float32)
    truth[10:30, 20:40] = 1
    assert (alpha == truth).all()
    assert (grab_cut(photo, (15, 5, 45, 35)) == alpha).all()


@pytest.mark.parametrize("box", [(0, 0, 60, 40), (5, 5, 5, 9), (0, 0, 61, 9)])
def test_a_box_needs_an_outside(box: tuple[int, int, int, int]) -> None:
    with pytest.raises(InputError, match="box"):
        grab_cut(patch_before_green(RED), box)


def test_a_clean_plate_shows_what_differs() -> None:
    plate = np.full((2, 3, 3), 0.5, np.float32)
    photo = plate.copy()
    photo[0, 0, 1], photo[1, 2, 2] = 0.9, 0.65
    expected = np.zeros((2, 3), np.float32)
    expected[0, 0], expected[1, 2] = 1, 0.5
    assert np.allclose(clean_plate(photo, plate, 0.1, 0.2), expected, atol=1e-6)
    with pytest.raises(InputError, match="low"):
        clean_plate(photo, plate, 0.2, 0.2)
    with pytest.raises(InputError, match="plate"):
        clean_plate(photo, plate[:1], 0.1, 0.2)
