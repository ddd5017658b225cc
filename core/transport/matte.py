"""A soft matte from slices: which share of each pixel the foreground covers, from light alone and whatever the colours.

The slices of the foreground hold its light, those of the background the rest. A pixel that both share has the light
F = alpha f and B = (1 - alpha) b, with f and b what the foreground and the background would show there if they covered
it all. These are taken from the nearest pixels that only one of the two covers, so no mean is taken across an edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.checks import require
from slopegate.core.transport.mosaic import demosaic
from slopegate.core.transport.sliced import SliceTransport

_PURE: Final = 0.02
"""Share of the other's light up to which a pixel counts as covered by one alone."""
_REACHES: Final = (2, 6, 18)
"""Pixels around a mixed one in which pure ones are looked for: the nearest that has any."""
_DARK: Final = 1e-3
"""Share of the brightest light (99th percentile) below which a pixel counts as unlit."""
_SIGMAS: Final = 5.0
_LEAST_VARIANCE: Final = 1e-4
"""Of an alpha that neighbours of one single value tell."""


@dataclass(frozen=True)
class MatteErrors:
    """How far a matte is from the true one: sum of absolute differences, in pixels, and mean square difference."""

    sad: float
    mse: float


def slice_light(slices: Sequence[SliceTransport], which: Sequence[int], mosaic: str = "") -> Singles:
    """All light of some slices (H, W) float32; behind a mosaic the mean of the three colours.

    Raises InputError for a number that no slice has.
    """
    out = np.zeros(slices[0].total.shape, np.float32)
    for index in which:
        require(0 <= index < len(slices), "slice", index, f"from 0 to {len(slices) - 1}")
        out += slices[index].total
    return demosaic(out, mosaic).mean(axis=2) if mosaic else out


def soft_matte(foreground: Singles, background: Singles) -> Singles:
    """Share of the foreground (H, W) float32, 0..1, from the light of its slices and of all others (H, W).

    Their noise is told by what lies below 0, since light cannot. Where neither shows light, it is shade, or out of the
    projector's frame. Shade falls along the columns, since the projector stands above the camera or below. So such a
    pixel belongs to the foreground only if the nearest lit ones above and below do.
    """
    noise = math.hypot(_noise(foreground), _noise(background))
    front, back = np.maximum(foreground, 0).astype(np.float64), np.maximum(background, 0).astype(np.float64)
    light = front + back
    least = max(_SIGMAS * noise, _DARK * float(np.percentile(light, 99)))
    lit = light > least
    ratio = np.divide(front, light, out=np.zeros_like(light), where=lit)
    pure = _PURE + np.divide(_SIGMAS * noise, light, out=np.zeros_like(light), where=lit)
    only_front, only_back = lit & (ratio >= 1 - pure), lit & (ratio <= pure)
    alpha = np.where(only_front, 1.0, np.where(only_back, 0.0, ratio))
    shade = _from_above_or_below(alpha, lit)
    # Beside an edge, little light of one side may still be a large share of something dark.
    inside_front, inside_back = _all_around(only_front), _all_around(only_back)
    both = (front > least) & (back > least) & ~inside_front & ~inside_back
    mixed = both | lit & ~only_front & ~only_back | only_front & ~_all_around(lit | (shade > 0.5))
    if mixed.any():
        pure_light = _Near.of(front, inside_front), _Near.of(back, inside_back)
        alpha[mixed] = _unmixed(front, back, ratio, *pure_light, back > least)[mixed]
    return np.where(lit, alpha, shade).astype(np.float32)


def _noise(light: Singles) -> float:
    """Standard deviation of the noise where there is no light, half of which lies below 0."""
    below = light[light < 0]
    return math.sqrt(float(np.mean(below.astype(np.float64) ** 2))) if below.size else 0.0


def matte_errors(alpha: Singles, truth: Singles) -> MatteErrors:
    """How far a matte (H, W) is from the true one. Raises InputError for one of another size."""
    require(alpha.shape == truth.shape, "matte", alpha.shape, f"of the true one's shape {truth.shape}")
    apart = alpha.astype(np.float64) - truth
    return MatteErrors(float(np.abs(apart).sum()), float((apart**2).mean()))


@dataclass(frozen=True, eq=False)
class _Near:
    """Light of pure pixels near each pixel (H, W), 0 where there are none, and its relative spread among them."""

    light: Doubles
    spread: Doubles

    @staticmethod
    def of(light: Doubles, pure: Bools) -> _Near:
        """The least of those within 2 pixels, since round things darken towards their edges, else the mean of those
        within the next reach that has any."""
        weight = pure.astype(np.float64)
        found, spread = np.zeros_like(light), np.zeros_like(light)
        for reach in reversed(_REACHES):
            count, total, square = (_box(plane, reach) for plane in (weight, weight * light, weight * light**2))
            some = count > 0.5
            found[some] = total[some] / count[some]
            variance = np.maximum(square[some] / count[some] - found[some] ** 2, 0)
            spread[some] = np.sqrt(variance) / found[some]
        least = cv2.erode(np.where(pure, light, np.inf), np.ones((5, 5), np.uint8), borderValue=np.inf)
        return _Near(np.where(np.isfinite(least), least, found), spread)


def _unmixed(
    front: Doubles, back: Doubles, ratio: Doubles, whole_front: _Near, whole_back: _Near, behind_lit: Bools
) -> Doubles:
    """Alpha from F = alpha f and from B = (1 - alpha) b, by how well f and b are known; where neither is, the ratio.

    Each is as uncertain as its share of the pixel times the relative spread of the light that it is taken from. Where
    there is no light from behind, that may be shade and tells nothing.
    """
    by_front = np.divide(front, whole_front.light, out=np.zeros_like(front), where=whole_front.light > 0)
    by_back = 1 - np.divide(back, whole_back.light, out=np.ones_like(back), where=whole_back.light > 0)
    trust_front = (whole_front.light > 0) / ((ratio * whole_front.spread) ** 2 + _LEAST_VARIANCE)
    trust_back = (behind_lit & (whole_back.light > 0)) / (((1 - ratio) * whole_back.spread) ** 2 + _LEAST_VARIANCE)
    trust = trust_front + trust_back
    both = np.clip(by_front, 0, 1) * trust_front + np.clip(by_back, 0, 1) * trust_back
    return np.asarray(np.divide(both, trust, out=ratio.copy(), where=trust > 0), np.float64)


def _box(plane: Doubles, reach: int) -> Doubles:
    """Sums over squares of pixels that reach so far around each."""
    side = (2 * reach + 1, 2 * reach + 1)
    return np.asarray(cv2.boxFilter(plane, -1, side, normalize=False, borderType=cv2.BORDER_CONSTANT), np.float64)


def _all_around(mask: Bools) -> Bools:
    """Where a pixel and its 8 neighbours, as far as the image goes, are all in the mask."""
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0, np.bool_)


def _from_above_or_below(alpha: Doubles, lit: Bools) -> Doubles:
    """The lesser alpha of the nearest lit pixels above and below in each column; 0 without any."""
    rows = np.arange(len(alpha))[:, None]
    above: Indices = np.maximum.accumulate(np.where(lit, rows, -1), axis=0)
    below: Indices = np.minimum.accumulate(np.where(lit, rows, len(alpha))[::-1], axis=0)[::-1]
    columns = np.broadcast_to(np.arange(alpha.shape[1]), alpha.shape)
    top = np.where(above >= 0, alpha[np.maximum(above, 0), columns], np.inf)
    bottom = np.where(below < len(alpha), alpha[np.minimum(below, len(alpha) - 1), columns], np.inf)
    least = np.minimum(top, bottom)
    return np.where(np.isfinite(least), least, 0.0)
