"""A camera whose delay is made by a sync board: callers ask for one delay and are told one.

The camera is asked for a start of exposure at the trigger (start = delay - exposure / 2) and told nothing else of the
delay; the board adds the rest by triggering it later. Triggers come once a projector period, so a start before the
trigger is one a whole period later.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError, require_positive
from slopegate.core.rig.settings import GateSettings, StartDelayUs, Steps, TriggerSettings, from_trigger, to_trigger
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.frame import Ability, CameraInfo, FrameStamp, exposed_s
from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.dialect import Pulse

DELAY_STEP_US: Final = 0.1
ALL_ROWS: Final = Ability("Its delay is made by a sync board, which is told for whole pictures.")
OWN_PULSE: Final = Ability("Its trigger comes from a sync board, whose pulse is as wide as the board was told.")
QUEUED: Final = 16
"""At least as many frames as wait in any camera's memory when nobody fetches them."""


class BoardDelay(Camera):
    """A camera over another one, which it closes, and a started board, which it leaves open."""

    def __init__(
        self,
        camera: Camera,
        board: Board,
        period_us: float,
        pulse: Pulse | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`pulse` tells everything about the board's pulses but their delay. Raises InputError for a plain camera."""
        require_positive("period_us", period_us)
        limits = camera.info.limits
        if limits is None:
            raise InputError(f"{camera.info.name} is a plain camera: a board's delay makes no gate with it")
        if board.dialect.limits is None:
            raise InputError(f"{board.dialect.title}: it sets no delay, so the camera's own trigger delay must")
        self._camera, self._board, self._period_us = camera, board, period_us
        self._pulse, self._clock = pulse or Pulse(0.0), clock
        self._reads_s = deque((clock(),), QUEUED)
        """When frames were asked for, since none was waiting; the next one was not there yet at the first of these."""
        own = replace(limits, delay_us=Steps(-period_us, 2 * period_us, DELAY_STEP_US))
        can = replace(camera.info.can, delay=Ability(), rows=ALL_ROWS, edge=OWN_PULSE)
        self._info = replace(camera.info, limits=own, can=can, board=board.dialect.title)
        self._asked: GateSettings | None = None
        self._applied: GateSettings | None = None
        """What the camera has, and the delay that was sent to the board."""

    @property
    def info(self) -> CameraInfo:
        """The camera's facts, with the board's delay."""
        return self._info

    @property
    def trouble(self) -> str:
        """Why the board's delay is not known or not as asked for."""
        board = self._board.status
        lost = "The board does not answer, so the gate is not known: " if board.state == "lost" else ""
        return lost + board.sentence

    def configure(self, settings: GateSettings) -> GateSettings:
        """Ask camera and board; the board confirms later, and until then no frame is settled."""
        at_trigger = replace(to_trigger(settings), start_us=StartDelayUs(0.0))
        has = to_trigger(self._camera.configure(from_trigger(at_trigger)))
        # By the exposure that the camera really has, for the gate's delay is to its middle.
        later_us = settings.delay_us - has.exposure_us / 2 - has.start_us
        turns_us = later_us // self._period_us * self._period_us
        sent = self._board.submit(replace(self._pulse, delay_us=later_us - turns_us))
        total_us = has.start_us + sent.delay_us + turns_us
        self._asked = settings
        self._applied = from_trigger(TriggerSettings(has.line_time_us, StartDelayUs(total_us), has.exposure_us))
        return self._applied

    def cover(self, covered: bool) -> None:
        """As the camera does."""
        self._camera.cover(covered)

    def start(self) -> None:
        """Make frames from now on."""
        self._reads_s = deque((self._clock(),), QUEUED)
        self._camera.start()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The camera's next frame, with the gate of camera and board, or without one while that is not certain."""
        asked_s, earliest_s = self._clock(), self._reads_s[0]
        stamp = self._camera.read(buffer, timeout_s)
        if stamp is None:
            self._reads_s.clear()
        self._reads_s.append(asked_s)
        if stamp is None or self._applied is None:
            return stamp
        agreed_s = self._board.status.agreed_s
        # A frame whose trigger came before the board was heard to agree may have been made with the delay before. One
        # that had to wait for a busy computer is stamped late: it may have arrived as soon as it was asked for.
        began_s = min(stamp.time_s, earliest_s - exposed_s(self._applied, self._info.height))
        if agreed_s is None or began_s - agreed_s < 2e-6 * self._period_us:
            return replace(stamp, asked=self._asked, applied=None, settled=False)
        return replace(stamp, asked=self._asked, applied=self._applied)

    def stop(self) -> None:
        """Make no more frames."""
        self._camera.stop()

    def close(self) -> None:
        """Let the camera go."""
        self._camera.close()
