"""What of a light transport is there: the camera's side in a colour a slice, and the projector's side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PySide6.QtCore import QObject, Signal

from slopegate.app.session.loading import Newest, Progress
from slopegate.app.widgets.light_pictures import colour_picture, peaks_picture, white_level
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.transport.sliced import dual_image
from slopegate.drivers.transports.storage import TransportFolder, open_transport

FILL_PX = 640
"""Width of the pictures."""


@dataclass(frozen=True, eq=False)
class Fill:
    """The finished slices together, as RGB pictures (h, w, 3)."""

    camera: Bytes
    """Each slice in a colour of its own, from red for the first to blue for the last."""
    projector: Bytes
    """The scene as seen from the projector: blocks that reach no pixel of any slice are black."""
    sizes: tuple[tuple[int, int], tuple[int, int]]
    """Width and height of the images that they are pictures of."""


class FillWatch(QObject):
    """Adds slices as they are finished; each is read once."""

    changed = Signal(object)
    """A Fill."""
    failed = Signal(str)
    """Why what is there cannot be shown."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._worker: Newest[Fill] = Newest(self)
        self._worker.finished.connect(self.changed)
        self._worker.failed.connect(self.failed)
        self._sums: FillSums | None = None

    def look_at(self, path: Path) -> None:
        """Show what is finished in this folder, and add to it what has been finished since the last look."""
        self._worker.want(lambda progress: self._filled(path, progress))

    def _filled(self, path: Path, progress: Progress) -> Fill:
        if self._sums is None or self._sums.path != path:
            self._sums = FillSums(open_transport(path))
        return self._sums.fill(progress)

    def close(self) -> None:
        """Stop."""
        self._worker.close()


class FillSums:
    """Sums of the slices of a folder that have been added."""

    def __init__(self, folder: TransportFolder) -> None:
        self._folder = folder
        self._added: set[int] = set()
        count = len(folder.manifest.slices)
        steps = np.rint(np.linspace(235, 20, count)).astype(np.uint8) if count > 1 else np.array([128], np.uint8)
        self._colours = cv2.applyColorMap(steps[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1].astype(np.float32) / 255
        raster = folder.grid.raster
        self._camera: Singles = np.zeros((*folder.shape, 3), np.float32)
        self._projector: Singles = np.zeros((raster.height, raster.width), np.float32)

    @property
    def path(self) -> Path:
        """The folder."""
        return self._folder.path

    def fill(self, progress: Progress) -> Fill:
        """Read the slices that are new, and draw all of them."""
        for index in sorted(set(self._folder.records()) - self._added):
            progress.step(index / len(self._colours), "Reading what is there ...")
            one = self._folder.slice(index)
            self._camera += one.total[:, :, None] * self._colours[index]
            self._projector += dual_image(one, self._folder.grid.raster, np.ones_like(one.total))
            self._added.add(index)
        (height, width), raster = self._folder.shape, self._folder.grid.raster
        return Fill(
            colour_picture(self._camera, white_level(self._camera.max(axis=2)), FILL_PX),
            peaks_picture(self._projector, FILL_PX),
            ((width, height), (raster.width, raster.height)),
        )
