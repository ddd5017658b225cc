"""The modulation transfer function (MTF) of an imaging system from one image of a slanted straight edge (ISO 12233).

The way of sfrmat3 (Burns 2000; ISO 12233:2000, annex C): where the edge crosses each line is the centroid of the
line's derivative under a Hamming window, a straight line is fitted to these places, all pixels are projected along it
into bins of a quarter pixel, and the derivative of that edge profile is Fourier-transformed under a window.

The last window is the one difference: a Tukey window, as in later editions of ISO 12233, for sfrmat3's Hamming window
narrows the profile of a soft edge: it makes the MTF50 of a Gaussian edge with a deviation of 3 pixels, in a region 64
wide, too large by 2.1 %, this one by 0.2 %. On the edge that sfrmat3 comes with (0.198 cycles per pixel) the two give
0.1976 and 0.1970. Bins average the profile over a quarter pixel, which is not corrected for: 0.4 % at 0.23 cycles per
pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.spread import robust_deviation

METHOD: Final = (
    "ISO 12233 slanted edge: straight-line fit, 4 bins a pixel, Tukey window of taper 0.85; the central difference of "
    "the edge profile is corrected for as in sfrmat3, the width of a bin is not"
)

_BINS: Final = 4
_TAPER: Final = 0.85
"""Share of the Tukey window that falls to 0: less of it narrows soft edges less and lets more noise through."""
_LEAST_SIDE: Final = 16
"""Pixels: a smaller region holds no edge with both of its sides."""
_MARGIN: Final = 4.0
"""Pixels that the edge must stay away from the region's border on every line."""
_MOST_TILT_DEG: Final = 30.0
_MOST_SCATTER: Final = 1.0
"""Pixels. Where single lines put the edge, around the fitted line: more (robust deviation) is no straight edge."""
_MOST_CLIPPED: Final = 0.01


@dataclass(frozen=True, eq=False)
class EdgeMtf:
    """What one edge says of the system that imaged it."""

    frequencies_cy_per_px: Doubles
    """(n,), across the edge, from 0 to 1 cycle per pixel."""
    mtf: Doubles
    """(n,), 1 at frequency 0."""
    mtf50_cy_per_px: float | None
    """Where the curve first falls to a half; None if it does not below 1 cycle per pixel."""
    edge_angle_deg: float
    """Of the edge to the image's columns or rows, whichever it is nearer to; positive turns clockwise on the screen."""
    near: Literal["vertical", "horizontal"]
    """Which of the two it is nearer to."""
    method: str = METHOD


def slanted_edge_mtf(image: NDArray[Any], full_scale: float | None = None) -> EdgeMtf:
    """MTF of the one edge in a region (H, W) of linear light or counts, any real number type.

    full_scale: the greatest value of the sensor; a region with more than 1 % of its pixels there is refused, for
    clipping sharpens an edge. Raises InputError, one sentence, for regions that hold no such edge.
    """
    require(image.ndim == 2, "image", f"of shape {image.shape}", "one plane of pixels (H, W)")
    height, width = image.shape
    size = f"{width} x {height} pixels"
    require(min(height, width) >= _LEAST_SIDE, "region", size, f"at least {_LEAST_SIDE} x {_LEAST_SIDE} pixels")
    values = image.astype(np.float64)
    require(bool(np.isfinite(values).all()), "region", "not a number in places", "finite in every pixel")
    if full_scale is not None:
        clipped = float(np.mean(values >= full_scale))
        allowed = f"less exposed: at most {_MOST_CLIPPED:.0%} of its pixels may be at full scale ({full_scale:g})"
        require(clipped <= _MOST_CLIPPED, "region", f"saturated in {clipped:.1%} of its pixels", allowed)
    upright = _across_columns(values)
    lines = values if upright else values.T
    if lines[:, -1].mean() < lines[:, 0].mean():
        lines = -lines
    slope, offset = _fit_edge(lines)
    profile = _profile(lines, slope, offset)
    frequencies, mtf = _transform(profile, math.cos(math.atan(slope)))
    # With y down, an edge x = slope y + offset leans to the right at its foot: anticlockwise.
    angle = math.degrees(math.atan(slope))
    if upright:
        return EdgeMtf(frequencies, mtf, _half(frequencies, mtf), -angle, "vertical")
    return EdgeMtf(frequencies, mtf, _half(frequencies, mtf), angle, "horizontal")


def _across_columns(values: Doubles) -> bool:
    """Whether the edge is nearer to vertical: whether the light changes more along rows than along columns."""
    along_row = abs(float(values[:, -3:].mean() - values[:, :3].mean()))
    along_column = abs(float(values[-3:].mean() - values[:3].mean()))
    return along_row >= along_column


def _fit_edge(lines: Doubles) -> tuple[float, float]:
    """Slope and offset of the edge x = slope y + offset, dark on its left; pixel k has its centre at k + 0.5."""
    height, width = lines.shape
    rise = np.diff(lines, axis=1)
    places = np.arange(1.0, width)
    rows = np.arange(height) + 0.5
    middles = np.full(height, width / 2)
    slope = offset = scatter = 0.0
    for _ in range(2):  # the second time under a window that follows the edge
        weighted = rise * _hamming(places - middles[:, None], np.maximum(middles, width - middles)[:, None])
        step = weighted.sum(axis=1)
        if not (step > 0).all():
            raise _no_edge()
        crossings = weighted @ places / step
        slope, offset = (float(value) for value in np.polyfit(rows, crossings, 1))
        fitted = slope * rows + offset
        scatter = robust_deviation(crossings - fitted, about=0.0)
        middles = np.clip(fitted, 1.0, width - 1.0)
    if scatter > _MOST_SCATTER:
        raise _no_edge()
    tilt = abs(math.degrees(math.atan(slope)))
    allowed = f"at most {_MOST_TILT_DEG:g} degrees off the image's columns or rows"
    require(tilt <= _MOST_TILT_DEG, "edge angle", round(tilt, 1), allowed)
    nearest = float(np.minimum(fitted, width - fitted).min())
    allowed = f"at least {_MARGIN:g} pixels: choose the region so that the edge crosses its middle"
    require(nearest >= _MARGIN, "distance of the edge from the region's border", round(nearest, 1), allowed)
    travel = abs(slope) * height
    allowed = "at least 1 pixel, so that the edge crosses pixels at every place: tilt it more or take a longer region"
    require(travel >= 1, "sideways travel of the edge through the region", round(travel, 2), allowed)
    return slope, offset


def _no_edge() -> InputError:
    return InputError("the region shows no single straight edge that crosses it from one side to the other")


def _hamming(distance: Doubles, half_width: Doubles) -> Doubles:
    return 0.54 + 0.46 * np.cos(np.pi * np.clip(distance / half_width, -1.0, 1.0))


def _profile(lines: Doubles, slope: float, offset: float) -> Doubles:
    """The edge profile in quarter pixels, 4 W values, the edge in their middle: means of the pixels in each bin."""
    height, width = lines.shape
    # Whole turns of the edge through the pixel grid, so that every place within a pixel counts the same.
    height = round(math.floor(height * abs(slope)) / abs(slope))
    lines = lines[:height]
    away = np.arange(width) + 0.5 - (slope * (np.arange(height) + 0.5) + offset)[:, None]
    count = _BINS * width
    bins: Indices = np.floor(away * _BINS).astype(np.int64) + count // 2
    inside = (bins >= 0) & (bins < count)
    pixels = np.bincount(bins[inside], minlength=count)
    total = np.bincount(bins[inside], lines[inside], count)
    filled = np.flatnonzero(pixels)
    between = pixels[filled[0] : filled[-1] + 1]
    if not between.all():
        raise InputError(
            f"edge angle is {math.degrees(math.atan(slope)):.2f} degrees: the edge crosses pixels at too few different "
            "places, so tilt it a little more or less"
        )
    profile: Doubles = total / np.maximum(pixels, 1)
    profile[: filled[0]], profile[filled[-1] + 1 :] = profile[filled[0]], profile[filled[-1]]
    return profile


def _transform(profile: Doubles, cosine: float) -> tuple[Doubles, Doubles]:
    """Frequencies across the edge in cycles per pixel, up to 1, and the MTF."""
    count = profile.size
    spread = np.zeros(count)
    spread[1:-1] = (profile[2:] - profile[:-2]) / 2
    away = np.abs(np.arange(count) + 0.5 - count / 2) / (count / 2)
    spread *= 0.5 + 0.5 * np.cos(np.pi * np.clip((away - (1 - _TAPER)) / _TAPER, 0.0, 1.0))
    response = np.abs(np.fft.rfft(spread))
    steps = np.arange(response.size)
    # np.sinc(x) is sin(pi x) / (pi x): what the central difference lets through. Not divided beyond a tenth of it.
    response /= np.maximum(np.sinc(2 * steps / count), 0.1)
    # Pixels were projected along the lines: across the edge they lie closer by the cosine of its angle.
    frequencies = steps * _BINS / (count * cosine)
    kept = frequencies <= 1.0
    return frequencies[kept], response[kept] / response[0]


def _half(frequencies: Doubles, mtf: Doubles) -> float | None:
    below = np.flatnonzero(mtf < 0.5)
    if not below.size:
        return None
    i = int(below[0])
    share = (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i])
    return float(frequencies[i - 1] + share * (frequencies[i] - frequencies[i - 1]))
