"""GenICam cameras, whatever carries their frames: aravis or a GenTL producer."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Protocol

from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.cameras.device_camera import IN_FLIGHT, RESTARTED, TRIGGERED, Arrival, Device, widened
from slopegate.drivers.cameras.genicam import (
    Features,
    Shutter,
    apply,
    choose_edge,
    edges_of,
    first_of,
    prepare,
    probe,
    set_rate,
)
from slopegate.drivers.cameras.pixels import PixelLayout, best_layout, layout_of, readable, unpack
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, Modes, OpenOptions, TriggerEdge


@dataclass(frozen=True)
class Block:
    """A frame as it came over the wire."""

    frame_id: int
    data: Bytes
    """Valid only while it is being taken."""
    width: int
    height: int
    clock_s: float | None = None
    """When the camera says that it made the frame, by its own clock; None where it does not."""


class Transport(Protocol):
    """An open GenICam device, however it is reached. Methods raise CameraError, or CameraGoneError when it is lost."""

    @property
    def name(self) -> str:
        """Vendor, model and serial number."""
        ...

    @property
    def features(self) -> Features:
        """Its features."""
        ...

    def begin(self) -> None:
        """Queue buffers and start the acquisition."""
        ...

    def end(self) -> None:
        """Stop the acquisition and forget what is in the buffers. Harmless when ended."""
        ...

    def fetch(self, take: Callable[[Block], None], timeout_s: float) -> bool:
        """Show the next whole frame to `take`; False after the time-out or when a frame came with parts missing."""
        ...

    def waiting(self) -> int:
        """Whole frames that are here but not fetched yet."""
        ...

    def lost_packets(self) -> int:
        """Packets lost since the device was opened; 0 where the transport does not say."""
        ...

    def check(self) -> None:
        """Raise CameraGoneError when the device does not answer or is not ours any more."""
        ...

    def close(self) -> None:
        """Let the device go."""
        ...


class GenicamDevice(Device):
    """A GenICam camera over a `Transport`."""

    def __init__(self, transport: Transport, rig: Rig, options: OpenOptions) -> None:
        """Sets frame size, pixel format and trigger. Closes the transport when it raises."""
        self._transport, self._period_us = transport, rig.projector.period_us
        self._running = False
        self._asked: GateSettings | None = None
        self._applied: GateSettings | None = None
        self._id = self._number = 0
        try:
            features = transport.features
            self._layout = _choose_layout(transport, options.pixel_format)
            width, height = _choose_size(features, (rig.camera.lens.width, rig.camera.lens.height))
            self._rows = (0, height)
            no_trigger = prepare(features, options.triggered)
            modes, choose_format = _format_modes(features, self._layout)
            choose_rate = Ability(TRIGGERED)
            if no_trigger:
                modes, choose_rate = set_rate(features, modes, options.rate_hz)
            self._shutter: Shutter | None = probe(features, rig, no_trigger)
            edge = edges_of(features, no_trigger)
        except BaseException:
            with suppress(CameraError):
                transport.close()
            raise
        plain = Ability("The camera has no exposure time that can be set.")
        can = self._shutter.can if self._shutter else Abilities(plain, plain, plain, Ability(no_trigger))
        can = replace(can, choose_format=choose_format, choose_rate=choose_rate, edge=edge)
        limits = self._shutter.limits if self._shutter else None
        form, top = self._layout.pixel_format, self._layout.max_count
        self._info = CameraInfo(transport.name, width, height, form, top, 0.0, limits, can, modes)

    @property
    def info(self) -> CameraInfo:
        """Fixed facts."""
        return self._info

    def apply(self, settings: GateSettings) -> tuple[GateSettings, int]:
        """Write the gate; a change of clock or line time is made with the acquisition stopped, as sensors demand."""
        shutter = self._shutter
        assert shutter is not None
        with self._paused(self._changes_line(shutter, settings)) as pause:
            applied = apply(self._transport.features, shutter, self._period_us, settings, self._rows[0])
        same, self._asked, self._applied = applied == self._applied, settings, applied
        if same and not pause:
            return applied, 0
        return applied, RESTARTED if pause or not self._running else self._transport.waiting() + IN_FLIGHT

    def set_rows(self, first: int, last: int) -> tuple[tuple[int, int], int]:
        """Read these rows only, widened to the camera's steps, and delay the trigger so that each keeps its gate."""
        features, height = self._transport.features, self._info.height
        low, _, step = features.span("Height")
        unit = 1 if self._layout.kind == "mono" else 2  # a mosaic keeps its colours
        step = math.lcm(unit, max(1, int(step)), max(1, int(features.span("OffsetY")[2])))
        first, last = widened((first, last), height, int(low), step)
        before = self._rows
        if (first, last) == before:
            return before, 0
        with self._paused(True):
            try:
                self._write_rows((first, last))
            except InputError:
                self._write_rows(before)
                raise
        return self._rows, RESTARTED

    def trigger_on(self, edge: TriggerEdge) -> int:
        """Choose the edge with the acquisition stopped, so that no frame of the other one is left."""
        with self._paused(True):
            choose_edge(self._transport.features, edge)
        return RESTARTED

    def start(self) -> None:
        """Begin to make frames."""
        if not self._running:
            self._transport.begin()
            self._running, self._id = True, -1

    def stop(self) -> None:
        """Make no more frames."""
        if self._running:
            self._running = False
            self._transport.end()

    def fetch(self, buffer: Counts, timeout_s: float) -> Arrival | None:
        """Fill the buffer with the counts of the next whole frame."""
        frame_id, clock_s = self._id, None

        def take(block: Block) -> None:
            nonlocal frame_id, clock_s
            first, last = self._rows
            if (block.height, block.width) != (last - first, self._info.width):
                kept = f"{self._info.width} x {last - first}"
                raise CameraError(f"{self._info.name} sends {block.width} x {block.height} pixels instead of {kept}")
            frame_id, clock_s = block.frame_id, block.clock_s
            buffer[:first] = buffer[last:] = 0
            unpack(block.data, self._layout, buffer[first:last])

        if not self._transport.fetch(take, timeout_s):
            return None
        self._number += frames_since(self._id, frame_id)
        self._id = frame_id
        return Arrival(self._number, self._transport.lost_packets(), clock_s)

    def check(self) -> None:
        """Raise CameraGoneError when the device does not answer."""
        self._transport.check()

    def close(self) -> None:
        """Let the device go."""
        try:
            self.stop()
        finally:
            self._transport.close()

    @contextmanager
    def _paused(self, wanted: bool) -> Iterator[bool]:
        """Stop the acquisition meanwhile, if wanted and running; tells whether it was."""
        pause = wanted and self._running
        if pause:
            self.stop()
        try:
            yield pause
        finally:
            if pause:
                self.start()

    def _write_rows(self, rows: tuple[int, int]) -> None:
        """Write offset and height; a smaller height first, so that both together never reach beyond the sensor."""
        features = self._transport.features
        sizes = {"Height": rows[1] - rows[0], "OffsetY": rows[0]}
        shrinks = sizes["Height"] <= self._rows[1] - self._rows[0]
        for name in sizes if shrinks else reversed(sizes):
            features.set_number(name, sizes[name])
        self._rows = rows
        if self._asked is not None and self._shutter is not None:
            self._applied = apply(features, self._shutter, self._period_us, self._asked, rows[0])

    def _changes_line(self, shutter: Shutter, settings: GateSettings) -> bool:
        if not shutter.line or self._applied is None:
            return bool(shutter.line)
        wanted = shutter.limits.line.nearest(settings.line_time_us)
        return not math.isclose(wanted, self._applied.line_time_us, rel_tol=1e-6)


def frames_since(last_id: int, frame_id: int) -> int:
    """How many frames after the one with `last_id` (negative: none yet) this one was made; 0 or less for an old one.

    GigE Vision counts in 16 bits from 1 to 65535 and leaves out 0, or in 64 bits.
    """
    if last_id < 0:
        return 1
    step = frame_id - last_id
    wrapped = last_id <= 0xFFFF and step < -0x7FFF
    return step + 0xFFFF if wrapped else step


def _choose_layout(transport: Transport, wanted: str | None) -> PixelLayout:
    features = transport.features
    names, present = features.choices("PixelFormat"), features.choice("PixelFormat")
    layout = best_layout(names, present) if wanted is None else layout_of(wanted) if wanted in names else None
    if layout is None:
        asked = "none that this program reads" if wanted is None else f"not {wanted}"
        raise CameraError(f"{transport.name} offers the pixel formats {', '.join(names)}: {asked}")
    if layout.name != present:
        features.choose("PixelFormat", layout.name)
        present = features.choice("PixelFormat")
        if layout.name != present:
            raise CameraError(f"{transport.name} was told the pixel format {layout.name} and has {present}")
    return layout


def _format_modes(features: Features, layout: PixelLayout) -> tuple[Modes, Ability]:
    """The pixel formats, and whether another one can be chosen."""
    names = readable(features.choices("PixelFormat"))
    others = len(names) > 1 and first_of(["PixelFormat"], features)
    only = Ability("" if others else "The camera offers no other pixel format that this program reads.")
    return Modes(layout.name, names), only


def _choose_size(features: Features, lens: tuple[int, int]) -> tuple[int, int]:
    """Set the size in the rig file, from the first pixel on, or the largest where the camera lacks that size."""
    for name in ("OffsetX", "OffsetY"):
        if first_of([name], features):
            features.set_number(name, features.span(name)[0])
    spans = [features.span(name) for name in ("Width", "Height")]
    fits = all(_reaches(span, size) for span, size in zip(spans, lens, strict=True))
    sizes = lens if fits else (int(spans[0][1]), int(spans[1][1]))
    for name, size in zip(("Width", "Height"), sizes, strict=True):
        if features.number(name) != size:
            features.set_number(name, size)
    return int(features.number("Width")), int(features.number("Height"))


def _reaches(span: tuple[float, float, float], size: int) -> bool:
    low, high, step = span
    return low <= size <= high and (not step or (size - low) % step == 0)
