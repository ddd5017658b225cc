"""Runs a depth sweep on any camera, by itself or behind a live window."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from slopegate.core.measure.sweep import DepthMap, DepthSweep
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.stream.search_run import SearchTap
from slopegate.drivers.stream.stream import Stream

Take = Callable[[GateSettings], tuple[Counts, GateSettings] | None]
"""One settled frame (H, W) made with these settings, and what was applied; None when given up."""

_TIMEOUT_S = 20.0


def run_sweep(
    take: Take, sweep: DepthSweep, told: Callable[[DepthSweep], None] = lambda sweep: None
) -> DepthMap | None:
    """Sweep to the end; each gate is the mean of as many frames as the sweep's settings say. None when given up.

    Raises what `take` raises, and InputError when the camera applies something else than was asked for.
    """
    repeats = sweep.settings.repeats
    while (asked := sweep.ask()) is not None:
        got = take(asked)
        if got is None:
            return None
        counts, applied = got
        if repeats > 1:
            total = counts.astype(np.float32)
            for _ in range(repeats - 1):
                more = take(asked)
                if more is None:
                    return None
                total += more[0]
            sweep.tell(total / np.float32(repeats), applied)
        else:
            sweep.tell(counts, applied)
        told(sweep)
    return sweep.result()


def frames_of(camera: Camera, clock: Callable[[], float] = time.monotonic, wait_s: float = _TIMEOUT_S) -> Take:
    """Takes frames of a started camera that nobody else uses. The pixels are valid until the next one.

    Taking raises CameraError when no settled frame with the settings asked for comes within `wait_s` seconds.
    """
    buffer = np.empty((camera.info.height, camera.info.width), np.uint16)

    def take(asked: GateSettings) -> tuple[Counts, GateSettings]:
        applied = camera.configure(asked)
        end_s = clock() + wait_s
        while clock() < end_s:
            stamp = camera.read(buffer, wait_s)
            if stamp is not None and stamp.settled and stamp.applied == applied:
                return buffer, applied
        raise CameraError(f"{camera.info.name} gave no frame with the settings asked for within {wait_s:g} seconds.")

    return take


@contextmanager
def frames_behind(stream: Stream, given_up: Callable[[], bool] = lambda: False) -> Iterator[Take]:
    """Takes frames of a running stream, which goes on showing them; its own gate comes back at the end.

    Raises InputError while something else takes every frame; taking raises CameraError when the stream ends.
    """
    tap: SearchTap | None = None

    def take(asked: GateSettings) -> tuple[Counts, GateSettings] | None:
        nonlocal tap
        if tap is None:
            # raw counts of whatever format: each pixel is judged by itself
            tap = SearchTap("mono12", asked)
            stream.attach(tap)
        return tap.frame(asked, given_up)

    try:
        yield take
    finally:
        if tap is not None:
            stream.detach(tap)
