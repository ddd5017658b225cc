"""How many pixels the projector has, where nobody says so: what the number of pictures and their codes leave open."""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.calibration.codes import decode, white_last
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.calibrations.pictures import CalibrationError, PoseFolder, read_pose

USUAL: Final = (
    (640, 360), (640, 480), (848, 480), (854, 480), (800, 600), (1024, 768), (1280, 720), (1280, 800), (912, 1140),
    (1280, 960), (1280, 1024), (1366, 768), (1400, 1050), (1600, 1200), (1920, 1080), (1920, 1200), (2048, 1536),
    (2560, 1600), (3840, 2160),
)  # fmt: skip
"""Of projectors, smaller ones first."""
MOST_BEYOND: Final = 0.01
"""Of the pixels with a clear code, those that may lie beyond the projector."""


def projector_of(pose: PoseFolder, usual: Raster) -> tuple[Raster, list[str]]:
    """The projector's size by the pictures of a pose, and a sentence where it was guessed.

    That is the usual one where the number of pictures fits it; else the smallest of common sizes that holds all codes;
    else the usual one, which then is refused where the pictures are read.
    """
    if len(pose.files) == white_last(usual).count:
        return usual, []
    for size in USUAL:
        raster = Raster(*size)
        if len(pose.files) == white_last(raster).count:
            try:
                frames = read_pose(pose, raster)
            except CalibrationError:  # as many pictures, and other bits for columns and rows
                continue
            decoded = decode(frames.order, frames.frames)
            beyond, within = int(decoded.beyond.sum()), int(np.isfinite(decoded.place[..., 0]).sum())
            if beyond <= MOST_BEYOND * within:
                return raster, [
                    f"the projector is taken to have {raster} pixels, the smallest usual size that holds all codes of "
                    f"{pose.name}: give --projector if it has another"
                ]
    return usual, []
