"""Which delays are of use: those at which the slab meets something."""

from __future__ import annotations

import numpy as np

from slopegate.app.session.source import Source, known_buffers
from slopegate.core.gating.slices import occupied_times, phase_range
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings

_NEAREST_M = 0.3
"""Nothing nearer is expected of a camera that knows no depth."""
_MARGIN = 0.03
"""Room beside the range, as a share of it."""


def lit_ends(source: Source) -> Singles | None:
    """First and last projector row (H, 2) that light what each camera row sees, -1 for none; None where unknown."""
    buffers = known_buffers(source)
    if buffers is None:
        return None
    rows, lit = buffers.projector_row, buffers.projector_row >= 0
    first, last = rows.min(axis=1, where=lit, initial=np.inf), rows.max(axis=1, where=lit, initial=-np.inf)
    return np.where(lit.any(axis=1), (first, last), -1.0).T.astype(np.float32)


def useful_delays_us(rig: Rig, gate: GateSettings, ends: Singles | None) -> tuple[float, float]:
    """From which delay to which the gate meets any of it; of an unknown scene, anything before the rig."""
    line_us = gate.line_time_us
    times = None if ends is None else occupied_times(rig, line_us, ends)
    first, last = times or phase_range(rig, line_us, _NEAREST_M)
    reach = gate.exposure_us / 2 + _MARGIN * (last - first)
    return first - reach, last + reach
