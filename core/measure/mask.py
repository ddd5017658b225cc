"""Masking: the gate that keeps or hides a painted region best (model section 2: windows wrap round the period).

At one line time all that a gate knows of a pixel is its phase (`gate.phase_us`), modulo the projector's period: a gate
records the pixels whose phase lies in one circular interval, and its complement all others. So the best delay and
exposure of a line time follow from two histograms of phases, and the best line time from trying them all. Of gates that
do the job equally well (`EQUAL_SHARE`, `TRIMMED_SHARE`) the thinnest is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.sensor import READ_VARIANCE
from slopegate.core.gating.gate import complement, row_windows, weights
from slopegate.core.gating.plan import every_line_time
from slopegate.core.rig.arrays import Bools, Counts, Doubles, Indices, Ints, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise

GOOD_IOU = 0.5
"""Below this no gate can be said to keep or hide the region."""
EQUAL_SHARE = 0.05
"""Line times do equally well whose best intersection over union falls short of the best of all by at most this share of
it: no hand paints truer,"""
TRIMMED_SHARE = 0.005
"""and of each line time the thinnest gate counts that falls short of its best one by this share: a few stray pixels are
not worth a thicker slab."""

_RANKING_PIXELS = 100_000
"""Pixels of each kind that rank the line times; a few of them are then judged by all pixels."""
_LEANING_PIXELS = 20_000
"""Pixels that tell how a surface leans."""
_RANKING_BIN_US = 4.0
"""Width of the histograms' bins while line times are ranked,"""
_FINAL_BIN_US = 1.0
"""and where the best of them are judged: as fine as delays are set."""
_FINALISTS = 3
"""How many line times are judged by all pixels."""
_MARGIN_ROWS = 2.0
"""Where nothing is lit beside the interval, each edge moves out by half the gap, at most this many projector rows."""


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
    """The gate, or complement, whose recorded (or `hide`: not recorded) pixels agree with the region, and the thinnest.

    projector_row (H, W) float32 as in `render.Buffers`, -1 where nothing is lit: such pixels do not count. region
    (H, W) bool. Every line time of the camera's ladder is tried. Of all gates that do the job equally well
    (`EQUAL_SHARE`, `TRIMMED_SHARE`) the thinnest wins, since it rejects most of all other light; of those that differ
    by less than the time of a projector row, the one that leans most nearly as the surface in it does. Raises
    InputError for a region of another shape, or one without a lit pixel.
    """
    require(region.shape == projector_row.shape, "region", region.shape, f"of the image's shape {projector_row.shape}")
    lit = projector_row >= 0
    inside = region & lit
    require(bool(inside.any()), "region", "a region without any lit pixel", "painted where the projector lights")
    kinds = (_pixels(rig, projector_row, inside), _pixels(rig, projector_row, lit & ~region))
    line_times = every_line_time(rig)
    made = []
    for line_time in _ranked(rig, kinds, line_times):
        phases = _Phases.of(rig, kinds, line_time, _FINAL_BIN_US)
        run = phases.thinnest(phases.best())
        got = _rounded(phases, run, projector_row, inside, hide, len(line_times))
        made.append((_Candidate(phases, run, got.iou, got.gate.exposure_us), got))
    best = _thinnest_first(rig, [candidate for candidate, _ in made])[0]
    return next(got for candidate, got in made if candidate is best)


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


def _thin_out(pixels: Pixels, most: int) -> tuple[Pixels, float]:
    """Every so many'th pixel, at most so many, and how many pixels each of them stands for."""
    stride = max(1, -(-pixels[0].size // most))
    return (pixels[0][::stride], pixels[1][::stride]), float(stride)


@dataclass(frozen=True)
class _Run:
    """A circular run of a period's bins of phases, and what a gate that records just these makes of a region."""

    start: int
    length: int
    ratio: float
    """Intersection over union of the region with what lies in it."""
    left_out: bool
    """Whether it is longer than half the period: then what it leaves out is the slab."""
    thin_us: float
    """How thick the slab is: the run or, if that is shorter, the rest of the period."""


@dataclass(frozen=True, eq=False)
class _Phases:
    """How many pixels of the region (`wanted`) and others are lit at each phase of a line time, (bins,) of a period.

    `pixels` are those that were counted, of either kind; each stands for one or more of the image.
    """

    rig: Rig
    line_time_us: float
    pixels: tuple[Pixels, Pixels]
    wanted: Doubles
    other: Doubles

    @staticmethod
    def of(
        rig: Rig,
        kinds: tuple[Pixels, Pixels],
        line_time_us: float,
        bin_us: float,
        scales: tuple[float, float] = (1.0, 1.0),
    ) -> _Phases:
        """Counted in bins of this width; a pixel of each kind stands for `scales` of the image."""
        period_us = rig.projector.period_us
        counts: list[Doubles] = []
        for pixels, scale in zip(kinds, scales, strict=True):
            found = np.zeros(round(period_us / bin_us), np.int64)
            count_phases(*pixels, line_time_us, period_us, found)
            counts.append(found.astype(np.float64) * scale)
        return _Phases(rig, line_time_us, kinds, *counts)

    @property
    def bins(self) -> int:
        """How many there are."""
        return int(self.wanted.size)

    @property
    def step_us(self) -> float:
        """Width of a bin."""
        return self.rig.projector.period_us / self.bins

    @property
    def least(self) -> int:
        """How many bins the camera's shortest exposure takes."""
        exposure = self.rig.camera.shutter.exposure_us
        return int(np.ceil(max(exposure.min, exposure.step) / self.step_us))

    def best(self) -> _Run:
        """The run of greatest intersection over union that the camera can expose."""
        start, length, _ = best_interval(self.wanted, self.other)
        return self._possible(start, length)

    def thinnest(self, best: _Run) -> _Run:
        """The run of the thinnest slab that is as good as the best run, to `TRIMMED_SHARE`."""
        enough = (1 - TRIMMED_SHARE) * best.ratio
        gain, need = self.wanted - enough * self.other, enough * float(self.wanted.sum())
        start, length = thinnest_run(gain, need)
        if 2 * length > self.bins:
            # Such a run may be as long as it likes: it is what it leaves out that is to be thin.
            start, rest = thinnest_run(-gain, need - float(gain.sum()))
            start, length = (start + rest) % self.bins, self.bins - rest
        return self._possible(start, length)

    def _possible(self, start: int, length: int) -> _Run:
        """The run, made no shorter than an exposure can be, and leaving as much out."""
        allowed = min(max(length, self.least), self.bins - self.least)
        if allowed != length:
            start = self._best_start(allowed)
        hit, extra = (_sum_of_run(of, start, allowed) for of in (self.wanted, self.other))
        short = min(allowed, self.bins - allowed)
        ratio = hit / max(float(self.wanted.sum()) + extra, 1.0)
        return _Run(start, allowed, ratio, 2 * allowed > self.bins, short * self.step_us)

    def _best_start(self, length: int) -> int:
        """Where the run of this length that has the greatest intersection over union begins."""

        def sums(values: Doubles) -> Doubles:
            total = np.concatenate([[0.0], np.cumsum(np.concatenate([values, values[:length]]))])
            moved: Doubles = total[length : length + values.size] - total[: values.size]
            return moved

        ratios = sums(self.wanted) / (self.wanted.sum() + sums(self.other))
        best = ratios >= ratios.max()
        # equally good starts: the middle of their longest run keeps the edges away from pixels
        turn = int(np.argmin(best))
        runs = np.flatnonzero(np.diff(np.concatenate([[False], np.roll(best, -turn), [False]])))
        longest = int(np.argmax(runs[1::2] - runs[::2]))
        return (int(runs[2 * longest] + runs[2 * longest + 1] - 1) // 2 + turn) % len(best)

    def off_own_tilt_us(self, run: _Run) -> float:
        """How far the line time is from that of the surface in the run's slab, microseconds a row."""
        lit_us, rows = _thin_out(self.pixels[1 if run.left_out else 0], _LEANING_PIXELS)[0]
        start, length = (run.start + run.length, self.bins - run.length) if run.left_out else (run.start, run.length)
        late = lit_us - (rows + 0.5) * self.line_time_us - start * self.step_us
        phase = np.mod(late, self.rig.projector.period_us)
        inside = phase < length * self.step_us
        if not inside.any():
            return 0.0
        # A surface that leans as the gate does has the same phase in every row.
        below = rows[inside] - rows[inside].mean()
        spread = float(below @ below)
        return abs(float(below @ phase[inside]) / spread) if spread else 0.0

    def with_margins(self, run: _Run) -> tuple[float, float]:
        """Start and length in microseconds, the edges moved out into gaps without pixels: proof against noise."""
        start, length, occupied = run.start, run.length, self.wanted + self.other
        edges = occupied[(start + np.array([0, 1, length - 2, length - 1])) % self.bins]
        if length <= self.least and not edges.any():
            # already widened, and placed midway between what lies on either side
            return start * self.step_us, length * self.step_us
        rows = 2 * _MARGIN_ROWS / self.rig.projector.rows_per_us
        reach = min(int(rows / self.step_us), (self.bins - length) // 2)
        before = occupied[(start - 1 - np.arange(reach)) % self.bins] > 0
        after = occupied[(start + length + np.arange(reach)) % self.bins] > 0
        ahead, behind = (int(np.argmax(row)) if row.any() else reach for row in (before, after))
        return (start - ahead / 2) * self.step_us, (length + (ahead + behind) / 2) * self.step_us


class _Candidate(NamedTuple):
    """The thinnest gate of a line time, and what it is chosen by."""

    phases: _Phases
    run: _Run
    iou: float
    thin_us: float


def _thinnest_first(rig: Rig, gates: list[_Candidate]) -> list[_Candidate]:
    """Those that do as well as the best of them, the one to take first: what `best_gate` promises."""
    enough = (1 - EQUAL_SHARE) * max(one.iou for one in gates)
    good = sorted((one for one in gates if one.iou >= enough), key=lambda one: one.thin_us)
    nearly_us = good[0].thin_us + 1 / rig.projector.rows_per_us
    alike = [one for one in good if one.thin_us <= nearly_us]
    return sorted(alike, key=lambda one: one.phases.off_own_tilt_us(one.run)) + good[len(alike) :]


def _sum_of_run(values: Doubles, start: int, length: int) -> float:
    """Sum of a circular run."""
    over = max(start + length - values.size, 0)
    return float(values[start : start + length].sum() + values[:over].sum())


def _ranked(rig: Rig, kinds: tuple[Pixels, Pixels], line_times: list[float]) -> list[float]:
    """The line times of the `_FINALISTS` gates to choose among, judged coarsely."""
    (wanted, many), (other, others) = (_thin_out(pixels, _RANKING_PIXELS) for pixels in kinds)
    counted = [_Phases.of(rig, (wanted, other), each, _RANKING_BIN_US, (many, others)) for each in line_times]
    best = [phases.best() for phases in counted]
    enough = (1 - EQUAL_SHARE) * max(run.ratio for run in best)
    gates = []
    for phases, run in zip(counted, best, strict=True):
        if run.ratio >= enough:
            thin = phases.thinnest(run)
            gates.append(_Candidate(phases, thin, run.ratio, thin.thin_us))
    return [one.phases.line_time_us for one in _thinnest_first(rig, gates)[:_FINALISTS]]


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


def _rounded(
    phases: _Phases, run: _Run, projector_row: Singles, inside: Bools, hide: bool, line_times: int
) -> MaskGate:
    """The gate of a run as the hardware makes it, counted pixel by pixel."""
    start_us, length_us = phases.with_margins(run)
    step_us = phases.rig.camera.shutter.exposure_us.step
    made = []
    # Where pixels lie right at the edges, rounding can lose a whole row of them: then a step more on either side.
    for more_us in (0.0, step_us):
        ends_us = (start_us - more_us, length_us + 2 * more_us)
        made.append(_made(phases, *ends_us, projector_row, inside, hide, line_times))
        if made[-1].iou >= (1 - TRIMMED_SHARE) * run.ratio:
            break
    return max(made, key=lambda one: one.iou)


def _made(
    phases: _Phases,
    start_us: float,
    length_us: float,
    projector_row: Singles,
    inside: Bools,
    hide: bool,
    line_times: int,
) -> MaskGate:
    rig = phases.rig
    period, shutter = rig.projector.period_us, rig.camera.shutter
    # A gate and its complement cut the period at the same two places: the thinner of the two is the slab to show.
    thin = length_us <= period / 2
    if not thin:
        start_us, length_us = start_us + length_us, period - length_us
    slab = quantise(shutter, gate(phases.line_time_us, start_us + length_us / 2, length_us), period)
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


@njit(cache=True, nogil=True)
def thinnest_run(gain: Doubles, need: float) -> tuple[int, int]:
    """Start and length of the shortest circular run of bins whose gain sums to `need` or more.

    gain (bins,). Of runs of one length the one of most gain; length 0 where nothing is needed, all bins where no run
    gives that much.
    """
    bins = gain.size
    if need <= 0.0:
        return 0, 0
    sums = np.zeros(2 * bins + 1)
    for i in range(2 * bins):
        sums[i + 1] = sums[i] + gain[i if i < bins else i - bins]
    first, length, most = 0, bins, -np.inf
    # Starts that may still be best, of rising sums: one that a later start undercuts can only make longer runs.
    starts = np.empty(2 * bins + 1, np.int64)
    head, tail = 0, 0
    for end in range(2 * bins + 1):
        while head < tail and (end - starts[head] > length or sums[end] - sums[starts[head]] >= need):
            start, total = starts[head], sums[end] - sums[starts[head]]
            if end - start < length or (end - start == length and total > most):
                first, length, most = start % bins, end - start, total
            head += 1
        while head < tail and sums[starts[tail - 1]] >= sums[end]:
            tail -= 1
        starts[tail] = end
        tail += 1
    return first, length
