"""Gated pictures of one plane, as they come, and the timing that they tell so far."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np

from slopegate.core.calibration.applied import with_timing
from slopegate.core.calibration.edges import edges_in, profiles
from slopegate.core.calibration.informative import (
    FIRST,
    LEAST_LEAD,
    TargetSight,
    TimingGoal,
    TimingVerdict,
    enough,
    gates_needed,
    next_gates,
    nominal_of,
    sight_of,
)
from slopegate.core.calibration.law import NAMES, Shot
from slopegate.core.calibration.timing import GateTiming, fit_timing
from slopegate.core.calibration.timing_errors import TimingErrors, timing_covariance
from slopegate.core.calibration.timing_target import OTHER_SIZE, ActiveRange, better_size
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.drivers.calibrations.lit_view import LitView
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.seen_target import SeenTarget, WrongChartError

PERIOD_ERROR: Final = 1e-3
"""Of the projector's period: its standard error where no calibration has told one. 60 Hz may mean 59.94."""
MOST_SATURATED: Final = 0.02
"""Of the plane's pixels, in a frame that counts: fully lit, none of them was."""
OPEN: Final = {"active_fraction": 0.01, "line_time_us": 0.01, "period_us": 0.5 * PERIOD_ERROR}
"""Standard errors, as shares, from which on a number is as good as not told."""
PROPOSED: Final = 6
"""Gates that are thought of at a time."""
MOST_MISFIT_ROWS: Final = 1.0
"""Rows of the picture by which edges may lie off the law for the plane to be where it is said to be."""
MOST_JITTER: Final = 0.02
"""Of a period, for a trigger that the projector gives."""


@dataclass(frozen=True)
class UselessFrames:
    """Frames that were taken and tell nothing."""

    saturated: int = 0
    without_edges: int = 0
    """Whose light neither begins nor ends on the plane."""
    off: int = 0
    """Whose edges do not follow the law of the others: their trigger came at another time."""


@dataclass(frozen=True)
class LineTimeFound:
    """What a line time that is set really is, microseconds; clock_mhz None where line times are set directly."""

    clock_mhz: float | None
    set_us: float
    line_time_us: float
    standard_error_us: float


@dataclass(frozen=True, eq=False)
class TimingOutcome:
    """What gates told.

    rig: with the timing in it. next_gate: the one that would tell most. open_numbers: those that the gates hardly tell,
    which are therefore much as they were believed. frames: gated ones, the useless included. needed: about how many of
    them would have done, where more gates alone would.
    """

    rig: Rig
    timing: GateTiming
    errors: TimingErrors
    line_times: tuple[LineTimeFound, ...]
    verdict: TimingVerdict
    next_gate: GateSettings
    open_numbers: tuple[str, ...]
    frames: int
    useless: UselessFrames
    how: str
    needed: int | None


class PlaneGates:
    """Edges of gates on one plane, and the law fitted to them."""

    def __init__(self, rig: Rig, view: LitView, seen: SeenTarget, max_count: int, goal: TimingGoal) -> None:
        """rig: by which gates are set. max_count: the camera's largest."""
        self._rig, self._view, self._seen, self._max_count, self._goal = rig, view, seen, max_count, goal
        self._sight: TargetSight = sight_of(seen.projector_row, seen.known)
        known = {} if rig.calibration is None else rig.calibration.standard_errors
        period_us = rig.projector.period_us
        self._nominal = nominal_of(rig, known.get("period_us", PERIOD_ERROR * period_us))
        self._shots: list[Shot] = []
        self._saturated = self._without_edges = 0
        self._digest = hashlib.sha256()
        self._fitted_to = 0
        self._proposed: list[GateSettings] = []
        self.timing: GateTiming | None = None
        """What the frames told at the last fit; None until they tell anything."""
        self.why_not = "no gate has been taken yet"
        """Why there is no timing, where there is none."""

    @property
    def frames(self) -> int:
        """How many were added."""
        return len(self._shots) + self._saturated

    @property
    def useless(self) -> UselessFrames:
        """Of those that were added."""
        off = 0 if self.timing is None else len(self.timing.left_out)
        return UselessFrames(self._saturated, self._without_edges, off)

    @property
    def verdict(self) -> TimingVerdict:
        """Whether the timing is known well enough, and edges lie where a plane puts them."""
        timing = self.timing
        off = 0.0 if timing is None else self._misfit_rows(timing)
        if off > MOST_MISFIT_ROWS:
            return TimingVerdict(
                False,
                f"edges lie {off:.1f} rows of the picture off where one timing puts them: the plane moved, is not "
                "where rig file and pictures say, or is another chart",
            )
        if timing is not None and timing.jitter_us > MOST_JITTER * timing.period_us:
            return TimingVerdict(
                False,
                f"gates come {timing.jitter_us:.0f} us early or late from frame to frame: see that the projector "
                "triggers the camera, and that the plane rests where rig file and pictures say",
            )
        return enough(timing, self._goal)

    def _misfit_rows(self, timing: GateTiming) -> float:
        """How far the edges lie off the law, rows of the picture."""
        row_us, stretch = timing.values[:2]
        rates = [
            abs(row_us * edge.slope - stretch * shot.settings.line_time_us)
            for shot in self._shots
            for edge in shot.edges
        ]
        return timing.edge_error_us / float(np.median(rates))

    def next_gate(self) -> GateSettings:
        """The gate that tells most about what is not known well; some are thought of together."""
        if not self._proposed:
            given = (self._rig, self._sight, self._shots, self.timing)
            self._proposed = next_gates(*given, PROPOSED, self._goal)
        return self._proposed.pop(0)

    def add(self, counts: Counts | Singles, applied: GateSettings) -> None:
        """A frame (H, W), or the mean of some, of the gate that was applied."""
        self._digest.update(np.ascontiguousarray(counts).tobytes())
        known = self._seen.known
        if float((counts[known] >= self._max_count).mean()) > MOST_SATURATED:
            self._saturated += 1
            return
        light = self._view.light(counts, applied.exposure_us)
        strips = profiles(light, self._view.full, self._seen.projector_row, known, self._view.noise)
        edges = tuple(edge for strip in strips for edge in edges_in(strip))
        self._without_edges += not edges
        self._shots.append(Shot(applied, edges))

    @property
    def due(self) -> bool:
        """Whether there are enough new frames for a fit to tell more."""
        new = len(self._shots) - self._fitted_to
        return len(self._shots) >= FIRST and new >= max(6, self._fitted_to // 8)

    def fit(self) -> None:
        """Fit the law to all frames so far."""
        self._fitted_to, self._proposed = len(self._shots), []
        try:
            self.timing = fit_timing(self._shots, self._nominal)
        except InputError as error:
            self.timing, self.why_not = None, str(error)

    def outcome(self, camera: str) -> TimingOutcome:
        """What all frames tell. Raises CalibrationError where that is no timing, WrongChartError where it contradicts
        the chart."""
        if self._fitted_to < len(self._shots) or self.timing is None:
            self.fit()
        timing, places = self.timing, [] if self._seen.place is None else [self._seen.place]
        if timing is None:
            hint = "" if self._seen.chart is None else f", or it is not chart {self._seen.chart}"
            raise CalibrationError(f"{self.frames} gates tell no timing: {self.why_not}{hint}")
        errors = timing_covariance(timing, self._rig, self._shots, places)
        self._require_chart(timing, errors)
        facts = {
            "timing.made": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing.camera": camera,
            "timing.target": self._seen.how,
            "timing.frames": str(self.frames),
            "timing.edges": str(timing.edges),
            "timing.left_out": str(sum(vars(self.useless).values())),
            "timing.jitter_us": f"{timing.jitter_us:.3g}",
            "timing.pictures_sha256": self._digest.hexdigest(),
        }
        return TimingOutcome(
            with_timing(self._rig, timing, errors, tuple(facts.items())), timing, errors, self._line_times(timing),
            self.verdict, self.next_gate(), self._open_numbers(timing), self.frames, self.useless, self._seen.how,
            self._needed(timing),
        )  # fmt: skip

    def _needed(self, timing: GateTiming) -> int | None:
        """None where it is known well enough, or no number of gates would mend what is wrong."""
        verdict = self.verdict
        if verdict.enough or verdict != enough(timing, self._goal) or timing.lead < LEAST_LEAD:
            return None
        return gates_needed(timing, self.frames, self._goal)

    def _require_chart(self, timing: GateTiming, errors: TimingErrors) -> None:
        chart, place = self._seen.chart, self._seen.place
        if chart is None or place is None:
            return
        allowed = ActiveRange(self._rig.projector.active_fraction)
        size = better_size(self._shots, self._rig, place(self._rig), timing)
        if size is not None:
            square_mm = 1000 * chart.square_m
            raise WrongChartError(
                f"the edges of {self.frames} gates follow one timing if its squares are {size * square_mm:.3g} mm, and "
                f"not if they are {square_mm:.6g} mm: measure them, and give a size within {OTHER_SIZE:.0%} of that"
            )
        if allowed.beyond(timing.active_fraction, float(errors.covariance[1, 1]) ** 0.5):
            raise WrongChartError(
                f"if it were chart {chart}, {self.frames} gates would tell an active fraction of "
                f"{timing.active_fraction:.3f}, where the rig file has {allowed.believed:.6g} and {allowed.least:.3g} "
                f"to {allowed.most:.3g} is allowed: give the inner corners and the squares, in mm, of the chart that "
                "is seen, or mend the rig file"
            )

    def _line_times(self, timing: GateTiming) -> tuple[LineTimeFound, ...]:
        line, error = self._rig.camera.shutter.line, float(timing.standard_errors[NAMES.index("stretch")])
        found = []
        for set_us in sorted({shot.settings.line_time_us for shot in self._shots if shot.edges}):
            clock_mhz = line.clock_mhz(set_us) if isinstance(line, PixelClocks) else None
            found.append(LineTimeFound(clock_mhz, set_us, timing.stretch * set_us, error * set_us))
        return tuple(found)

    def _open_numbers(self, timing: GateTiming) -> tuple[str, ...]:
        row, line, _, _, period = timing.standard_errors / timing.values
        errors = {"active_fraction": row, "line_time_us": line, "period_us": period}
        return tuple(name for name, most in OPEN.items() if errors[name] > most)
