"""PNG: a folder of 8-bit previews, one per slice with levels common to all, and a contact sheet."""

from __future__ import annotations

import math

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.drivers.captures.export import ExportJob
from slopegate.drivers.captures.model import SliceRecord
from slopegate.drivers.files.images import srgb8, write_image

THUMB_WIDTH = 320
LABEL_HEIGHT = 22
BRIGHT_PERCENTILE = 99.9
MOSAICS = {
    "bayer_rg": cv2.COLOR_BayerBG2RGB,
    "bayer_gr": cv2.COLOR_BayerGB2RGB,
    "bayer_gb": cv2.COLOR_BayerGR2RGB,
    "bayer_bg": cv2.COLOR_BayerRG2RGB,
}
"""OpenCV names a mosaic by its second row's second and third pixel."""


def write(job: ExportJob) -> None:
    """slice_0000.png ... and contact.png; black is what is counted in the dark, white the brightest slice's light."""
    job.target.mkdir()
    white = max(float(np.percentile(mean[::4, ::4], BRIGHT_PERCENTILE)) for _, mean in job.means())
    black = 0.0 if job.subtract_dark else float(np.median(job.folder.dark_mean()))
    mosaic = MOSAICS.get(job.folder.manifest.camera.pixel_format[:8])
    small = []
    for record, mean in job.means():
        picture = preview(mean, black, max(white, black + 1.0), mosaic)
        write_image(job.target / f"slice_{record.index:04d}.png", ".png", picture, record.model_dump(mode="json"))
        small.append(thumb(picture, _label(record)))
    write_image(job.target / "contact.png", ".png", sheet(small), job.facts)


def preview(mean: Singles, black: float, white: float, mosaic: int | None) -> Bytes:
    """Mean counts (H, W) -> 8 bit (H, W), or RGB (H, W, 3) of a mosaic, by the sRGB curve (IEC 61966-2-1)."""
    level = np.clip((mean - np.float32(black)) / np.float32(white - black), 0.0, 1.0)
    if mosaic is not None:
        level = cv2.cvtColor(np.rint(65535 * level).astype(np.uint16), mosaic) / np.float32(65535)
    return srgb8(level)


def _label(record: SliceRecord) -> str:
    distance = record.distance_m
    where = f"{distance:.3f} m" if distance is not None else f"{record.applied.delay_us:g} us"
    return f"{record.index}  {where}" + ("  no light" if record.empty else "")


def thumb(picture: Bytes, label: str) -> Bytes:
    """A small RGB picture (h, w, 3) of a picture (H, W) or (H, W, 3), with a label above it."""
    height = max(1, round(picture.shape[0] * THUMB_WIDTH / picture.shape[1]))
    small = cv2.resize(picture, (THUMB_WIDTH, height), interpolation=cv2.INTER_AREA)
    colour = cv2.cvtColor(small, cv2.COLOR_GRAY2RGB) if small.ndim == 2 else small
    strip = np.full((LABEL_HEIGHT, THUMB_WIDTH, 3), 32, np.uint8)
    cv2.putText(strip, label, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235, 235, 235), 1, cv2.LINE_AA)
    return np.concatenate([strip, colour.astype(np.uint8)])


def sheet(thumbs: list[Bytes]) -> Bytes:
    """All of them, of equal size, on one sheet (H, W, 3)."""
    columns = math.ceil(math.sqrt(len(thumbs)))
    rows = math.ceil(len(thumbs) / columns)
    height, width = thumbs[0].shape[:2]
    whole = np.zeros((rows * height, columns * width, 3), np.uint8)
    for place, one in enumerate(thumbs):
        row, column = divmod(place, columns)
        whole[row * height : (row + 1) * height, column * width : (column + 1) * width] = one
    return whole
