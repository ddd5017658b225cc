"""A sync board as it is chosen: where it is, how it is spoken to, and what its pulses are like but for their delay."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, field_validator
from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.boards import dialect_of, serial_board
from slopegate.drivers.sync.dialect import Pulse


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
        """Its pulses, with this delay."""
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
