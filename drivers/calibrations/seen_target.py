"""Finds the plane that gates are seen on, and which projector row lights each of its pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart, Corners, find_corners
from slopegate.core.calibration.sight import as_bytes
from slopegate.core.calibration.target import FlatTarget, TargetOf, chart_target, flat_part, target_rows
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.lit_view import LitView
from slopegate.drivers.calibrations.pictures import CalibrationError

BEYOND_CORNERS: Final = 0.9
"""Of a square, how far round its inner corners a chart is flat for sure."""
DARKEST: Final = 0.02
"""Of the light of the plane's bright pixels: what is darker is in shadow, or not lit."""
LEAST_PIXELS: Final = 400
LEAST_FLAT: Final = 0.25
"""Of what the patterns light, the share of the largest plane."""
LEAST_ROWS: Final = 40
MOST_SATURATED: Final = 0.2
"""Of the plane's pixels: those few that are saturated are left out."""
LEAST_SIGNAL: Final = 3.0
"""The bright pixels' light over the noise of a pixel."""
MOST_OUTSIDE: Final = 0.1
"""Of a chart, what may be lit where no light of the projector should reach it."""
_AS_BRIGHT: Final = 0.8
"""Times as bright as the rest is what is lit there; other light alone would hide the gates."""
_BRIGHT: Final = 75.0
"""Percentile of the light that counts as the bright pixels'."""
_TENT: Final = np.array([1, 2, 1], np.float32) / 4
"""Along rows and columns, it weighs the colours of a mosaic alike at every pixel."""


class WrongChartError(CalibrationError):
    """The chart that is seen has other squares than the one that was named; the message says what contradicts it."""


@dataclass(frozen=True, eq=False)
class SeenTarget:
    """The plane in the camera's picture.

    projector_row (H, W) float32: the continuous row that lights a pixel. known (H, W): the plane's pixels. how: it was
    found, for the rig's facts. place: where it stands, if the rig is another; None where patterns told the rows. chart:
    by which it was found, if by one.
    """

    projector_row: Singles
    known: Bools
    how: str
    place: TargetOf | None
    chart: Chart | None = None


def plane_target(plane: tuple[float, float, float, float]) -> FlatTarget:
    """The plane A x + B y + C z + D = 0, metres in the camera's axes. Raises InputError for one that is none."""
    a, b, c, d = plane
    if d == 0 or not any((a, b, c)):
        raise InputError(
            f"plane is {','.join(f'{one:g}' for one in plane)}: D must not be 0, for the plane would pass through the "
            "camera, nor may A, B and C all be; 0,0,1,-1 is the one that stands 1 m ahead"
        )
    return FlatTarget((-a / d, -b / d, -c / d))


def seen_chart(view: LitView, rig: Rig, chart: Chart, mosaic: bool) -> SeenTarget:
    """The chart in the lit picture. Raises CalibrationError where it is not there, or badly lit, and WrongChartError
    where it is lit as no chart of its size would be.

    mosaic: the picture's pixels have colour filters.
    """
    image = cv2.sepFilter2D(view.full, -1, _TENT, _TENT) if mosaic else view.full
    corners = find_corners(chart, as_bytes(np.asarray(image, np.float32)))
    if corners is None:
        raise CalibrationError(
            f"no chart {chart} was found in the picture with all of the projector's light: hold it where camera and "
            "projector both reach it, in focus, and see that its corners and squares are those"
        )
    points = chart.points_m[corners.index]

    def place(other: Rig) -> FlatTarget:
        return chart_target(other, points, corners.points)

    how = f"chart {chart}, {len(points)} corners"
    inside, rows = _outline(chart, corners, view.full.shape), target_rows(rig, place(rig))
    _require_reached(view, chart, inside, rows)
    return _judged(view, rig, SeenTarget(rows, inside, how, place, chart))


def seen_plane(view: LitView, rig: Rig, target: FlatTarget) -> SeenTarget:
    """A plane of known place. Raises CalibrationError where camera and projector do not both see it, or badly."""
    x, y, one = target.slopes
    how = f"plane 1/z = {x:.6g} x + {y:.6g} y + {one:.6g}"
    everything = np.ones(view.full.shape, np.bool_)
    return _judged(view, rig, SeenTarget(target_rows(rig, target), everything, how, lambda other: target))


def seen_code(view: LitView, rig: Rig, projector_row: Singles) -> SeenTarget:
    """The largest plane of what shows clear codes: projector_row (H, W), NaN elsewhere.

    Raises CalibrationError where little does, or little of that is flat.
    """
    decoded = np.isfinite(projector_row)
    rows = np.where(decoded, projector_row, np.float32(-1))
    known = _lit_well(view, decoded)
    flat = flat_part(rig, rows, known)
    share = float(flat.sum() / known.sum())
    if flat.sum() < LEAST_PIXELS or share < LEAST_FLAT:
        raise CalibrationError(
            f"the largest plane has {share:.0%} of what the patterns light, and at least {LEAST_FLAT:.0%} of it must "
            "be flat: put a board or a wall before the rig"
        )
    return SeenTarget(rows, flat, f"rows decoded from patterns, {share:.0%} of them on a plane", None)


def _judged(view: LitView, rig: Rig, seen: SeenTarget) -> SeenTarget:
    """Of the pixels that may be the plane's, those that tell something."""
    rows, height = seen.projector_row, rig.projector.lens.height
    return replace(seen, known=_lit_well(view, seen.known & (rows >= 1) & (rows <= height - 1)))


def _require_reached(view: LitView, chart: Chart, inside: Bools, rows: Singles) -> None:
    """Raise WrongChartError where the chart is as bright beyond the rows (H, W) that should light it as within them."""
    within, beyond = inside & (rows >= 0), inside & (rows < 0)
    share = float(beyond.sum() / max(1, inside.sum()))
    if share <= MOST_OUTSIDE or within.sum() < LEAST_PIXELS or view.saturated[inside].mean() > MOST_SATURATED:
        return
    lit, other = (float(np.percentile(view.full[part], _BRIGHT)) for part in (within, beyond))
    if lit > LEAST_SIGNAL * view.noise and other >= _AS_BRIGHT * lit:
        raise WrongChartError(
            f"if it were chart {chart}, {share:.0%} of it would stand where the projector does not reach, and that is "
            f"as bright as the rest; at most {MOST_OUTSIDE:.0%} may be: give the inner corners and the squares, in mm, "
            "of the chart that is seen"
        )


def _lit_well(view: LitView, reached: Bools) -> Bools:
    """The plane's pixels that tell something. Raises CalibrationError where they are too few, too dark or saturated."""
    _require_seen(reached, "camera and projector share too little of the plane")
    bright = float(np.percentile(view.full[reached], _BRIGHT))
    if bright < LEAST_SIGNAL * view.noise or bright <= 0:
        raise CalibrationError(
            f"the plane is too dark: the projector brings {bright:.1f} counts where a pixel's noise is "
            f"{view.noise:.1f}; open the iris, raise the gain or come nearer"
        )
    saturated = float(view.saturated[reached].mean())
    if saturated > MOST_SATURATED:
        raise CalibrationError(
            f"{saturated:.0%} of the plane's pixels are saturated with all of the projector's light, and at most "
            f"{MOST_SATURATED:.0%} may be: lower the camera's gain or close its iris"
        )
    known = reached & ~view.saturated & (view.full > DARKEST * bright)
    _require_seen(known, "the projector lights too little of the plane")
    return np.asarray(known, np.bool_)


def _require_seen(pixels: Bools, why: str) -> None:
    count, rows = int(pixels.sum()), int(pixels.any(axis=1).sum())
    if count < LEAST_PIXELS or rows < LEAST_ROWS:
        raise CalibrationError(
            f"{why}: {count} pixels in {rows} rows of the picture, where at least {LEAST_PIXELS} in {LEAST_ROWS} rows "
            "are needed; move it into both views, and see that the rig file and the plane are right"
        )


def _outline(chart: Chart, corners: Corners, shape: tuple[int, ...]) -> Bools:
    """Pixels of the chart's squares (H, W)."""
    beyond = BEYOND_CORNERS * chart.square_m
    right, bottom = chart.points_m[-1, :2] + beyond
    left = top = -beyond
    flat = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    there = cv2.findHomography(chart.points_m[corners.index, :2], corners.points)[0]
    edge = cv2.perspectiveTransform(flat[None], there)[0]
    inside = np.zeros(shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, np.rint(edge).astype(np.int32), 1)
    return inside > 0
