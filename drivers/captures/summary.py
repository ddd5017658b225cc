"""Summarises a capture in a few images: sum, coloured overlay and depth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slopegate.core.measure.stack import DARK_SIGMAS, Stack, StackSummary
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.spread import robust_deviation
from slopegate.drivers.captures.model import SliceRecord
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.files.durable import StorageError


def by_delay(folder: Capture) -> list[SliceRecord]:
    """The slices taken so far, by rising delay, so the farthest first."""
    return sorted(folder.records().values(), key=lambda record: record.applied.delay_us)


def summarise(folder: Capture, progress: Callable[[float], bool] | None = None) -> StackSummary:
    """Read every slice once. Raises StorageError for a capture without slices, Cancelled when told to stop."""
    records = by_delay(folder)
    if not records:
        raise StorageError(f"{folder.path} has no slice yet: there is nothing to show")
    dark = folder.dark_mean()
    stack = Stack(folder.rig, tuple(record.applied.settings() for record in records), _floor(folder, records))
    for place, record in enumerate(records):
        if progress is not None and not progress(place / len(records)):
            raise Cancelled("Reading the capture was stopped")
        assert record.index is not None
        stack.add(folder.mean(record.index) - dark)
    return stack.summary()


def _floor(folder: Capture, records: list[SliceRecord]) -> float:
    """Counts above the dark that noise alone does not reach: from the dark frame, else from the dimmest slice."""
    frames = folder.manifest.frames
    dark = folder.dark_record()
    if dark is not None and dark.noise_counts is not None:
        return DARK_SIGMAS * dark.noise_counts / float(np.sqrt(frames)) + 0.5
    taken = [record.index for record in records if not record.empty and record.index is not None]
    samples = [folder.mean(index)[::4, ::4] for index in taken]
    if not samples:
        return 0.5
    dimmest = min(samples, key=lambda sample: float(np.median(sample)))
    return DARK_SIGMAS * robust_deviation(dimmest) + 0.5
