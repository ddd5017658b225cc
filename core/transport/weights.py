"""The fully lit image from slices: a sum with a weight for each (model section 5).

Slices whose windows tile the delays add up to it as they are. Where windows overlap or leave gaps, least-squares
weights make every place count once, as nearly as it can be: sum over slices of weight times how often its gate records
the place = 1. The paper weighs each slice by |dz / dt_d| (its equations 15 and 16), the Jacobian of a density of depth
that a camera does not measure; it is here to be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from slopegate.core.gating.gate import recorded_times, row_windows
from slopegate.core.measure.quality import psnr_db, ssim
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.axis import infinity_us, solve_axis, time_rate
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.sliced import Entries, SliceTransport

Weighting = Literal["tiling", "least-squares", "paper"]
WEIGHTINGS: Final[tuple[Weighting, ...]] = get_args(Weighting)

_AT_ONCE = 1 << 16
"""Places that are looked at together."""
_BEHIND = 1 / 8
"""Share of a period by which a delay before that of infinity counts as before it, and not as nearly a period after."""
_EVEN = 1e-9
"""Share of the mean square by which weights are drawn together, so that equal gates get equal weights."""


@dataclass(frozen=True, eq=False)
class Occupied:
    """Where light falls: camera rows (N,) int64, projector rows (N,) float64, and how much there is of it (N,)."""

    camera_row: Indices
    projector_row: Doubles
    light: Doubles


@dataclass(frozen=True)
class Agreement:
    """How like a fully lit image from slices is to the captured one, whose brightest pixel is the peak."""

    psnr_db: float
    """Infinite where they are equal."""
    ssim: float


def slice_weights(
    weighting: Weighting, rig: Rig, slices: Sequence[SliceTransport], gates: Sequence[GateSettings | None]
) -> Doubles:
    """A weight for each slice, (slices,) float64, by the gate that it was seen through.

    least-squares: 0 for a slice without light. paper: scaled so that the weighted sum has as much light as the plain
    one. A camera without a gate (None) has one slice, whose weight is 1. Raises InputError for a slice at or
    beyond infinity, whose weight the paper's rule leaves open.
    """
    require(weighting in WEIGHTINGS, "weights", weighting, ", ".join(WEIGHTINGS))
    set_gates = [settings for settings in gates if settings is not None]
    if weighting == "tiling" or len(set_gates) < len(gates):
        return np.ones(len(slices))
    if weighting == "paper":
        return _by_depth(rig, slices, set_gates)
    return least_squares(rig, set_gates, occupied_by(rig, slices, set_gates))


def floodlit(slices: Sequence[SliceTransport], weights: Sequence[float] | Doubles) -> Singles:
    """The fully lit image (H, W) float32: the weighted sum of all slices' light."""
    out = np.zeros(slices[0].total.shape)
    for transport, weight in zip(slices, weights, strict=True):
        out += weight * transport.total
    return out.astype(np.float32)


def agreement(image: Singles, white: Singles) -> Agreement:
    """How like an image (H, W) is to the fully lit one. Raises InputError for an image too small or without light."""
    peak = float(white.max())
    return Agreement(psnr_db(image, white, peak), ssim(image, white, peak))


def occupied_by(rig: Rig, slices: Sequence[SliceTransport], gates: Sequence[GateSettings]) -> Occupied:
    """The places that slices have light of: the parts of each block's rows that the slice's gate records.

    A place is the middle of a run of projector rows in which no gate's window and no block begins or ends, so gates
    count all of the run alike.
    """
    windows = [row_windows(rig, settings) for settings in gates]
    height, last = slices[0].total.shape[0], rig.projector.lens.height
    edges = {layer.grid.row_edges.tobytes(): layer.grid.row_edges for one in slices for layer in one.layers}
    whole = np.concatenate([[0, last], *edges.values()])
    cuts = [np.broadcast_to(whole, (height, len(whole)))]
    cuts += [np.clip(np.stack([one.low, one.high], axis=1), 0, last) for one in windows]
    ends = np.sort(np.concatenate(cuts, axis=1), axis=1)
    middle, length = (ends[:, 1:] + ends[:, :-1]) / 2, np.diff(ends, axis=1)
    camera_row = np.broadcast_to(np.arange(height)[:, None], middle.shape)
    light = np.zeros(middle.shape)
    for transport, window in zip(slices, windows, strict=True):
        if transport.layers:
            finest = max(transport.layers, key=lambda layer: layer.grid.count)
            block_row = np.searchsorted(finest.grid.row_edges[1:-1], middle, side="right")
            run = length * (recorded_times(window, camera_row, middle) > 0)
            place = camera_row * finest.grid.rows + block_row
            whole = np.bincount(place.ravel(), run.ravel(), height * finest.grid.rows)
            per_row = _row_light(finest, transport.total.shape) / np.where(whole > 0, whole, np.inf)
            light += run * per_row[place]
    if not light.max() > 0:
        raise InputError("slices is without light: at least one slice must hold some")
    lit = light > 0
    return Occupied(camera_row[lit], middle[lit], light[lit])


def least_squares(rig: Rig, gates: Sequence[GateSettings], occupied: Occupied) -> Doubles:
    """Weights (gates,) of at least 0 for which the weighted times that places are recorded are 1, by least squares."""
    windows = [row_windows(rig, settings) for settings in gates]
    square, wanted = np.zeros((len(gates), len(gates))), np.zeros(len(gates))
    for first in range(0, len(occupied.light), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        camera_row, projector_row = occupied.camera_row[some], occupied.projector_row[some]
        times = np.stack([recorded_times(window, camera_row, projector_row) for window in windows]).astype(np.float64)
        weighted = times * occupied.light[some]
        square += weighted @ times.T
        wanted += weighted.sum(axis=1)
    square += _EVEN * np.trace(square) / len(gates) * np.eye(len(gates))
    return _not_negative(square, wanted)


def _row_light(entries: Entries, shape: tuple[int, ...]) -> Doubles:
    """Light of each camera row by row of blocks, (H x block rows)."""
    height, width = shape
    pixel = np.repeat(np.arange(height * width), np.diff(entries.starts))
    rows = entries.grid.rows
    place = pixel // width * rows + entries.block // entries.grid.columns
    return np.asarray(np.bincount(place, entries.value, height * rows), np.float64)


def _by_depth(rig: Rig, slices: Sequence[SliceTransport], gates: Sequence[GateSettings]) -> Doubles:
    """|dz / dt_d| where each gate's middle meets the axis, scaled to keep the light.

    With t the delay after that of infinity and the light of nearer points later by k us a 1/m, z = k / t and
    |dz / dt| = z^2 / k, which is the paper's b f / (v t_d^2) for its rig (v_c = v_p, f_c = f_p, c_c = c_p).
    """
    period = rig.projector.period_us
    slopes = []
    for number, settings in enumerate(gates):
        late = settings.delay_us - float(infinity_us(rig, settings.line_time_us))
        late = (late + _BEHIND * period) % period - _BEHIND * period
        w = solve_axis(rig, settings.line_time_us, late).w
        allowed = "at a finite distance before the rig, or another weighting"
        require(0 < w < np.inf, f"slice {number}", f"at an inverse distance of {w:g} per m", allowed)
        slopes.append(1 / (w**2 * abs(time_rate(rig, settings.line_time_us, w, w))))
    light = np.array([float(one.total.sum(dtype=np.float64)) for one in slices])
    raw = np.array(slopes)
    lost = float((raw * light).sum())
    return raw * (light.sum() / lost) if lost > 0 else np.ones(len(slices))


def _not_negative(square: Doubles, wanted: Doubles) -> Doubles:
    """The x >= 0 with the least x' square x / 2 - wanted' x (Lawson and Hanson's active sets)."""
    x, free = np.zeros(len(wanted)), np.zeros(len(wanted), np.bool_)
    rounding = 1e-10 * float(np.abs(wanted).max(initial=0.0))
    for _ in range(3 * len(wanted)):
        slope = np.where(free, -np.inf, wanted - square @ x)
        if slope.max(initial=-np.inf) <= rounding:
            break
        free[int(np.argmax(slope))] = True
        while True:
            trial = np.zeros(len(x))
            trial[free] = np.linalg.solve(square[np.ix_(free, free)], wanted[free])
            below = free & (trial <= 0)
            if not below.any():
                break
            reach = float((x[below] / (x[below] - trial[below])).min())
            x = x + reach * (trial - x)
            free &= x > rounding * 1e-6
            x[~free] = 0
        x = trial
    return x
