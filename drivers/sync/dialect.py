"""Dialects: how a kind of sync board or delay generator is spoken to, as tables of lines and readers of replies.

Everything here is pure. A board waits for the projector's trigger and sends the camera one pulse, delayed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

from slopegate.core.rig.checks import UserError, require, require_finite
from slopegate.core.rig.settings import Steps

Values = dict[str, float | bool]
"""Fields of a `Pulse` by name, as far as they are known."""

_NUMBER: Final = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class BoardError(UserError):
    """A board failed; the message is one sentence for the user."""


class RefusedError(BoardError):
    """The instrument answered that it will not do this."""


class ReplyError(BoardError):
    """No reply, half a reply, or one that makes no sense, so that later replies may answer earlier questions."""


class StrangerError(ReplyError):
    """Somebody answered in whole lines, but not an instrument of this kind."""


@dataclass(frozen=True)
class Pulse:
    """What one output does after each trigger."""

    delay_us: float
    """Trigger to the start of the pulse."""
    width_us: float = 100.0
    inverted: bool = False
    """Low during the pulse."""
    enabled: bool = True
    external: bool = True
    """Started by the trigger input. An instrument may be found otherwise, but its own clock gates nothing."""
    trigger_rising: bool = True
    trigger_level_v: float = 1.5


PULSE_FIELDS: Final = tuple(field.name for field in fields(Pulse))


@dataclass(frozen=True)
class PulseLimits:
    """What an instrument accepts."""

    delay_us: Steps
    width_us: Steps
    trigger_level_v: Steps

    def round(self, pulse: Pulse) -> Pulse:
        """The pulse on the instrument's steps. Raises InputError, naming the field, outside its ranges."""
        require(pulse.external, "external", pulse.external, "True")
        rounded: dict[str, float] = {}
        for name in ("delay_us", "width_us", "trigger_level_v"):
            value, steps = getattr(pulse, name), getattr(self, name)
            require_finite(name, value)
            require(steps.min <= value <= steps.max, name, value, f"from {steps.min:g} to {steps.max:g}")
            rounded[name] = round(steps.nearest(value), 6)
        return replace(pulse, **rounded)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Line:
    """One line to send, and what looks at the line that answers it."""

    text: str
    accept: Callable[[str], None] | None
    """Raises RefusedError or ReplyError unless the reply is good; None: the instrument does not answer."""


@dataclass(frozen=True)
class Item:
    """One setting of an instrument (or several at once): the lines that write it and the queries that read it back."""

    fields: tuple[str, ...]
    write: Callable[[Pulse], tuple[Line, ...]]
    queries: tuple[str, ...]
    decode: Callable[[tuple[str, ...]], Values]
    """Replies to the queries -> the fields; fewer when the instrument is in a state that a Pulse cannot describe."""


@dataclass(frozen=True)
class Dialect:
    """How one kind of instrument is spoken to."""

    key: str
    title: str
    bauds: tuple[int, ...]
    """The usual one first."""
    hello: str
    identity: Callable[[str], str]
    """Reply to `hello` -> what to call the instrument; raises ReplyError when it is not one of this kind."""
    items: Callable[[int], tuple[tuple[Item, ...], ...]]
    """Output number (from 1) -> what it sets, each with alternatives, for models spell it differently."""
    outputs: int = 0
    """0: it passes the trigger on and sets no delay."""
    limits: PulseLimits | None = None
    ending: bytes = b"\r\n"
    reply_ending: bytes = b"\n"
    """Empty: replies are single characters."""
    pause_s: float = 0.0
    """Between one reply and the next line."""
    prologue: tuple[Line, ...] = ()
    """Sent after every greeting."""


TOLERANCE: Final = {"delay_us": 0.2, "width_us": 0.2, "trigger_level_v": 0.06}
"""Instruments round to clocks of their own: differences up to this are rounding, beyond it a fault."""


def differing(
    wanted: Pulse, known: Values, settable: Collection[str], tolerance: Mapping[str, float] = TOLERANCE
) -> tuple[str, ...]:
    """The settable fields that are not known to be as wanted."""
    return tuple(
        name
        for name in PULSE_FIELDS
        if name in settable
        and (name not in known or abs(known[name] - getattr(wanted, name)) > tolerance.get(name, 1e-6))
    )


def number(reply: str, what: str) -> float:
    """Read a plain decimal number; raises ReplyError for anything else."""
    text = reply.strip()
    value = float(text) if _NUMBER.fullmatch(text) else math.inf
    if not math.isfinite(value):
        raise ReplyError(f"The instrument answered {reply!r} when asked for {what}: a number was expected.")
    return value


def microseconds(seconds: str, what: str) -> float:
    """Read a time in seconds as microseconds, rounded to the picosecond, for finer digits are arithmetic."""
    return round(number(seconds, what) * 1e6, 6)


def code(reply: str, what: str, allowed: Collection[int] | None = None) -> int:
    """Read a whole number, one of those allowed; raises ReplyError for anything else."""
    value = number(reply, what)
    if not value.is_integer() or (allowed is not None and value not in allowed):
        raise ReplyError(f"The instrument answered {reply!r} when asked for {what}: a known code was expected.")
    return int(value)


def word(reply: str, what: str, meanings: Mapping[str, bool]) -> bool:
    """Read a word by its beginning, in either case; raises ReplyError for any other."""
    text = reply.strip().upper()
    for start, meaning in meanings.items():
        if text.startswith(start):
            return meaning
    known = ", ".join(meanings)
    raise ReplyError(f"The instrument answered {reply!r} when asked for {what}: one of {known} was expected.")
