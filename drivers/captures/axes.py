"""Sizes of the axes of a stack of slices, for formats that want one size for the whole stack.

A picture of a camera has no size in metres but at a distance: that of the middle slice is taken, or 1 m where slices
have none. Slices at equal steps of the delay are not at equal steps in space, so their mean step is given beside where
each of them truly is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slopegate.core.gating.gate import slab_if_any
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings


@dataclass(frozen=True)
class StackAxes:
    """Where slices lie, and how far apart they and their pixels are."""

    along: str
    """What tells the slices apart: "distance" in metres, or "delay" in microseconds where they are no slabs."""
    places: tuple[float, ...]
    """Distance or delay of each slice."""
    step: float
    """Mean step between slices; negative where they come nearer."""
    pixel_m: tuple[float, float]
    """Height and width of a pixel ..."""
    at_m: float
    """... at this distance."""


def axes_of(rig: Rig, gates: Sequence[GateSettings | None]) -> StackAxes:
    """The axes of a stack of at least one slice, from the gates that were applied (None: a camera without a gate)."""
    slabs = [None if gate is None else slab_if_any(rig, gate).slab for gate in gates]
    known = [slab.distance_m for slab in slabs if slab is not None and slab.distance_m is not None]
    distances = len(known) == len(gates) and bool(np.isfinite(known).all())
    places = tuple(known) if distances else tuple(0.0 if gate is None else float(gate.delay_us) for gate in gates)
    step = (places[-1] - places[0]) / (len(places) - 1) if len(places) > 1 else 0.0
    at_m = float(np.median(known)) if distances else 1.0
    lens = rig.camera.lens
    return StackAxes("distance" if distances else "delay", places, step or 1.0, (at_m / lens.fy, at_m / lens.fx), at_m)
