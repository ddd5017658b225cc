"""How sharp the projector's picture is, from the Gray code that was taken anyway: fine stripes lose contrast by blur.

A stripe pattern less its inverse is a square wave of +-1 times the direct light. A Gaussian blur of s pixels leaves of
stripes w pixels wide the mean amount

    C(s, w) = 8 / pi^2  SUM over odd k of exp(-pi^2 s^2 k^2 / (2 w^2)) / k^2,

which is 1 without blur: s follows from how the amounts of stripes of 2, 4, 8 and 16 pixels compare. What the camera's
own blur adds is known from the chart's printed edges and is taken off, in squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.calibration.codes import FINE_PX, CodeOrder, Decoded
from slopegate.core.rig.arrays import Bools, Bytes, Counts, Doubles, Singles
from slopegate.core.rig.spread import robust_deviation

TEN_TO_NINETY: Final = 2.563
"""Width of a blurred edge from 10 to 90 %, in standard deviations of the Gaussian that blurred it."""
OF_INTERPOLATION: Final = 0.23
"""Square of the blur, in pixels of the camera, that an edge shows by being read between pixels."""
EDGE_SHARE: Final = 0.05
"""How well the square of the camera's own blur is known."""
PIXEL: Final = 1 / 12
"""Square of the blur that the area of a pixel of the camera is; how much of it edges and stripes share is not known."""
LEAST_SNR: Final = 20.0
"""Direct light over noise, of pixels that count: of darker ones noise alone would leave stripes an amount."""
MOST_BLUR_PX: Final = 1.2
"""Of the projector, before it is asked to be focused: the finest stripes keep 15 % then."""
MAP: Final = (6, 8)
"""Fields of the map, down and across the camera's picture."""
LEAST_PIXELS: Final = 200
"""In a field: fewer do not hold all phases of a stripe."""
_MOST_BLUR_PX: Final = 12.0
_LEAST_BLUR_PX: Final = 0.2
_STEP: Final = 0.01
_MOST_READ: Final = 500_000
"""Pixels of the camera that are looked at, more or less."""
_SPAN: Final = 12
"""Pixels of the camera over which the projector's pixels are counted."""
_TERMS: Final = 200
_PARTS: Final = 10
"""Of the picture, each left out once to see how sure the result is."""


@dataclass(frozen=True, eq=False)
class Focus:
    """How sharp the stripes of a pose are, of columns and of rows.

    blur_px: standard deviation of the projector's blur in its pixels, its camera's taken off; standard_errors: theirs.
    camera_px: the camera's blur in the projector's pixels. blur_map (2, 6, 8) float64: the same over the camera's
    picture, NaN where too little of the code is seen.
    """

    blur_px: tuple[float, float]
    standard_errors: tuple[float, float]
    camera_px: tuple[float, float]
    blur_map: Doubles

    @property
    def mean_px(self) -> float:
        """One blur for both directions."""
        return float(np.sqrt(np.mean(np.square(self.blur_px))))

    @property
    def standard_error(self) -> float:
        """That of `mean_px`."""
        return float(np.mean(self.standard_errors))


def contrast(blur_px: Doubles, stripe_px: Doubles) -> Doubles:
    """What is left of the mean amount of stripes, 0 to 1 (broadcast)."""
    odd = np.arange(1, 2 * _TERMS, 2, dtype=np.float64)
    ratio = np.asarray(blur_px / stripe_px, np.float64)[..., None]
    return np.asarray(8 / np.pi**2 * (np.exp(-0.5 * (np.pi * ratio * odd) ** 2) / odd**2).sum(axis=-1), np.float64)


def focus(order: CodeOrder, frames: Bytes | Counts, decoded: Decoded, edge_px: float = 0.0) -> Focus | None:
    """The projector's blur from the frames (count, H, W) of a code; None where too little of it is seen.

    edge_px: width of a sharp printed edge in the camera's picture, 10 to 90 %, as of `ChartSight`; NaN: not known, and
    nothing is taken off. On rendered rigs within 0.1 pixels of the truth for blurs of 0.4 to 2, where the camera's own
    is no larger.
    """
    step = max(1, round((decoded.direct.size / _MOST_READ) ** 0.5))
    thin = (slice(None, None, step), slice(None, None, step))
    direct, noise, place = decoded.direct[thin], decoded.noise[thin], decoded.place[thin]
    seen = (direct > LEAST_SNR * noise) & (direct > 1)
    if int(seen.sum()) < LEAST_PIXELS:
        return None
    light = np.where(seen, direct, np.float32(1))
    camera_px = float(np.sqrt(max((edge_px / TEN_TO_NINETY) ** 2 - OF_INTERPOLATION, 0.0))) if edge_px > 0 else 0.0
    found = []
    for axis, bits in enumerate(order.bits):
        first = (order.first_column, order.first_row)[axis]
        stripes = {bit: 1 << (bits - bit) for bit in range(bits) if 1 << (bits - bit) <= FINE_PX}
        gaps = [_gap(frames[first + 2 * bit][thin], frames[first + 2 * bit + 1][thin]) for bit in stripes]
        amounts = np.stack([_sums(np.where(seen, gap / light, np.float32(0))) for gap in gaps])
        scale = _medians(_pixels_per_pixel(place[..., axis], max(1, _SPAN // step)) / step)
        found.append(_along(amounts, _sums(seen), np.array([*stripes.values()], np.float64), camera_px, scale))
    columns, rows = found
    if columns is None or rows is None:
        return None
    return Focus(
        (columns.blur_px, rows.blur_px),
        (columns.standard_error, rows.standard_error),
        (columns.camera_px, rows.camera_px),
        np.stack([columns.fields, rows.fields]),
    )


@dataclass(frozen=True, eq=False)
class _Along:
    blur_px: float
    standard_error: float
    camera_px: float
    fields: Doubles


def _along(amounts: Doubles, counts: Doubles, stripes: Doubles, camera_px: float, scale: Doubles) -> _Along | None:
    """The blur across the stripes of one axis, from their amounts (S, rows, columns) in fields of so many pixels.

    camera_px: the camera's blur in its own pixels; scale (rows, columns): how many of the projector's one of them is,
    NaN where the code cannot be read.
    """
    known = counts >= LEAST_PIXELS
    if not known.any() or len(stripes) < 2:
        return None
    usual = float(np.median(told)) if (told := scale[np.isfinite(scale)]).size else 0.0
    own = camera_px * np.where(np.isfinite(scale), scale, usual)
    fields = _less(_fitted(amounts.reshape(len(stripes), -1), stripes).reshape(known.shape), own)
    kept = amounts[:, known]
    of_camera = float(np.sqrt(np.average(own[known] ** 2, weights=counts[known])))
    blur = float(_less(_fitted(kept.sum(axis=1)[:, None], stripes), of_camera)[0])
    part = np.arange(kept.shape[1]) % _PARTS
    left = _fitted(np.stack([kept[:, part != one].sum(axis=1) for one in np.unique(part)], axis=1), stripes)
    spread = float(np.sqrt((left.size - 1) / left.size * np.sum((left - left.mean()) ** 2))) + _STEP / 2
    total = float(np.hypot(blur, of_camera))
    # both in squares: what the camera's blur is off by weighs the more, the larger its part is
    squares = np.array([2 * total * spread, EDGE_SHARE * of_camera**2, PIXEL * usual**2 if camera_px else 0.0])
    error = np.sqrt(squares @ squares) / (2 * max(blur, _LEAST_BLUR_PX))
    return _Along(blur, float(error), of_camera, np.where(known, fields, np.nan))


def _gap(pattern: Bytes | Counts, inverse: Bytes | Counts) -> Singles:
    return np.asarray(np.abs(pattern.astype(np.float32) - inverse.astype(np.float32)), np.float32)


def _less(blur_px: Doubles, own: Doubles | float) -> Doubles:
    return np.asarray(np.sqrt(np.maximum(blur_px**2 - np.square(own), 0.0)), np.float64)


def _fitted(amounts: Doubles, stripes: Doubles) -> Doubles:
    """The blur (N,) that amounts (S, N) of stripes (S,) tell, whatever their common scale."""
    shapes = _shapes(tuple(stripes.tolist()))
    return np.asarray(_STEP * (shapes @ amounts).argmax(axis=0), np.float64)


@lru_cache(maxsize=4)
def _shapes(stripes: tuple[float, ...]) -> Doubles:
    """What every blur leaves of these stripes, of length 1 for each."""
    found = contrast(np.arange(0.0, _MOST_BLUR_PX, _STEP)[:, None], np.array(stripes))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True), np.float64)


def _pixels_per_pixel(place: Singles, span: int) -> Doubles:
    """Pixels of the projector along one of its axes that one of these pixels spans (H, W), NaN where not known."""
    out: Doubles = np.full(place.shape, np.nan)
    inner = place[:-span, :-span].astype(np.float64)
    across, down = place[:-span, span:] - inner, place[span:, :-span] - inner
    out[:-span, :-span] = np.hypot(across, down) / span
    return out


def _sums(values: Singles | Bools) -> Doubles:
    """The sum over every field of the map."""
    return np.array([[float(field.sum(dtype=np.float64)) for field in band] for band in _fields(values)])


def _medians(values: Doubles) -> Doubles:
    """The median over every field of the map, NaN where there is none."""
    return np.array(
        [
            [float(np.median(known)) if (known := field[np.isfinite(field)]).size else np.nan for field in band]
            for band in _fields(values)
        ]
    )


def _fields(values: NDArray[Any]) -> list[list[NDArray[Any]]]:
    return [np.array_split(band, MAP[1], axis=1) for band in np.array_split(values, MAP[0], axis=0)]


@dataclass(frozen=True, eq=False)
class TypicalFocus:
    """The projector's focus in several views: one blur in pixels, its standard error, and the map (6, 8) over the
    camera's picture, the median over views and directions, NaN where no view shows it.
    """

    blur_px: float
    standard_error: float
    blur_map: Doubles

    @property
    def sharpest_px(self) -> float:
        """Of the map's fields, nearly the sharpest."""
        return float(np.nanpercentile(self.blur_map, 10))

    @property
    def softest_px(self) -> float:
        """Of the map's fields, nearly the most blurred."""
        return float(np.nanpercentile(self.blur_map, 90))


def typical(views: Sequence[Focus]) -> TypicalFocus:
    """One focus for all views; a few that are out of focus do not move it."""
    found = np.array([view.mean_px for view in views])
    middle = float(np.median(found))
    spread = robust_deviation(found) * (np.pi / 2 / found.size) ** 0.5
    # what is not known of the camera's blur is the same in all of them
    error = max(spread, float(np.median([view.standard_error for view in views])))
    fields = np.concatenate([view.blur_map for view in views]).reshape(-1, MAP[0] * MAP[1])
    known = np.isfinite(fields).any(axis=0)
    blur_map: Doubles = np.full(fields.shape[1], np.nan)
    blur_map[known] = np.nanmedian(fields[:, known], axis=0)
    return TypicalFocus(middle, error, blur_map.reshape(MAP))
