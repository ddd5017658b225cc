"""Depth from gates: a coarse-to-fine sweep of the delay, told frame by frame what the camera saw.

At one line time a pixel is recorded when its phase (`gate.phase_us`) lies in the exposure, so every frame compares all
phases with two numbers, the edges of its window. The sweep halves the intervals of phase that hold
pixels, two of them a frame, and leaves alone those that hold none. A plain sweep takes a frame for every step instead.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.sensor import READ_VARIANCE
from slopegate.core.gating.gate import rows_at_phase, upright_line_time
from slopegate.core.gating.slices import phase_range
from slopegate.core.rig.arrays import Bools, Bytes, Counts, Indices, Ints, Singles
from slopegate.core.rig.axis import infinity_us, require_slabs
from slopegate.core.rig.checks import InputError, require, require_positive
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.rig.triangulate import depth_m, triangulate


@dataclass(frozen=True, eq=False)
class DepthMap:
    """The depth map that a sweep found; arrays (H, W) float32."""

    projector_row: Singles
    """Continuous projector row that lights the pixel, -1 where unknown."""
    inverse_depth: Singles
    """1/z in 1/m along the camera's axis, 0 where unknown."""
    disparity_rows: Singles
    """Projector rows by which the light comes later than from infinity on the axis, NaN where unknown; f_p b / z at
    B = 1 of the ideal rig."""
    frames: int
    """Settings measured, the two of all light and of none included."""
    plain_frames: int
    """What a sweep in equal steps takes for the same range and resolution."""
    resolution_rows: float
    """Width of the intervals of projector rows that pixels were sorted into."""
    lit_counts: Singles
    """The projector's light where everything is lit: counts above black, less ambient light; of a mosaic a mosaic."""
    ambient_counts: Singles
    """Ambient light of one projector period, counts."""

    @property
    def depth_m(self) -> Singles:
        """Metres along the camera's axis, NaN where unknown."""
        return depth_m(self.inverse_depth)

    @property
    def known(self) -> Bools:
        """Where there is a depth, (H, W) bool."""
        return self.inverse_depth > 0


def points_m(rig: Rig, found: DepthMap) -> Singles:
    """Where the pixels with known depth lie in world coordinates, metres (n, 3), in the order of the pixels."""
    rows, columns = np.nonzero(found.known)
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    world = rays / found.inverse_depth[rows, columns][:, None] + rig.camera_centre_m
    return world.astype(np.float32)


@dataclass(frozen=True)
class DepthError:
    """How far a depth map is from the truth, in shares of pixels and in millimetres."""

    known_share: float
    """Of the pixels that the projector lights, those with a depth."""
    median_mm: float
    rms_mm: float
    p95_mm: float
    """95th percentile of the absolute error."""
    wrong_share: float
    """Of the pixels with a depth, those off by more than a whole interval."""


def depth_error(found: DepthMap, projector_row: Singles, inverse_depth: Singles) -> DepthError | None:
    """Errors of a depth map against `render.Buffers`, (H, W) each; None where no lit pixel has a depth."""
    lit = (projector_row >= 0) & (inverse_depth > 0)
    both = lit & found.known
    if not both.any():
        return None
    away_mm = 1000 * np.abs(1 / found.inverse_depth[both].astype(np.float64) - 1 / inverse_depth[both])
    median_mm, p95_mm = np.percentile(away_mm, (50, 95))
    rows = np.abs(found.projector_row[both] - projector_row[both])
    return DepthError(
        known_share=float(np.count_nonzero(both) / np.count_nonzero(lit)),
        median_mm=float(median_mm),
        rms_mm=float(np.sqrt(np.mean(away_mm**2))),
        p95_mm=float(p95_mm),
        wrong_share=float(np.mean(rows > found.resolution_rows)),
    )


Readings = Counts | Singles
"""Counts of one frame, or the mean of several."""

_SIGMAS = 6.0
"""A pixel takes part when its light stands so many standard deviations above the noise (`sensor.READ_VARIANCE`)."""
_ASIDE_US = 2.0
"""How far windows of all and of no light stay from where light can be, for shutters that round."""
_CHECKS = 4


@dataclass(frozen=True)
class SweepSettings:
    """How far and how finely a sweep looks, and in how many frames a gate."""

    nearest_m: float = 0.3
    """Nothing nearer than this is expected."""
    finest_rows: float = 1.0
    """Width of the last intervals in projector rows."""
    least_share: float = 2e-5
    """An interval with a smaller share of the pixels is not refined, and its pixels stay unknown."""
    repeats: int = 1
    """Frames whose mean is told for each gate: darker pixels take part."""

    def __post_init__(self) -> None:
        require_positive("nearest_m", self.nearest_m)
        require_positive("finest_rows", self.finest_rows)
        require(self.repeats >= 1, "repeats", self.repeats, "a whole number of at least 1")
        require(0 <= self.least_share < 1, "least_share", self.least_share, "at least 0 and below 1")


@dataclass(frozen=True)
class _Interval:
    """Phases from low_us to high_us, where the shutter really cut: cells first .. last - 1 of the planned grid."""

    low_us: float
    high_us: float
    first: int
    last: int
    pixels: int

    @property
    def cut(self) -> int:
        return (self.first + self.last) // 2


@njit(cache=True, nogil=True)
def decide(
    counts: Counts | Singles,
    half: Singles,
    ambient: Singles,
    exposure_us: float,
    places: tuple[Ints, Ints],
    wrong: tuple[Bools, Bools],
    labels: Ints,
    strikes: Bytes,
    population: Indices,
) -> None:
    """Move each pixel, all (n,), to the interval that its answer in this frame names; population counts who is where.

    A pixel is lit when counts > half + ambient * exposure. By label: places says where a dark and where a lit pixel
    goes, wrong which of the two answers contradicts what is known of it (a strike). Labels below 0 are not looked at.
    """
    exposure = np.float32(exposure_us)
    for i in range(labels.size):
        label = labels[i]
        if label < 0:
            continue
        if np.float32(counts[i]) > half[i] + ambient[i] * exposure:
            target, bad = places[1][label], wrong[1][label]
        else:
            target, bad = places[0][label], wrong[0][label]
        labels[i] = target
        population[target] += 1
        if bad and strikes[i] < 255:
            strikes[i] += 1


class DepthSweep:
    """A depth sweep: ask for a gate and tell what it showed, until `ask` returns None; then read `result`.

    The first frame shows all light, the second only what is ambient: between them lies each pixel's threshold.
    """

    def __init__(self, rig: Rig, black_count: float, settings: SweepSettings | None = None) -> None:
        """Raises InputError where nearest_m or finest_rows are beyond this camera and projector, and for a rig whose
        gates tell no distances apart (`axis.no_slabs`)."""
        require_slabs(rig)
        self._rig, self._black = rig, black_count
        self.settings = settings or SweepSettings()
        shutter, period = rig.camera.shutter, rig.projector.period_us
        self._line_time_us = upright_line_time(rig)
        self._least_us = max(shutter.exposure_us.min, shutter.exposure_us.step)
        self._step_us = self.settings.finest_rows / rig.projector.rows_per_us
        self._start_us, end_us = phase_range(rig, self._line_time_us, self.settings.nearest_m)
        self.plain_frames = max(1, int(np.ceil((end_us - self._start_us) / self._step_us)))
        """What equal steps of the same resolution over the same range would take."""
        coarse = max(shutter.delay_us.step, shutter.exposure_us.step)
        allowed = f"larger: the shutter sets its edges in steps of {coarse:g} us"
        require(self._step_us >= 4 * coarse, "finest_rows", self.settings.finest_rows, allowed)
        dark_us = period - self.plain_frames * self._step_us
        allowed = f"larger, so that a part of the period ({period:g} us) is without light"
        require(dark_us > 2 * self._least_us + 8 * _ASIDE_US, "nearest_m", self.settings.nearest_m, allowed)
        self.frames = 0
        """Frames told so far."""
        self._flood: Singles | None = None
        self._labels: Ints | None = None
        self._intervals: list[_Interval] = []
        self._cuts: list[int] = []
        self._checks: list[tuple[float, float]] | None = None
        self._window = (0.0, 0.0)
        self._flood_us = 0.0

    @property
    def share_done(self) -> float:
        """Share of the pixels' bits that are known, 0..1."""
        lit = sum(one.pixels for one in self._intervals)
        if self._labels is None:
            return 0.0
        left = sum(one.pixels * np.log2(one.last - one.first) for one in self._intervals if self._open(one))
        return 1.0 - float(left / max(lit * np.log2(max(self.plain_frames, 2)), 1))

    def ask(self) -> GateSettings | None:
        """The gate of the next frame, unrounded; None when there is nothing left to learn."""
        window = self._next_window()
        if window is None:
            return None
        self._window = window
        return gate(self._line_time_us, (window[0] + window[1]) / 2, window[1] - window[0])

    def tell(self, counts: Readings, applied: GateSettings) -> None:
        """The frame, (H, W) uint16 or a float32 mean of several, that the gate asked for gave, and what was applied."""
        lens = self._rig.camera.lens
        shape = (lens.height, lens.width)
        require(counts.shape == shape, "counts", counts.shape, f"of the camera's shape {shape}")
        start, end = self._applied_edges(applied)
        if self._flood is None:
            self._flood, self._flood_us = counts.astype(np.float32).ravel(), end - start
        elif self._labels is None:
            self._learn(counts, end - start)
        else:
            self._split(counts, start, end)
            if self._checks and not self._cuts:
                self._checks.pop()
        self.frames += 1

    def result(self) -> DepthMap:
        """What is known by now; complete once `ask` has returned None."""
        lens, projector = self._rig.camera.lens, self._rig.projector
        flat = np.full(lens.height * lens.width, np.nan)
        if self._labels is not None:
            middles = [
                (one.low_us + one.high_us) / 2 if one.last - one.first == 1 else np.nan for one in self._intervals
            ]
            sure = (self._labels >= 0) & (self._strikes == 0)
            flat[sure] = np.array(middles)[self._labels[sure]]
        phases = flat.reshape(lens.height, lens.width)
        lit = rows_at_phase(self._rig, self._line_time_us, lens.row_centres[:, None], phases).astype(np.float32)
        # a cell at the raster's border can have its middle outside
        inside = (lit > -self.settings.finest_rows) & (lit < projector.lens.height + self.settings.finest_rows)
        lit = np.where(inside, np.clip(lit, 0, np.float32(projector.lens.height - 1e-3)), np.float32(-1))
        inverse = triangulate(self._rig, lit)
        lit[inverse <= 0] = -1
        later_us = phases - float(infinity_us(self._rig, self._line_time_us))
        disparity = np.where(inverse > 0, later_us * projector.rows_per_us, np.nan).astype(np.float32)
        direct, ambient = (np.zeros(lit.shape, np.float32), np.zeros(lit.shape, np.float32))
        if self._labels is not None:
            direct = (2 * (self._half - np.float32(self._black))).reshape(lit.shape)
            ambient = self._ambient.reshape(lit.shape) * np.float32(projector.period_us)
        resolution = self.settings.finest_rows
        return DepthMap(lit, inverse, disparity, self.frames, self.plain_frames, resolution, direct, ambient)

    def _edge(self, cell: int) -> float:
        return self._start_us + cell * self._step_us

    def _next_window(self) -> tuple[float, float] | None:
        """Start and end of the next exposure: all light, none, two cuts, one cut, a check, or nothing more."""
        end_us = self._edge(self.plain_frames)
        # All light, then none: half-way between the two is every pixel's threshold.
        if self._flood is None:
            return self._start_us - _ASIDE_US, end_us + _ASIDE_US
        if self._labels is None:
            return end_us + 2 * _ASIDE_US, self._start_us - 2 * _ASIDE_US + self._rig.projector.period_us
        self._cuts = self._next_cuts()
        edges = [self._edge(cut) for cut in self._cuts]
        if len(edges) == 2:
            return edges[0], edges[1]
        if edges:
            return self._start_us - self._least_us, edges[0]
        if self._checks is None:
            self._checks = self._planned_checks()
        return self._checks[-1] if self._checks else None

    def _planned_checks(self) -> list[tuple[float, float]]:
        """Last windows that light everything once between them: a pixel that moved or was sorted wrongly shows."""
        found = [one for one in self._intervals if one.last - one.first == 1 and one.pixels > 0]
        if not found:
            return []
        share = np.cumsum([one.pixels for one in found]) / sum(one.pixels for one in found)
        last = {int(np.searchsorted(share, (part + 1) / _CHECKS)) for part in range(_CHECKS - 1)} - {len(found) - 1}
        inner = [(found[index].high_us + found[index + 1].low_us) / 2 for index in sorted(last)]
        edges = [self._start_us - self._least_us, *inner, self._edge(self.plain_frames) + self._least_us]
        return [pair for pair in itertools.pairwise(edges) if pair[1] - pair[0] >= self._least_us]

    def _learn(self, dark: Readings, exposure_us: float) -> None:
        """Each pixel's threshold half-way between its light and none."""
        assert self._flood is not None
        black = np.float32(self._black)
        signal = self._flood - black
        self._ambient = np.maximum(dark.astype(np.float32).ravel() - black, 0) / np.float32(exposure_us)
        # The two exposures differ, and ambient light grows with the exposure.
        direct = signal - self._ambient * np.float32(self._flood_us)
        noise = np.sqrt((np.maximum(signal, 0) + np.float32(READ_VARIANCE)) / np.float32(self.settings.repeats))
        self._half = black + direct / 2
        self._labels = np.where(direct > _SIGMAS * noise, 0, -1).astype(np.int32)
        self._strikes = np.zeros(self._labels.size, np.uint8)
        pixels = int(np.count_nonzero(self._labels == 0))
        self._intervals = [_Interval(self._start_us, self._edge(self.plain_frames), 0, self.plain_frames, pixels)]

    def _open(self, one: _Interval) -> bool:
        """Whether an interval is to be halved."""
        assert self._labels is not None
        return one.last - one.first > 1 and one.pixels > self.settings.least_share * self._labels.size

    def _next_cuts(self) -> list[int]:
        """The next one or two cells to cut at: of the widest intervals, as near together as the exposure can be short.

        A window has two edges, so one frame can halve two intervals.
        """
        wanting = sorted((one for one in self._intervals if self._open(one)), key=lambda one: one.first - one.last)
        if not wanting:
            return []
        first = wanting[0].cut
        apart = int(np.ceil(self._least_us / self._step_us))
        level = wanting[0].last - wanting[0].first
        # The second cut must be far enough for an exposure to fit between, and near, for less ambient light.
        far_enough = [one for one in wanting if abs(one.cut - first) >= apart]
        partner = min(
            far_enough, key=lambda one: (2 * (one.last - one.first) < level, abs(one.cut - first)), default=None
        )
        return [first] if partner is None else sorted((first, partner.cut))

    def _split(self, counts: Readings, start: float, end: float) -> None:
        """Every pixel of a cut interval goes to one of its halves; the others are checked by what they must show."""
        assert self._labels is not None
        children: list[tuple[float, float, int, int]] = []
        places, wrong = np.empty((2, len(self._intervals)), np.int32), np.zeros((2, len(self._intervals)), np.bool_)
        for index, one in enumerate(self._intervals):
            place, low, high = len(children), one.low_us, one.high_us
            # With two cuts the window opens at the first and closes at the second: lit pixels lie after the one and
            # before the other. A single cut closes a window that opened before all light.
            if one.cut in self._cuts and self._open(one):
                opens = one.cut == self._cuts[0] and len(self._cuts) == 2
                edge = start if opens else end
                children += [(low, edge, one.first, one.cut), (edge, high, one.cut, one.last)]
                places[:, index] = (place, place + 1) if opens else (place + 1, place)
            else:
                children.append((low, high, one.first, one.last))
                places[:, index] = place
                # Not cut now, so what is known of it says what it must show: dark is wrong inside the window, lit
                # outside.
                wrong[:, index] = (start <= low and high <= end, high <= start or end <= low)
        population = np.zeros(len(children), np.int64)
        decide(
            counts.ravel(),
            self._half,
            self._ambient,
            end - start,
            (places[0], places[1]),
            (wrong[0], wrong[1]),
            self._labels,
            self._strikes,
            population,
        )
        self._intervals = [_Interval(*child, int(count)) for child, count in zip(children, population, strict=True)]

    def _applied_edges(self, applied: GateSettings) -> tuple[float, float]:
        """Start and end of the exposure that was really made, in the turn of the period that was asked for."""
        start, end = self._window
        asked = (start + end) / 2
        middle = asked + math.remainder(applied.delay_us - asked, self._rig.projector.period_us)
        made = middle - applied.exposure_us / 2, middle + applied.exposure_us / 2
        near = max(abs(made[0] - start), abs(made[1] - end)) < self._step_us / 2
        if not near:
            raise InputError(
                f"the camera made delay {float(applied.delay_us):g} and exposure {applied.exposure_us:g} us where "
                f"{(start + end) / 2:.0f} and {end - start:.0f} us were asked for: a sweep needs one that makes any "
                "gate, which a recorded capture does not"
            )
        return made
