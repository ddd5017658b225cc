"""NCC, PSNR, SSIM and contrasts: against scikit-image and by hand, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from slopegate.core.measure.quality import bright_and_dark, contrast, contrast_to_noise, ncc, psnr_db, ssim
from slopegate.core.rig.checks import InputError

KINDS = [(np.float32, 1.0), (np.uint16, 4095.0), (np.uint8, 255.0)]


def pair(kind: type = np.float32, peak: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth picture, and the same with noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:48, :64]
    picture = 0.5 + 0.3 * np.sin(x / 5) * np.cos(y / 7)
    noisy = np.clip(picture + 0.1 * rng.normal(size=picture.shape), 0, 1)
    return (noisy * peak).astype(kind), (picture * peak).astype(kind)


def region() -> np.ndarray:
    found = np.zeros((48, 64), bool)
    found[10:30, 5:50] = True
    return found


@pytest.mark.parametrize(("kind", "peak"), KINDS)
def test_all_three_agree_with_another_implementation(kind: type, peak: float) -> None:
    image, reference = pair(kind, peak)
    wang = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": peak}
    double = image.astype(np.float64), reference.astype(np.float64)
    mean, similarity = structural_similarity(*double, full=True, **wang)
    assert ssim(image, reference, peak) == pytest.approx(mean, abs=1e-12)
    assert ssim(image, reference, peak, region()) == pytest.approx(similarity[region()].mean(), abs=1e-12)
    assert psnr_db(image, reference, peak) == pytest.approx(peak_signal_noise_ratio(*double, data_range=peak))
    assert ncc(image, reference) == pytest.approx(np.corrcoef(double[0].ravel(), double[1].ravel())[0, 1])
    inside = np.corrcoef(double[0][region()], double[1][region()])[0, 1]
    assert ncc(image, reference, region()) == pytest.approx(inside)


@given(gain=st.floats(0.01, 100), offset=st.floats(-10, 10))
def test_ncc_knows_neither_gain_nor_offset(gain: float, offset: float) -> None:
    image, reference = (plane.astype(np.float64) for plane in pair())
    assert ncc(gain * image + offset, reference) == pytest.approx(ncc(image, reference), abs=1e-9)
    assert ncc(-gain * image + offset, reference) == pytest.approx(-ncc(image, reference), abs=1e-9)


def test_equal_images_are_as_like_as_can_be() -> None:
    image, _ = pair()
    assert ncc(image, image) == 1
    assert psnr_db(image, image, 1.0) == math.inf
    assert ssim(image, image, 1.0) == pytest.approx(1, abs=1e-12)


def test_a_constant_image_shows_nothing_of_the_reference() -> None:
    _, reference = pair()
    for value in (0.0, 0.1, 1e30):
        assert ncc(np.full_like(reference, value), reference) == 0
        with pytest.raises(InputError, match="reference is 'constant'"):
            ncc(reference, np.full_like(reference, value))
        with pytest.raises(InputError, match="reference is 'constant'"):
            bright_and_dark(np.full_like(reference, value))


def test_only_the_region_counts() -> None:
    image, reference = pair()
    elsewhere = ~region()
    spoilt = image.copy()
    spoilt[elsewhere] = np.nan
    assert ncc(spoilt, reference, region()) == ncc(image, reference, region())
    assert psnr_db(spoilt, reference, 1.0, region()) == psnr_db(image, reference, 1.0, region())


def test_what_has_no_meaning_is_refused_in_a_sentence() -> None:
    image, reference = pair()
    holed = image.copy()
    holed[3, 4] = np.nan
    nothing = np.zeros(image.shape, bool)
    border = nothing.copy()
    border[0] = True
    for figure in (ncc, lambda i, r, *a: psnr_db(i, r, 1.0, *a), lambda i, r, *a: ssim(i, r, 1.0, *a)):
        with pytest.raises(InputError, match="image is 'not a number in 1 of 3072 pixels': it must be finite"):
            figure(holed, reference)
        with pytest.raises(InputError, match="reference is 'not a number in 1 of"):
            figure(image, holed)
        with pytest.raises(InputError, match="region is 'empty'"):
            figure(image, reference, nothing)
        with pytest.raises(InputError, match=r"region is \(2, 2\): it must be of the image's shape"):
            figure(image, reference, np.ones((2, 2), bool))
        with pytest.raises(InputError, match=r"image is \(47, 64\): it must be of the reference's shape"):
            figure(image[1:], reference)
        with pytest.raises(InputError, match="one plane of pixels"):
            figure(np.zeros((3, 4, 3)), np.zeros((3, 4, 3)))
    for peak in (0.0, math.nan, -1.0):
        with pytest.raises(InputError, match="peak is"):
            psnr_db(image, reference, peak)
        with pytest.raises(InputError, match="peak is"):
            ssim(image, reference, peak)
    with pytest.raises(InputError, match="at least 11 x 11 pixels"):
        ssim(image[:10], reference[:10], 1.0)
    with pytest.raises(InputError, match="region is 'all border'"):
        ssim(image, reference, 1.0, border)


def test_the_two_tones_of_a_print_are_its_areas() -> None:
    sign = np.full((20, 30), 0.1, np.float32)
    sign[5:12, 8:20] = 0.9
    where = np.ones((20, 30), bool)
    where[:, 25:] = False
    bright, dark = bright_and_dark(sign, where)
    np.testing.assert_array_equal(bright, sign > 0.5)
    np.testing.assert_array_equal(dark, (sign < 0.5) & where)
    assert contrast(sign, bright, dark) == pytest.approx(0.8)
    assert contrast(sign, dark, bright) == pytest.approx(-0.8)
    assert contrast(sign + 0.05, bright, dark, black=0.05) == pytest.approx(0.8)


def test_noise_is_no_contrast_and_texture_no_noise() -> None:
    rng = np.random.default_rng(1)
    texture = rng.uniform(0, 40, (200, 300))
    bright = np.zeros((200, 300), bool)
    bright[:, :150] = True
    light = texture + np.where(bright, 300.0, 200.0)
    first, second = (light + rng.normal(0, 5, light.shape) for _ in range(2))
    assert contrast(first, bright, ~bright) == pytest.approx(100 / 540, rel=0.01)
    assert contrast_to_noise(first, second, bright, ~bright) == pytest.approx(20, rel=0.02)


def test_without_light_or_noise_nothing_is_divided_by_zero() -> None:
    black = np.full((4, 6), 40, np.uint16)
    left = np.zeros((4, 6), bool)
    left[:, :3] = True
    assert contrast(black, left, ~left, black=40.0) == 0
    assert contrast(black, left, ~left, black=41.0) == 0
    assert contrast_to_noise(black, black, left, ~left) == 0
    lit = black + left.astype(np.uint16)
    assert contrast_to_noise(lit, lit, left, ~left) == math.inf
    with pytest.raises(InputError, match="region is 'empty'"):
        contrast(black, left & ~left, left)
