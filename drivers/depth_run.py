"""Runs a depth sweep on any camera."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from slopegate.core.depth_map import DepthMap
from slopegate.core.settings import GateSettings
from slopegate.core.sweep import DepthSweep
from slopegate.drivers.camera import Camera, CameraError

Told = Callable[[int, float], bool]
"""Frames measured so far and the share done; False stops the sweep."""

_TIMEOUT_S = 5.0


def run_sweep(
    camera: Camera,
    sweep: DepthSweep,
    repeats: int = 1,
    told: Told = lambda frames, share: True,
    clock: Callable[[], float] = time.monotonic,
) -> DepthMap:
    """Drive a camera that is started through the sweep; each setting is the mean of `repeats` settled frames.

    Stops early, with what is known by then, when `told` returns False. The camera is left with the last setting. Raises
    CameraError when no settled frame with the setting asked for comes within five seconds.
    """
    buffer = np.empty((camera.info.height, camera.info.width), np.uint16)
    while (asked := sweep.ask()) is not None:
        applied = camera.configure(asked)
        if repeats == 1:
            settled_frame(camera, applied, buffer, clock)
            sweep.tell(buffer, applied)
        else:
            total = np.zeros(buffer.shape, np.float32)
            for _ in range(repeats):
                settled_frame(camera, applied, buffer, clock)
                total += buffer
            sweep.tell(total / np.float32(repeats), applied)
        if not told(sweep.frames, sweep.share_done):
            break
    return sweep.result()


def settled_frame(
    camera: Camera, applied: GateSettings, buffer: NDArray[np.uint16], clock: Callable[[], float] = time.monotonic
) -> None:
    """Read into `buffer` until a frame was made with these settings and is not one of the first after a change."""
    end_s = clock() + _TIMEOUT_S
    while clock() < end_s:
        stamp = camera.read(buffer, _TIMEOUT_S)
        if stamp is not None and stamp.settled and stamp.applied == applied:
            return
    raise CameraError(f"{camera.info.name} gave no frame with the settings asked for within {_TIMEOUT_S:g} seconds.")
