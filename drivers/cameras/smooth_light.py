"""The light of a virtual camera's frames that does not go through the gate pixel by pixel.

Fog, interreflection and skin are smooth: what they bring to a gate is summed once, together with the ambient light of
its exposure, into one plane. Frames read it in the ambient light's place until the gate, the shown parts or the scene
change, so a frame at rest costs no more than one of the clear scene. Where a lens is blurred, direct light is among
them.
"""

from __future__ import annotations

import threading
from collections.abc import Collection

import numpy as np

from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import Plates
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.lights import PLAIN, Lights
from slopegate.core.light.part import PARTS, LightPart, PartName
from slopegate.core.render.render import Buffers, Region
from slopegate.core.rig.arrays import Singles


class SmoothLight:
    """The parts that are ready and those that are shown, and the plane that they make of a gate. From any thread."""

    def __init__(self, shown: Collection[PartName]) -> None:
        self._lights, self._shown = Lights(), frozenset(shown)
        self._lock = threading.Lock()
        self._ambient = np.zeros((0, 0), np.float32)
        self._plane = np.zeros((0, 0), np.float32)
        self._changes, self._poured_at = 0, -1

    @property
    def ready(self) -> tuple[PartName, ...]:
        """The parts that are ready, shown or not, in the order of PARTS."""
        return tuple(name for name in PARTS if name in PLAIN or name in self._lights.names)

    @property
    def shown(self) -> frozenset[PartName]:
        """The parts that frames show as soon as they are ready."""
        return self._shown

    @property
    def lit(self) -> frozenset[PartName]:
        """The parts that frames show now: equal light makes equal frames only while these are the same."""
        return self._shown.intersection(self.ready)

    def show(self, names: Collection[PartName]) -> None:
        """Show these parts alone."""
        with self._lock:
            self._shown = frozenset(names)
            self._changes += 1

    def put(self, part: LightPart) -> None:
        """Take a part that has been made ready, or refined."""
        with self._lock:
            self._lights.put(part)
            self._changes += 1

    def light_with(self, pattern: Singles | None) -> None:
        """Let every part be as if the projector showed this picture: see `LightPart.light_with`."""
        with self._lock:
            self._lights.light_with(pattern)
            self._changes += 1

    def take_ambient(self, ambient: Singles) -> None:
        """The ambient light (H, W) of one period, linear; kept, not copied."""
        with self._lock:
            self._ambient = ambient
            self._changes += 1

    def follow(self, buffers: Buffers, region: Region, time_s: float, ambient: Singles) -> None:
        """The scene has moved: its buffers, where they differ, the time, and the ambient light (h, w) there."""
        with self._lock:
            if self._needed:
                self._ambient[region.rows, region.columns] = ambient
                self._lights.follow(buffers, region, time_s)
            self._changes += 1

    @property
    def changes(self) -> int:
        """Counts what may change the plane, besides the gate."""
        return self._changes

    @property
    def _needed(self) -> bool:
        return bool(self._lights.names)

    def pour(self, plates: Plates, windows: RowWindows, periods: float, gate_changes: int) -> tuple[bool, float]:
        """Fill the plates' second plane for this gate, unless it holds that.

        gate_changes counts what may have changed the gate. Returns whether direct light is shown, and what the frame
        has to take the second plane times: the exposure in periods, or 1 where the plane holds a gate's whole light.
        """
        with self._lock:
            shown = self._shown
            smooth = [name for name in self._lights.names if name in shown]
            if not smooth:
                if plates.poured:
                    plates.drain(self._ambient)
                self._poured_at = -1
                direct = "direct" in shown and "direct" not in self._lights.names
                return direct, periods if "ambient" in shown else 0.0
            stamp = self._changes + gate_changes
            if not plates.poured or stamp != self._poured_at:
                self._sum(windows, periods if "ambient" in shown else 0.0, smooth)
                plates.pour(self._plane)
                self._poured_at = stamp
            return "direct" in shown and "direct" not in smooth, 1.0

    def _sum(self, windows: RowWindows, periods: float, smooth: list[PartName]) -> None:
        if self._plane.shape != self._ambient.shape:
            self._plane = np.empty_like(self._ambient)
        np.multiply(self._ambient, np.float32(periods), out=self._plane)
        self._lights.add(windows, smooth, self._plane)

    def whole(self, windows: RowWindows) -> Singles:
        """What all parts that are ready bring to a gate of one period, without direct light: (H, W) float32."""
        with self._lock:
            self._sum(windows, 1.0, [name for name in self._lights.names if name != "direct"])
            return self._plane.copy()

    def by_part(
        self, direct: Singles, projector_row: Singles, windows: RowWindows, periods: float
    ) -> dict[PartName, Singles]:
        """What each part that is ready brings to a gate, shown or not: (H, W) float32, linear.

        direct, projector_row (H, W): of the scene as it is now. The next frame waits for this.
        """
        found: dict[PartName, Singles] = {"direct": gated(projector_row, direct, np.zeros_like(direct), windows, 0.0)}
        with self._lock:
            for name in self._lights.names:
                found[name] = np.zeros_like(direct)
                self._lights.add(windows, (name,), found[name])
            found["ambient"] = np.float32(periods) * self._ambient
        return found
