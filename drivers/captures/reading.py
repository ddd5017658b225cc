"""What can be read of a capture, wherever its numbers are: in its own folder, or in what it was exported to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.captures.model import Manifest, Sidecar, SliceRecord
from slopegate.drivers.captures.tiff import Sums
from slopegate.drivers.files.durable import StorageError


class Capture(ABC):
    """A capture to read. Nothing is kept in memory: every call reads anew."""

    def __init__(self, path: Path, manifest: Manifest, rig: Rig) -> None:
        self.path, self.manifest, self.rig = path, manifest, rig

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of every image."""
        return self.manifest.camera.height, self.manifest.camera.width

    @property
    def sidecar(self) -> Sidecar:
        """Everything but the pixels."""
        found = self.records()
        dark, slices = self.dark_record(), list(found.values())
        return Sidecar(capture=self.manifest, dark=dark, slices=slices, missing=self._not_in(found))

    @abstractmethod
    def records(self) -> dict[int, SliceRecord]:
        """The slices that are there, by rising index."""

    @abstractmethod
    def dark_record(self) -> SliceRecord | None:
        """The record of the dark frame, if there is one."""

    @abstractmethod
    def total(self, index: int) -> Sums:
        """The sum (H, W) of a slice's frames. Raises StorageError, also for a slice without pixels."""

    @abstractmethod
    def dark_total(self) -> Sums | None:
        """The sum (H, W) of the dark frames; None without a dark frame. Raises StorageError."""

    @abstractmethod
    def pixel_means(self, indices: Sequence[int], row: int, column: int) -> Doubles:
        """Mean counts (N,) of one pixel in these slices, without reading the rest of them."""

    def missing(self) -> list[int]:
        """Indices of the slices that are not there."""
        return self._not_in(self.records())

    def _not_in(self, records: dict[int, SliceRecord]) -> list[int]:
        return [index for index in range(len(self.manifest.slices)) if index not in records]

    def mean(self, index: int) -> Singles:
        """Mean counts (H, W) float32 of a slice; those of the dark for an empty slice."""
        record = self.records().get(index)
        if record is None:
            gone, total = len(self.missing()), len(self.manifest.slices)
            raise StorageError(f"{self.path} has no slice {index}: {gone} of {total} are missing")
        return self.dark_mean() if record.empty else _mean(self.total(index), record.frames)

    def dark_mean(self) -> Singles:
        """Mean counts (H, W) float32 in the dark: the dark frame, else the camera's black level."""
        record, total = self.dark_record(), self.dark_total()
        if record is None or total is None:
            return np.full(self.shape, self.manifest.camera.black_count, np.float32)
        return _mean(total, record.frames)

    def unfinished(self) -> str:
        """One sentence about the slices that are missing; empty when none is."""
        missing, total = len(self.missing()), len(self.manifest.slices)
        return f"{self.path.name} is unfinished: {missing} of {total} slices are missing" if missing else ""


def _mean(total: Sums, frames: int) -> Singles:
    return (total / np.float64(frames)).astype(np.float32)
