"""The state of the window: which gate is wanted, what was sent, and the camera that it was sent to."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Flag, auto

from PySide6.QtCore import QObject, Signal

from slopegate.app.session.holding import Hold, Needs
from slopegate.app.session.letting_go import LettingGo
from slopegate.app.session.meter import Meter
from slopegate.app.session.source import Source
from slopegate.core.gating.gate import Slab, SlabOrWhy, complement, slab_if_any
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.render.render import Buffers
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise
from slopegate.core.scene.scene import Preset
from slopegate.drivers.contract.frame import Frame
from slopegate.drivers.stream.stream import Stream

_log = logging.getLogger(__name__)

CLOSE_S = 5.0
"""Longest that the end of the program waits for a camera."""


@dataclass(frozen=True)
class PlaneWish:
    """A gate that is wanted by its plane: tilt, distance on the axis, and thickness there."""

    tilt_deg: float
    distance_m: float
    thickness_m: float


@dataclass(frozen=True)
class Intent:
    """What the user wants: a gate by its settings or by its plane, or its complement."""

    wish: GateSettings | PlaneWish
    complement: bool = False


@dataclass(frozen=True)
class Resolved:
    """What an intent means for one rig, in numbers."""

    asked: GateSettings
    """Unrounded."""
    gate: GateSettings
    """The settings of the hardware that are nearest to it."""
    sent: GateSettings
    """The same, or its complement: what the camera is told."""
    asked_plane: PlaneWish | None
    """The plane that is wanted, or that of `asked`; None where it has no finite distance and thickness."""
    read_out: SlabOrWhy
    """The slab of `gate`, or why it is none."""

    @property
    def slab(self) -> Slab | None:
        """The slab of `gate`; None where it is none."""
        return self.read_out.slab


def resolve(rig: Rig, intent: Intent) -> Resolved:
    """What an intent means for this rig. Raises InputError with one sentence for what no gate can do."""
    limits, period = rig.camera.shutter, rig.projector.period_us
    plane: PlaneWish | None
    read_out: SlabOrWhy
    if isinstance(intent.wish, PlaneWish):
        plane = intent.wish
        planned = plan_on_hardware(rig, plane.tilt_deg, plane.distance_m, plane.thickness_m)
        asked, applied = planned.exact, planned.applied
        read_out = SlabOrWhy(planned.slab, "", planned.slab.warnings)
    else:
        asked = intent.wish
        applied = quantise(limits, asked, period)
        read_out = slab_if_any(rig, applied)
        plane = plane_of((read_out if applied == asked else slab_if_any(rig, asked)).slab)
    sent = quantise(limits, complement(applied, period), period) if intent.complement else applied
    return Resolved(asked, applied, sent, plane, read_out)


def intent_of(preset: Preset) -> Intent:
    """A named gate, by its plane where that is what the scene asks for."""
    wish = preset.settings if preset.asked_slab is None else PlaneWish(*preset.asked_slab)
    return Intent(wish, preset.complement)


def asked_slab(intent: Intent) -> tuple[float, float, float] | None:
    """Tilt (degrees), distance and thickness (m) of a gate that was asked for by its plane; None of another."""
    wish = intent.wish
    return (wish.tilt_deg, wish.distance_m, wish.thickness_m) if isinstance(wish, PlaneWish) else None


def plane_of(read_out: Slab | None) -> PlaneWish | None:
    """The slab as a wish that would bring it back; None where it has no finite distance or thickness."""
    if read_out is None or read_out.distance_m is None or read_out.thickness_m is None:
        return None
    return PlaneWish(read_out.tilt_deg, read_out.distance_m, read_out.thickness_m)


def reachable(source: Source, intent: Intent) -> Intent:
    """The intent, with the delay that a camera without one of its own has: rows are exposed from the trigger on."""
    wish, shutter = intent.wish, source.rig.camera.shutter
    if source.camera.info.can.delay or source.fixed_gate or not isinstance(wish, GateSettings):
        return intent
    exposure_us = shutter.exposure_us.nearest(wish.exposure_us)
    return replace(intent, wish=gate(wish.line_time_us, exposure_us / 2 - shutter.delay_offset_us, exposure_us))


def _possible(source: Source, intent: Intent | None) -> tuple[Intent, Resolved]:
    if intent is not None and not source.fixed_gate:
        with suppress(InputError):
            intent = reachable(source, intent)
            return intent, resolve(source.rig, intent)
    intent = reachable(source, intent_of(source.presets[0]))
    return intent, resolve(source.rig, intent)


class Change(Flag):
    """What a `Session.changed` is about."""

    GATE = auto()
    SOURCE = auto()
    PAUSE = auto()
    REFUSED = auto()
    DEPTH = auto()
    """A sweep has measured the depth of a device's scene."""
    HOLD = auto()
    """Something holds the gate, the source or the program, or does so no longer."""
    PRESENT = auto()
    """The gate that is really there, while something else than the user sets it."""


class Session(QObject):
    """Turns intents into settings, sends them to the camera, and tells what changed by one signal."""

    changed = Signal(object)
    """A Change."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.meter = Meter()
        self.refusal = ""
        """Why the last wish was not granted; empty when it was."""
        self._clock = clock
        self._source: Source | None = None
        self._stream: Stream | None = None
        self._intent: Intent | None = None
        self._resolved: Resolved | None = None
        self._last_plane: PlaneWish | None = None
        self._paused = False
        self._holds: list[Hold] = []
        self._present: Resolved | None = None
        self.closing = LettingGo()
        """Streams that are being closed, in threads of their own."""

    @property
    def source(self) -> Source | None:
        """What is looked at; None before the first scene is ready."""
        return self._source

    @property
    def intent(self) -> Intent | None:
        """What the user wants."""
        return self._intent

    @property
    def resolved(self) -> Resolved | None:
        """What that means in numbers."""
        return self._resolved

    @property
    def present(self) -> tuple[Resolved, Intent] | None:
        """The gate that is really there: of what is exposed now where something holds the gate, else what is wanted."""
        if self._resolved is None or self._intent is None:
            return None
        if self._present is not None:
            return self._present, Intent(self._present.sent)
        return self._resolved, self._intent

    def show_applied(self, applied: GateSettings | None) -> None:
        """Take note of the settings that made the frame on show."""
        if applied is None or self._source is None or self._resolved is None or self.held("gate") is None:
            return
        old = self._present or self._resolved
        if applied == old.sent:
            return
        if applied == self._resolved.sent:
            self._present = None
        else:
            with suppress(InputError):
                self._present = resolve(self._source.rig, Intent(applied))
        self.changed.emit(Change.PRESENT)

    def hold(self, by: str, fate: str = "", stop: Callable[[], None] | None = None) -> Hold:
        """A hold for work of one kind, which begins and ends it. `by`, `fate` and `stop` as `Hold` has them."""
        made = Hold(self._on_hold, by, fate, stop)
        self._holds.append(made)
        return made

    def held(self, needs: Needs) -> Hold | None:
        """What holds the gate, the source or the program now, if anything does."""
        return next(iter(self.holds(needs)), None)

    @property
    def locked(self) -> str:
        """Why the gate cannot be set now although there is one, in one sentence; empty when it can."""
        held = self.held("gate")
        if held is not None:
            return f"The gate is {held.sentence[0].lower()}{held.sentence[1:]}"
        return "" if self._source is None else self._source.fixed_gate

    def holds(self, needs: Needs) -> list[Hold]:
        """Everything that does."""
        return [hold for hold in self._holds if hold.holds(needs)]

    def _on_hold(self) -> None:
        change = Change.HOLD
        if self._present is not None and self.held("gate") is None:
            self._present = None
            change |= Change.PRESENT
        self.changed.emit(change)

    @property
    def paused(self) -> bool:
        """Whether the picture is held; the camera goes on."""
        return self._paused

    @property
    def last_plane(self) -> PlaneWish | None:
        """The last plane with finite numbers: where editing starts from when the present gate has none."""
        return self._last_plane

    def ask(self, intent: Intent) -> bool:
        """Set the gate that is wanted. False when no gate can do it, or something holds the one that is there.

        Then `refusal` says why, and the old one stays.
        """
        if self._source is None:
            return False
        locked = self.locked
        try:
            if self._source.camera.info.limits is None:
                raise InputError(f"{self._source.camera.info.name} is a plain camera without a gate")
            intent = reachable(self._source, intent)
            resolved = resolve(self._source.rig, intent)
            self.refusal = "" if self._source.fixed_gate and intent == self._intent else locked
        except InputError as error:
            self.refusal = f"No gate does that, so the last one stays: {error}"
        if self.refusal:
            self.changed.emit(Change.REFUSED)
            return False
        old = self._resolved
        self._intent, self._resolved = intent, resolved
        self._last_plane = resolved.asked_plane or self._last_plane
        if old is None or old.sent != resolved.sent:
            self._send()
        if old != resolved:
            self.changed.emit(Change.GATE)
        return True

    def ask_wish(self, wish: GateSettings | PlaneWish) -> bool:
        """Ask for another gate; whether it is the complement stays."""
        return self.ask(Intent(wish, self._intent.complement if self._intent else False))

    def ask_complement(self, wanted: bool) -> bool:
        """Ask for the same gate, or for its complement."""
        return self._intent is not None and self.ask(replace(self._intent, complement=wanted))

    def use(self, preset: Preset) -> bool:
        """Ask for a named gate."""
        return self.ask(intent_of(preset))

    def adopt(self, source: Source, intent: Intent | None = None, stream: Stream | None = None) -> None:
        """Stream from this source from now on; the old one is closed, in a thread of its own.

        The gate is `intent`, or the source's first named gate where that is None or impossible. `stream` runs already,
        as that of a device must, for starting one may block. Raises CameraError, and then nothing has changed, when the
        camera does not start.
        """
        intent, resolved = _possible(source, intent)
        started = stream or Stream(source.streamed)
        if source.camera.info.limits is not None:
            started.submit(resolved.sent, source.rows(resolved.sent))
        if stream is None:
            started.start()
        self.release()
        self._source, self._stream = source, started
        self._intent, self._resolved = intent, resolved
        self._last_plane = resolved.asked_plane
        self._present = None
        self._paused = False
        self.refusal = ""
        self.meter.restart()
        _log.info("Looking at %s", self.facts)
        self.changed.emit(Change.SOURCE | Change.GATE | Change.PAUSE)

    def see_with(self, source: Source) -> None:
        """Look at the same camera as another rig sees it: `source` has the camera of the one that runs.

        The gate is what was wanted, or the source's first one where that is impossible now.
        """
        before, intent = self._resolved, self._intent
        self._source = source
        self._intent, self._resolved = _possible(source, intent)
        self._last_plane = self._resolved.asked_plane or self._last_plane
        self._present = None
        if before is None or before.sent != self._resolved.sent:
            self._send()
        _log.info("Looking at %s", self.facts)
        self.changed.emit(Change.SOURCE | Change.GATE)

    def learn(self, measured: Buffers) -> None:
        """Keep what a depth sweep measured of the scene."""
        if self._source is not None:
            self._source = replace(self._source, measured=measured)
            self.changed.emit(Change.DEPTH)

    def pause(self, wanted: bool) -> None:
        """Stop or go on taking frames from the stream."""
        if wanted != self._paused:
            self._paused = wanted
            self.meter.interrupt()
            self.changed.emit(Change.PAUSE)

    def newest(self) -> Frame | None:
        """A frame not seen before, lent until the next one is taken; None when paused or there is none."""
        if self._stream is None or self._paused:
            return None
        return self._stream.newest()

    @property
    def stream(self) -> Stream | None:
        """The stream of frames, for what needs every one of them (see `Tap`)."""
        return self._stream

    @property
    def facts(self) -> str:
        """What is looked at and with which gate, for the log."""
        if self._source is None or self._resolved is None:
            return "no scene"
        where, rig, options = self._source.where, self._source.rig.name, self._source.options
        return f"{where}, rig {rig}, {options}, gate {self._resolved.sent}"

    def release(self) -> None:
        """Stop the stream and close the camera, without waiting for it. The last picture stays until `adopt`."""
        stream, self._stream = self._stream, None
        if stream is not None:
            self.closing.begin(stream.close, "the camera")

    def close(self) -> None:
        """Stop the stream and close the camera. One that hangs is left behind."""
        self.release()
        self._source = None
        self.closing.wait(CLOSE_S)

    def _send(self) -> None:
        if self._stream is not None and self._source is not None and self._resolved is not None:
            self.meter.sent(self._resolved.sent, self._clock())
            self._stream.submit(self._resolved.sent, self._source.rows(self._resolved.sent))
