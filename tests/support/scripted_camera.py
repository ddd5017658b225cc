"""A camera whose frames hold their own sequence number, with faults on demand."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp
from small_capture import RIG

USERS = gate(200.0, 1234.0, 5000.0)


class Scripted:
    """A camera whose frames hold their own sequence number, with faults on demand."""

    def __init__(self) -> None:
        self.info = CameraInfo("scripted", 80, 60, "mono12", 4095, 40.0, RIG.camera.shutter)
        self.asked = USERS
        self.told: list[GateSettings] = []
        self.settled = True
        self.sequence = 0
        self.jumps: dict[int, int] = {}
        """Frames to lose (above 0) or to show again (below 0) before the one with this number."""
        self.refuses = self.broken = self.stuck = False
        self.pause_s = 0.0005
        self.hold: Callable[[], bool] = lambda: False
        """While this is so it makes no frame, and what is under way can be looked at for as long as that takes."""
        self._stopped = threading.Event()

    def configure(self, settings: GateSettings) -> GateSettings:
        if self.refuses:
            raise InputError("delay_us is 7: it must be anything else")
        if not self.stuck:
            self.settled = self.settled and settings == self.asked
            self.asked = settings
        self.told.append(settings)
        return settings

    def start(self) -> None:
        self._stopped.clear()

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        if self.broken:
            raise CameraError("The cable is loose.")
        if self.hold():
            self._stopped.wait(timeout_s)
            return None
        if self._stopped.wait(self.pause_s):
            return None
        jump = self.jumps.pop(self.sequence, 0)
        self.sequence += jump
        buffer[:] = self.sequence % 4096
        stamp = FrameStamp(self.sequence, self.sequence * 0.01, self.asked, self.asked, self.settled)
        self.sequence += 1
        if jump >= 0:
            self.settled = True
        return stamp

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.stop()
