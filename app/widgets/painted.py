"""A region of the image that is painted shape by shape, with undo."""

from __future__ import annotations

import base64
import itertools
import struct

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Ints
from slopegate.drivers.files.picture_checks import MAX_PIXELS

_SHIFT = 4
_UNDO_STEPS = 20


class PaintedRegion:
    """The painted pixels (H, W) bool. Shapes are in continuous columns and rows; they add pixels or remove them."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._mask = np.zeros(shape, np.uint8)
        self._past: list[Bytes] = []

    @property
    def pixels(self) -> Bools:
        """The region (H, W) bool; a view, not a copy."""
        return self._mask.view(np.bool_)

    @property
    def empty(self) -> bool:
        """Whether nothing is painted."""
        return not self._mask.any()

    @property
    def can_undo(self) -> bool:
        """Whether there is a shape to undo."""
        return bool(self._past)

    def rectangle(self, box: tuple[int, int, int, int], add: bool = True) -> None:
        """Paint a box (x0, y0, x1, y1): columns x0 .. x1 - 1 of rows y0 .. y1 - 1, cut to the image."""
        self._remember()
        x0, y0, x1, y1 = (max(edge, 0) for edge in box)
        self._mask[y0:y1, x0:x1] = add

    def polygon(self, corners: Doubles, add: bool = True) -> None:
        """Paint the inside of a polygon with corners (N, 2); it may cross itself (even-odd)."""
        self._remember()
        cv2.fillPoly(self._mask, [_fixed(corners)], int(add), cv2.LINE_8, _SHIFT)

    def stroke(self, points: Doubles, radius_px: float, add: bool = True) -> None:
        """Paint with a round brush along points (N, 2). A single point begins a stroke, which one undo takes back."""
        if len(points) == 1:
            self._remember()
        fixed = _fixed(points)
        width = max(round(2 * radius_px), 1)
        for start, end in itertools.pairwise(fixed):
            cv2.line(self._mask, start.tolist(), end.tolist(), int(add), width, cv2.LINE_8, _SHIFT)
        for at in fixed:
            radius = round(radius_px * (1 << _SHIFT))
            cv2.circle(self._mask, at.tolist(), radius, int(add), cv2.FILLED, cv2.LINE_8, _SHIFT)

    def show(self, region: Bools) -> None:
        """Have this region (H, W) painted in place of all there was."""
        self._remember()
        self._mask = np.ascontiguousarray(region, np.uint8)

    def clear(self) -> None:
        """Remove everything; this can be undone."""
        if not self.empty:
            self._remember()
            self._mask[:] = 0

    def undo(self) -> None:
        """Take back the last shape."""
        if self._past:
            self._mask = self._past.pop()

    def _remember(self) -> None:
        self._past.append(self._mask.copy())
        del self._past[:-_UNDO_STEPS]


def _fixed(points: Doubles) -> Ints:
    """Continuous coordinates, where pixel k is centred at k + 1/2, as OpenCV's fixed-point ones, centred at k."""
    return np.rint((points - 0.5) * (1 << _SHIFT)).astype(np.int32)


def region_text(region: Bools) -> str:
    """A region (H, W) as text: a PNG of one bit a pixel in base64."""
    done, data = cv2.imencode(".png", region.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    assert done
    return base64.b64encode(data.tobytes()).decode("ascii")


def text_region(text: object, shape: tuple[int, int]) -> Bools | None:
    """The region of an image of this height and width that `region_text` has written; None of anything else."""
    region = _picture(text) if isinstance(text, str) else None
    return region if region is not None and region.shape == shape else None


def _picture(text: str) -> Bools | None:
    """None of no picture, and of one larger than an image is."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError:
        return None
    if data[:8] != b"\x89PNG\r\n\x1a\n" or len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    if width * height > MAX_PIXELS:
        return None
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if picture is None else np.asarray(picture > 127)
