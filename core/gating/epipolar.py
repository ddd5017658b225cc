"""Gates of a rig whose rows are epipolar: they select light by how many rows it has moved, not by distance.

An epipolar plane contains the baseline. With the projector beside the camera the rows of both lie in such planes, so a
camera row sees the direct light of one projector row, the one that faces it, whatever the distance. A gate whose window
follows the facing row keeps the direct light of the whole picture, and of indirect light what came back in the row it
left in; its complement keeps what left its row; any other delay keeps light that has moved by so many rows (section
VI-C and figure 8b of the paper). At B = 1 the window follows the facing row through the whole picture, at other line
times it crosses it somewhere.

The facing row's light needs some time to be kept whole. A pixel is as high as its camera row, so even light of exactly
one instant a row comes for a line time (12.8 us of the check rig's lenses: a shorter exposure keeps its share of it,
exposure / line time). Where each projector row stays lit for its whole time (`gate.discrete_weights`) it is a row time
more on either side, at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slopegate.core.gating.gate import phase_us, recorded_times, row_windows, upright_line_time
from slopegate.core.gating.slices import covering, phase_range
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, turns_into
from slopegate.core.rig.triangulate import projector_rows

NEAREST_M = 0.3
"""Direct light from here to infinity is what an epipolar gate keeps: a real rig's rows are never quite epipolar."""
MOST_SHARE = 0.1
"""Of the projector's period: a gate that needs more for the direct light of all distances refuses little else."""
_GRID, _DISTANCES = 33, 5


def epipolar_gate(rig: Rig) -> GateSettings | None:
    """The camera's shortest gate that keeps the direct light of every distance; None where that takes too long.

    Every distance from `NEAREST_M`, sampled on a grid of rays; at the line time nearest to B = 1, with a line time and
    two row times more than the grid's points need (see above). Exactly what is needed plus rounding to the camera's
    steps. A rig with slabs that are thin enough has no such gate: for it a gate that holds all distances is nearly
    everything.
    """
    line_time_us, period = upright_line_time(rig), rig.projector.period_us
    first, last = phase_range(rig, line_time_us, NEAREST_M, margin_rows=1.0)
    first, last = first - line_time_us / 2, last + line_time_us / 2
    if last - first > MOST_SHARE * period:
        return None
    delays = rig.camera.shutter.delay_us
    turn = period * turns_into(delays.min, delays.max, (first + last) / 2, period)
    found = covering(rig, line_time_us, first + turn, last + turn)
    return found if kept(rig, found).direct_share > 0 else None  # of a projector that lights nothing there is none


@dataclass(frozen=True)
class Kept:
    """What a gate keeps of a rig without slabs, in rows."""

    direct_share: float
    """Share of the picture, of what faces the projector's raster, whose direct light is kept whatever the distance."""
    some_share: float
    """The same for what is kept at some distance, at least."""
    low_rows: float
    high_rows: float
    """In the camera's middle row: projector rows by which light that is kept has moved, from the one that faces it."""


def kept(rig: Rig, settings: GateSettings) -> Kept:
    """What this gate keeps: shares from a grid of pixels at a few distances from `NEAREST_M` on; rows to 1e-9.

    Infinite rows where the picture's middle does not face the projector.
    """
    lens = rig.camera.lens
    rows = np.unique(np.linspace(0, lens.height - 1, _GRID).round().astype(np.int64))
    columns = np.linspace(0.5, lens.width - 0.5, _GRID)
    rays = rig.camera_rays(columns, rows[:, None] + 0.5)
    lit = np.stack([projector_rows(rig, rays, w) for w in np.linspace(0.0, 1 / NEAREST_M, _DISTANCES)])
    faced = np.isfinite(lit).all(axis=0) & (lit.min(axis=0) >= 0) & (lit.max(axis=0) < rig.projector.lens.height)
    times = recorded_times(row_windows(rig, settings), rows[:, None], np.where(faced, lit, -1.0))
    always, ever = (float((found[faced] > 0).mean()) if faced.any() else 0.0 for found in (times.min(0), times.max(0)))
    return Kept(always, ever, *_moved_rows(rig, settings))


def _moved_rows(rig: Rig, settings: GateSettings) -> tuple[float, float]:
    """Rows from the facing row to both edges of the middle row's window, of its copies the one nearest to it."""
    lens, speed = rig.camera.lens, rig.projector.rows_per_us
    middle = np.array([lens.height // 2 + 0.5])
    facing = projector_rows(rig, rig.camera_rays(lens.width / 2, middle), 0.0)
    if not np.isfinite(facing).all():
        return -math.inf, math.inf
    phase = float(phase_us(rig, settings.line_time_us, middle, facing)[0])
    later = math.remainder(settings.delay_us - phase, rig.projector.period_us)
    return (later - settings.exposure_us / 2) * speed, (later + settings.exposure_us / 2) * speed
