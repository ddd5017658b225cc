"""From points that a gate should record to the gate that records them (model section 3, inverse design)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate


def gate_around(
    rig: Rig,
    camera_rows: NDArray[np.floating],
    projector_rows: NDArray[np.floating],
    line_time_us: float,
    keep: float = 0.98,
) -> GateSettings:
    """The thinnest gate of this line time that records the share `keep` of the points, as many lost before as after.

    camera_rows (n,): the rows that see the points, whole numbers; projector_rows (n,): continuous rows that light them.
    Raises ValueError where there are no points. Delay and exposure to 4 roundings of the points' times (1e-11 us), and
    a projector row wider than the points, so no rounding loses one that should be kept.
    """
    require(camera_rows.size > 0, "camera_rows", camera_rows.size, "at least one point")
    late_us = projector_rows / rig.projector.rows_per_us - (camera_rows + 0.5) * line_time_us
    first, last = np.quantile(late_us, ((1 - keep) / 2, (1 + keep) / 2))
    row_us = 1 / rig.projector.rows_per_us
    return gate(line_time_us, float(first + last) / 2, float(last - first) + row_us)
