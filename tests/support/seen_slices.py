"""Slices of a scene as the bench's direct light makes them, without noise and without showing any pattern."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.render import Buffers
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.sliced import SliceTransport, one_a_pixel


def seen_slices(rig: Rig, buffers: Buffers, gates: Sequence[GateSettings], grid: BlockGrid) -> list[SliceTransport]:
    """Direct light of each gate: every lit pixel sees the one block that its projector row and column lie in."""
    block = grid.numbers(buffers.projector_column, buffers.projector_row)
    light = mono(buffers.direct)
    made = []
    for settings in gates:
        total = (light * weights(row_windows(rig, settings), buffers.projector_row)).astype(np.float32)
        made.append(SliceTransport(total, (one_a_pixel(grid, np.where(total > 0, block, -1).astype(np.int32), total),)))
    return made
