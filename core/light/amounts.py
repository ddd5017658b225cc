"""What a gate keeps of each part of the light and what it refuses, at a pixel and in the whole picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopegate.core.light.part import PARTS, PartName
from slopegate.core.rig.arrays import Singles


class Split(NamedTuple):
    """Light of one part, linear: what the gate records, and what it leaves out of a fully lit picture."""

    kept: float
    refused: float


@dataclass(frozen=True, eq=False)
class Amounts:
    """Images (H, W) of each part of the light, linear: as a gate records it, and with everything lit once."""

    kept: Mapping[PartName, Singles]
    lit: Mapping[PartName, Singles]

    @property
    def names(self) -> tuple[PartName, ...]:
        """The parts, in the order of PARTS."""
        return tuple(name for name in PARTS if name in self.kept and name in self.lit)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self.kept[self.names[0]].shape
        return height, width

    def at(self, column: int, row: int) -> dict[PartName, Split]:
        """Each part at one pixel."""
        pixel = (row, column)
        return {name: _split(float(self.kept[name][pixel]), float(self.lit[name][pixel])) for name in self.names}

    def mean(self) -> dict[PartName, Split]:
        """Each part in the mean over all pixels. A part is refused where its pixels are, so it is summed by pixel."""
        found = {}
        for name in self.names:
            kept, lit = self.kept[name], self.lit[name]
            refused = float(np.maximum(lit - kept, 0).mean(dtype=np.float64))
            found[name] = Split(float(kept.mean(dtype=np.float64)), refused)
        return found


def _split(kept: float, lit: float) -> Split:
    """More than once recorded, nothing is refused."""
    return Split(kept, max(lit - kept, 0.0))
