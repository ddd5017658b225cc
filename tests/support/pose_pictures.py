"""Folders of calibration pictures: what a hidden pair sees of a chart, one folder a pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from chart_views import HiddenPair, Look, Pose, pictures
from slopegate.core.calibration.chart import Chart


def write_frames(folder: Path, frames: np.ndarray) -> Path:
    """One PNG a frame."""
    folder.mkdir(parents=True)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"pattern_{number:02d}.png"), frame)
    return folder


def write_poses(folder: Path, pair: HiddenPair, chart: Chart, held: Sequence[Pose], how: Look | None = None) -> Path:
    """A folder pose_01, pose_02 and so on for each of the poses."""
    rng = np.random.default_rng(0)
    for number, pose in enumerate(held):
        write_frames(folder / f"pose_{number + 1:02d}", pictures(pair, chart, pose, rng, how))
    return folder
