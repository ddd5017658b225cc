"""A virtual camera of a rig that nobody knows: its gates are set, and told, by a rig that is only believed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import (
    MAX_LINE_TIME_US,
    MAX_TIME_US,
    GateSettings,
    LineTimes,
    PixelClocks,
    ShutterLimits,
    Steps,
    gate,
    quantise,
)
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import Camera, check_rows
from slopegate.drivers.contract.frame import Ability, CameraInfo, FrameStamp, TriggerEdge

_FINE_US = 2.0**-20
PULSE_US: Final = 120.0
"""How long a trigger's pulse lasts, where nothing else is said."""
_FREE = ShutterLimits(
    LineTimes(_FINE_US, MAX_LINE_TIME_US, _FINE_US),
    Steps(-MAX_TIME_US, MAX_TIME_US, _FINE_US),
    Steps(_FINE_US, MAX_TIME_US, _FINE_US),
)


def any_gate(rig: Rig) -> Rig:
    """The rig with a shutter that makes any gate, to a millionth of a microsecond: for the camera of `BelievedCamera`,
    whose real gates lie between the steps of the settings."""
    return replace(rig, camera=replace(rig.camera, shutter=_FREE))


class BelievedCamera(Camera):
    """The virtual camera of a true rig, as whoever believes in another one meets it.

    A real camera is told a line time by clocks and a trigger delay of which the rig's offset is a part. So where the
    believed rig has another number of clocks a line or another delay offset than the true one, real gates differ from
    those set, and nothing tells but the pictures.
    """

    def __init__(
        self,
        inner: VirtualCamera,
        true: ShutterLimits,
        believed: Rig,
        turned: bool = False,
        pulse_us: float = PULSE_US,
    ) -> None:
        """Owns `inner`, the camera of `any_gate(true rig)`, from here on.

        true: what the true rig file says of the shutter. turned: pictures come turned by half a turn, so that their
        rows count against the scan. pulse_us: by how much the trigger's falling edge comes after its rising one. Raises
        InputError where the believed rig's camera has other pixels.
        """
        lens, info = believed.camera.lens, inner.info
        size, allowed = f"{lens.width} x {lens.height}", f"{info.width} x {info.height} as of the true rig"
        require((lens.width, lens.height) == (info.width, info.height), "pixels of the camera", size, allowed)
        self._inner, self._believed, self._turned = inner, believed, turned
        shutter = believed.camera.shutter
        self._pulse_us, self._edge_us, self._unsettled = pulse_us, 0.0, False
        self._later_us = shutter.delay_offset_us - true.delay_offset_us
        self._stretch = 1.0
        if isinstance(shutter.line, PixelClocks) and isinstance(true.line, PixelClocks):
            self._stretch = true.line.clocks_per_line / shutter.line.clocks_per_line
        self._asked = self._applied = _first_gate(believed)
        self.configure(self._asked)

    @property
    def info(self) -> CameraInfo:
        """Facts of the true camera, with the limits of the believed one."""
        inner = self._inner.info
        return replace(inner, limits=self._believed.camera.shutter, can=replace(inner.can, edge=Ability()))

    @property
    def rig(self) -> Rig:
        """The rig that is believed."""
        return self._believed

    def configure(self, settings: GateSettings) -> GateSettings:
        """Round to what the believed rig's camera accepts, and make what comes of it on the true one."""
        believed, period_us = self._believed, self._inner.rig.projector.period_us
        applied = quantise(believed.camera.shutter, settings, believed.projector.period_us)
        delay_us = math.remainder(applied.delay_us + self._later_us + self._edge_us, period_us)
        self._inner.configure(gate(self._stretch * applied.line_time_us, delay_us, applied.exposure_us))
        self._asked, self._applied = settings, applied
        return applied

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """As the true camera does."""
        height = self.info.height
        if not self._turned:
            return self._inner.set_rows(first, last)
        check_rows(self.info, first, last)
        low, high = self._inner.set_rows(height - last, height - first)
        return height - high, height - low

    def cover(self, covered: bool) -> None:
        """As the true camera does."""
        self._inner.cover(covered)

    def trigger_on(self, edge: TriggerEdge) -> None:
        """The falling edge starts a frame later by the pulse."""
        self._edge_us = self._pulse_us if edge == "falling" else 0.0
        self._unsettled = True
        self.configure(self._asked)

    def trigger_late(self, late_us: float) -> None:
        """As the true camera does."""
        self._inner.trigger_late(late_us)

    def light_with(self, pattern: Singles | None) -> None:
        """As the true camera does."""
        self._inner.light_with(pattern)

    def number_frames_from(self, sequence: int) -> None:
        """As the true camera does."""
        self._inner.number_frames_from(sequence)

    def start(self) -> None:
        """Begin to make frames."""
        self._inner.start()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The true camera's next frame, by the settings that are believed."""
        stamp = self._inner.read(buffer, timeout_s)
        if stamp is None:
            return None
        rows, settled = stamp.rows, stamp.settled and not self._unsettled
        self._unsettled = False
        if self._turned:
            buffer[:] = buffer[::-1, ::-1].copy()
            rows = None if rows is None else (self.info.height - rows[1], self.info.height - rows[0])
        return replace(stamp, asked=self._asked, applied=self._applied, settled=settled, rows=rows)

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._inner.stop()

    def close(self) -> None:
        """Stop and let the true camera go."""
        self._inner.close()


def _first_gate(rig: Rig) -> GateSettings:
    return whole_period(rig, upright_line_time(rig))
