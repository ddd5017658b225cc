"""Facts of screens, and what makes one unfit for a projector."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from PySide6.QtGui import QScreen

from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import RigProjector

RATE_TOLERANCE: Final = 5e-4
"""Wide enough for the rounding of desktops, and narrow enough to tell 59.94 Hz from 60 Hz."""
USUAL_RATE_HZ: Final = 60.0


@dataclass(frozen=True)
class ScreenFacts:
    """A screen: size in its own pixels, place in those of the desktop."""

    name: str
    x: int
    y: int
    width_px: int
    height_px: int
    scale: float
    rate_hz: float

    @property
    def raster(self) -> Raster:
        """The number of its pixels."""
        return Raster(self.width_px, self.height_px)

    @property
    def period_us(self) -> float:
        """Time from one frame to the next; that of 60 Hz where the desktop does not tell the rate."""
        return 1e6 / (self.rate_hz if self.rate_hz > 0 else USUAL_RATE_HZ)

    def __str__(self) -> str:
        return f"{self.name}: {self.raster}, {self.rate_hz:.2f} Hz"


def facts(screen: QScreen) -> ScreenFacts:
    """What Qt knows of a screen; halves of a pixel are rounded up as Qt does."""
    area, scale = screen.geometry(), screen.devicePixelRatio()
    width_px, height_px = (math.floor(side * scale + 0.5) for side in (area.width(), area.height()))
    return ScreenFacts(screen.name(), area.x(), area.y(), width_px, height_px, scale, screen.refreshRate())


def objections(screen: ScreenFacts, others: list[ScreenFacts], projector: RigProjector) -> Iterator[str]:
    """A sentence for everything that is not as the rig file says, or as a pattern needs it."""
    if any((screen.x, screen.y) == (other.x, other.y) for other in others):
        yield f"{screen.name} shows the same as another screen: let them extend each other in the desktop's settings."
    if screen.scale != 1:
        yield (
            f"{screen.name} is scaled to {100 * screen.scale:g} %: set it to 100 %, or the last row and column of a"
            " pattern may be missing."
        )
    raster = projector.raster
    if screen.raster != raster:
        yield (
            f"{screen.name} has {screen.raster} pixels and the rig's projector {raster}: the rows of a pattern are not"
            " the rows that the gate counts with."
        )
    if abs(screen.period_us / projector.period_us - 1) > RATE_TOLERANCE:
        yield (
            f"{screen.name} refreshes at {screen.rate_hz:.3f} Hz and the rig's projector at"
            f" {1e6 / projector.period_us:.3f} Hz: choose that mode, or write period_us = {screen.period_us:.1f} into"
            " the rig file."
        )
