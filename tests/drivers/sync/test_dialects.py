"""Dialects against strict instruments without a wire: what is said is understood, what is answered is checked."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from slopegate.drivers.sync.boards import DIALECTS, dialect_of
from slopegate.drivers.sync.dialect import BoardError, Dialect, Pulse, RefusedError, ReplyError, code, differing, number
from slopegate.drivers.sync.talk import Conversation
from sync_instruments import KINDS, EdgelessPulseInstrument, Instrument, OlderPulseInstrument, PulseInstrument

SETTING = [dialect for dialect in DIALECTS if dialect.limits is not None]


class Wire:
    """A port straight into an instrument's ear."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument, self._waiting = instrument, b""

    def write(self, data: bytes) -> None:
        for line in self._instrument.frames(data):
            answer = self._instrument.received(line)
            if answer is not None:
                self._waiting += (answer + self._instrument.reply_ending).encode()

    def read(self, timeout_s: float) -> bytes:
        data, self._waiting = self._waiting, b""
        return data

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ports")


@pytest.fixture(scope="module")
def instruments(folder: Path) -> Iterator[dict[str, Instrument]]:
    made = {key: kind(folder / key) for key, kind in KINDS.items() if key != "own"}
    for instrument in made.values():
        instrument.sleep = lambda seconds: None  # type: ignore[method-assign,assignment]
    yield made
    for instrument in made.values():
        instrument.close()


def talk_to(instrument: Instrument, dialect: Dialect, output: int = 1) -> Conversation:
    return Conversation(Wire(instrument), dialect, output, 0.2, sleep=lambda seconds: None)


@pytest.mark.parametrize("dialect", SETTING, ids=lambda dialect: dialect.key)
def test_any_pulse_arrives_and_is_read_back(dialect: Dialect, instruments: dict[str, Instrument]) -> None:
    limits = dialect.limits
    assert limits is not None
    instrument = instruments[dialect.key]
    talk = talk_to(instrument, dialect)
    talk.greet()
    state = {"known": talk.read_all()}

    @given(
        st.builds(
            Pulse,
            st.floats(0.0, min(limits.delay_us.max, 10e6)),
            st.floats(limits.width_us.min, 5e6),
            st.booleans(),
            st.booleans(),
            st.just(True),
            st.booleans(),
            st.floats(max(limits.trigger_level_v.min, 0.3), limits.trigger_level_v.max),
        )
    )
    def check(pulse: Pulse) -> None:
        asked = limits.round(pulse)
        state["known"] = known = talk.write(asked, state["known"])
        assert differing(asked, known, talk.settable) == ()
        delay, width, inverted, on = instrument.pulse()  # type: ignore[attr-defined]
        assert delay == pytest.approx(asked.delay_us, abs=0.011)
        assert width == pytest.approx(asked.width_us, abs=0.011)
        assert (inverted, on) == (asked.inverted, asked.enabled)
        assert talk.read_all() == known

    check()
    assert instrument.violations == []


@pytest.mark.parametrize("dialect", SETTING, ids=lambda dialect: dialect.key)
def test_outputs_are_told_apart(dialect: Dialect, instruments: dict[str, Instrument]) -> None:
    for output in range(1, dialect.outputs + 1):
        talk = talk_to(instruments[dialect.key], dialect, output)
        talk.greet()
        talk.write(Pulse(1000.0 * output, 10.0 * output), talk.read_all())
    for output in range(1, dialect.outputs + 1):
        talk = talk_to(instruments[dialect.key], dialect, output)
        known = talk.read_all()
        assert known["delay_us"] == pytest.approx(1000.0 * output)
        assert known["width_us"] == pytest.approx(10.0 * output)


@pytest.mark.parametrize("dialect", SETTING, ids=lambda dialect: dialect.key)
def test_edges_and_sources_are_the_manuals(dialect: Dialect, instruments: dict[str, Instrument]) -> None:
    instrument = instruments[dialect.key]
    talk = talk_to(instrument, dialect)
    talk.greet()
    attribute, rising, falling = {
        "pulse": ("edge", "RIS", "FALL"),
        "dg645": ("source", 1, 2),
        "t560": ("trigger", "POS", "NEG"),
    }[dialect.key]
    for edge in (True, False):
        known = talk.write(Pulse(1.0, trigger_rising=edge), talk.read_all())
        assert getattr(instrument, attribute) == (rising if edge else falling)
        assert known["external"] is True
    with pytest.raises(ValueError, match="external is False"):
        dialect.limits.round(Pulse(1.0, external=False))  # type: ignore[union-attr]


@pytest.mark.parametrize("key", ["pulse", "dg645", "t560"])
def test_an_instrument_with_a_clock_of_its_own_is_told_from_a_triggered_one(
    key: str, instruments: dict[str, Instrument]
) -> None:
    instrument = instruments[key]
    for name, free in (("mode", "DIS"), ("source", 0), ("trigger", "SYN")):
        if hasattr(instrument, name):
            setattr(instrument, name, free)
    talk = talk_to(instrument, dialect_of(key))
    known = talk.read_all()
    assert known["external"] is False
    assert "external" in differing(Pulse(1.0), known, talk.settable)
    assert talk.write(Pulse(1.0), known)["external"] is True


def test_what_cannot_be_read_after_a_change_is_not_known(instruments: dict[str, Instrument]) -> None:
    """A DG645 whose channel A stays linked to another one has no delay from the trigger, least of all the old one."""
    instrument = instruments["dg645"]
    talk = talk_to(instrument, dialect_of("dg645"))
    talk.greet()
    known = talk.write(Pulse(100.0), talk.read_all())
    answer = instrument.received
    instrument.received = lambda line: "5,+0.001" if line == "DLAY?2" else answer(line)  # type: ignore[method-assign]
    known = talk.write(Pulse(200.0), known)
    del instrument.received  # type: ignore[method-assign]
    assert "delay_us" not in known
    assert differing(Pulse(200.0), known, talk.settable) == ("delay_us",)


def test_only_what_differs_is_sent(instruments: dict[str, Instrument]) -> None:
    instrument = instruments["pulse"]
    talk = talk_to(instrument, dialect_of("pulse"))
    talk.greet()
    known = talk.write(Pulse(1000.0), talk.read_all())
    heard: list[str] = []
    answer = instrument.received
    instrument.received = lambda line: (heard.append(line), answer(line))[1]  # type: ignore[method-assign,func-returns-value]
    talk.write(Pulse(2000.0), known)
    del instrument.received  # type: ignore[method-assign]
    assert heard == [":PULSE1:DELAY 0.002000000", ":PULSE1:DELAY?"]


@pytest.mark.parametrize("kind", [OlderPulseInstrument, EdgelessPulseInstrument])
def test_models_that_spell_it_otherwise(kind: type[PulseInstrument], folder: Path) -> None:
    instrument = kind(folder / kind.__name__)
    talk = talk_to(instrument, dialect_of("pulse"))
    talk.greet()
    known = talk.read_all()
    edgeless = kind is EdgelessPulseInstrument
    assert ("trigger_rising" in talk.settable) is not edgeless
    known = talk.write(Pulse(500.0, trigger_rising=edgeless), known)
    instrument.close()
    assert differing(Pulse(500.0, trigger_rising=edgeless), known, talk.settable) == ()
    assert instrument.pulse() == (pytest.approx(500.0), pytest.approx(100.0), False, True)


def test_what_the_instrument_refuses_is_said(instruments: dict[str, Instrument]) -> None:
    wide = Pulse(5e10)
    for key, words in (("pulse", "?5 (invalid parameter)"), ("dg645", "error 12 (illegal delay)"), ("t560", "'AD ")):
        talk = talk_to(instruments[key], dialect_of(key))
        talk.greet()
        with pytest.raises(RefusedError, match="refused") as refused:
            talk.write(wide, talk.read_all())
        assert words in str(refused.value)


def test_a_refusing_t560_keeps_its_old_delay_and_says_that_it_is_off(instruments: dict[str, Instrument]) -> None:
    talk = talk_to(instruments["t560"], dialect_of("t560"))
    known = talk.write(Pulse(700.0), talk.read_all())
    with pytest.raises(RefusedError):
        talk.write(Pulse(5e10), dict(known))
    known = talk.read_all()
    assert known["delay_us"] == pytest.approx(700.0)
    assert known["external"] is False  # the line that would have armed the trigger again was not reached
    known = talk.write(Pulse(800.0), known)
    assert instruments["t560"].pulse()[0::3] == (pytest.approx(800.0), True)  # type: ignore[attr-defined]
    assert instruments["t560"].changed_with_trigger_on == 0  # type: ignore[attr-defined]


def agrees(reply: str) -> bool:
    """Whether an instrument may say this when it has done as it was told: OK, or that the last error was none."""
    if re.fullmatch(r"(?i)ok(;ok)*", reply.strip()):
        return True
    try:
        return float(reply) == 0
    except ValueError:
        return False


@given(st.text(max_size=60))
@example("DG645")
@example("OK;OK")
@example("1e-999")
def test_no_reply_is_misread(reply: str) -> None:
    """Whatever comes back is a value in range, or a sentence."""
    for dialect in DIALECTS:
        for item in (item for slot in dialect.items(1) for item in slot):
            try:
                told = item.decode((reply,) * len(item.queries))
            except BoardError:
                told = {}
            assert set(told) <= set(item.fields)
            assert all(math.isfinite(value) for value in told.values())
            for line in item.write(Pulse(1.0)):
                if line.accept is not None and not agrees(reply):
                    with pytest.raises(BoardError):
                        line.accept(reply)
        with contextlib.suppress(ReplyError):
            assert dialect.identity(reply)


@pytest.mark.parametrize("reply", ["", "nan", "inf", "1e999", "0x10", "1_0", "1,5", "٣", "--1", "1 2", "ok"])
def test_what_is_no_number(reply: str) -> None:
    with pytest.raises(ReplyError):
        number(reply, "delay")


@pytest.mark.parametrize("reply", ["1.5", "7", "-1", "x"])
def test_what_is_no_code(reply: str) -> None:
    with pytest.raises(ReplyError):
        code(reply, "source", range(7))


@pytest.mark.parametrize(
    ("key", "hello", "name"),
    [
        ("pulse", "QC,9530,12345,1.2", "QC 9530"),
        ("pulse", "BNC,575-4,31,2.4.1", "BNC 575-4"),
        ("dg645", "Stanford Research Systems,DG645,s/n001776,ver1.14.10E", "DG645 s/n001776"),
        ("t560", "Trig REM HIZ Level 1.250 Div 0000000000 SYN 00010000.00", "Highland T560"),
        ("authors", "y", "Authors' sync board"),
    ],
)
def test_who_answers(key: str, hello: str, name: str) -> None:
    for dialect in DIALECTS:
        if dialect.key == key:
            assert dialect.identity(hello) == name
        else:
            with pytest.raises(ReplyError):
                dialect.identity(hello)


@pytest.mark.parametrize(
    ("field", "value"), [("delay_us", -1.0), ("delay_us", math.nan), ("width_us", 0.0), ("trigger_level_v", 99.0)]
)
@pytest.mark.parametrize("dialect", SETTING, ids=lambda dialect: dialect.key)
def test_impossible_pulses_are_refused_before_the_wire(dialect: Dialect, field: str, value: float) -> None:
    assert dialect.limits is not None
    with pytest.raises(ValueError, match=field):
        dialect.limits.round(Pulse(**{"delay_us": 10.0, field: value}))


def test_an_unknown_dialect_is_named() -> None:
    with pytest.raises(ValueError, match=r"'morse'.*pulse, dg645, t560, authors"):
        dialect_of("morse")
