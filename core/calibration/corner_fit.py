"""Corners of a chart to some thousandths of a pixel: two edges that cross, fitted to the pixels about them.

What pixels show of an edge depends on where it lies between them. Methods that take derivatives of the picture err by
that, up to a tenth of a pixel where squares are few pixels wide. Here a whole crossing is fitted: two straight edges,
their blur, black and white, and light that falls off to one side. Perspective keeps straight edges straight, so that
the crossing stays where it is.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Doubles, Singles

LEAST_HALF: Final = 2
MOST_HALF: Final = 11
"""Pixels on each side of a corner that are looked at, at least and at most."""
_NUMBERS: Final = 9
_ROUNDS: Final = 30
_STILL: Final = 1e-5
"""Pixels: a step below it ends the search."""
_SHARPEST: Final = 0.2
"""Standard deviation of the least blur, pixels: a pixel's own width is 0.29."""
_WEIGHT: Final = 0.75
"""Standard deviation of the weights, as a share of the half width: the last pixels count little, whole or not."""


def fit_corners(image: Singles, points: Doubles, half: int) -> Doubles:
    """Corners (N, 2) near `points` (N, 2), continuous columns and rows (pixel k covers [k, k + 1)), in an image (H, W).

    half: pixels on each side that show nothing but the crossing. NaN where none is found within them.
    """
    found = np.empty_like(points)
    _fit_corners(image, points, half, found)
    return found


@njit(cache=True, nogil=True)
def _fit_corners(image: Singles, points: Doubles, half: int, found: Doubles) -> None:
    size = 2 * half + 1
    values, weights = np.empty(size * size), np.empty(size * size)
    at = np.empty((size * size, 2))
    for number in range(points.shape[0]):
        found[number] = np.nan
        column, row = math.floor(points[number, 0]), math.floor(points[number, 1])
        if not (half <= column < image.shape[1] - half and half <= row < image.shape[0] - half):
            continue
        k = 0
        for y in range(row - half, row + half + 1):
            for x in range(column - half, column + half + 1):
                at[k, 0], at[k, 1] = x + 0.5 - points[number, 0], y + 0.5 - points[number, 1]
                values[k] = image[y, x]
                weights[k] = math.exp(-0.5 * (at[k, 0] ** 2 + at[k, 1] ** 2) / (_WEIGHT * half) ** 2)
                k += 1
        model = _begun(at, values, weights)
        if np.isnan(model[0]) or not _improve(at, values, weights, half, model):
            continue
        found[number, 0], found[number, 1] = points[number, 0] + model[0], points[number, 1] + model[1]


@njit(cache=True, nogil=True)
def _begun(at: Doubles, values: Doubles, weights: Doubles) -> Doubles:
    """A first guess: the saddle of the parabolic surface through the pixels; NaN where it is none."""
    normal, wanted = np.zeros((6, 6)), np.zeros(6)
    for k in range(len(values)):
        x, y = at[k]
        base = np.array([1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y])
        for i in range(6):
            wanted[i] += weights[k] * base[i] * values[k]
            for j in range(6):
                normal[i, j] += weights[k] * base[i] * base[j]
    _, by_x, by_y, xx, xy, yy = np.linalg.solve(normal, wanted)
    model = np.full(_NUMBERS, np.nan)
    bend = xx * yy - xy * xy
    if not bend < 0:
        return model
    model[0], model[1] = (xy * by_y - yy * by_x) / bend, (xy * by_x - xx * by_y) / bend
    # along its edges a saddle is level: xx cos^2 + 2 xy cos sin + yy sin^2 = 0
    middle, apart = 0.5 * math.atan2(2 * xy, xx - yy), 0.5 * math.acos(-(xx + yy) / math.hypot(xx - yy, 2 * xy))
    model[2], model[3] = middle + apart, middle - apart
    first, second = _across(model[2]), _across(model[3])
    total, plus, light = 0.0, 0.0, 0.0
    for k in range(len(values)):
        x, y = at[k, 0] - model[0], at[k, 1] - model[1]
        side = (first[0] * x + first[1] * y) * (second[0] * x + second[1] * y)
        plus += weights[k] * values[k] * (1.0 if side > 0 else -1.0)
        light += weights[k] * values[k]
        total += weights[k]
    model[4], model[5], model[6], model[7], model[8] = light / total, plus / total, 0.7, 0.0, 0.0
    return model


@njit(cache=True, nogil=True)
def _across(angle: float) -> tuple[float, float]:
    """What is normal to an edge of this direction."""
    return -math.sin(angle), math.cos(angle)


@njit(cache=True, nogil=True)
def _improve(at: Doubles, values: Doubles, weights: Doubles, half: int, model: Doubles) -> bool:
    """Least squares after Levenberg and Marquardt; whether a crossing was found within half of the window."""
    damping = 1e-3
    normal, wanted = np.empty((_NUMBERS, _NUMBERS)), np.empty(_NUMBERS)
    worst = _equations(at, values, weights, model, normal, wanted)
    tried, other, right = np.empty(_NUMBERS), np.empty((_NUMBERS, _NUMBERS)), np.empty(_NUMBERS)
    for _ in range(_ROUNDS):
        damped = normal.copy()
        for i in range(_NUMBERS):
            damped[i, i] += damping * normal[i, i] + 1e-12
        step = np.linalg.solve(damped, wanted)
        tried[:] = model + step
        tried[6] = min(max(tried[6], _SHARPEST), float(half))
        missed = _equations(at, values, weights, tried, other, right)
        if missed <= worst:
            model[:], normal[:], wanted[:] = tried, other, right
            worst, damping = missed, max(damping / 5, 1e-9)
            if max(abs(step[0]), abs(step[1])) < _STILL:
                break
        else:
            damping *= 8
            if damping > 1e6:
                break
    return math.hypot(model[0], model[1]) < 0.5 * half + 0.5 and abs(model[5]) > 0


@njit(cache=True, nogil=True)
def _equations(
    at: Doubles, values: Doubles, weights: Doubles, model: Doubles, normal: Doubles, wanted: Doubles
) -> float:
    """Fill the normal equations of a model; returns its weighted sum of squares.

    The model: corner, both edges' directions, mean of black and white, half their difference, blur, fall-off.
    """
    normal[:], wanted[:] = 0.0, 0.0
    (ax, ay), (bx, by) = _across(model[2]), _across(model[3])
    level, swing, blur = model[4], model[5], model[6]
    slope, total = np.empty(_NUMBERS), 0.0
    peak = math.sqrt(2 / math.pi) / blur
    for k in range(len(values)):
        x, y = at[k, 0] - model[0], at[k, 1] - model[1]
        u, v = ax * x + ay * y, bx * x + by * y
        one, other = math.erf(u / (1.4142135623730951 * blur)), math.erf(v / (1.4142135623730951 * blur))
        by_u = peak * math.exp(-0.5 * (u / blur) ** 2) * other
        by_v = peak * math.exp(-0.5 * (v / blur) ** 2) * one
        light, seen = 1 + model[7] * x + model[8] * y, level + swing * one * other
        slope[0] = -model[7] * seen - light * swing * (by_u * ax + by_v * bx)
        slope[1] = -model[8] * seen - light * swing * (by_u * ay + by_v * by)
        slope[2] = light * swing * by_u * (-ay * x + ax * y)
        slope[3] = light * swing * by_v * (-by * x + bx * y)
        slope[4], slope[5] = light, light * one * other
        slope[6] = -light * swing * (by_u * u + by_v * v) / blur
        slope[7], slope[8] = x * seen, y * seen
        missed = values[k] - light * seen
        total += weights[k] * missed * missed
        for i in range(_NUMBERS):
            wanted[i] += weights[k] * slope[i] * missed
            for j in range(i + 1):
                normal[i, j] += weights[k] * slope[i] * slope[j]
    for i in range(_NUMBERS):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return total
