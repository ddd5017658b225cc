"""One delay, made by camera and board together: proved where both really act."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, PixelClocks, ShutterLimits, Steps, gate, quantise, to_trigger
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, exposed_s
from slopegate.drivers.sync.board import Board
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import dialect_of, serial_board
from slopegate.drivers.sync.serial_port import SerialPort
from sync_instruments import DelayGenerator645

PERIOD_US = 16_666.7
LIMITS = ShutterLimits(
    PixelClocks(996.66866, (50.0, 76.0, 78.0, 80.0)), Steps(-2000, 30_000, 5), Steps(100, 20_000, 50)
)
LINE_US = LIMITS.line.nearest(12.8)


class TriggeredCamera:
    """A camera that notes, into each frame, when after the projector's trigger its exposure really began."""

    def __init__(self, generator: DelayGenerator645, limits: ShutterLimits | None = LIMITS) -> None:
        self.info = CameraInfo("triggered", 2, 100, "mono12", 4095, 0.0, limits)
        self._generator = generator
        self._applied: GateSettings | None = None
        self._count = 0
        self.calls: list[str] = []
        self.memory: deque[float] = deque()
        """Frames that nobody has fetched yet: when each began."""

    def configure(self, settings: GateSettings) -> GateSettings:
        self._applied = quantise(LIMITS, settings, PERIOD_US)
        return self._applied

    def start(self) -> None:
        self.calls.append("start")

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        if not self.memory:
            time.sleep(0.004)
        if self._applied is None:
            return None
        fetched_s = time.monotonic()
        if not self.memory:
            self.expose()
        self.began_us = self.memory.popleft()
        self._count += 1
        time_s = fetched_s - exposed_s(self._applied, self.info.height)
        return FrameStamp(self._count, time_s, self._applied, self._applied)

    def expose(self) -> None:
        """The projector's trigger comes."""
        assert self._applied is not None
        self.memory.append(self._generator.pulse()[0] + to_trigger(self._applied).start_us)

    def stop(self) -> None:
        self.calls.append("stop")

    def close(self) -> None:
        self.calls.append("close")


@pytest.fixture(scope="module")
def generator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DelayGenerator645]:
    made = DelayGenerator645(tmp_path_factory.mktemp("board") / "port")
    yield made
    made.close()


@pytest.fixture
def board(generator: DelayGenerator645) -> Iterator[Board]:
    dialect = dialect_of("dg645")
    path = str(generator.link)
    made = Board(lambda: SerialPort(path, 9600), dialect, reply_timeout_s=1.0, poll_s=0.02, retry_s=(0.02,))
    yield made
    made.close()


@pytest.fixture
def both(generator: DelayGenerator645, board: Board) -> Iterator[BoardDelay]:
    made = BoardDelay(TriggeredCamera(generator), board, PERIOD_US)
    board.start()
    made.start()
    yield made
    made.close()


def frame(camera: BoardDelay) -> FrameStamp:
    stamp = camera.read(np.zeros((100, 2), np.uint16), 1.0)
    assert stamp is not None
    return stamp


def settled(camera: BoardDelay) -> FrameStamp:
    end_s = time.monotonic() + 60
    while not (stamp := frame(camera)).settled:
        assert time.monotonic() < end_s, camera.trouble
    return stamp


def test_every_settled_frame_began_when_its_stamp_says(both: BoardDelay) -> None:
    camera = both._camera
    assert isinstance(camera, TriggeredCamera)

    @settings(max_examples=25)
    @given(st.floats(-PERIOD_US, 2 * PERIOD_US), st.floats(50.0, 21_000.0))
    def check(delay_us: float, exposure_us: float) -> None:
        asked = gate(LINE_US, delay_us, exposure_us)
        promised = both.configure(asked)
        assert promised.delay_us == pytest.approx(asked.delay_us, abs=0.01)  # finer than the camera's steps of 5
        stamp = settled(both)
        assert (stamp.asked, stamp.applied) == (asked, promised)
        began_us = promised.delay_us - promised.exposure_us / 2
        wrong = (camera.began_us - began_us) / PERIOD_US
        assert wrong == pytest.approx(round(wrong), abs=1e-5)

    check()


def test_no_frame_is_given_a_delay_that_was_not_read_back(both: BoardDelay, generator: DelayGenerator645) -> None:
    both.configure(gate(LINE_US, 3000.0, 500.0))
    assert settled(both).applied is not None
    generator.misbehave("silent", times=10**6)
    both.configure(gate(LINE_US, 5000.0, 500.0))
    for _ in range(20):
        stamp = frame(both)
        assert not stamp.settled
        assert stamp.applied is None
        assert stamp.asked is not None
        assert stamp.asked.delay_us == 5000.0
    generator.misbehave("", 0)
    assert settled(both).applied == both.configure(gate(LINE_US, 5000.0, 500.0))


def test_a_board_that_goes_unsettles_the_frames_and_comes_back(both: BoardDelay, generator: DelayGenerator645) -> None:
    applied = both.configure(gate(LINE_US, 4000.0, 500.0))
    assert settled(both).applied == applied
    generator.unplug()
    end_s = time.monotonic() + 60
    while frame(both).settled:
        assert time.monotonic() < end_s
    assert "does not answer" in both.trouble
    generator.plug()
    assert settled(both).applied == applied
    assert both.trouble == ""


def test_a_frame_under_way_when_the_board_agreed_is_not_settled(both: BoardDelay, board: Board) -> None:
    both.configure(gate(LINE_US, 4000.0, 500.0))
    settled(both)
    both.configure(gate(LINE_US, 4100.0, 500.0))
    stamp = settled(both)
    agreed_s = board.status.agreed_s
    assert agreed_s is not None
    assert stamp.time_s - agreed_s >= 2 * PERIOD_US * 1e-6


def test_frames_that_waited_for_a_busy_computer_are_not_settled(both: BoardDelay, board: Board) -> None:
    camera = both._camera
    assert isinstance(camera, TriggeredCamera)
    both.configure(gate(LINE_US, 3000.0, 500.0))
    settled(both)
    for _ in range(8):
        camera.expose()
    promised = both.configure(gate(LINE_US, 5000.0, 500.0))
    end_s = time.monotonic() + 60
    while (agreed_s := board.status.agreed_s) is None or time.monotonic() < agreed_s + 0.2:
        assert time.monotonic() < end_s
        time.sleep(0.001)
    assert not any(frame(both).settled for _ in range(8))
    assert settled(both).applied == promised
    assert camera.began_us == pytest.approx(promised.delay_us - promised.exposure_us / 2, abs=0.1)


def test_its_limits_are_of_the_board(both: BoardDelay) -> None:
    limits = both.info.limits
    assert limits is not None
    assert limits.delay_us.step == 0.1
    assert (limits.line, limits.exposure_us) == (LIMITS.line, LIMITS.exposure_us)
    assert both.info.can.delay
    assert both.info.board == "Stanford Research DG645"


def test_all_rows_are_read_with_a_boards_delay(both: BoardDelay) -> None:
    assert not both.info.can.rows
    with pytest.raises(InputError, match="told for whole pictures"):
        both.set_rows(0, 10)


def test_who_cannot_share_a_delay(generator: DelayGenerator645, tmp_path: Path) -> None:
    plain = TriggeredCamera(generator, None)
    with pytest.raises(ValueError, match="plain camera"):
        BoardDelay(plain, serial_board(str(tmp_path), dialect_of("dg645")), PERIOD_US)
    with pytest.raises(ValueError, match="sets no delay"):
        BoardDelay(TriggeredCamera(generator), serial_board(str(tmp_path), dialect_of("authors")), PERIOD_US)
