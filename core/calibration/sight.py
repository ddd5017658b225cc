"""One pose of the chart, from its frames to corners in both pictures, and what is wrong with it.

A view that moved, is blurred or overexposed, or that the projector lights in part only, spoils a fit without being
noticed in it. Each is looked for by itself, and named.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart, Corners, find_corners, half_px, spacing_px
from slopegate.core.calibration.codes import CodeOrder, Decoded, decode
from slopegate.core.calibration.corner_fit import fit_corners
from slopegate.core.calibration.geometry import LEAST_CORNERS, ChartView
from slopegate.core.calibration.projected import projected
from slopegate.core.rig.arrays import Bools, Bytes, Counts, Singles

LEAST_SHARE: Final = 0.6
"""Of the chart's corners that were found, those that the projector has to light."""
MOST_SATURATED: Final = 0.02
"""Of the chart's pixels."""
MOST_SHIFT_PX: Final = 0.3
"""Between any two pairs of frames."""
CORNERS_WATCHED: Final = 16
"""For movement, at least half as many as this and at most twice."""
MOST_BLUR_SHARE: Final = 0.35
"""Width of an edge between squares, from 10 to 90 %, as a share of a square."""
MOST_BEYOND: Final = 0.05
"""Of the pixels with a clear code, those whose code no pixel of the projector has."""
FLATTENED: Final = (0.02, 0.08)
"""Of the picture's width, over which light is evened out where the chart is not found at once."""
LEAST_RADIUS_PX: Final = 6.0
MOST_RADIUS_PX: Final = 40.0


@dataclass(frozen=True, eq=False)
class ChartSight:
    """What the frames of one pose show.

    view: what a fit takes, None where the chart was not found or hardly lit. faults: a sentence for each thing that is
    wrong; a view that has any is left out. blur_px: width of the chart's edges in the camera's picture, 10 to 90 %.
    beyond_share: of the pixels with a clear code, those with one that no pixel of the projector has.
    """

    name: str
    view: ChartView | None
    corners: Corners | None
    decoded: Decoded
    faults: tuple[str, ...]
    shift_px: float
    saturated: float
    blur_px: float
    lit_share: float
    beyond_share: float = 0.0


def look(name: str, chart: Chart, order: CodeOrder, frames: Bytes | Counts, full_scale: float) -> ChartSight:
    """Find the chart in the frames (count, H, W) of a pose, and where the projector would see its corners.

    full_scale: counts at which the camera saturates. Raises InputError where there are not as many frames as
    the code has.
    """
    decoded = decode(order, frames)
    even = _evenly_lit(order, frames, slice(None))
    bright = as_bytes(even)
    corners = find_corners(chart, bright) or _found_dimly(chart, even)
    if corners is None:
        fault = f"{name}: no {chart} was found in it: all of it has to be seen and lit, and nothing before it"
        return ChartSight(name, None, None, decoded, (fault,), np.nan, np.nan, np.nan, 0.0)
    inside = _hull(corners, bright.shape)
    radius = float(np.clip(0.55 * spacing_px(chart, corners), LEAST_RADIUS_PX, MOST_RADIUS_PX))
    places = projected(corners.points, decoded.place, radius)
    lit = np.isfinite(places.points[:, 0])
    saturated = float((frames[order.white][inside] >= 0.995 * full_scale).mean())
    shift, blur = _shift_px(chart, order, frames, corners, lit), _edge_px(chart, corners, bright)
    # a checkerboard is found whole, and corners in the dark are then let go; of a ChArUco board parts are found
    share = float(lit.sum()) / (chart.count if chart.kind == "checkerboard" else len(lit))
    faults = _faults(name, saturated, shift, blur / spacing_px(chart, corners), share)
    if (beyond := _beyond(decoded)) > MOST_BEYOND:
        faults.append(
            f"{name}: {100 * beyond:.0f} % of the pixels that it lights have a code beyond a projector of "
            f"{order.raster} pixels: its size or the order of the frames is another"
        )
    seen = corners.index[lit]
    view = (
        ChartView(name, chart.points_m[seen], corners.points[lit], places.points[lit])
        if lit.sum() >= LEAST_CORNERS
        else None
    )
    return ChartSight(name, view, corners, decoded, tuple(faults), shift, saturated, blur, share, beyond)


def _found_dimly(chart: Chart, image: Singles) -> Corners | None:
    """The corners of a chart that is lit in part: the rest still shows in the light of the room."""
    tried = (
        find_corners(chart, as_bytes(image / (cv2.GaussianBlur(image, (0, 0), share * image.shape[1]) + 1)))
        for share in FLATTENED
    )
    return next((corners for corners in tried if corners is not None), None)


def _faults(name: str, saturated: float, shift_px: float, blur_share: float, lit: float) -> list[str]:
    found = []
    if saturated > MOST_SATURATED:
        found.append(
            f"{name}: {100 * saturated:.0f} % of the chart is saturated: expose less, or turn the chart's gloss away"
        )
    if shift_px > MOST_SHIFT_PX:
        found.append(f"{name}: chart or camera moved by {shift_px:.1f} pixels while it was taken")
    if blur_share > MOST_BLUR_SHARE:
        found.append(f"{name}: the chart is blurred, its edges are {100 * blur_share:.0f} % of a square wide")
    if lit < LEAST_SHARE:
        found.append(f"{name}: the projector lights only {100 * lit:.0f} % of the corners that were found")
    return found


def _evenly_lit(order: CodeOrder, frames: Bytes | Counts, part: slice) -> Singles:
    """The mean of pattern plus inverse over a part of the pairs: the scene fully lit, with little noise."""
    pairs = [
        first + 2 * bit
        for first, bits in zip((order.first_column, order.first_row), order.bits, strict=True)
        for bit in range(bits)
    ]
    total = np.zeros(frames.shape[1:], np.float32)
    chosen = pairs[part]
    for first in chosen:
        total += frames[first]
        total += frames[first + 1]
    total /= len(chosen)
    return total


def as_bytes(image: Singles) -> Bytes:
    """Counts stretched to 0 .. 255, white at the 99.5th percentile."""
    low, high = np.percentile(image[::4, ::4], (0.5, 99.5))
    scaled = (image - low) * (255 / max(1.0, float(high - low)))
    return np.asarray(np.clip(scaled, 0, 255), np.uint8)


def _hull(corners: Corners, shape: tuple[int, ...]) -> Bools:
    """Pixels between the chart's corners."""
    outline = cv2.convexHull(corners.points.astype(np.float32))
    inside = np.zeros(shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, np.rint(outline).astype(np.int32), 1)
    return inside > 0


def _shift_px(chart: Chart, order: CodeOrder, frames: Bytes | Counts, corners: Corners, lit: Bools) -> float:
    """How far the chart ever was from where it was in another pair of frames, the median over its lit corners.

    A pattern and its inverse together light everything, so every pair shows the corners. What hides the chart in some
    pair takes the code from it, too: NaN where none of its corners is lit.
    """
    some = corners.points[lit][:: max(1, int(lit.sum()) // CORNERS_WATCHED)]
    half = half_px(chart, corners)
    at = np.stack(
        [fit_corners(_evenly_lit(order, frames, slice(pair, pair + 1)), some, half) for pair in range(sum(order.bits))]
    )
    seen = np.isfinite(at[..., 0]).all(axis=0)
    if not seen.any():
        return np.nan
    apart = at[:, None, seen] - at[None, :, seen]
    return float(np.median(np.hypot(apart[..., 0], apart[..., 1]), axis=-1).max())


def _edge_px(chart: Chart, corners: Corners, image: Bytes) -> float:
    """Width of the edges between squares, 10 to 90 %, the median over pairs of neighbouring corners.

    On the way from one corner to the next the edge runs along; it is crossed at the middle of the way.
    """
    place = {int(number): point for number, point in zip(corners.index, corners.points, strict=True)}
    widths = []
    for number, point in place.items():
        beside = place.get(number + 1) if (number + 1) % chart.columns else None
        if beside is None:
            continue
        along = beside - point
        length = float(np.hypot(*along))
        across = np.array([-along[1], along[0]]) / length
        steps = np.linspace(-0.4 * length, 0.4 * length, 81)
        path = ((point + beside) / 2 - 0.5 + steps[:, None] * across).astype(np.float32)
        line = cv2.remap(image, path[None, :, 0], path[None, :, 1], cv2.INTER_LINEAR).ravel().astype(np.float64)
        low, high = float(line[:8].mean()), float(line[-8:].mean())
        if abs(high - low) > 20:
            share = (line - low) / (high - low)
            widths.append(float(((share > 0.1) & (share < 0.9)).sum() * (steps[1] - steps[0])))
    return float(np.median(widths)) if widths else np.nan


def _beyond(decoded: Decoded) -> float:
    """Of the pixels with a clear code, those with one that no pixel of the projector has."""
    beyond, within = int(decoded.beyond.sum()), int(np.isfinite(decoded.place[..., 0]).sum())
    return beyond / max(1, beyond + within)
