"""Every kind of sync board and delay generator: which there are, who answers on a port, and the board as chosen.

A new kind is a dialect in a file of its own and an entry in `DIALECTS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pydantic import BaseModel, ConfigDict, Field, field_validator

from slopegate.core.rig.checks import InputError
from slopegate.drivers.sync.authors import AUTHORS
from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.dg645 import DG645
from slopegate.drivers.sync.dialect import BoardError, Dialect, Pulse, StrangerError
from slopegate.drivers.sync.pulse import PULSE
from slopegate.drivers.sync.serial_port import Port, SerialPort, find_port
from slopegate.drivers.sync.t560 import T560
from slopegate.drivers.sync.talk import Conversation

DIALECTS: Final[tuple[Dialect, ...]] = (PULSE, DG645, T560, AUTHORS)


def dialect_of(key: str) -> Dialect:
    """A dialect by its key. Raises InputError for an unknown one."""
    for dialect in DIALECTS:
        if dialect.key == key:
            return dialect
    raise InputError(f"dialect is {key!r}: it must be one of {', '.join(known.key for known in DIALECTS)}")


def serial_board(where: str, dialect: Dialect, baud: int | None = None, output: int = 1) -> Board:
    """A board on a serial port, by path or `PortFacts.usb_key`; call `start` to connect."""
    rate = baud or dialect.bauds[0]
    return Board(lambda: SerialPort(where, rate), dialect, output)


def identify(open_port: Callable[[int], Port], dialect: Dialect, reply_timeout_s: float = 0.5) -> tuple[str, int]:
    """Name of the instrument that answers in this dialect, and its baud rate. Raises PortError or BoardError."""
    problem: BoardError | None = None
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
    assert problem is not None, f"{dialect.title} has no baud rate"
    raise problem


def who_answers(where: str) -> tuple[str, Dialect, int]:
    """Name, dialect and baud rate of the instrument at a port, found by asking in every dialect. Changes nothing.

    Raises PortError for a port that cannot be opened, BoardError when nobody answers.
    """
    for dialect in DIALECTS:
        try:
            name, baud = identify(lambda baud: SerialPort(where, baud), dialect)
        except BoardError:
            continue
        return name, dialect, baud
    raise BoardError(f"Nothing that this program knows answers on {find_port(where)}.")


class BoardChoice(BaseModel):
    """A sync board or delay generator, how to speak to it, and everything about its pulses but their delay."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    where: str
    dialect: str
    baud: int = Field(gt=0)
    output: int = Field(default=1, ge=1)
    width_us: float = Field(default=100.0, gt=0)
    inverted: bool = False
    trigger_rising: bool = True
    trigger_level_v: float = 1.5

    @field_validator("dialect")
    @classmethod
    def _known(cls, key: str) -> str:
        return dialect_of(key).key

    def pulse(self, delay_us: float = 0.0) -> Pulse:
        """The pulses to ask of the board, with this delay."""
        rising, level = self.trigger_rising, self.trigger_level_v
        return Pulse(delay_us, self.width_us, self.inverted, trigger_rising=rising, trigger_level_v=level)

    def check(self) -> None:
        """Raise InputError, naming the field, for pulses that this kind of board does not make."""
        limits = dialect_of(self.dialect).limits
        if limits is not None:
            limits.round(self.pulse())

    def board(self) -> Board:
        """The board; call `start` to connect. Raises InputError for an output that it has not."""
        return serial_board(self.where, dialect_of(self.dialect), self.baud, self.output)
