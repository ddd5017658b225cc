"""How like or unlike two images are, and how well two areas of one image stand apart.

Images are (H, W) of any real number type, finite where they count, and computed with in float64. A region (H, W) bool
picks the pixels that count; None is all of them. InputError is raised, one sentence, where a figure would have no
meaning.
"""

from __future__ import annotations

import math
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bools, Doubles
from slopegate.core.rig.checks import require, require_positive

Image = NDArray[Any]

_SIGMA: Final = 1.5
_RADIUS: Final = 5
_K1: Final = 0.01
_K2: Final = 0.03


def ncc(image: Image, reference: Image, region: Bools | None = None) -> float:
    """Zero-mean normalised cross-correlation with a reference, -1..1: 1 is the same picture, whatever gain and offset.

    A constant image shows nothing of the reference: 0. A constant reference is refused.
    """
    first, second = _pair(image, reference, region)
    _require_varied(second, reference.dtype)
    if not _varied(first, image.dtype):
        return 0.0
    first, second = first - first.mean(), second - second.mean()
    # Sums, not dot products: numpy hands those to threads of its own, which wait for each other on a busy machine.
    shared, own, other = ((one * two).sum() for one, two in ((first, second), (first, first), (second, second)))
    return float(np.clip(shared / math.sqrt(float(own * other)), -1.0, 1.0))


def psnr_db(image: Image, reference: Image, peak: float, region: Bools | None = None) -> float:
    """Peak signal to noise ratio, 10 log10(peak^2 / mean square difference), dB; infinite for equal images.

    peak: the greatest value that such images can have.
    """
    require_positive("peak", peak)
    first, second = _pair(image, reference, region)
    square = float(np.mean((first - second) ** 2))
    return 10 * math.log10(peak**2 / square) if square > 0 else math.inf


def ssim(image: Image, reference: Image, peak: float, region: Bools | None = None) -> float:
    """Mean structural similarity, at most 1 (Wang, Bovik, Sheikh and Simoncelli 2004).

    Their conventions: a Gaussian window of 11 x 11 pixels with a deviation of 1.5, weights that add up to 1, variances
    without Bessel's correction, K1 = 0.01, K2 = 0.03, and the mean over the pixels whose window lies inside the image.
    Their reduction of large images to about 256 pixels before is left out. peak: the greatest value that such images
    can have.
    """
    require_positive("peak", peak)
    _pair(image, reference, region)
    height, width = image.shape
    side = 2 * _RADIUS + 1
    allowed = f"at least {side} x {side} pixels, the window of SSIM"
    require(min(height, width) >= side, "image", f"{width} x {height} pixels", allowed)
    inside = (slice(_RADIUS, height - _RADIUS), slice(_RADIUS, width - _RADIUS))
    counted = None if region is None else region[inside]
    allowed = f"with pixels that are {_RADIUS} or more from the image's border"
    require(counted is None or bool(counted.any()), "region", "all border", allowed)

    # With s = x + y and d = x - y: s^2 + d^2 = 2 (x^2 + y^2) and s^2 - d^2 = 4 x y. So one blur of (s, d) and one of
    # (s^2, d^2) give all means and (co)variances.
    first, second = image.astype(np.float64), reference.astype(np.float64)
    both = np.stack([first + second, first - second], axis=2)
    mean = _blurred(both)[inside]
    variance = _blurred(both**2)[inside] - mean**2
    mean_squares = mean**2
    c1, c2 = (_K1 * peak) ** 2, (_K2 * peak) ** 2
    total = (mean_squares.sum(axis=2) / 2 + c1) * (variance.sum(axis=2) / 2 + c2)
    shared = ((mean_squares[..., 0] - mean_squares[..., 1]) / 2 + c1) * ((variance[..., 0] - variance[..., 1]) / 2 + c2)
    similarity = shared / total
    return float(np.mean(similarity if counted is None else similarity[counted]))


def bright_and_dark(reference: Image, region: Bools | None = None) -> tuple[Bools, Bools]:
    """The region's pixels above the mean that the reference has there, and the others, both (H, W) bool.

    On a picture of two tones, a sign or a print, these are the two tones.
    """
    values = _values("reference", reference, region)
    counted = np.ones(reference.shape, bool) if region is None else region
    _require_varied(values, reference.dtype)
    bright = counted & (reference > values.mean())
    return bright, counted & ~bright


def contrast(image: Image, bright: Bools, dark: Bools, black: float = 0.0) -> float:
    """Michelson contrast of two areas, (m_b - m_d) / (m_b + m_d) of their means above black; negative if reversed.

    Of means, for noise must not count as contrast, as it would in the extremes of single pixels or in the deviation
    over a region (RMS contrast). 0 where there is no light above black. Light cannot be negative, so neither mean is
    taken below black, where noise alone can put it.
    """
    high = max(float(_values("image", image, bright).mean()) - black, 0.0)
    low = max(float(_values("image", image, dark).mean()) - black, 0.0)
    return (high - low) / (high + low) if high + low > 0 else 0.0


def contrast_to_noise(first: Image, second: Image, bright: Bools, dark: Bools) -> float:
    """Difference of two areas' means over the standard deviation of a pixel's noise in one image.

    The noise is taken from the difference of two images of the same thing, so texture inside the areas does not count
    as noise. Infinite for two equal images that have a contrast; 0 without any.
    """
    one, two = (np.concatenate([_values("image", image, area) for area in (bright, dark)]) for image in (first, second))
    count = int(np.count_nonzero(bright))
    mean = (one + two) / 2
    apart = abs(float(mean[:count].mean() - mean[count:].mean()))
    noise = float(np.std(one - two)) / math.sqrt(2)
    if noise > 0:
        return apart / noise
    return math.inf if apart > 0 else 0.0


def _pair(image: Image, reference: Image, region: Bools | None) -> tuple[Doubles, Doubles]:
    """The pixels of both that count, (n,)."""
    allowed = f"of the reference's shape {reference.shape}"
    require(image.shape == reference.shape, "image", image.shape, allowed)
    return _values("image", image, region), _values("reference", reference, region)


def _values(name: str, image: Image, region: Bools | None) -> Doubles:
    """The pixels that count, (n,), at least one, all finite."""
    require(image.ndim == 2, name, f"of shape {image.shape}", "one plane of pixels (H, W)")
    allowed = f"of the image's shape {image.shape}"
    require(region is None or region.shape == image.shape, "region", None if region is None else region.shape, allowed)
    values: Doubles = (image.ravel() if region is None else image[region]).astype(np.float64)
    require(values.size > 0, "region", "empty", "at least one pixel of the image")
    strange = int(np.count_nonzero(~np.isfinite(values)))
    require(strange == 0, name, f"not a number in {strange} of {values.size} pixels", "finite in every pixel")
    return values


def _require_varied(values: Doubles, kind: np.dtype[Any]) -> None:
    allowed = "an image with more than one value in the region"
    require(_varied(values, kind), "reference", "constant", allowed)


def _varied(values: Doubles, kind: np.dtype[Any]) -> bool:
    """Whether the values of an image of this type differ by more than its rounding."""
    rounding = 2 * float(np.finfo(kind).eps) * float(np.abs(values).max()) if kind.kind == "f" else 0.0
    return float(np.ptp(values)) > rounding


def _blurred(planes: Doubles) -> Doubles:
    side = 2 * _RADIUS + 1
    return np.asarray(cv2.GaussianBlur(planes, (side, side), _SIGMA), np.float64)
