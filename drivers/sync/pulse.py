"""The `:PULSEn:` dialect: Quantum Composers 9200 to 9530, BNC 525, 575 and 577, and any board that speaks it.

Lines end in CR LF; a setting is answered by `ok` or `?n`, a query by its value; times are in seconds. Channel 0 is the
instrument as a whole (Quantum Composers 9530 series manual, version 4.8, section on SCPI commands).
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
    word,
)

_REFUSALS: Final = {
    1: "incorrect prefix",
    2: "missing keyword",
    3: "invalid keyword",
    4: "missing parameter",
    5: "invalid parameter",
    6: "query only",
    7: "no such query",
    8: "not available in its present state",
}
_FLAG: Final = {"1": True, "0": False, "ON": True, "OFF": False}
_INVERTED: Final = {"NORM": False, "INV": True, "COMP": True}
_RISING: Final = {"RIS": True, "POS": True, "FALL": False, "NEG": False}


def _refused(reply: str, text: str) -> None:
    match = re.fullmatch(r"\?(\d+)", reply.strip())
    if match:
        code = int(match[1])
        why = _REFUSALS.get(code, "unknown reason")
        raise RefusedError(f"The instrument refused '{text}' with ?{code} ({why}).")


def _set(text: str) -> Line:
    def accept(reply: str) -> None:
        _refused(reply, text)
        if reply.strip().lower() != "ok":
            raise ReplyError(f"The instrument answered {reply!r} to '{text}': ok was expected.")

    return Line(text, accept)


def _time(output: int, key: str, field: str) -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        _refused(replies[0], key)
        return {field: microseconds(replies[0], key)}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        # fixed point: some models misread times with many significant digits
        return (_set(f":PULSE{output}:{key} {getattr(pulse, field) * 1e-6:.9f}"),)

    return Item((field,), write, (f":PULSE{output}:{key}?",), decode)


def _polarity(output: int) -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        _refused(replies[0], "POL")
        return {"inverted": word(replies[0], "polarity", _INVERTED)}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return (_set(f":PULSE{output}:POL {'INV' if pulse.inverted else 'NORM'}"),)

    return Item(("inverted",), write, (f":PULSE{output}:POL?",), decode)


def _running(output: int, whole: str) -> Item:
    """An output is on when both its own switch and that of the whole instrument are."""

    def decode(replies: tuple[str, ...]) -> Values:
        for reply in replies:
            _refused(reply, "STATE")
        return {"enabled": all(word(reply, "state", _FLAG) for reply in replies)}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        if not pulse.enabled:
            return (_set(f":PULSE{output}:STATE OFF"),)
        return _set(f":PULSE{output}:STATE ON"), _set(f"{whole}:STATE ON")

    return Item(("enabled",), write, (f":PULSE{output}:STATE?", f"{whole}:STATE?"), decode)


def _source(output: int, edge: str = "") -> Item:
    """Delays count from T0, which the trigger input starts; `edge`: what this model calls the input's slope."""

    def decode(replies: tuple[str, ...]) -> Values:
        for reply in replies:
            _refused(reply, "TRIG")
        from_trigger = replies[0].strip().upper().startswith("TRIG") and replies[1].strip().upper() == "T0"
        known: Values = {"external": from_trigger}
        if edge:
            known["trigger_rising"] = word(replies[2], "trigger edge", _RISING)
        return known

    def write(pulse: Pulse) -> tuple[Line, ...]:
        texts = [":PULSE0:TRIG:MODE TRIG", f":PULSE{output}:SYNC T0"]
        if edge:
            texts.append(f":PULSE0:TRIG:{edge} {'RIS' if pulse.trigger_rising else 'FALL'}")
        return tuple(_set(text) for text in texts)

    names, queries = ("external",), (":PULSE0:TRIG:MODE?", f":PULSE{output}:SYNC?")
    if edge:
        return Item((*names, "trigger_rising"), write, (*queries, f":PULSE0:TRIG:{edge}?"), decode)
    return Item(names, write, queries, decode)


def _level() -> Item:
    def decode(replies: tuple[str, ...]) -> Values:
        _refused(replies[0], "TRIG:LEV")
        return {"trigger_level_v": number(replies[0], "trigger level")}

    def write(pulse: Pulse) -> tuple[Line, ...]:
        return (_set(f":PULSE0:TRIG:LEV {pulse.trigger_level_v:.2f}"),)

    return Item(("trigger_level_v",), write, (":PULSE0:TRIG:LEV?",), decode)


def _items(output: int) -> tuple[tuple[Item, ...], ...]:
    return (
        (_level(),),
        (_source(output, "EDGE"), _source(output, "LOG"), _source(output)),
        (_polarity(output),),
        (_time(output, "WIDTH", "width_us"),),
        (_time(output, "DELAY", "delay_us"),),
        (_running(output, ":PULSE0"), _running(output, ":SPULSE")),
    )


def _identity(reply: str) -> str:
    words = [part.strip() for part in reply.split(",")]
    if len(words) < 2 or not all(words[:2]) or "DG645" in words:
        raise ReplyError(f"{reply!r} is not the name of an instrument that speaks :PULSEn:.")
    return " ".join(words[:2])


PULSE: Final = Dialect(
    key="pulse",
    title="Quantum Composers, BNC and others (:PULSEn:)",
    bauds=(115200, 38400, 57600, 19200, 9600),
    hello="*IDN?",
    identity=_identity,
    items=_items,
    outputs=8,
    limits=PulseLimits(Steps(0.0, 999e6, 0.01), Steps(0.01, 999e6, 0.01), Steps(0.2, 15.0, 0.01)),
    pause_s=0.05,
)
