"""Runs a search on a camera, or on a running stream that others look at.

On a stream the search is a tap that holds the gate from its first frame to its last. However it ends, found,
cancelled or failed, the gate then goes back to what was submitted: taking over the one found is for whoever asked.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import cv2
import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.core.search.search import ask, cancelled, tell
from slopegate.core.search.state import State
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.frame import FrameStamp, PixelFormat
from slopegate.drivers.stream.sieve import Sieve
from slopegate.drivers.stream.stream import Stream

TIMEOUT_S = 20.0
_SLICE_S = 0.05
_TOO_LATE = f"No frame with the gate asked for came within {TIMEOUT_S:g} seconds."


class SearchTap:
    """Picks out of a stream the one frame that a search asked for."""

    def __init__(self, pixel_format: PixelFormat, first: GateSettings) -> None:
        self._pixel_format = pixel_format
        self._wanted = first
        self._got: tuple[Counts, GateSettings] | None = None
        self._failure = ""
        self._sieve = Sieve()
        self._change = threading.Condition()

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        with self._change:
            return self._wanted

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`. Frames of another gate, those that have not settled, and those seen before are let go."""
        with self._change:
            if self._sieve.take(stamp, self._wanted) and self._got is None:
                self._got = _grey(image, self._pixel_format), stamp.applied or self._wanted
                self._change.notify_all()

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        with self._change:
            self._failure = sentence
            self._change.notify_all()

    def frame(self, settings: GateSettings, given_up: Callable[[], bool]) -> tuple[Counts, GateSettings] | None:
        """The next settled frame (H, W) made with these settings and what was applied; None when given up.

        Raises CameraError when the gate is refused, the stream ends or no such frame comes in time.
        """
        with self._change:
            self._ask(settings)
            for _ in range(round(TIMEOUT_S / _SLICE_S)):
                if given_up():
                    return None
                if self._failure:
                    raise CameraError(self._failure)
                if self._got is not None:
                    return self._got
                self._change.wait(_SLICE_S)
        raise CameraError(_TOO_LATE)

    def _ask(self, settings: GateSettings) -> None:
        if settings != self._wanted:
            self._sieve.begin()
        self._wanted, self._got = settings, None


def _grey(image: Counts, pixel_format: PixelFormat) -> Counts:
    """A grey copy: in a mosaic each pixel is averaged with its neighbours, wherever the mosaic begins."""
    return np.asarray(cv2.blur(image, (2, 2)) if pixel_format.startswith("bayer") else image.copy(), np.uint16)


def run_on_camera(camera: Camera, state: State, watch: Callable[[State], None] = lambda state: None) -> State:
    """Search to the end on a started camera that nobody else uses; its gate is then that of the last frame.

    Raises CameraError when the camera fails or makes no settled frame in time.
    """
    buffer = np.empty((camera.info.height, camera.info.width), np.uint16)
    while (settings := ask(state)) is not None:
        applied = camera.configure(settings)
        for _ in range(round(TIMEOUT_S)):
            stamp = camera.read(buffer, 1.0)
            if stamp is not None and stamp.settled:
                break
        else:
            raise CameraError(_TOO_LATE)
        state = tell(state, _grey(buffer, camera.info.pixel_format), applied)
        watch(state)
    return state


def run_search(
    stream: Stream,
    pixel_format: PixelFormat,
    state: State,
    watch: Callable[[State], None] = lambda state: None,
    given_up: Callable[[], bool] = lambda: False,
) -> State:
    """Search to the end, in the caller's thread; `watch` sees every state, `given_up` is asked often and ends it.

    Raises CameraError when the camera fails, InputError when something else holds the stream's gate.
    """
    first = ask(state)
    if first is None:
        return state
    tap = SearchTap(pixel_format, first)
    stream.attach(tap)
    try:
        while (settings := ask(state)) is not None:
            got = tap.frame(settings, given_up)
            state = cancelled(state) if got is None else tell(state, *got)
            watch(state)
    finally:
        stream.detach(tap)
    return state
