"""What the drivers of all devices share: waiting for frames, stopping, numbering, and coming back after a loss."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Protocol

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, Steps, turns_into
from slopegate.drivers.contract.camera import Camera, CameraError, CameraGoneError, check_buffer, check_rows, unable
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, TriggerEdge, exposed_s

SLICE_S: Final = 0.05
"""Longest that a device is waited for in one go, so that `stop` is heard soon."""

SILENCE_S: Final = 1.0
"""After this long without a frame, and again after as long, the device is asked whether it is still there."""

KEPT_STAMPS: Final = 64
"""Frames that a device's clock is compared with the computer's over."""

IN_FLIGHT: Final = 3
"""Frames that may have been exposed, read out or sent with the old gate when a new one is written."""

FREE_RUNNING: Final = "The camera was opened to run by itself, without the projector's trigger."
"""Why a camera that was not to be triggered has no delay."""

TRIGGERED: Final = "The projector's sync signal sets the pace of the camera."
"""Why the frame rate of a camera that is triggered cannot be chosen."""

RESTARTED: Final = 1
"""The first frame after a start is often wrong on rolling-shutter sensors."""


@dataclass(frozen=True)
class Arrival:
    """One whole frame, as its device counts."""

    number: int
    """Counts every frame that the device made since its `start`; what is missing was lost on the way."""
    lost_packets: int = 0
    """So far."""
    clock_s: float | None = None
    """When the frame was made, by a clock of the device's own that may start and run as it likes; None without one."""


class DeviceClock:
    """Translates a device's own clock to the computer's.

    A frame may be held up on its way to the program, but it cannot come early. So of the latest frames the one that
    came soonest after its device's stamp says how the clocks differ; a few seconds of frames follow how they drift.
    """

    def __init__(self) -> None:
        self._ahead_s: deque[float] = deque(maxlen=KEPT_STAMPS)

    def reset(self) -> None:
        """The device's stamps may mean something else from now on."""
        self._ahead_s.clear()

    def time_s(self, device_s: float, latest_s: float) -> float:
        """A device's stamp on the computer's clock, where it cannot be later than `latest_s`."""
        self._ahead_s.append(latest_s - device_s)
        return device_s + min(self._ahead_s)


def trigger_delay(span: tuple[float, float, float], exact_us: float, period_us: float) -> tuple[float, int]:
    """A camera's own delay for an exact one, and how many projector periods were added to bring it into the range.

    `span` is the camera's smallest and largest delay and its step (0: none). A trigger one period later lights the same
    rows, so a start before the trigger becomes one in the next period. Raises InputError when no number of whole
    periods brings it into the range.
    """
    low, high, step = span
    turns = turns_into(low, high, exact_us, period_us)
    delay_us = exact_us + turns * period_us
    if not low <= delay_us <= high:
        raise InputError(
            f"the delay needs a trigger delay of {exact_us:.0f} us, give or take whole periods of {period_us:.0f} us: "
            f"the camera's goes from {low:.0f} to {high:.0f} us"
        )
    return Steps(low, high, step).nearest(delay_us) if step else delay_us, turns


def widened(rows: tuple[int, int], height: int, least: int, step: int) -> tuple[int, int]:
    """The smallest range around these rows with at least `least`, from a multiple of `step` to one or to the end."""
    first = rows[0] // step * step
    last = min(-(-rows[1] // step) * step, height)
    missing = max(least, 1) - (last - first)
    if missing > 0:
        last = min(height, last + -(-missing // step) * step)
        first = max(0, min(first, (last - max(least, 1)) // step * step))
    return first, last


class Device(Protocol):
    """An open device, used by one thread at a time. Any method may raise CameraError, or CameraGoneError when lost."""

    @property
    @abstractmethod
    def info(self) -> CameraInfo:
        """Fixed facts."""
        ...

    def apply(self, settings: GateSettings) -> tuple[GateSettings, int]:
        """Set a gate and read it back; also how many of the frames to come may not have been made with it.

        Called only where `info.can.exposure`. Raises InputError, with the old gate still set, for what it cannot do.
        """
        raise unable(self.info, self.info.can.exposure)

    def set_rows(self, first: int, last: int) -> tuple[tuple[int, int], int]:
        """Read at least these rows; also how many of the frames to come may be wrong.

        Called only where `info.can.rows`. The rows that are read keep the gate that they had. Raises InputError, with
        nothing changed, where the gate cannot be kept.
        """
        raise unable(self.info, self.info.can.rows)

    def trigger_on(self, edge: TriggerEdge) -> int:
        """Let this edge of the trigger start the frames; how many of the frames to come may be wrong.

        Called only where `info.can.edge`.
        """
        raise unable(self.info, self.info.can.edge)

    @abstractmethod
    def start(self) -> None:
        """Begin to make frames, none of them left over from before."""
        ...

    @abstractmethod
    def stop(self) -> None:
        """Make no more frames. Harmless when stopped."""
        ...

    @abstractmethod
    def fetch(self, buffer: Counts, timeout_s: float) -> Arrival | None:
        """Fill the buffer (height, width) with the next whole frame, 0 in rows not read; None after the time-out."""
        ...

    @abstractmethod
    def check(self) -> None:
        """Raise CameraGoneError when the device does not answer."""
        ...

    @abstractmethod
    def close(self) -> None:
        """Let the device go."""
        ...


class DeviceCamera(Camera):
    """A camera over a `Device`. One that is lost is connected anew, with the same gate, by `read`."""

    def __init__(self, connect: Callable[[], Device], clock: Callable[[], float] = time.monotonic) -> None:
        """Opens the device at once, and again whenever it was lost; raises what `connect` raises."""
        self._connect, self._clock = connect, clock
        self._device: Device | None = connect()
        self._info = self._device.info
        self._lock = threading.RLock()
        self._stopped = threading.Event()
        self._stopped.set()
        self._running = self._closed = self._interrupted = False
        self._asked: GateSettings | None = None
        self._applied: GateSettings | None = None
        self._rows = (0, self._info.height)
        self._edge: TriggerEdge = "rising"
        self._unsettled = 0
        self._sequence = -1
        self._number: int | None = None
        self._lost_packets = self._lost_before = 0
        self._heard_s = 0.0
        self._device_clock = DeviceClock()

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera."""
        return self._info

    def configure(self, settings: GateSettings) -> GateSettings:
        """Set a gate and return what the device reads back. Raises InputError, CameraError."""
        if not self._info.can.exposure:
            raise unable(self._info, self._info.can.exposure)
        with self._lock:
            try:
                applied, unsettled = self._reach().apply(settings)
            except CameraGoneError:
                self._lose()
                raise
            if applied != self._applied:
                self._device_clock.reset()
            self._asked, self._applied = settings, applied
            self._unsettled = max(self._unsettled, unsettled)
        return applied

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """Read only these rows, widened to what the device can do."""
        if not self._info.can.rows:
            raise unable(self._info, self._info.can.rows)
        check_rows(self._info, first, last)
        with self._lock:
            try:
                self._rows, unsettled = self._reach().set_rows(first, last)
            except CameraGoneError:
                self._lose()
                raise
            self._unsettled = max(self._unsettled, unsettled)
            self._device_clock.reset()
            return self._rows

    def trigger_on(self, edge: TriggerEdge) -> None:
        """Let this edge of the trigger start the frames, also of a device that was lost meanwhile."""
        if not self._info.can.edge:
            raise unable(self._info, self._info.can.edge)
        with self._lock:
            self._edge = edge
            try:
                unsettled = self._reach().trigger_on(edge)
            except CameraGoneError:
                self._lose()
                raise
            self._unsettled = max(self._unsettled, unsettled)
            self._device_clock.reset()

    def start(self) -> None:
        """Begin to make frames; raises CameraError when the device will not."""
        with self._lock:
            self._stopped.clear()
            try:
                self._run(self._reach())
            except CameraError as error:
                self._stopped.set()
                if isinstance(error, CameraGoneError):
                    self._lose()
                raise

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The next frame into `buffer` (height, width) uint16; None after time-out, `stop` or `close`."""
        check_buffer(self._info, buffer)
        end_s = self._clock() + timeout_s
        try:
            while not self._stopped.is_set():
                left_s = end_s - self._clock()
                with self._lock:
                    try:
                        stamp = self._take(buffer, min(max(left_s, 0.0), SLICE_S))
                    except CameraGoneError:
                        self._lose()
                        raise
                if stamp is not None:
                    return stamp
                if left_s <= SLICE_S:
                    break
            return None
        finally:
            # `stop` leaves this to a reader that was busy for longer, say with a device that did not answer
            if self._stopped.is_set():
                self._halt()

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._stopped.set()
        if self._lock.acquire(timeout=4 * SLICE_S):
            try:
                self._halt()
            finally:
                self._lock.release()

    def close(self) -> None:
        """Stop and let the device go."""
        self.stop()
        with self._lock:
            self._closed = True
            self._lose()

    def _reach(self) -> Device:
        """The device, connected anew with the same gate when it was lost."""
        if self._closed:
            raise CameraError(f"{self._info.name} was closed")
        if self._device is None:
            device = self._connect()
            try:
                if device.info != self._info:
                    raise CameraError(f"{self._info.name} came back as another camera or in another mode: open it anew")
                if self._rows != (0, self._info.height):
                    self._rows, self._unsettled = device.set_rows(*self._rows)
                if self._edge != "rising":
                    self._unsettled = device.trigger_on(self._edge)
                if self._asked is not None:
                    self._applied, self._unsettled = device.apply(self._asked)
            except (CameraError, InputError) as error:
                with suppress(CameraError):
                    device.close()
                raise CameraGoneError(str(error)) from None
            self._device = device
        return self._device

    def _run(self, device: Device) -> None:
        if not self._running:
            device.start()
            self._running, self._number = True, None
            self._device_clock.reset()
            self._heard_s = self._clock()

    def _halt(self) -> None:
        with self._lock:
            if self._running and self._device is not None:
                try:
                    self._device.stop()
                except CameraError:
                    self._lose()
            self._running = False

    def _lose(self) -> None:
        """Let go of a device that does not answer; the next call that needs it connects it anew."""
        device, self._device = self._device, None
        self._interrupted = self._interrupted or self._running
        self._running = False
        self._lost_before += self._lost_packets
        self._lost_packets = 0
        if device is not None:
            with suppress(CameraError):
                device.close()

    def _take(self, buffer: Counts, wait_s: float) -> FrameStamp | None:
        if self._stopped.is_set():
            return None
        device = self._reach()
        self._run(device)
        arrival = device.fetch(buffer, wait_s)
        now_s = self._clock()
        if arrival is None:
            if now_s - self._heard_s > SILENCE_S:
                self._heard_s = now_s
                device.check()
            return None
        self._heard_s = now_s
        if self._number is not None and arrival.number <= self._number:
            return None  # a frame seen before
        return self._stamp(arrival, now_s)

    def _stamp(self, arrival: Arrival, now_s: float) -> FrameStamp:
        # How many frames a lost device made is not known: count one, so that the gap shows.
        self._sequence += 1 + self._interrupted if self._number is None else arrival.number - self._number
        self._number, self._interrupted = arrival.number, False
        self._lost_packets = arrival.lost_packets
        settled = self._unsettled == 0
        self._unsettled = max(0, self._unsettled - 1)
        lost = self._lost_before + arrival.lost_packets
        rows = None if self._rows == (0, self._info.height) else self._rows
        time_s = now_s - exposed_s(self._applied, self._rows[1])
        if arrival.clock_s is not None:
            time_s = self._device_clock.time_s(arrival.clock_s, time_s)
        return FrameStamp(self._sequence, time_s, self._asked, self._applied, settled, lost_packets=lost, rows=rows)
