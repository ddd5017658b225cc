"""Sets of gates that cut a scene into slices: windows that tile a range of depth or delay, or a list of delays.

At one line time every surface point has one phase u = r_p / v_p - row * line_time (`gate.phase_us`). A slice records
the points with u in [delay - exposure / 2, delay + exposure / 2). Slices that share their edges therefore
record each point exactly once, and their images add up to that of one gate over the whole range, without weights
(model section 5). Edges stay shared on hardware when every exposure is a whole number of delay steps: settings are
chosen so here, never rounded one by one. Steps that are a multiple of 2^-30 us share their edges to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from slopegate.core.gating.gate import phase_us
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.axis import no_slab, time_on_axis
from slopegate.core.rig.checks import InputError, require, require_finite
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, Steps, gate, quantise, turns_into
from slopegate.core.rig.triangulate import projector_rows

Slices = tuple[GateSettings, ...]
Spacing = Literal["delay", "depth"]

_GRID = 17
_SAME = 1e-6
"""Share of a step by which a number may miss a whole multiple of it."""


def tile_times(rig: Rig, line_time_us: float, start_us: float, end_us: float, count: int) -> Slices:
    """`count` equally long slices that share edges and cover the phases [start_us, end_us], nearest first.

    The settings are the camera's own (line time nearest to the one given), so the range covered is a little longer than
    the one asked for. Raises InputError where the camera's steps or limits do not allow it.
    """
    require_finite("start_us", start_us)
    require(math.isfinite(end_us) and end_us > start_us, "end_us", end_us, f"above start_us ({start_us:g})")
    require(count >= 1, "count", count, "a whole number of at least 1")
    delay, exposure = rig.camera.shutter.delay_us, rig.camera.shutter.exposure_us
    most = most_slices(rig, start_us, end_us)
    allowed = f"at most {most}, since the shortest exposure that fits is {_shortest(rig):g} us"
    require(count <= most, "count", count, allowed)
    width = _exposure_at_least(exposure, max(_span(rig, start_us, end_us) / count, exposure.min), delay.step)
    return _placed(rig, line_time_us, (start_us + end_us - count * width) / 2, [width] * count)


def once_around(rig: Rig, slices: Slices) -> Slices:
    """Slices that share edges, nearest first, with the first and the last made longer until all are one period.

    So they also record once what fog and surfaces scatter, at any phase: the first all that comes from nearer, too, the
    last all from farther. Where direct light falls, they stay as they were. Steps may make them some delay steps longer
    than a period. Raises InputError where the camera's steps or limits do not allow it.
    """
    limits, period = rig.camera.shutter, rig.projector.period_us
    step = limits.delay_us.step * 2  # on either side of a centre that is a whole number of delay steps
    while not _multiple(step, limits.exposure_us.step):
        step += 2 * limits.delay_us.step
        require(step < 1e4 * limits.delay_us.step, "slices", "so few", "others: this camera's steps let none meet")
    start, end = _reach(slices)
    more = math.ceil(max(period - (end - start), 0.0) / step - _SAME)
    nearer, farther = more // 2 * step, (more - more // 2) * step
    made = list(slices)
    for place, longer, side in ((0, nearer, 0.5), (-1, farther, -0.5)):
        one = made[place]
        exposure = one.exposure_us + longer
        allowed = f"at most {limits.exposure_us.max:g} us: take more slices"
        require(exposure <= limits.exposure_us.max, "exposure_us", exposure, allowed)
        longest = gate(one.line_time_us, one.delay_us + side * longer, exposure)
        made[place] = quantise(limits, longest, period)
    return tuple(made)


def most_slices(rig: Rig, start_us: float, end_us: float) -> int:
    """How many slices that share edges fit between two phases: the camera's shortest exposure sets it."""
    return max(1, math.floor(_span(rig, start_us, end_us) / _shortest(rig)))


def depth_times(rig: Rig, line_time_us: float, near_m: float, far_m: float) -> tuple[float, float]:
    """First and last phase of near_m..far_m (may be infinite) on the axis x = y = 0; as `axis.time_on_axis`.

    Raises InputError for distances that are none, and for gates that tell none apart (`axis.no_slab`).
    """
    if reason := no_slab(rig, line_time_us):
        raise InputError(reason)
    require(math.isfinite(near_m) and near_m > 0, "near_m", near_m, "a finite number above 0")
    require(far_m > near_m, "far_m", far_m, f"above near_m ({near_m:g})")
    start, end = sorted(time_on_axis(rig, line_time_us, w) for w in (1 / near_m, 1 / far_m))
    return start, end


def tile_depths(
    rig: Rig, line_time_us: float, near_m: float, far_m: float, count: int, spacing: Spacing = "delay"
) -> Slices:
    """`count` slices that share edges and cover near_m..far_m on the axis x = y = 0, nearest first.

    Equally long in delay (equal steps of disparity; far_m may be infinite), or equally thick in depth. Raises
    InputError where the camera's steps or limits do not allow it.
    """
    require(count >= 1, "count", count, "a whole number of at least 1")
    line = rig.camera.shutter.line.nearest(line_time_us)
    times = depth_times(rig, line, near_m, far_m)
    if spacing == "delay":
        return tile_times(rig, line, *times, count)
    require(math.isfinite(far_m), "far_m", far_m, "finite for slices of equal depth")
    depths = np.linspace(near_m, far_m, count + 1)
    return _placed(rig, line, *_uneven(rig, sorted(time_on_axis(rig, line, 1 / float(z)) for z in depths)))


def _uneven(rig: Rig, edges_us: list[float]) -> tuple[float, list[float]]:
    """First edge and widths near these edges, each width a whole number of two delay steps."""
    delay, exposure = rig.camera.shutter.delay_us, rig.camera.shutter.exposure_us
    step = 2 * delay.step
    while not _multiple(step, exposure.step):
        step += 2 * delay.step
        require(step < 1e4 * delay.step, "spacing", "depth", "delay: this camera's steps let no such slices meet")
    # one delay step more on both sides makes up for the rounding of the first delay
    base = edges_us[0] - delay.step
    # A slice's centre is half-way between its edges and must be settable too: hence two delay steps.
    counts = [round((edge - base) / step) for edge in edges_us[1:-1]]
    counts = [0, *counts, math.ceil((edges_us[-1] - base + delay.step) / step)]
    widths = [step * (b - a) for a, b in pairwise(counts)]
    if len(widths) == 1:
        widths = [max(widths[0], step * math.ceil(exposure.min / step - _SAME))]
    thin = min(widths)
    fits = thin >= exposure.min and _multiple(exposure.min, exposure.step)
    allowed = f"fewer: the thinnest slice needs {thin:g} us and the shortest exposure is {exposure.min:g} us"
    require(fits, "count", len(widths), allowed)
    return base, widths


def at_delays(rig: Rig, line_time_us: float, exposure_us: float, delays_us: Sequence[float]) -> Slices:
    """One slice per delay, in the order given, each rounded to what the camera has."""
    require(len(delays_us) > 0, "delays_us", tuple(delays_us), "at least one delay")
    period = rig.projector.period_us
    return tuple(quantise(rig.camera.shutter, gate(line_time_us, delay, exposure_us), period) for delay in delays_us)


def covering(rig: Rig, line_time_us: float, start_us: float, end_us: float) -> GateSettings:
    """The camera's shortest gate of this line time that is open between these two phases; as far as its longest
    exposure reaches.
    """
    limits = rig.camera.shutter
    delay = limits.delay_us.nearest((start_us + end_us) / 2)
    needed = 2 * max(end_us - delay, delay - start_us)
    exposure = limits.exposure_us.nearest(needed)
    if exposure < needed:
        exposure = limits.exposure_us.nearest(exposure + limits.exposure_us.step)
    return gate(line_time_us, delay, exposure)


def occupied_times(rig: Rig, line_time_us: float, projector_row: Singles) -> tuple[float, float] | None:
    """First and last phase of what the projector lights, from `Buffers.projector_row` (H, W); None for nothing.

    For the rows as float32 holds them to 1e-15 of the times of projector row and camera row.
    """
    rows = rig.camera.lens.row_centres[:, None]
    lit = projector_row >= 0
    if not lit.any():
        return None
    times = phase_us(rig, line_time_us, rows, projector_row.astype(np.float64))
    return float(times.min(where=lit, initial=np.inf)), float(times.max(where=lit, initial=-np.inf))


def phase_range(rig: Rig, line_time_us: float, nearest_m: float, margin_rows: float = 2.0) -> tuple[float, float]:
    """First and last phase, microseconds, at which anything from `nearest_m` to infinity can be lit and seen.

    Taken on a grid of rays; widened by some projector rows at either end for what lies between them.
    """
    lens = rig.camera.lens
    columns, rows = np.meshgrid(np.linspace(0, lens.width, _GRID), np.linspace(0.5, lens.height - 0.5, _GRID))
    rays = rig.camera_rays(columns.ravel(), rows.ravel())
    ends = np.stack([projector_rows(rig, rays, w) for w in (0.0, 1 / nearest_m)])
    last = rig.projector.lens.height
    # of a ray that leaves the projector's frame only the part inside is ever lit, of one beside it none
    seen = np.isfinite(ends).all(axis=0) & (ends.max(axis=0) > 0) & (ends.min(axis=0) < last)
    row_us = 1 / rig.projector.rows_per_us
    if not seen.any():
        return 0.0, row_us
    phases = phase_us(rig, line_time_us, rows.ravel()[seen], np.clip(ends[:, seen], 0, last))
    return float(phases.min()) - margin_rows * row_us, float(phases.max()) + margin_rows * row_us


def share_edges(slices: Slices) -> bool:
    """Whether all slices have one line time and, sorted by delay, each begins where the one before ends."""
    if len({item.line_time_us for item in slices}) != 1:
        return False
    ordered = sorted(slices, key=lambda item: item.delay_us)
    return all(abs(after.start_us - before.end_us) < _SAME for before, after in pairwise(ordered))


@dataclass(frozen=True)
class Probe:
    """A search for the slices that hold any light: ask for a gate over several at once, tell whether it was lit.

    A dark one clears all of its slices, a lit one is halved. Of n slices with k lit ones it asks for about
    2 k log2(n / k) gates, and for one where nothing is lit.
    """

    rig: Rig
    slices: Slices
    pending: tuple[tuple[int, int], ...]
    lit: tuple[int, ...] = ()

    @staticmethod
    def over(rig: Rig, slices: Slices) -> Probe:
        """Start with as few gates as the camera's longest exposure allows, and each below one period."""
        longest = min(rig.camera.shutter.exposure_us.max, rig.projector.period_us)
        groups: list[tuple[int, int]] = []
        for index in range(len(slices)):
            first = groups[-1][0] if groups else index
            together = slices[first : index + 1]
            one_line = together[0].line_time_us == slices[index].line_time_us
            if groups and one_line and _reach(together)[1] - _reach(together)[0] <= longest:
                groups[-1] = (first, index + 1)
            else:
                groups.append((index, index + 1))
        return Probe(rig, slices, tuple(reversed(groups)))

    @property
    def asked(self) -> GateSettings | None:
        """The gate to look through next; None when all is known and `lit` is complete."""
        if not self.pending:
            return None
        first, last = self.pending[-1]
        return _covering(self.rig, self.slices[first:last])

    def tell(self, lit: bool) -> Probe:
        """The state after looking through the gate asked for."""
        first, last = self.pending[-1]
        rest = self.pending[:-1]
        if not lit:
            return replace(self, pending=rest)
        if last - first == 1:
            return replace(self, pending=rest, lit=(*self.lit, first))
        # The half that is asked for next lies on top; the other waits below it.
        middle = (first + last) // 2
        return replace(self, pending=(*rest, (middle, last), (first, middle)))


def _reach(slices: Slices) -> tuple[float, float]:
    """First start and last end of the exposures of row coordinate 0, microseconds."""
    return min(item.start_us for item in slices), max(item.end_us for item in slices)


def _covering(rig: Rig, slices: Slices) -> GateSettings:
    """The shortest gate of the camera that records whatever any of these does."""
    if len(slices) == 1:
        return slices[0]
    return covering(rig, slices[0].line_time_us, *_reach(slices))


def _placed(rig: Rig, line_time_us: float, first_edge_us: float, widths: list[float]) -> Slices:
    """Slices of these widths one after the other from about this edge on, latest (nearest) first."""
    limits, period = rig.camera.shutter, rig.projector.period_us
    longest = max(widths)
    allowed = f"at most {limits.exposure_us.max:g} us: take more slices or a shorter range"
    require(longest <= limits.exposure_us.max, "exposure_us", longest, allowed)
    # Centres are half of either width apart, so that each slice begins where the one before ends.
    steps = [0.0, *np.cumsum([(a + b) / 2 for a, b in pairwise(widths)]).tolist()]
    first = first_edge_us + widths[0] / 2
    first += period * turns_into(limits.delay_us.min, limits.delay_us.max - steps[-1], first, period)
    first = limits.delay_us.nearest(first)
    inside = limits.delay_us.min <= first and first + steps[-1] <= limits.delay_us.max + _SAME
    allowed = f"within {limits.delay_us.min:g} to {limits.delay_us.max:g} us: the slices reach too far"
    require(inside, "delay_us", first + steps[-1], allowed)
    line = limits.line.nearest(line_time_us)
    pairs = zip(steps, widths, strict=True)
    return tuple(gate(line, limits.delay_us.nearest(first + step), width) for step, width in pairs)[::-1]


def _span(rig: Rig, start_us: float, end_us: float) -> float:
    """Length that slices have to cover, microseconds: rounding moves the first delay by up to half a step."""
    return end_us - start_us + rig.camera.shutter.delay_us.step


def _shortest(rig: Rig) -> float:
    """The shortest exposure, microseconds, with which slices can share their edges."""
    exposure = rig.camera.shutter.exposure_us
    return _exposure_at_least(exposure, exposure.min, rig.camera.shutter.delay_us.step)


def _exposure_at_least(exposure: Steps, least_us: float, delay_step_us: float) -> float:
    """The shortest settable exposure of at least this that is a whole number of delay steps."""
    first = math.ceil((least_us - exposure.min) / exposure.step - _SAME)
    for count in range(max(first, 0), max(first, 0) + 10_000):
        value = exposure.min + count * exposure.step
        if _multiple(value, delay_step_us):
            return float(value)
    raise InputError(
        f"exposure_us has steps of {exposure.step:g} us from {exposure.min:g} us: none of them is a whole number of "
        f"delay steps ({delay_step_us:g} us), so slices cannot share their edges"
    )


def _multiple(value: float, step: float) -> bool:
    """Whether a value is a whole number of steps, to `_SAME` of a step."""
    return abs(value / step - round(value / step)) < _SAME
