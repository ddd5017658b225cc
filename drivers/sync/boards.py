"""The kinds of sync boards and delay generators, and boards of each on serial ports."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from slopegate.core.rig.checks import InputError
from slopegate.drivers.sync.authors import AUTHORS
from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.dg645 import DG645
from slopegate.drivers.sync.dialect import BoardError, Dialect, StrangerError
from slopegate.drivers.sync.pulse import PULSE
from slopegate.drivers.sync.serial_port import Port, SerialPort, find_port
from slopegate.drivers.sync.t560 import T560
from slopegate.drivers.sync.talk import Conversation

DIALECTS: Final[tuple[Dialect, ...]] = (PULSE, DG645, T560, AUTHORS)


def dialect_of(key: str) -> Dialect:
    """A dialect by its key; raises ValueError for an unknown one."""
    for dialect in DIALECTS:
        if dialect.key == key:
            return dialect
    raise InputError(f"dialect is {key!r}: it must be one of {', '.join(known.key for known in DIALECTS)}")


def serial_board(where: str, dialect: Dialect, baud: int | None = None, output: int = 1) -> Board:
    """A board on a serial port, by path or `PortFacts.usb_key`; call `start` to connect."""
    rate = baud or dialect.bauds[0]
    return Board(lambda: SerialPort(where, rate), dialect, output)


def identify(open_port: Callable[[int], Port], dialect: Dialect, reply_timeout_s: float = 0.5) -> tuple[str, int]:
    """Who answers in this dialect, and at which baud rate. Raises PortError, or BoardError when nobody does."""
    problem = BoardError("No baud rate was tried.")
    for baud in dialect.bauds:
        port = open_port(baud)
        try:
            return Conversation(port, dialect, 1, reply_timeout_s).greet(), baud
        except StrangerError:
            raise  # in readable words, so the rate is right
        except BoardError as error:
            problem = error
        finally:
            port.close()
    raise problem


def who_answers(where: str) -> tuple[str, Dialect, int]:
    """Who is at a serial port, in which dialect and at which baud rate: asked in all of them, which changes nothing.

    Raises PortError for a port that cannot be opened, BoardError when nobody answers.
    """
    for dialect in DIALECTS:
        try:
            name, baud = identify(lambda baud: SerialPort(where, baud), dialect)
        except BoardError:
            continue
        return name, dialect, baud
    raise BoardError(f"Nothing that this program knows answers on {find_port(where)}.")
