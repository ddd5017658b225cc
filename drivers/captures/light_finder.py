"""Looks through several slices at once to find those that hold no light, so that no frames are spent on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from slopegate.core.gating.slices import Probe
from slopegate.core.measure.stack import count_above
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings

DARK_SIGMAS: Final = 6.0
"""A pixel that stands out of the dark by this many standard deviations is lit: one false alarm in 500 frames of two
million pixels, which costs frames and loses nothing. Fainter surfaces count as dark."""


class LightFinder:
    """Ask for a gate, tell what one frame shows through it, until `asked` is None."""

    def __init__(self, rig: Rig, gates: Mapping[int, GateSettings], dark: Singles, noise_counts: float) -> None:
        """`dark` (H, W): counts without light; `noise_counts`: standard deviation of a pixel in the dark."""
        self._indices = tuple(gates)
        self._probe = Probe.over(rig, tuple(gates.values()))
        self._floor = dark + np.float32(DARK_SIGMAS * noise_counts + 0.5)

    @property
    def asked(self) -> GateSettings | None:
        """The gate to look through next; None when all is known."""
        return self._probe.asked

    def tell(self, image: Counts) -> None:
        """One frame (H, W) through the gate asked for."""
        self._probe = self._probe.tell(count_above(image, self._floor) > 0)

    @property
    def dark(self) -> tuple[int, ...]:
        """Indices of the gates without light, once all is known."""
        lit = {self._indices[place] for place in self._probe.lit}
        return tuple(index for index in self._indices if index not in lit)
