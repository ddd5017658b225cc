"""Talks with an instrument over an open port: sends lines, waits for replies, and reads back whatever it sets."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from slopegate.drivers.sync.dialect import (
    Dialect,
    Item,
    Line,
    Pulse,
    RefusedError,
    ReplyError,
    StrangerError,
    Values,
    differing,
)
from slopegate.drivers.sync.serial_port import Port

MAX_REPLY_BYTES: Final = 1024
STALE_S: Final = 0.03
"""After so long without a byte, no reply to an earlier question is on its way any more."""


class Conversation:
    """A conversation with one instrument.

    Every method blocks, for a second or so at most, and may raise ReplyError, RefusedError or PortError.
    """

    def __init__(
        self,
        port: Port,
        dialect: Dialect,
        output: int,
        reply_timeout_s: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._port, self._dialect = port, dialect
        self._slots = dialect.items(output)
        self._timeout_s, self._clock, self._sleep = reply_timeout_s, clock, sleep
        self._items: tuple[Item, ...] = ()
        self._turn = 0
        self._received = b""
        self._quiet_s = -1e9

    @property
    def settable(self) -> tuple[str, ...]:
        """Fields of a Pulse that this instrument sets and tells; known after `read_all`."""
        return tuple(field for item in self._items for field in item.fields)

    def greet(self) -> str:
        """Ask who is there and drop replies to earlier questions. Raises StrangerError for another kind."""
        self._drain()
        self._send(self._dialect.hello)
        end_s = self._clock() + self._timeout_s
        stranger: StrangerError | None = None
        while True:
            try:
                reply = self._line(end_s, self._dialect.hello)
            except ReplyError as silence:
                raise stranger or silence from None
            try:
                name = self._dialect.identity(reply)
                break
            except ReplyError as error:
                stranger = StrangerError(str(error))
        self._drain()
        for line in self._dialect.prologue:
            self._do(line)
        return name

    def read_all(self) -> Values:
        """Everything that the instrument tells, after finding which of its alternatives this model knows."""
        chosen: list[Item] = []
        known: Values = {}
        for alternatives in self._slots:
            for item in alternatives:
                try:
                    known |= self._read(item)
                except RefusedError:
                    continue
                chosen.append(item)
                break
        self._items = tuple(chosen)
        return known

    def read_next(self) -> tuple[tuple[str, ...], Values]:
        """Read one item back, each in its turn; its fields, and their values as far as the instrument tells them."""
        if not self._items:
            self.greet()
            return (), {}
        self._turn = (self._turn + 1) % len(self._items)
        item = self._items[self._turn]
        return item.fields, self._read(item)

    def write(self, wanted: Pulse, known: Values) -> Values:
        """Set what is not known to be as wanted and read it back; returns all that is known now."""
        for item in self._items:
            if not differing(wanted, known, item.fields, {}):
                continue
            for name in item.fields:
                known.pop(name, None)
            for line in item.write(wanted):
                self._do(line)
            known |= self._read(item)
        return known

    def listen(self) -> None:
        """Drop what comes unasked; raises PortError when the port has gone."""
        self._port.read(0.0)

    def _read(self, item: Item) -> Values:
        return item.decode(tuple(self._ask(query) for query in item.queries))

    def _do(self, line: Line) -> None:
        if line.accept is None:
            self._send(line.text)
        else:
            line.accept(self._ask(line.text))

    def _ask(self, text: str) -> str:
        self._received = b""
        self._port.read(0.0)
        self._send(text)
        return self._line(self._clock() + self._timeout_s, text)

    def _send(self, text: str) -> None:
        wait_s = self._quiet_s + self._dialect.pause_s - self._clock()
        if wait_s > 0:
            self._sleep(wait_s)
        self._port.write(text.encode("ascii") + self._dialect.ending)
        self._quiet_s = self._clock()

    def _line(self, end_s: float, asked: str) -> str:
        """The next reply: a line that is neither empty nor an echo, or a character where the dialect has no lines."""
        while True:
            raw = self._next(end_s, asked)
            self._quiet_s = self._clock()
            text = raw.decode("ascii", "replace").strip("\r\n\0 ")
            if not text.isprintable() or not text.isascii():
                raise ReplyError(f"Garbage came back for '{asked}': {raw[:40]!r}. Is the baud rate right?")
            if text and (text != asked or not self._dialect.reply_ending):
                return text

    def _next(self, end_s: float, asked: str) -> bytes:
        ending = self._dialect.reply_ending
        while True:
            if ending and ending in self._received:
                raw, _, self._received = self._received.partition(ending)
                return raw
            if not ending and self._received:
                raw, self._received = self._received[:1], self._received[1:]
                return raw
            left_s = end_s - self._clock()
            if left_s <= 0:
                raise self._silence(asked)
            self._received += self._port.read(left_s)
            if len(self._received) > MAX_REPLY_BYTES:
                raise ReplyError(f"More than {MAX_REPLY_BYTES} bytes came back for '{asked}', and no end of line.")

    def _silence(self, asked: str) -> ReplyError:
        within = f"within {self._timeout_s:g} s"
        if self._received:
            return ReplyError(f"The reply to '{asked}' broke off after {self._received[:40]!r} {within}.")
        return ReplyError(f"No reply to '{asked}' {within}.")

    def _drain(self) -> None:
        """Drop what is on its way, until the line is silent or has babbled for a time-out."""
        self._received = b""
        end_s = self._clock() + self._timeout_s
        while self._clock() < end_s and self._port.read(STALE_S):
            pass
