"""A proximity alarm (section VI-A of the paper): something that crosses the sheet of space that a gate records."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import require, require_finite
from slopegate.core.rig.spread import robust_deviation

_SIGMAS = 8.0
QUIET_FRAMES = 5
"""So many frames below the share end an event: what crosses after that sets the alarm off anew."""


@dataclass(frozen=True)
class AlarmZone:
    """The region of the image to watch, columns x0 .. x1 - 1 and rows y0 .. y1 - 1, and what sets the alarm off."""

    x0: int
    y0: int
    x1: int
    y1: int
    level_count: float
    """A pixel brighter than this has something in it."""
    least_share: float
    """Share of the region's pixels, 0..1, that sets the alarm off when reached."""

    def __post_init__(self) -> None:
        require(0 <= self.x0 < self.x1, "x0", self.x0, f"at least 0 and below x1 ({self.x1})")
        require(0 <= self.y0 < self.y1, "y0", self.y0, f"at least 0 and below y1 ({self.y1})")
        require_finite("level_count", self.level_count)
        require(0 < self.least_share <= 1, "least_share", self.least_share, "above 0 and at most 1")


@dataclass(frozen=True)
class Trip:
    """The frame that set the alarm off."""

    sequence: int
    time_s: float
    """The frame's own time stamp."""
    share: float


@dataclass(frozen=True)
class Alarm:
    """The state of an alarm: an event begins at the share and ends `QUIET_FRAMES` after the last frame that had it."""

    watch: AlarmZone
    share: float = 0.0
    """Of the frame seen last."""
    trip: Trip | None = None
    """How the last event began; None before the first."""
    trips: int = 0
    """How many events there were."""
    frames: int = 0
    quiet: int = QUIET_FRAMES
    """Frames below the share, one after the other; no event goes on from `QUIET_FRAMES` on."""

    def after(self, image: Counts, sequence: int, time_s: float) -> Alarm:
        """The alarm after another frame, (H, W) uint16."""
        share = bright_share(image, self.watch)
        seen = replace(self, share=share, frames=self.frames + 1)
        if share < self.watch.least_share:
            return replace(seen, quiet=self.quiet + 1)
        if self.quiet < QUIET_FRAMES:
            return replace(seen, quiet=0)
        return replace(seen, quiet=0, trip=Trip(sequence, time_s, share), trips=self.trips + 1)


def bright_share(image: Counts, watch: AlarmZone) -> float:
    """Share of the region's pixels, 0..1, above the level. Raises InputError for a region beyond the image."""
    height, width = image.shape
    require(watch.x1 <= width, "x1", watch.x1, f"at most the image's width ({width})")
    require(watch.y1 <= height, "y1", watch.y1, f"at most the image's height ({height})")
    region = image[watch.y0 : watch.y1, watch.x0 : watch.x1]
    return int(np.count_nonzero(region > watch.level_count)) / region.size


def quiet_level(image: Counts, region: tuple[int, int, int, int]) -> float:
    """A level that noise does not reach, from a frame (H, W) with nothing in the sheet; region is x0, y0, x1, y1.

    The region's 99.99th percentile and eight standard deviations more; these from the median absolute deviation, and of
    at least 4 counts.
    """
    x0, y0, x1, y1 = region
    values = image[y0:y1, x0:x1].astype(np.float32)
    require(values.size > 0, "region", region, "x0 < x1 and y0 < y1, inside the image")
    return float(np.percentile(values, 99.99)) + _SIGMAS * max(robust_deviation(values), 4.0)
