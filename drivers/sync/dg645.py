"""The Stanford Research DG645: settings are not answered, so each is followed by a look into the error queue.

Output AB is high from A to B. `DLAY 2,0,t` puts A at T0 + t, `DLAY 3,2,w` puts B at A + w; channels are T0 0, T1 1,
A 2 .. H 9, outputs T0 0, AB 1 .. GH 4 (DG645 manual, remote programming).
"""

from __future__ import annotations

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
    code,
    microseconds,
    number,
)

_REFUSALS: Final = {
    10: "illegal value",
    11: "illegal mode",
    12: "illegal delay",
    13: "illegal link",
    110: "illegal command",
    111: "undefined command",
    112: "illegal query",
    113: "illegal set",
    114: "null parameter",
    115: "extra parameters",
    116: "missing parameters",
}

# External rising, external falling; the single-shot variants wait for a command that never comes.
_SOURCES: Final = {1: (True, True), 2: (True, False), 3: (False, True), 4: (False, False)}


def _set(*texts: str) -> tuple[Line, ...]:
    def accept(reply: str) -> None:
        error = code(reply, "the last error")
        if error:
            why = _REFUSALS.get(error, "see its manual")
            raise RefusedError(f"The DG645 refused '{'; '.join(texts)}' with error {error} ({why}).")

    return (*(Line(text, None) for text in texts), Line("LERR?", accept))


def _time(channel: int, start: int, field: str) -> Item:
    """The edge of one channel, counted from another."""

    def decode(replies: tuple[str, ...]) -> Values:
        link, comma, seconds = replies[0].partition(",")
        if not comma:
            raise ReplyError(f"The DG645 answered {replies[0]!r} to DLAY?{channel}: channel and time were expected.")
        value_us = microseconds(seconds, f"DLAY?{channel}")
        return {field: value_us} if code(link, f"DLAY?{channel}", range(10)) == start else {}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return _set(f"DLAY {channel},{start},{getattr(pulse, field) * 1e-6:.12f}")

    return Item((field,), write, (f"DLAY?{channel}",), decode)


def _polarity(output: int) -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        return {"inverted": code(replies[0], "polarity", (0, 1)) == 0}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return _set(f"LPOL {output},{0 if pulse.inverted else 1}")

    return Item(("inverted",), write, (f"LPOL?{output}",), decode)


def _source() -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        source = _SOURCES.get(code(replies[0], "trigger source", range(7)))
        if source is None:
            return {"external": False}
        return {"enabled": source[0], "external": True, "trigger_rising": source[1]}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        codes = {source: key for key, source in _SOURCES.items()}
        return _set(f"TSRC {codes[pulse.enabled, pulse.trigger_rising]}")

    return Item(("enabled", "external", "trigger_rising"), write, ("TSRC?",), decode)


def _level() -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        return {"trigger_level_v": number(replies[0], "trigger level")}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return _set(f"TLVL {pulse.trigger_level_v:.2f}")

    return Item(("trigger_level_v",), write, ("TLVL?",), decode)


def _items(output: int) -> tuple[tuple[Item, ...], ...]:
    first = 2 * output
    items = (
        _level(),
        _polarity(output),
        _time(first, 0, "delay_us"),
        _time(first + 1, first, "width_us"),
        _source(),
    )
    return tuple((item,) for item in items)


def _identity(reply: str) -> str:
    words = [part.strip() for part in reply.split(",")]
    if words[1:2] != ["DG645"]:
        raise ReplyError(f"{reply!r} is not the name of a DG645.")
    return " ".join(words[1:3])


DG645: Final = Dialect(
    key="dg645",
    title="Stanford Research DG645",
    bauds=(9600, 19200, 38400, 57600, 115200),
    hello="*IDN?",
    identity=_identity,
    items=_items,
    outputs=4,
    limits=PulseLimits(Steps(0.0, 2000e6, 0.001), Steps(0.001, 2000e6, 0.001), Steps(-3.5, 3.5, 0.01)),
    prologue=(Line("*CLS", None),),
)
