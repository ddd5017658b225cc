"""Keypoints of a target, found once and then looked at where they were found (section VI-B of the paper; model 6).

The camera does not move. So a keypoint is seen when the light of the small patch about it is there and the ORB
descriptor computed at its stored position, size and angle is still the stored one; nothing is detected anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bools, Bytes, Counts, Doubles, Indices
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.triangulate import projector_rows

Rectangle = tuple[int, int, int, int]
"""Columns x0 <= x < x1 and rows y0 <= y < y1 of the image."""

PATCH = 3
"""Half size of the patch whose light is measured: 7 x 7 pixels."""
MAX_HAMMING = 64
"""Of 256 bits. Noise flips up to about 40 of them, another place differs in 128 -+ 8 and more."""
NOISE_SIGMAS = 5.0
LIT_SHARE = 0.5
"""A keypoint is lit or it is not: half of its full light tells which, wherever the exposure's noise allows it."""

_MARGIN = 64
"""Pixels about the target that go with it, so that descriptors at its rim know their surroundings."""
_CELLS = 8
_CANDIDATES = 6
_TOE_COUNTS = 32.0
"""Rounds the square root off near black, where read noise rules."""


@dataclass(frozen=True)
class Tone:
    """How counts become the 8-bit grey that ORB reads: a square root, so that shot noise is equal in light and dark."""

    black: float
    white: float

    def table(self) -> Bytes:
        """Grey for every 16-bit count, (65536,)."""
        light = np.clip(np.arange(65536) - self.black, 0.0, self.white - self.black)
        root = np.sqrt(light + _TOE_COUNTS) - np.sqrt(_TOE_COUNTS)
        return np.asarray(np.rint(255 * root / root[-1]), np.uint8)


@dataclass(frozen=True, eq=False)
class Keypoints:
    """K keypoints of one image and what their patches send back.

    columns, rows (K,) float64: continuous pixel coordinates. shape (K, 3) float64: ORB's size, angle and octave.
    descriptors (K, 32) uint8. direct, ambient, noise (K,) float64, counts averaged over the patch: the projector's
    light, the ambient light of one period, and the standard deviation of one reading under full light.
    """

    crop: Rectangle
    tone: Tone
    columns: Doubles
    rows: Doubles
    shape: Doubles
    descriptors: Bytes
    direct: Doubles
    ambient: Doubles
    noise: Doubles

    def __len__(self) -> int:
        return len(self.rows)

    def only(self, chosen: NDArray[np.generic]) -> Keypoints:
        """The chosen ones (mask or indices)."""
        kept = {
            name: getattr(self, name)[chosen]
            for name in ("columns", "rows", "shape", "descriptors", "direct", "ambient", "noise")
        }
        return replace(self, **kept)

    def projector_rows(self, rig: Rig, inverse_depth: float) -> Doubles:
        """The projector row (K,) that lights each keypoint if it is at this 1/z from the camera, NaN behind the rig."""
        return projector_rows(rig, rig.camera_rays(self.columns, self.rows), inverse_depth)


def detect(image: Counts, black_count: float, target: Rectangle, limit: int) -> Keypoints:
    """At most `limit` ORB keypoints inside the target of a fully lit image (H, W); `direct` holds all light.

    They are spread over the target: the strongest of each of 8 x 8 cells, so that a busy corner does not outvote all.
    """
    height, width = image.shape
    x0, y0, x1, y1 = target
    crop = (max(x0 - _MARGIN, 0), max(y0 - _MARGIN, 0), min(x1 + _MARGIN, width), min(y1 + _MARGIN, height))
    inside = image[y0:y1:2, x0:x1:2]
    tone = Tone(black_count, max(float(np.percentile(inside, 99.5)), black_count + 16.0))
    grey = _grey(image, crop, tone)
    mask = np.zeros_like(grey)
    mask[y0 - crop[1] : y1 - crop[1], x0 - crop[0] : x1 - crop[0]] = 255
    orb = cv2.ORB.create(nfeatures=_CANDIDATES * limit)
    strongest = sorted(orb.detect(grey, mask), key=lambda point: -point.response)
    cells: dict[tuple[int, int], int] = {}
    chosen = []
    for point in strongest:
        x, y = point.pt[0] + crop[0] - x0, point.pt[1] + crop[1] - y0
        cell = (int(x * _CELLS / (x1 - x0)), int(y * _CELLS / (y1 - y0)))
        cells[cell] = cells.get(cell, 0) + 1
        if cells[cell] <= limit // _CELLS**2:
            chosen.append(point)
    found, descriptors = orb.compute(grey, chosen) if chosen else ((), np.zeros((0, 32), np.uint8))
    places = np.array([point.pt for point in found], np.float64).reshape(-1, 2)
    shape = np.array([(point.size, point.angle, point.octave) for point in found], np.float64).reshape(-1, 3)
    empty = np.zeros(len(found))
    points = Keypoints(
        crop=crop,
        tone=tone,
        columns=places[:, 0] + crop[0] + 0.5,
        rows=places[:, 1] + crop[1] + 0.5,
        shape=shape,
        descriptors=np.asarray(descriptors, np.uint8),
        direct=empty,
        ambient=empty,
        noise=empty,
    )
    patches = _patches(image, points)
    return replace(points, direct=patches.mean(axis=1) - black_count, noise=patches.std(axis=1))


def repeated(points: Keypoints, first: Counts, second: Counts) -> Keypoints:
    """The keypoints that a second fully lit image shows as well, with their noise measured from the difference."""
    one, two = _patches(first, points), _patches(second, points)
    # Half a count is what rounding to counts alone can do.
    pixel = np.maximum((one - two).std(axis=1) / np.sqrt(2), 0.5)
    direct = (one + two).mean(axis=1) / 2 - points.tone.black
    measured = replace(points, direct=direct, noise=pixel / (2 * PATCH + 1))
    return measured.only(matches(measured, second))


def without_ambient(points: Keypoints, dark: Counts, periods: float) -> Keypoints:
    """The keypoints with ambient and projector's light told apart, by an image of this exposure without the latter."""
    ambient = np.maximum(light(points, dark) / periods, 0.0)
    ambient = np.where(ambient > 2 * points.noise, ambient, 0.0)
    return replace(points, direct=points.direct - ambient, ambient=ambient)


def light(points: Keypoints, image: Counts) -> Doubles:
    """Counts above black, averaged over each keypoint's patch; (K,)."""
    return np.asarray(_patches(image, points).mean(axis=1) - points.tone.black)


def lit_share(points: Keypoints, image: Counts, periods: float) -> Doubles:
    """The projector's light at each keypoint over what full exposure shows there, about 0 or 1 for each; (K,)."""
    return (light(points, image) - periods * points.ambient) / points.direct


def lit(points: Keypoints, image: Counts, periods: float) -> Bools:
    """Whether each keypoint's patch stands above the noise; (K,)."""
    share = lit_share(points, image, periods)
    return (share > LIT_SHARE) & (share * points.direct > NOISE_SIGMAS * points.noise)


def visible(points: Keypoints, image: Counts, periods: float) -> Bools:
    """Whether each keypoint is lit and looks as it did; (K,)."""
    seen = lit(points, image, periods)
    chosen = np.flatnonzero(seen)
    if chosen.size:
        seen[chosen] = matches(points.only(chosen), image)
    return seen


def matches(points: Keypoints, image: Counts) -> Bools:
    """Whether the descriptor at each keypoint's place is within `MAX_HAMMING` of the stored one; (K,)."""
    result = np.zeros(len(points), bool)
    if not len(points):
        return result
    grey = _grey(image, points.crop, points.tone)
    stored = [
        cv2.KeyPoint(x - points.crop[0] - 0.5, y - points.crop[1] - 0.5, size, angle, 0.0, int(octave), index)
        for index, (x, y, (size, angle, octave)) in enumerate(
            zip(points.columns, points.rows, points.shape, strict=True)
        )
    ]
    # OpenCV may leave out keypoints near the rim; class_id says which are left.
    again, descriptors = cv2.ORB.create().compute(grey, stored)
    if descriptors is not None:
        index = np.array([point.class_id for point in again])
        result[index] = hamming(np.asarray(descriptors, np.uint8), points.descriptors[index]) <= MAX_HAMMING
    return result


def hamming(one: Bytes, two: Bytes) -> Indices:
    """Differing bits of descriptors (K, 32); (K,)."""
    return np.asarray(np.bitwise_count(one ^ two).sum(axis=1, dtype=np.int64))


def _grey(image: Counts, crop: Rectangle, tone: Tone) -> Bytes:
    x0, y0, x1, y1 = crop
    return tone.table()[image[y0:y1, x0:x1]]


def _patches(image: Counts, points: Keypoints) -> Doubles:
    """(K, 49) counts; at the image's rim the nearest pixels stand in."""
    step = np.arange(-PATCH, PATCH + 1)
    rows = np.clip(points.rows.astype(int)[:, None, None] + step[:, None], 0, image.shape[0] - 1)
    columns = np.clip(points.columns.astype(int)[:, None, None] + step, 0, image.shape[1] - 1)
    return image[rows, columns].reshape(len(points), step.size**2).astype(np.float64)
