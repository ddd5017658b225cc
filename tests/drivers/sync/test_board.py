"""Boards over real pseudo-terminals, with instruments that are late, cut short, wrong, silent, or gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.boards import DIALECTS, dialect_of, identify, serial_board
from slopegate.drivers.sync.dialect import BoardError, Pulse, ReplyError
from slopegate.drivers.sync.serial_port import PortError, SerialPort
from sync_instruments import KINDS, Instrument

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are of Unix")

SUPPORT = Path(__file__).resolve().parents[2] / "support" / "sync_instruments.py"
SETTING = ("pulse", "dg645", "t560")
REPLY_S = 0.15
"""Of boards whose instrument does not answer in time; others are given the time that a busy machine takes."""
PATIENCE_S = 60.0

MakeBoard = Callable[..., Board]
MakeInstrument = Callable[[str], Instrument]


@pytest.fixture
def plug_in(tmp_path: Path) -> Iterator[MakeInstrument]:
    made: list[Instrument] = []

    def make(key: str) -> Instrument:
        made.append(KINDS[key](tmp_path / "port"))
        made[-1].gap_s = 0.0
        return made[-1]

    yield make
    for instrument in made:
        instrument.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "slopegate-board"]


@pytest.fixture
def connect(tmp_path: Path, plug_in: MakeInstrument) -> Iterator[MakeBoard]:
    made: list[Board] = []

    def make(key: str, pause_s: float = 0.002, **options: object) -> Board:
        dialect = replace(dialect_of(key), pause_s=pause_s)
        settings: dict[str, object] = {"reply_timeout_s": 20.0, "poll_s": 0.1, "retry_s": (0.02, 0.05), **options}
        path = str(tmp_path / "port")
        board = Board(lambda: SerialPort(path, dialect.bauds[0]), dialect, **settings)  # type: ignore[arg-type]
        made.append(board)
        board.start()
        return board

    yield make
    for board in made:
        board.close()


def until(true: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
    end_s = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end_s, "it did not happen"
        time.sleep(0.005)


def apply(board: Board, pulse: Pulse) -> Pulse:
    """With the time that a busy machine takes."""
    return board.apply(pulse, PATIENCE_S)


@pytest.mark.parametrize("key", SETTING)
def test_a_pulse_is_applied_when_it_was_read_back(key: str, plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in(key)
    instrument.gap_s = type(instrument).gap_s
    board = connect(key, pause_s=dialect_of(key).pause_s)
    assert board.wait_ready(PATIENCE_S)
    assert board.status.asked is None
    applied = apply(board, Pulse(13_200.0, 120.0, inverted=True))
    assert (applied.delay_us, applied.width_us) == (pytest.approx(13_200.0), pytest.approx(120.0))
    assert instrument.pulse() == (pytest.approx(13_200.0), pytest.approx(120.0), True, True)  # type: ignore[attr-defined]
    assert board.status.sentence == ""
    assert board.status.agreed_s is not None
    assert instrument.violations == []


def test_the_authors_board_answers_and_sets_no_delay(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("authors")
    board = connect("authors")
    assert board.wait_ready(PATIENCE_S)
    with pytest.raises(ValueError, match="no pulse"):
        board.submit(Pulse(1.0))
    assert instrument.violations == []


@pytest.mark.parametrize("fault", ["silent", "late", "truncated", "garbage", "wrong", "flood", "gone"])
@pytest.mark.parametrize("key", SETTING)
def test_every_fault_ends_in_a_sentence_and_then_in_the_right_pulse(
    key: str, fault: str, plug_in: MakeInstrument, connect: MakeBoard
) -> None:
    instrument = plug_in(key)
    board = connect(key, reply_timeout_s=REPLY_S, poll_s=60.0)
    apply(board, Pulse(100.0))
    before, identity = board.status.errors, board.status.identity
    sentences: set[str] = set()
    for delay_us in (200.0, 300.0) if fault in ("late", "wrong", "gone") else (200.0,):
        instrument.misbehave(fault, late_s=REPLY_S + 0.4)
        board.submit(Pulse(delay_us))
        if fault == "gone":
            until(lambda: board.status.state == "lost")
            assert board.status.applied is None
            instrument.plug()
        until(lambda: instrument.faults_left <= 0)
        until(lambda: sentences.add(board.status.sentence) or board.status.agreed_s)
        applied = board.status.applied
        assert applied is not None
        assert applied.delay_us == pytest.approx(delay_us)
        assert instrument.pulse()[0] == pytest.approx(delay_us)  # type: ignore[attr-defined]
    assert board.status.errors > before
    assert (board.status.sentence, board.status.identity) == ("", identity)
    assert all("\n" not in sentence and len(sentence) < 250 for sentence in sentences)


def test_a_value_is_not_taken_for_set_while_nobody_answers(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("dg645")
    board = connect("dg645", reply_timeout_s=REPLY_S)
    apply(board, Pulse(100.0))
    instrument.misbehave("silent", times=10**6)
    with pytest.raises(BoardError, match="not confirmed"):
        board.apply(Pulse(200.0), timeout_s=0.8)
    assert board.status.applied is None
    assert board.status.agreed_s is None
    until(lambda: "No reply to" in board.status.sentence)
    instrument.misbehave("", 0)
    until(lambda: board.status.agreed_s is not None)
    assert instrument.pulse()[0] == pytest.approx(200.0)  # type: ignore[attr-defined]


def test_an_instrument_that_keeps_another_value_is_found_out(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    """It says ok and does not do it."""
    instrument = plug_in("pulse")
    board = connect("pulse")
    apply(board, Pulse(100.0))
    answer = instrument.received
    instrument.received = lambda line: "ok" if ":DELAY " in line else answer(line)  # type: ignore[method-assign]
    with pytest.raises(BoardError, match=r"delay_us 100\.0; asked was delay_us 250\.0"):
        apply(board, Pulse(250.0))
    status = board.status
    assert status.state == "ready"
    assert status.agreed_s is None
    assert status.applied is not None
    assert status.applied.delay_us == pytest.approx(100.0)


def test_after_a_refusal_the_board_says_what_the_instrument_still_has(
    plug_in: MakeInstrument, connect: MakeBoard
) -> None:
    instrument = plug_in("pulse")
    board = connect("pulse", poll_s=60.0)
    apply(board, Pulse(100.0))
    answer = instrument.received
    instrument.received = lambda line: "?8" if ":DELAY " in line else answer(line)  # type: ignore[method-assign]
    with pytest.raises(BoardError, match=r"refused ':PULSE1:DELAY 0\.000250000' with \?8"):
        apply(board, Pulse(250.0))
    status = board.status
    assert (status.state, status.agreed_s) == ("ready", None)
    assert status.applied is not None
    assert status.applied.delay_us == pytest.approx(100.0)


def test_a_board_of_ones_own_needs_the_least_only(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("own")
    board = connect("pulse")
    applied = apply(board, Pulse(700.0))
    assert instrument.pulse() == (pytest.approx(700.0), pytest.approx(100.0), False, True)  # type: ignore[attr-defined]
    assert applied.delay_us == pytest.approx(700.0)
    assert set(board.status.settable) == {"delay_us", "width_us", "enabled", "external"}
    with pytest.raises(BoardError, match="cannot be told inverted, trigger_level_v"):
        apply(board, Pulse(700.0, inverted=True, trigger_level_v=2.5))


def test_a_knob_turned_at_the_instrument_is_noticed(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("dg645")
    board = connect("dg645", poll_s=0.01)
    apply(board, Pulse(100.0))
    instrument.delays[2] = (0, 555e-6)  # type: ignore[attr-defined]
    until(lambda: "delay_us 555" in board.status.sentence)
    assert board.status.agreed_s is None
    instrument.delays[2] = (3, 1e-6)  # type: ignore[attr-defined]
    until(lambda: "delay_us unknown" in board.status.sentence)
    assert board.status.applied is None
    apply(board, Pulse(100.0))
    assert instrument.pulse()[0] == pytest.approx(100.0)  # type: ignore[attr-defined]
    assert board.status.sentence == ""


def test_an_instrument_that_was_off_gets_its_pulse_back(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("t560")
    board = connect("t560")
    apply(board, Pulse(4321.0))
    instrument.unplug()
    until(lambda: board.status.state == "lost")
    assert "no port" in board.status.sentence or "has gone" in board.status.sentence
    for letter in "ABCD":
        instrument.installed[letter]["D"] = 0.0  # type: ignore[attr-defined]
    instrument.plug()
    until(lambda: board.status.agreed_s is not None)
    assert instrument.pulse()[0] == pytest.approx(4321.0)  # type: ignore[attr-defined]
    assert board.status.connections == 2


def test_the_wrong_instrument_is_named(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    plug_in("pulse")
    board = connect("dg645", reply_timeout_s=REPLY_S)
    until(lambda: "QC,9530" in board.status.sentence)
    assert board.status.state == "lost"


def test_a_busy_port_and_a_port_that_is_none(plug_in: MakeInstrument, tmp_path: Path) -> None:
    plug_in("pulse")
    path = str(tmp_path / "port")
    first = SerialPort(path, 9600)
    with pytest.raises(PortError, match="busy"):
        SerialPort(path, 9600)
    first.close()
    SerialPort(path, 9600).close()
    with pytest.raises(PortError, match=r"no port .*nothing"):
        SerialPort(str(tmp_path / "nothing"), 9600)
    (tmp_path / "file").touch()
    with pytest.raises(PortError, match="not a serial port"):
        SerialPort(str(tmp_path / "file"), 9600)
    with pytest.raises(PortError, match="usb:0403:6001:NONE is not plugged in"):
        SerialPort("usb:0403:6001:NONE", 9600)


def test_a_busy_port_is_taken_when_it_is_free_again(
    plug_in: MakeInstrument, connect: MakeBoard, tmp_path: Path
) -> None:
    plug_in("dg645")
    other = SerialPort(str(tmp_path / "port"), 9600)
    board = connect("dg645")
    until(lambda: "busy" in board.status.sentence)
    other.close()
    assert board.wait_ready(PATIENCE_S)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may open everything")
def test_a_port_without_permission_says_which_group(plug_in: MakeInstrument, tmp_path: Path) -> None:
    plug_in("pulse")
    (tmp_path / "port").chmod(0)
    with pytest.raises(PortError, match="sudo usermod -aG"):
        SerialPort(str(tmp_path / "port"), 9600)


def test_the_latest_wish_wins(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("pulse")
    board = connect("pulse")
    apply(board, Pulse(100.0))
    started_s = time.monotonic()
    with instrument._lock:  # it does not answer
        for delay_us in range(200, 1200):
            board.submit(Pulse(float(delay_us)))
    assert time.monotonic() - started_s < 15.0  # a thousand wishes wait for no instrument
    until(lambda: board.status.agreed_s is not None)
    assert instrument.pulse()[0] == pytest.approx(1199.0)  # type: ignore[attr-defined]
    assert len(instrument.lines) < 100


@pytest.mark.parametrize("key", ["pulse", "dg645", "t560", "authors"])
def test_who_is_there_is_found_by_asking(key: str, plug_in: MakeInstrument, tmp_path: Path) -> None:
    instrument = plug_in(key)
    for dialect in DIALECTS:
        if dialect.key == key:
            name, baud = identify(lambda baud: SerialPort(str(tmp_path / "port"), baud), dialect, 20.0)
            assert name
            assert baud == dialect.bauds[0]
        elif dialect.key == "authors" or key == "authors":
            continue  # single characters and lines are noise to each other
        else:
            with pytest.raises(BoardError):
                identify(lambda baud: SerialPort(str(tmp_path / "port"), baud), dialect, 0.05)
    if key == "authors":
        assert (instrument.power_presses, instrument.mode_presses) == (0, 0)  # type: ignore[attr-defined]


def test_asking_as_another_instrument_presses_no_button(plug_in: MakeInstrument, tmp_path: Path) -> None:
    """The authors' board takes any character for a command, so greetings of other kinds must not hold its letters."""
    instrument = plug_in("authors")
    for key in SETTING:
        with pytest.raises(ReplyError):
            identify(lambda baud: SerialPort(str(tmp_path / "port"), baud), dialect_of(key), 0.02)
    assert (instrument.power_presses, instrument.mode_presses) == (0, 0)  # type: ignore[attr-defined]


def test_a_board_closes_at_once_whatever_it_waits_for(plug_in: MakeInstrument, connect: MakeBoard) -> None:
    instrument = plug_in("pulse")
    board = connect("pulse", reply_timeout_s=0.5)
    assert board.wait_ready(PATIENCE_S)
    instrument.misbehave("silent", times=10**6)
    board.submit(Pulse(1.0))
    started_s = time.monotonic()
    board.close()
    assert time.monotonic() - started_s < 4.5, "sooner than it would have left the thread behind"
    assert board.status.state == "closed"
    assert board.status.applied is None


def test_an_output_that_is_not_there() -> None:
    with pytest.raises(ValueError, match="outputs 1 to 4"):
        serial_board("nowhere", dialect_of("dg645"), output=5)


def start_instrument(key: str, port: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, str(SUPPORT), key, str(port)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "plugged\n"
    return process


@pytest.mark.parametrize("key", SETTING)
def test_ten_kills(key: str, tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    """The instrument's process is killed ten times in the middle of changes; the pulse comes back by itself."""
    port = tmp_path / "port"
    dialect = replace(dialect_of(key), pause_s=0.002)
    process = start_instrument(key, port)
    board = Board(lambda: SerialPort(str(port), dialect.bauds[0]), dialect, reply_timeout_s=5.0, retry_s=(0.02, 0.05))
    board.start()
    lost_s, back_s = [], []
    try:
        apply(board, Pulse(1000.0))
        for kill in range(10):
            board.submit(Pulse(2000.0 + kill))
            time.sleep(0.013 * kill)  # in another place of the conversation every time
            process.send_signal(signal.SIGKILL)
            process.wait()
            killed_s = time.monotonic()
            until(lambda: board.status.state == "lost")
            lost_s.append(time.monotonic() - killed_s)
            assert board.status.applied is None
            assert board.status.sentence
            process.communicate()
            process = start_instrument(key, port)
            plugged_s = time.monotonic()
            until(lambda: board.status.agreed_s is not None)
            back_s.append(time.monotonic() - plugged_s)
            applied = board.status.applied
            assert applied is not None
            assert applied.delay_us == pytest.approx(2000.0 + kill)
        assert board.status.connections >= 11
    finally:
        board.close()
        process.kill()
        process.communicate()
    record_property("noticed_s", max(lost_s))
    record_property("back_s", max(back_s))
    print(f"{key}: noticed within {max(lost_s):.3f} s, back within {max(back_s):.3f} s of being plugged in")
