"""The Highland T560 and T564: CR ends a line, `;` joins commands, each is answered by `OK`, `??` or what was asked.

Outputs A to D are changed with the trigger off and after what was under way has ended, because a change cuts a pulse
short (T560 manual, section 4.3). `AS` and `TR` tell everything: "Ch A  POS  ON  Dly  00.000,500  Wid  00.001,000" in
seconds, "Trig POS HIZ Level 1.250 Div 00 SYN 00010000.00".
"""

from __future__ import annotations

import re
from typing import Final

from slopegate.core.rig.settings import Steps
from slopegate.drivers.sync.dialect import (
    Dialect,
    Item,
    Line,
    Pulse,
    PulseLimits,
    RefusedError,
    ReplyError,
    Values,
    microseconds,
    number,
)

_UNDER_WAY_US: Final = 50_000
_CHANNEL: Final = re.compile(r"Ch\s+([A-D])\s+(POS|NEG)\s+(ON|OFF)\s+Dly\s+([\d.,]+)\s+Wid\s+([\d.,]+)\s*")
_TRIGGER: Final = re.compile(r"Trig\s+(\w+)\s+\w+\s+Level\s+([\d.,]+)\s+Div\s+[\d.,]+\s+SYN\s+[\d.,]+\s*")


def _joined(*commands: str) -> Line:
    text = ";".join(commands)

    def accept(reply: str) -> None:
        words = reply.strip().split(";")
        if words[-1] == "??" and words[:-1] == ["OK"] * (len(words) - 1) and len(words) <= len(commands):
            raise RefusedError(f"The T560 refused '{commands[len(words) - 1]}'.")
        if words != ["OK"] * len(commands):
            raise ReplyError(f"The T560 answered {reply!r} to '{text}': {len(commands)} times OK were expected.")

    return Line(text, accept)


def _source_word(pulse: Pulse) -> str:
    return "POS" if pulse.trigger_rising else "NEG"


def _plain(text: str) -> str:
    """Verbose mode groups digits with commas."""
    return text.replace(",", "")


def _channel(output: int) -> Item:
    letter = "ABCD"[output - 1]

    def decode(replies: tuple[str, ...]) -> Values:
        match = _CHANNEL.fullmatch(replies[0])
        if match is None or match[1] != letter:
            raise ReplyError(f"The T560 answered {replies[0]!r} when asked for channel {letter}.")
        return {
            "inverted": match[2] == "NEG",
            "enabled": match[3] == "ON",
            "delay_us": microseconds(_plain(match[4]), "delay"),
            "width_us": microseconds(_plain(match[5]), "width"),
        }

    def write(pulse: Pulse) -> tuple[Line, ...]:
        line = _joined(
            "TRIGGER OFF",
            f"WAIT {_UNDER_WAY_US}",
            f"{letter}D {pulse.delay_us:.4f}u",
            f"{letter}W {pulse.width_us:.4f}u",
            f"{letter}S {'NEG' if pulse.inverted else 'POS'}",
            f"{letter}S {'ON' if pulse.enabled else 'OFF'}",
            "INSTALL",
            f"TRIGGER {_source_word(pulse)}",
        )
        return (line,)

    return Item(("delay_us", "width_us", "inverted", "enabled"), write, (f"{letter}S",), decode)


def _trigger() -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        match = _TRIGGER.fullmatch(replies[0])
        if match is None:
            raise ReplyError(f"The T560 answered {replies[0]!r} when asked for its trigger.")
        known: Values = {"trigger_level_v": number(_plain(match[2]), "trigger level")}
        if match[1] not in ("POS", "NEG"):
            return known | {"external": False}
        return known | {"external": True, "trigger_rising": match[1] == "POS"}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return (_joined(f"TLEVEL {pulse.trigger_level_v:.3f}", f"TRIGGER {_source_word(pulse)}"),)

    return Item(("external", "trigger_rising", "trigger_level_v"), write, ("TR",), decode)


def _items(output: int) -> tuple[tuple[Item, ...], ...]:
    return (_trigger(),), (_channel(output),)


def _identity(reply: str) -> str:
    if _TRIGGER.fullmatch(reply) is None:
        raise ReplyError(f"{reply!r} is not what a T560 says of its trigger.")
    return "Highland T560"


T560: Final = Dialect(
    key="t560",
    title="Highland T560 or T564",
    bauds=(38400,),
    hello="TR",
    identity=_identity,
    items=_items,
    outputs=4,
    limits=PulseLimits(Steps(0.0, 10e6, 0.001), Steps(0.002, 10e6, 0.001), Steps(0.25, 3.3, 0.01)),
    ending=b"\r",
)
