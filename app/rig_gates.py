"""Gates of a rig: the part of `slopegate.app.api` that renders nothing, for commands that have to start fast."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slopegate.core.gating.epipolar import epipolar_gate
from slopegate.core.gating.gate import Slab, SlabOrWhy, complement, slab, slab_if_any, upright_line_time
from slopegate.core.gating.plan import PlaneError, Planned, plan_on_hardware, plan_plane_on_hardware, whole_period
from slopegate.core.gating.slices import (
    Slices,
    Spacing,
    at_delays,
    depth_times,
    most_slices,
    tile_depths,
)
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise, require_line_time
from slopegate.drivers.files.rig_files import load_rig

USUAL_COUNT = 16
"""Slices, where no number is asked for."""
_SAME = 1e-6
"""Share of a slice by which one more would be no longer than the rounding of times."""


@dataclass(frozen=True, eq=False, repr=False)
class OpenRig:
    """A projector and a camera, and the gates that the two can make. Nothing here renders.

    A gate is a `GateSettings`: line_time_us (tilt), delay_us (distance, to the middle of the exposure of row 0) and
    exposure_us (thickness). Every method takes any gate; `rounded` says what the camera would make of it.
    """

    rig: Rig
    """The program's own description of it, which may change: read `name`, `shape` and `period_us` instead."""

    def __repr__(self) -> str:
        height, width = self.shape
        return f"<{type(self).__name__}: {self._title}, {width} x {height} pixels>"

    @property
    def _title(self) -> str:
        return self.name or "a rig without a name"

    @property
    def name(self) -> str:
        """What the rig file calls it."""
        return self.rig.name

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the camera's image in pixels."""
        return self.rig.camera.lens.height, self.rig.camera.lens.width

    @property
    def period_us(self) -> float:
        """Microseconds from one projector frame to the next."""
        return self.rig.projector.period_us

    @property
    def everything_lit(self) -> GateSettings:
        """The gate of exactly one projector period: the fully lit image."""
        return whole_period(self.rig, upright_line_time(self.rig))

    def gate(
        self, *, delay_us: float, exposure_us: float, clock_mhz: float | None = None, line_time_us: float | None = None
    ) -> GateSettings:
        """A gate by its settings, unrounded; the tilt by pixel clock or by line time."""
        return gate(self._line_time_us(clock_mhz, line_time_us), delay_us, exposure_us)

    def plan(self, tilt_deg: float, distance_m: float, thickness_m: float) -> Planned:
        """The gate of a slab: tilt (positive with the top leaning away), distance and thickness straight ahead.

        `.applied` is the gate as the camera makes it, `.exact` the gate before rounding; the rest tells the difference.
        """
        return plan_on_hardware(self.rig, tilt_deg, distance_m, thickness_m)

    def plan_plane(self, plane: tuple[float, float, float, float], thickness_m: float) -> Planned:
        """The gate along the plane A x + B y + C z + D = 0, metres in the camera's axes (x right, y down, z forward).

        `thickness_m` is across the plane. A gate cannot lean sideways: A tilts nothing.
        """
        a, b, c, d = plane
        length = math.hypot(a, b, c)
        if not math.isfinite(length) or (b, c) == (0, 0):
            sideways = "B and C must not both be 0, for no gate faces exactly sideways"
            raise PlaneError("plane", plane, f"A, B, C, D with finite A, B, C: {sideways}")
        normal = (a / length, b / length, c / length)
        # The plane is given from the camera's centre, the model from the middle between camera and projector.
        offset_m = float(np.dot(normal, self.rig.camera_centre_m)) - d / length
        try:
            return plan_plane_on_hardware(self.rig, normal, offset_m, thickness_m)
        except PlaneError as error:
            upright = "0, 0, 1, -1 is the one that stands 1 m ahead"
            raise PlaneError("plane", plane, f"A, B, C, D {error.allowed}; {upright}") from None

    def complement(self, gate: GateSettings) -> GateSettings:
        """The gate that records what this one does not."""
        return complement(gate, self.period_us)

    def rounded(self, gate: GateSettings) -> GateSettings:
        """The nearest gate that the camera can make."""
        return quantise(self.rig.camera.shutter, gate, self.period_us)

    def slab(self, gate: GateSettings) -> Slab:
        """Where the gate lies: tilt, distance, near and far surface, thickness, planes, hinge; metres and degrees.

        `.errors` has one standard error of each, where the rig file tells how well its numbers are known.
        UserError where the gate is no slab, as with the projector beside the camera.
        """
        return slab(self.rig, gate)

    def slab_if_any(self, gate: GateSettings) -> SlabOrWhy:
        """The same without an error: `.slab`, or None and the reason in `.why`."""
        return slab_if_any(self.rig, gate)

    @property
    def epipolar(self) -> GateSettings | None:
        """With the projector beside the camera: the gate that keeps the direct light of every distance, and little
        else; None where the rows are not epipolar."""
        return epipolar_gate(self.rig)

    def clock_mhz(self, gate: GateSettings) -> float | None:
        """The gate's pixel clock; None for a camera that sets line times."""
        line = self.rig.camera.shutter.line
        return line.clock_mhz(gate.line_time_us) if isinstance(line, PixelClocks) else None

    def plan_slices(
        self,
        near_m: float,
        far_m: float,
        count: int | None = None,
        spacing: Spacing = "delay",
        *,
        clock_mhz: float | None = None,
        line_time_us: float | None = None,
        exposure_us: float | None = None,
    ) -> Slices:
        """Gates that share their edges and cover near_m..far_m (may be infinite) straight ahead, nearest first.

        Equally long in delay, or with spacing "depth" equally thick. `count` None: as many as `exposure_us` asks for,
        which is how long one is at most, or else 16; fewer where the camera's shortest exposure is too long. Upright,
        unless a clock or line time is given.
        """
        line = self._settable_us(clock_mhz, line_time_us)
        if count is None:
            count = self._count(*depth_times(self.rig, line, near_m, far_m), exposure_us)
        return tile_depths(self.rig, line, near_m, far_m, count, spacing)

    def _count(self, start_us: float, end_us: float, exposure_us: float | None) -> int:
        """How many slices from one phase to another: as long as this at most, or as usual, and as the camera can."""
        wanted = USUAL_COUNT
        if exposure_us is not None:
            require(exposure_us > 0, "exposure_us", exposure_us, "above 0")
            wanted = max(1, math.ceil((end_us - start_us) / exposure_us - _SAME))
        return min(wanted, most_slices(self.rig, start_us, end_us))

    def slices_at(
        self,
        delays_us: tuple[float, ...],
        exposure_us: float,
        *,
        clock_mhz: float | None = None,
        line_time_us: float | None = None,
    ) -> Slices:
        """One gate a delay, in the order given, each rounded to what the camera can make."""
        return at_delays(self.rig, self._settable_us(clock_mhz, line_time_us), exposure_us, delays_us)

    def _line_time_us(self, clock_mhz: float | None, line_time_us: float | None) -> float:
        if clock_mhz is None:
            require(line_time_us is not None, "line_time_us", None, "a number, or clock_mhz in its place")
            assert line_time_us is not None
            return line_time_us
        require(line_time_us is None, "line_time_us", line_time_us, "left out where clock_mhz is given")
        line = self.rig.camera.shutter.line
        allowed = "left out: this camera has no pixel clock, give line_time_us instead"
        require(isinstance(line, PixelClocks), "clock_mhz", clock_mhz, allowed)
        assert isinstance(line, PixelClocks)
        found = line.line_time_us(clock_mhz)
        require_line_time(f"the line time of clock_mhz {clock_mhz:g}", found)
        return found

    def _settable_us(self, clock_mhz: float | None, line_time_us: float | None) -> float:
        """The camera's line time nearest to what is asked for; without a wish, the upright one."""
        if clock_mhz is None and line_time_us is None:
            return upright_line_time(self.rig)
        return self.rig.camera.shutter.line.nearest(self._line_time_us(clock_mhz, line_time_us))


def open_rig(file: str | Path | None = None) -> OpenRig:
    """The rig of a TOML file, or a shipped one by its key; None is the default, made for the shipped scenes."""
    return OpenRig(load_rig(file))
