"""Masking: the gate that keeps or hides a painted region best (model section 2: windows wrap round the period).

At one line time all that a gate knows of a pixel is its phase (`gate.phase_us`), modulo the projector's period: a gate
records the pixels whose phase lies in one circular interval, and its complement all others. So the best delay and
exposure of a line time follow from two histograms of phases, and the best line time from trying them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.sensor import READ_VARIANCE
from slopegate.core.gating.gate import complement, exact_upright_line_time, row_windows, weights
from slopegate.core.rig.arrays import Bools, Counts, Doubles, Indices, Ints, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, LineTimes, gate, quantise

GOOD_IOU = 0.5
"""Below this no gate can be said to keep or hide the region."""

_RANKING_PIXELS = 150_000
"""Pixels of each kind that rank the line times; the best few are then judged by all pixels."""
_RANKING_BIN_US = 4.0
"""Width of the histograms' bins while line times are ranked,"""
_FINAL_BIN_US = 1.0
"""and where the best of them are judged: as fine as delays are set."""
_FINALISTS = 4
"""How many line times are judged by all pixels."""
_DIGITS = 3
"""Ratios that agree to so many decimals are equally good."""
_MARGIN_ROWS = 2.0
"""Where nothing is lit beside the interval, each edge moves out by half the gap, at most this many projector rows."""
_STEPS_OF_A_FREE_LINE = 80


@dataclass(frozen=True)
class MaskGate:
    """The best gate for a region, as the hardware does it, and what it makes of every pixel that is lit at all."""

    gate: GateSettings
    """The thinner of the two: the gate itself or what its complement leaves out."""
    complement: bool
    """Whether everything but `gate` is to be recorded."""
    sent: GateSettings
    """What the camera is told."""
    iou: float
    """Intersection over union of the region with what is recorded (to keep) or not recorded (to hide)."""
    hit_pixels: int
    missed_pixels: int
    extra_pixels: int
    line_times: int
    """How many line times were tried."""

    @property
    def good(self) -> bool:
        """Whether it is worth applying."""
        return self.iou >= GOOD_IOU


def best_gate(rig: Rig, projector_row: Singles, region: Bools, hide: bool = False) -> MaskGate:
    """The gate, or complement, whose recorded (or `hide`: not recorded) pixels agree best with the region.

    projector_row (H, W) float32 as in `render.Buffers`, -1 where nothing is lit: such pixels do not count. region
    (H, W) bool. Every line time of the camera's ladder is tried; where several do equally well (to 0.001) the thinnest
    slab wins, since it rejects most of all other light. Raises InputError for a region of another shape, or one without
    a lit pixel.
    """
    require(region.shape == projector_row.shape, "region", region.shape, f"of the image's shape {projector_row.shape}")
    lit = projector_row >= 0
    inside = region & lit
    require(bool(inside.any()), "region", "a region without any lit pixel", "painted where the projector lights")
    kinds = (_pixels(rig, projector_row, inside), _pixels(rig, projector_row, lit & ~region))
    line_times = _line_times(rig)
    samples, scales = zip(*(_thin_out(pixels) for pixels in kinds), strict=True)
    ranking = [_rank(rig, samples, scales, line_time) for line_time in line_times]
    finalists = sorted(zip(ranking, line_times, strict=True), reverse=True)[:_FINALISTS]
    found = [_judge(rig, kinds, line_time, projector_row, inside, hide, len(line_times)) for _, line_time in finalists]
    return max(found, key=lambda one: (round(one.iou, _DIGITS), -one.gate.exposure_us))


def recorded(rig: Rig, settings: GateSettings, projector_row: Singles) -> Bools:
    """Which pixels, (H, W) bool, this gate records light of the projector from."""
    seen: Bools = weights(row_windows(rig, settings), projector_row) > 0
    return seen


def overlap(chosen: Bools, region: Bools, counted: Bools) -> float:
    """Intersection over union of two (H, W) masks among the counted pixels; 1 where both are empty."""
    union = int(np.count_nonzero((chosen | region) & counted))
    return int(np.count_nonzero(chosen & region & counted)) / union if union else 1.0


def seen_in_frames(gated: Counts, rest: Counts, black_count: float) -> tuple[Bools, Bools]:
    """From a frame of a gate and one of its complement: which pixels the gate recorded, and which could be told.

    Both (H, W) uint16 -> (H, W) bool. Light of the projector is in exactly one of the two, so the brighter one has it,
    where ambient light of one period is weaker than that; of pixels that the projector does not light nothing can be
    said. A pixel is told when the difference exceeds five standard deviations of both frames' noise
    (`sensor.READ_VARIANCE`).
    """
    difference = gated.astype(np.int32) - rest
    total = np.maximum(gated.astype(np.float32) + rest - np.float32(2 * black_count), 0)
    return difference > 0, np.abs(difference) > 5 * np.sqrt(total + np.float32(2 * READ_VARIANCE))


Pixels = tuple[Singles, Ints]
"""When each of n pixels is lit, in microseconds, and its camera row."""


def _pixels(rig: Rig, projector_row: Singles, which: Bools) -> Pixels:
    """The chosen pixels of an image as `Pixels`."""
    flat = np.flatnonzero(which)
    lit_us = projector_row.ravel()[flat] * np.float32(1 / rig.projector.rows_per_us)
    return lit_us, (flat // projector_row.shape[1]).astype(np.int32)


def _thin_out(pixels: Pixels) -> tuple[Pixels, float]:
    """Every so many'th pixel, `_RANKING_PIXELS` at most, and how many pixels each of them stands for."""
    stride = max(1, -(-pixels[0].size // _RANKING_PIXELS))
    return (pixels[0][::stride], pixels[1][::stride]), float(stride)


def _line_times(rig: Rig) -> list[float]:
    """Every line time of the ladder; of a camera that sets it freely, evenly spaced tilts about B = 1."""
    line = rig.camera.shutter.line
    if not isinstance(line, LineTimes):
        return [line.line_time_us(clock) for clock in line.ladder_mhz]
    upright = exact_upright_line_time(rig.camera.lens, rig.projector)
    ratios = 1 + np.linspace(-0.85, 0.85, _STEPS_OF_A_FREE_LINE + 1)
    return sorted({line.nearest(upright / ratio) for ratio in ratios})


def _rank(rig: Rig, kinds: tuple[Pixels, ...], scales: tuple[float, ...], line_time_us: float) -> tuple[float, float]:
    """How good a line time is: its best intersection over union, coarsely, then how thin the slab is that has it."""
    histograms = [_histogram(rig, pixels, line_time_us, _RANKING_BIN_US) for pixels in kinds]
    wanted, other = (histogram * scale for histogram, scale in zip(histograms, scales, strict=True))
    _, length, ratio = _interval(rig, wanted, other)
    return round(ratio, _DIGITS), -float(min(length, wanted.size - length))


@njit(cache=True, nogil=True)
def count_phases(lit_us: Singles, camera_rows: Ints, line_time_us: float, period_us: float, counts: Indices) -> None:
    """Add to counts (bins,) the phases (lit_us - (row + 1/2) line_time) mod period of n pixels, in equal bins.

    The law of `gate.phase_us`, repeated here because arrays of phases would be made and thrown away for every line time
    that is tried; a test holds the two together.
    """
    bins = counts.size
    scale = bins / period_us
    for i in range(lit_us.size):
        turns = (lit_us[i] - (camera_rows[i] + 0.5) * line_time_us) / period_us
        at = int((turns - np.floor(turns)) * period_us * scale)
        counts[at if at < bins else 0] += 1


def _histogram(rig: Rig, pixels: Pixels, line_time_us: float, bin_us: float) -> Doubles:
    period_us = rig.projector.period_us
    counts = np.zeros(round(period_us / bin_us), np.int64)
    count_phases(*pixels, line_time_us, period_us, counts)
    return counts.astype(np.float64)


def _judge(
    rig: Rig,
    kinds: tuple[Pixels, Pixels],
    line_time_us: float,
    projector_row: Singles,
    inside: Bools,
    hide: bool,
    line_times: int,
) -> MaskGate:
    """The best gate of one line time, rounded to the hardware, counted pixel by pixel."""
    period, shutter = rig.projector.period_us, rig.camera.shutter
    wanted, other = (_histogram(rig, pixels, line_time_us, _FINAL_BIN_US) for pixels in kinds)
    start, length, _ = _interval(rig, wanted, other)
    start_us, length_us = _with_margins(rig, wanted + other, start, length)
    # A gate and its complement cut the period at the same two places: the thinner of the two is the slab to show.
    thin = length_us <= period / 2
    if not thin:
        start_us, length_us = start_us + length_us, period - length_us
    slab = quantise(shutter, gate(line_time_us, start_us + length_us / 2, length_us), period)
    all_but = thin == hide
    sent = quantise(shutter, complement(slab, period), period) if all_but else slab
    seen = recorded(rig, sent, projector_row)
    chosen = (~seen & (projector_row >= 0)) if hide else seen
    hit = int(np.count_nonzero(chosen & inside))
    extra, missed = int(np.count_nonzero(chosen)) - hit, int(np.count_nonzero(inside)) - hit
    return MaskGate(slab, all_but, sent, hit / (hit + extra + missed), hit, missed, extra, line_times)


@njit(cache=True, nogil=True)
def best_interval(wanted: Doubles, other: Doubles) -> tuple[int, int, float]:
    """The circular run of bins with the greatest intersection over union; start, length and that ratio.

    wanted, other (bins,): pixels inside and outside the region. Ratio maximised by Dinkelbach's iteration: for a trial
    ratio q the run of greatest sum(wanted - q other) is a largest circular subarray (Kadane), whose own ratio is the
    next q; it rises until the maximum, exactly, is reached.
    """
    bins = wanted.size
    total = wanted.sum()
    start, length = 0, bins
    ratio = total / max(total + other.sum(), 1.0)
    for _ in range(60):
        # One pass finds the greatest run and the least: a run round the end of the period is all but a least one.
        best, low, sum_all = 0.0, 0.0, 0.0
        best_from, best_to, low_from, low_to = 0, 0, 0, 0
        rise, fall, rise_from, fall_from = 0.0, 0.0, 0, 0
        for i in range(bins):
            value = wanted[i] - ratio * other[i]
            sum_all += value
            if rise <= 0.0:
                rise, rise_from = 0.0, i
            rise += value
            if rise > best:
                best, best_from, best_to = rise, rise_from, i + 1
            if fall >= 0.0:
                fall, fall_from = 0.0, i
            fall += value
            if fall < low:
                low, low_from, low_to = fall, fall_from, i + 1
        if sum_all - low > best:
            first, count = low_to % bins, bins - (low_to - low_from)
        else:
            first, count = best_from, best_to - best_from
        inside, extra = 0.0, 0.0
        for i in range(count):
            k = (first + i) % bins
            inside += wanted[k]
            extra += other[k]
        found = inside / max(total + extra, 1.0)
        if found <= ratio:
            break
        start, length, ratio = first, count, found
    # bins without wanted pixels at either end only add others
    while length > 0 and wanted[(start + length - 1) % bins] == 0:
        length -= 1
    while length > 0 and wanted[start] == 0:
        start, length = (start + 1) % bins, length - 1
    return start, length, ratio


def _interval(rig: Rig, wanted: Doubles, other: Doubles) -> tuple[int, int, float]:
    """The best run of bins that is no shorter than an exposure can be, and leaves as much out: start, length, ratio."""
    least = _least_bins(rig, wanted.size)
    start, length, ratio = best_interval(wanted, other)
    allowed = min(max(length, least), wanted.size - least)
    if allowed == length:
        return start, length, ratio

    def sums(values: Doubles) -> Doubles:
        total = np.concatenate([[0.0], np.cumsum(np.concatenate([values, values[:allowed]]))])
        moved: Doubles = total[allowed : allowed + values.size] - total[: values.size]
        return moved

    # The length is given now, so every start is tried.
    ratios = sums(wanted) / (wanted.sum() + sums(other))
    best = ratios >= ratios.max()
    # equally good starts: the middle of their longest run keeps the edges away from pixels
    turn = int(np.argmin(best))
    runs = np.flatnonzero(np.diff(np.concatenate([[False], np.roll(best, -turn), [False]])))
    longest = int(np.argmax(runs[1::2] - runs[::2]))
    start = (int(runs[2 * longest] + runs[2 * longest + 1] - 1) // 2 + turn) % best.size
    return start, allowed, float(ratios.max())


def _least_bins(rig: Rig, bins: int) -> int:
    """How many of the bins of a period the camera's shortest exposure takes."""
    exposure = rig.camera.shutter.exposure_us
    return int(np.ceil(max(exposure.min, exposure.step) * bins / rig.projector.period_us))


def _with_margins(rig: Rig, occupied: Doubles, start: int, length: int) -> tuple[float, float]:
    """Start and length in microseconds, the edges moved out into gaps without pixels: proof against noise, no worse."""
    bins, step_us = occupied.size, rig.projector.period_us / occupied.size
    edges = occupied[(start + np.array([0, 1, length - 2, length - 1])) % bins]
    if length <= _least_bins(rig, bins) and not edges.any():
        # already widened, and placed midway between what lies on either side
        return start * step_us, length * step_us
    reach = min(int(2 * _MARGIN_ROWS / rig.projector.rows_per_us / step_us), (bins - length) // 2)
    before = occupied[(start - 1 - np.arange(reach)) % bins] > 0
    after = occupied[(start + length + np.arange(reach)) % bins] > 0
    ahead, behind = (int(np.argmax(row)) if row.any() else reach for row in (before, after))
    return (start - ahead / 2) * step_us, (length + (ahead + behind) / 2) * step_us
