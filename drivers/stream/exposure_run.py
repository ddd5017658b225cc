"""Runs an exposure sweep on any camera: how like a fog-free image each exposure's image is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from slopegate.core.measure.exposure_sweep import FogTarget, Likeness, measured_likeness
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.stream.depth_run import Take


def run_exposures(
    take: Take,
    gates: Sequence[GateSettings],
    target: FogTarget,
    black_count: float,
    frames: int,
    told: Callable[[float], None] = lambda share: None,
) -> tuple[tuple[GateSettings, Likeness], ...] | None:
    """What `frames` frames (at least 2) of each gate say, with the gate that was applied; None when given up.

    `told` hears the share done. Raises what `take` raises.
    """
    found = []
    for place, asked in enumerate(gates):
        cuts, applied = [], asked
        for _ in range(frames):
            got = take(asked)
            if got is None:
                return None
            cuts.append(target.cut(got[0]).copy())
            applied = got[1]
        found.append((applied, measured_likeness(cuts, target, black_count)))
        told((place + 1) / len(gates))
    return tuple(found)
