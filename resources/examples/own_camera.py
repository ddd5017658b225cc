"""A camera of your own, in less than 60 lines: made up, but it keeps the whole contract.

    python own_camera.py [FOLDER]      writes a frame of it there

The contract is `drivers/contract/camera.py`, which is no public API: a driver is a part of the program. The suite that
every camera passes, this one too, is `tests/drivers/contract/test_contract.py`: a line in `KINDS` puts yours to it.
"""

import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise
from slopegate.drivers.contract.camera import Camera, check_buffer
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, exposed_s
from slopegate.drivers.files.rig_files import load_rig


class StripeCamera(Camera):
    """Sees stripes, one frame per projector frame: the delay moves them, the exposure makes them brighter."""

    def __init__(self, rig: Rig) -> None:
        lens, self._limits, self._period_us = rig.camera.lens, rig.camera.shutter, rig.projector.period_us
        self._info = CameraInfo("Stripes", lens.width, lens.height, "mono12", 4095, 40.0, self._limits)
        self._settled, self._sequence, self._due_s, self._stopped = True, 0, 0.0, threading.Event()
        self._asked = self._applied = quantise(self._limits, gate(10.0, 0.0, 1000.0), self._period_us)
        self.stop()

    @property
    def info(self) -> CameraInfo:
        return self._info

    def configure(self, settings: GateSettings) -> GateSettings:
        # Here the SDK is told, and asked what it has made of it.
        applied = quantise(self._limits, settings, self._period_us)
        self._settled = self._settled and applied == self._applied
        self._asked, self._applied = settings, applied
        return applied

    def start(self) -> None:
        self._stopped.clear()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        check_buffer(self._info, buffer)
        wait_s = max(self._due_s - time.monotonic(), 0.0)
        if self._stopped.wait(min(timeout_s, wait_s)) or timeout_s < wait_s:
            return None
        self._due_s = time.monotonic() + self._period_us / 1e6
        # Here the SDK's frame is copied.
        phase = np.arange(self._info.height)[:, None] / 8 + self._applied.delay_us / 1000
        buffer[:] = np.minimum(40 + (1 + np.sin(phase)) * self._applied.exposure_us / 8, 4095)
        began_s = time.monotonic() - exposed_s(self._applied, self._info.height)
        stamp = FrameStamp(self._sequence, began_s, self._asked, self._applied, self._settled)
        self._sequence, self._settled = self._sequence + 1, True
        return stamp

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.stop()


if __name__ == "__main__":
    camera = StripeCamera(load_rig(None))
    image = np.empty((camera.info.height, camera.info.width), np.uint16)
    camera.start()
    camera.configure(gate(13.0, 500.0, 4000.0))
    while (made := camera.read(image, 1.0)) is None or not made.settled:
        pass
    camera.close()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / "stripes.png"), image * 16)
    print(f"frame {made.sequence} was made with {made.applied}")
