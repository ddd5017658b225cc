"""What every way to make a frame has in common: how it is run, checked, and what it keeps in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from slopegate.app.bench.subject import GateNumbers, Subject
from slopegate.core.exposure import kernels
from slopegate.core.exposure.sensor import Plates, response
from slopegate.core.rig.arrays import Counts, Doubles, Indices

FINE: Final = 16
"""Errors are read from the very kernels that make frames, told to count in sixteenths of a count: these fit 16 bits."""


@dataclass(frozen=True, eq=False)
class Variant:
    """One way to make the frame of gate `index`.

    run makes it, and is timed. counts gives (H, W) the same frame before its counts are rounded, without noise; None
    where only single pixels are known, and then `at` gives those of some flat indices. edge_rows: how far its edges lie
    from the exact ones, maximum and root mean square, in camera rows; None where that is not what it gets wrong.
    kept_bytes: arrays that it holds from frame to frame. share: of a frame's work that `run` does. gates: how many
    frames, of different gates, make one timing.
    """

    group: str
    name: str
    run: Callable[[int], object]
    counts: Callable[[int], Doubles] | None = None
    at: Callable[[int, Indices], Doubles] | None = None
    edge_rows: tuple[float, float] | None = None
    kept_bytes: int = 0
    share: float = 1.0
    gates: int = 9
    slow: bool = False
    default: bool = False


def gate_response(plates: Plates, gate: GateNumbers) -> kernels.Response:
    """The program's own arithmetic for this gate."""
    return response(plates, gate.periods)


def fine_response(coarse: kernels.Response) -> kernels.Response:
    """The same in sixteenths of a count."""
    return coarse._replace(
        direct_step=np.float32(coarse.direct_step * FINE),
        ambient_step=np.float32(coarse.ambient_step * FINE),
        offset=np.float32((coarse.offset - 0.5) * FINE + 0.5),
        max_count=np.float32(65535),
    )


def read_fine(out: Counts, subject: Subject) -> Doubles:
    """Counts from a frame in sixteenths of a count."""
    return np.minimum(out / FINE, subject.sensor.max_count)


def array_bytes(*values: Any) -> int:
    """Bytes of all arrays in these values, NamedTuples and sequences."""
    total = 0
    for value in values:
        if isinstance(value, np.ndarray):
            total += value.nbytes
        elif isinstance(value, tuple | list):
            total += array_bytes(*value)
    return total
