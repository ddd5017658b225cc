"""Flat charts to calibrate with: checkerboards and ChArUco boards, their points and their picture."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.calibration.corner_fit import LEAST_HALF, MOST_HALF, fit_corners
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Ints, Singles
from slopegate.core.rig.checks import InputError, require, require_positive

USUAL_CHART: Final = "9x7:22"
"""The largest checkerboard of 9 x 7 inner corners, in whole millimetres, that fits a page of A4 or Letter."""
CHART_ERROR_PERCENT: Final = 0.2
"""Standard error of a chart's lengths where nothing else is said: printed on paper, measured with a ruler."""
ChartKind = Literal["checkerboard", "charuco"]

LEAST_CORNERS: Final = 3
MOST_CORNERS: Final = 100
MARKER_SHARE: Final = 0.7
"""Side of a ChArUco marker in squares, where none is given."""
REACH: Final = 0.4
"""Of a square's side, as far as a corner is looked at: beyond begin the next corners, blurred."""
CROOKED: Final = 0.3
"""Of the distance between corners, by which one may lie off a flat chart: a bent lens does no more."""
LEAST_FOUND: Final = 4
"""Corners, of a chart that counts as found."""
DICTIONARIES: Final = {
    f"{bits}x{bits}_{count}": getattr(cv2.aruco, f"DICT_{bits}X{bits}_{count}")
    for bits in (4, 5, 6, 7)
    for count in (50, 100, 250, 1000)
}
_TEXT = re.compile(
    r"(?:(checkerboard|charuco):)?(\d{1,4})x(\d{1,4}):([0-9.]{1,12})(?::([0-9.]{1,12}))?(?::(\w{1,12}))?"
)
ALLOWED: Final = (
    "COLUMNSxROWS:SQUARE_MM of inner corners, as 9x7:30, or charuco:COLUMNSxROWS:SQUARE_MM[:MARKER_MM[:DICTIONARY]], "
    "as charuco:9x7:30:21:4x4_100"
)


@dataclass(frozen=True)
class Chart:
    """A chart by its inner corners, where four squares meet: `columns` x `rows` of them, `square_m` apart."""

    kind: ChartKind
    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = "4x4_100"

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            value = getattr(self, name)
            allowed = f"from {LEAST_CORNERS} to {MOST_CORNERS} inner corners"
            require(LEAST_CORNERS <= value <= MOST_CORNERS, f"chart {name}", value, allowed)
        require_positive("chart square_m", self.square_m)
        if self.kind == "charuco":
            fits = 0 < self.marker_m < self.square_m
            require(fits, "chart marker_m", self.marker_m, f"above 0 and below the square's {self.square_m:g} m")
            require(self.dictionary in DICTIONARIES, "chart dictionary", self.dictionary, f"one of {[*DICTIONARIES]}")
            needed, held = ((self.columns + 1) * (self.rows + 1)) // 2, int(self.dictionary.split("_")[1])
            require(needed <= held, "chart dictionary", self.dictionary, f"one of at least {needed} markers")

    def __str__(self) -> str:
        size = f"{self.columns}x{self.rows}:{1000 * self.square_m:.6g}"
        return size if self.kind == "checkerboard" else f"charuco:{size}:{1000 * self.marker_m:.6g}:{self.dictionary}"

    @property
    def count(self) -> int:
        """How many inner corners there are."""
        return self.columns * self.rows

    @cached_property
    def points_m(self) -> Doubles:
        """The inner corners in the chart's own plane, row by row, (count, 3) metres with z = 0."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        flat = np.zeros(self.count)
        return self.square_m * np.stack([columns.ravel(), rows.ravel(), flat], axis=-1).astype(np.float64)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of all squares together, metres."""
        return (self.columns + 1) * self.square_m, (self.rows + 1) * self.square_m

    @cached_property
    def board(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board of a ChArUco chart."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary])
        squares = (self.columns + 1, self.rows + 1)
        return cv2.aruco.CharucoBoard(squares, self.square_m, self.marker_m, dictionary)


def chart_from(text: str) -> Chart:
    """The chart that a text names, in inner corners and millimetres: "9x7:30", "charuco:9x7:30:21:4x4_100".

    Raises InputError with one sentence otherwise.
    """
    found = _TEXT.fullmatch(text.strip().lower())
    if found is None:
        raise InputError(f"chart is {text!r}: it must be {ALLOWED}")
    kind, columns, rows, square, marker, dictionary = found.groups()
    try:
        square_m, marker_m = float(square) / 1000, float(marker or 0) / 1000
    except ValueError:
        raise InputError(f"chart is {text!r}: it must be {ALLOWED}") from None
    if kind != "charuco":
        require(marker is None and dictionary is None, "chart", text, ALLOWED)
        return Chart("checkerboard", int(columns), int(rows), square_m)
    chosen = dictionary or _smallest((int(columns) + 1) * (int(rows) + 1) // 2)
    return Chart("charuco", int(columns), int(rows), square_m, marker_m or MARKER_SHARE * square_m, chosen)


def _smallest(markers: int) -> str:
    return next((f"4x4_{count}" for count in (50, 100, 250, 1000) if count >= markers), "4x4_1000")


def picture(chart: Chart, square_px: int, margin_px: int = 0) -> Bytes:
    """The chart in black and white, its squares `square_px` wide and a white margin round it, uint8."""
    require(square_px >= 8, "square_px", square_px, "at least 8")
    if chart.kind == "charuco":
        size = ((chart.columns + 1) * square_px, (chart.rows + 1) * square_px)
        squares = np.asarray(chart.board.generateImage(size), np.uint8)
    else:
        dark = (np.arange(chart.rows + 1)[:, None] + np.arange(chart.columns + 1)[None, :]) % 2 == 0
        squares = np.kron(np.where(dark, 0, 255), np.ones((square_px, square_px))).astype(np.uint8)
    return np.pad(squares, margin_px, constant_values=255)


def dark_parts(chart: Chart) -> Doubles:
    """The chart as rectangles to draw with: left, top, width and height of all that is dark, (N, 4) metres.

    They overlap, so that no seam shows between parts that touch.
    """
    side = chart.square_m
    squares = [
        (column * side, row * side, side, side)
        for row in range(chart.rows + 1)
        for column in range(chart.columns + 1)
        if (row + column) % 2 == 0
    ]
    if chart.kind == "checkerboard":
        return np.array(squares, np.float64)
    board, dictionary = chart.board, cv2.aruco.getPredefinedDictionary(DICTIONARIES[chart.dictionary])
    cells = dictionary.markerSize + 2
    cell = chart.marker_m / cells
    parts = list(squares)
    for number, corners in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
        left, top = map(float, corners[0][:2])
        dark = dictionary.generateImageMarker(int(number), cells) == 0
        parts += [(left + x * cell, top + y * cell, n * cell, cell) for y, x, n in _runs(dark)]
        parts += [(left + x * cell, top + y * cell, cell, n * cell) for x, y, n in _runs(dark.T)]
    return np.array(parts, np.float64)


def _runs(dark: Bools) -> list[tuple[int, int, int]]:
    """Line, start and length of every run of dark cells along the lines."""
    padded = np.pad(dark.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(padded, axis=1)
    starts, ends = np.argwhere(steps == 1), np.argwhere(steps == -1)
    return [(int(line), int(start), int(end - start)) for (line, start), (_, end) in zip(starts, ends, strict=True)]


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a chart that were found in a picture.

    index (N,) int32: which of the chart's points each one is, rising. points (N, 2) float64: where, continuous columns
    and rows (pixel k covers [k, k + 1)).
    """

    index: Ints
    points: Doubles


def find_corners(chart: Chart, image: Bytes) -> Corners | None:
    """The chart's corners in a grey image (H, W) uint8, to a fraction of a pixel; None where it is not seen.

    A checkerboard has to be seen whole, of a ChArUco board at least four corners that are not all in a line.
    """
    found = _find_charuco(chart, image) if chart.kind == "charuco" else _find_checkerboard(chart, image)
    if found is None:
        return None
    index, points = found
    rough = Corners(index, points + 0.5)
    if not _in_rows(chart, rough):
        return None
    sharp = refined(image.astype(np.float32), rough.points, half_px(chart, rough))
    seen = np.isfinite(sharp[:, 0])
    return Corners(index[seen], sharp[seen]) if seen.sum() >= LEAST_FOUND else None


def half_px(chart: Chart, corners: Corners) -> int:
    """How many pixels on each side of a corner show nothing but its four squares."""
    share = REACH if chart.kind == "checkerboard" else min(REACH, (1 - chart.marker_m / chart.square_m) / 2)
    return max(LEAST_HALF, min(MOST_HALF, math.floor(share * spacing_px(chart, corners))))


def refined(image: Singles, points: Doubles, half: int) -> Doubles:
    """Corners (N, 2) near `points`, as `fit_corners` finds them, looked at about where they are; NaN where none is."""
    return fit_corners(image, fit_corners(image, points, half), half)


def _find_checkerboard(chart: Chart, image: Bytes) -> tuple[Ints, Doubles] | None:
    size = (chart.columns, chart.rows)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    index = np.arange(chart.count, dtype=np.int32)
    seen, points = cv2.findChessboardCornersSB(image, size, flags=flags)
    if not seen or not _in_rows(chart, Corners(index, _pairs(points))):
        classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        seen, points = cv2.findChessboardCorners(image, size, flags=classic)
    return (index, _pairs(points)) if seen else None


def _pairs(points: ArrayLike) -> Doubles:
    return np.asarray(points, np.float64).reshape(-1, 2)


def _in_rows(chart: Chart, corners: Corners) -> bool:
    """Whether the corners lie as a flat chart's do, but for what a lens bends.

    OpenCV now and then makes up a row of corners where a chart is cut off by the edge of the picture.
    """
    flat = chart.points_m[corners.index, :2]
    matrix, _ = cv2.findHomography(flat, corners.points)
    if np.shape(matrix) != (3, 3):
        return False
    fitted = cv2.perspectiveTransform(flat[:, None], matrix)[:, 0]
    off = np.hypot(*(np.asarray(fitted, np.float64) - corners.points).T)
    return bool(off.max() < CROOKED * spacing_px(chart, Corners(corners.index, np.asarray(fitted, np.float64))))


def _find_charuco(chart: Chart, image: Bytes) -> tuple[Ints, Doubles] | None:
    points, index, _, _ = cv2.aruco.CharucoDetector(chart.board).detectBoard(image)
    if index is None or len(index) < 4:
        return None
    order = np.argsort(index.ravel())
    kept = np.asarray(index, np.int32).ravel()[order]
    flat = chart.points_m[kept, :2]
    if np.linalg.matrix_rank(flat - flat[0], tol=0.5 * chart.square_m) < 2:
        return None
    return kept, np.asarray(points, np.float64).reshape(-1, 2)[order]


def spacing_px(chart: Chart, corners: Corners) -> float:
    """Pixels between neighbouring corners, where they are closest."""
    place = {int(number): point for number, point in zip(corners.index, corners.points, strict=True)}
    beside = [
        float(np.hypot(*(place[number + step] - point)))
        for number, point in place.items()
        for step in (1, chart.columns)
        if number + step in place and (step > 1 or (number + 1) % chart.columns)
    ]
    return min(beside, default=8.0)
