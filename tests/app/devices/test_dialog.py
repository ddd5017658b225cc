"""The device dialog: a hanging driver holds nothing up, and a real instrument is tested, connected and remembered."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, QRect, Qt, QTimer
from PySide6.QtWidgets import QDialogButtonBox, QScrollArea, QTreeWidgetItem
from pytestqt.qtbot import QtBot

from slopegate.app.devices.dialog import DeviceDialog
from slopegate.app.devices.hub import DeviceChoices, DeviceHub
from slopegate.app.session.preferences import load
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.families import Family, Found
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.sync import boards as sync_boards
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import BoardChoice, dialect_of, identify
from slopegate.drivers.sync.dialect import Pulse
from slopegate.drivers.sync.serial_port import PortError
from sync_instruments import DelayGenerator645

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are of Unix")


@pytest.fixture
def generator(tmp_path: Path) -> Iterator[DelayGenerator645]:
    made = DelayGenerator645(tmp_path / "port")
    yield made
    made.close()


@pytest.fixture
def release() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    return tmp_path / "config" / "devices.json"


def serial_family(port: Path) -> Family:
    def find() -> list[Found]:
        return [Found("board", "serial", str(port), "FT232R", str(port))] if port.is_symlink() else []

    def test(device: Found) -> str:
        name, _ = identify(lambda baud: sync_boards.SerialPort(device.where, baud), dialect_of("dg645"))
        return f"{name} answers."

    return Family("serial", "board", "Serial ports", lambda: "", find, test)


def hanging(release: threading.Event, missing: str = "") -> Family:
    def find() -> list[Found]:
        return [Found("camera", "slow", "1", "Slow camera")]

    def test(device: Found) -> str:
        release.wait(30)
        return "It answers."

    return Family("slow", "camera", "Slow cameras", lambda: missing, find, test)


@pytest.fixture
def hub(memory: Path, generator: DelayGenerator645, release: threading.Event, qapp: object) -> Iterator[DeviceHub]:
    absent = Family("absent", "camera", "GenTL cameras", lambda: "They need harvesters: install it.", list)
    made = DeviceHub(memory, [VIRTUAL, hanging(release), serial_family(generator.link), absent])
    yield made
    made.close()


@pytest.fixture
def dialog(qtbot: QtBot, hub: DeviceHub) -> DeviceDialog:
    made = DeviceDialog(hub)
    qtbot.addWidget(made)
    with qtbot.waitSignal(hub.surveyed):
        made.show()
    return made


def test_it_fits_low_screens(qtbot: QtBot, dialog: DeviceDialog) -> None:
    dialog.resize(700, 420)
    qtbot.waitUntil(lambda: dialog.height() == 420)
    close = dialog.findChild(QDialogButtonBox)
    assert dialog.rect().contains(close.geometry())
    scroll = dialog.findChild(QScrollArea)
    qtbot.waitUntil(lambda: scroll.verticalScrollBar().maximum() > 0)
    scroll.ensureWidgetVisible(dialog.status)
    assert (
        scroll.viewport()
        .rect()
        .intersects(QRect(dialog.by_board.mapTo(scroll.viewport(), QPoint()), dialog.by_board.size()))
    )


def rows(dialog: DeviceDialog) -> dict[str, QTreeWidgetItem]:
    tops = [dialog.tree.topLevelItem(index) for index in range(dialog.tree.topLevelItemCount())]
    return {top.child(index).text(0): top.child(index) for top in tops for index in range(top.childCount())}


def select(dialog: DeviceDialog, name: str) -> None:
    dialog.tree.setCurrentItem(rows(dialog)[name])


def use_dg645(dialog: DeviceDialog) -> None:
    dialog.board.kind.setCurrentIndex(dialog.board.kind.findData("dg645"))


class Lateness:
    """How late the event loop is for a timer of 10 ms."""

    def __init__(self) -> None:
        self.ticks, self.worst_s, self._last_s = 0, 0.0, time.monotonic()
        self._timer = QTimer()
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)
        self._timer.start(10)

    def _tick(self) -> None:
        now_s = time.monotonic()
        self.ticks += 1
        self.worst_s = max(self.worst_s, now_s - self._last_s - 0.01)
        self._last_s = now_s

    def stop(self) -> None:
        self._timer.stop()


def test_one_list_of_what_is_there_and_what_could_be(dialog: DeviceDialog) -> None:
    listed = rows(dialog)
    assert list(listed) == ["Virtual camera", "Slow camera", "FT232R", "GenTL cameras"]
    assert listed["GenTL cameras"].text(2) == "They need harvesters: install it."
    assert not dialog.test.isEnabled()
    assert not dialog.connect_button.isEnabled()
    select(dialog, "GenTL cameras")
    assert dialog.device is None
    assert dialog.answer.text() == "They need harvesters: install it."
    select(dialog, "Slow camera")
    assert dialog.test.isEnabled()
    assert not dialog.connect_button.isEnabled()


def test_an_instrument_is_tested_connected_and_remembered(
    qtbot: QtBot, dialog: DeviceDialog, hub: DeviceHub, generator: DelayGenerator645, memory: Path
) -> None:
    select(dialog, "FT232R")
    use_dg645(dialog)
    with qtbot.waitSignal(hub.tested):
        qtbot.mouseClick(dialog.test, Qt.MouseButton.LeftButton)
        assert not dialog.test.isEnabled()
    assert dialog.answer.text() == "\u2713 DG645 s/n001776 answers."
    dialog.board.width_us.setValue(250.0)
    qtbot.mouseClick(dialog.connect_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: "DG645 s/n001776 is ready" in dialog.status.text())
    qtbot.waitUntil(lambda: generator.pulse() == (0.0, pytest.approx(250.0), False, True))
    assert not dialog.test.isEnabled()  # its port has an owner
    choices, notice = load(memory, DeviceChoices, "devices")
    assert notice == ""
    assert choices.board == BoardChoice(where=str(generator.link), dialect="dg645", baud=9600, width_us=250.0)
    qtbot.mouseClick(dialog.disconnect_button, Qt.MouseButton.LeftButton)
    assert dialog.status.text() == "No board is connected."
    assert load(memory, DeviceChoices, "devices")[0].board is None


def test_a_remembered_board_connects_by_itself(qtbot: QtBot, memory: Path, generator: DelayGenerator645) -> None:
    memory.parent.mkdir()
    choice = BoardChoice(where=str(generator.link), dialect="dg645", baud=9600)
    memory.write_text(DeviceChoices(board=choice).model_dump_json())
    again = DeviceHub(memory, [])
    qtbot.waitUntil(lambda: again.board_status is not None and again.board_status.state == "ready")
    again.close()
    assert again.board_status is None


@pytest.mark.parametrize("text", ["{", '{"board": {"where": "x", "dialect": "morse", "baud": 1}}', "[]"])
def test_a_damaged_memory_is_told_and_connects_nothing(text: str, memory: Path, qapp: object) -> None:
    memory.parent.mkdir()
    memory.write_text(text)
    made = DeviceHub(memory, [])
    assert "devices.json" in made.notice
    assert made.board_status is None
    made.close()


def test_a_remembered_output_that_is_not_there_is_told(memory: Path, qapp: object) -> None:
    memory.parent.mkdir()
    choice = BoardChoice(where="port", dialect="t560", baud=9600, output=9)
    memory.write_text(DeviceChoices(board=choice).model_dump_json())
    made = DeviceHub(memory, [])
    assert "outputs 1 to 4" in made.notice
    made.close()


def test_a_pulled_cable_is_told_and_mended(
    qtbot: QtBot, dialog: DeviceDialog, generator: DelayGenerator645, hub: DeviceHub
) -> None:
    select(dialog, "FT232R")
    use_dg645(dialog)
    dialog.connect_button.click()
    qtbot.waitUntil(lambda: "is ready" in dialog.status.text())
    generator.unplug()
    qtbot.waitUntil(lambda: "Trying again by itself" in dialog.status.text())
    with qtbot.waitSignal(hub.surveyed):
        hub.look()
    assert "FT232R" not in rows(dialog)
    assert dialog.answer.text() == "FT232R pulled."
    generator.plug()
    qtbot.waitUntil(lambda: "is ready" in dialog.status.text())
    with qtbot.waitSignal(hub.surveyed):
        hub.look()
    assert "FT232R" in rows(dialog)
    assert dialog.answer.text() == "FT232R plugged in."


def test_the_one_delay_is_the_boards_only_where_the_board_makes_it(
    qtbot: QtBot, dialog: DeviceDialog, hub: DeviceHub, generator: DelayGenerator645, rig: Rig
) -> None:
    camera = VirtualCamera(rig, Scene("nothing"))
    assert not dialog.by_board.isEnabled()
    assert hub.with_delay(camera, rig.projector.period_us) is camera
    select(dialog, "FT232R")
    use_dg645(dialog)
    dialog.connect_button.click()
    assert dialog.by_board.isEnabled()
    assert hub.with_delay(camera, rig.projector.period_us) is camera
    dialog.by_board.click()
    both = hub.with_delay(camera, rig.projector.period_us)
    assert isinstance(both, BoardDelay)
    applied = both.configure(gate(12.8, 3000.0, 500.0))
    qtbot.waitUntil(lambda: generator.pulse()[0] > 0)
    assert generator.pulse()[0] == pytest.approx(2750.0, abs=0.1)
    assert applied.delay_us == pytest.approx(3000.0, abs=0.1)
    qtbot.waitUntil(lambda: dialog.delay.text().startswith("2750.00"))
    dialog.board.kind.setCurrentIndex(dialog.board.kind.findData("authors"))
    dialog.connect_button.click()
    assert hub.delay_owner == "camera"
    assert dialog.by_camera.isChecked()
    assert not dialog.by_board.isEnabled()
    both.close()


def test_a_device_that_hangs_leaves_the_window_responsive(
    qtbot: QtBot, dialog: DeviceDialog, hub: DeviceHub, release: threading.Event
) -> None:
    """The driver hangs for 30 s, or rather until the window has been seen to live on."""
    select(dialog, "Slow camera")
    dialog.test.click()
    late = Lateness()
    qtbot.waitUntil(lambda: late.ticks >= 150)
    assert hub.testing
    select(dialog, "FT232R")
    assert not dialog.test.isEnabled()
    dialog.close()
    assert not hub.testing
    late.stop()
    print(f"event loop at most {1000 * late.worst_s:.1f} ms late in {late.ticks} ticks beside a device that hangs")
    hub.close()  # does not wait for it either
    release.set()


def test_a_port_that_hangs_when_opened_leaves_the_window_responsive(
    qtbot: QtBot, dialog: DeviceDialog, hub: DeviceHub, release: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang(where: str, baud: int) -> object:
        release.wait(30)
        raise PortError("it was hanging")

    monkeypatch.setattr(sync_boards, "SerialPort", hang)
    select(dialog, "FT232R")
    dialog.connect_button.click()
    late = Lateness()
    qtbot.waitUntil(lambda: late.ticks >= 100)
    assert "connecting" in dialog.status.text()
    dialog.disconnect_button.click()
    assert dialog.status.text() == "No board is connected."
    qtbot.waitUntil(lambda: late.ticks >= 120)
    late.stop()
    print(f"event loop at most {1000 * late.worst_s:.1f} ms late in {late.ticks} ticks beside a port that hangs")
    release.set()


def test_pulses_that_an_instrument_cannot_make_are_not_connected(
    dialog: DeviceDialog, hub: DeviceHub, generator: DelayGenerator645
) -> None:
    choice = BoardChoice(where=str(generator.link), dialect="t560", baud=38400, trigger_level_v=5.0)
    with pytest.raises(ValueError, match="trigger_level_v is 5"):
        hub.connect_board(choice)
    assert hub.board_status is None
    assert hub.choices.board is None
    assert choice.pulse(12.0) == Pulse(12.0, trigger_level_v=5.0)


def test_every_kind_can_be_chosen(dialog: DeviceDialog) -> None:
    for index in range(dialog.board.kind.count()):
        dialog.board.kind.setCurrentIndex(index)
        choice = dialog.board.choice("port")
        dialect = dialect_of(choice.dialect)
        assert choice.baud == dialect.bauds[0]
        assert dialog.board.width_us.isEnabled() is (dialect.limits is not None)
        if dialect.limits is not None:
            assert dialect.limits.round(choice.pulse()).width_us == pytest.approx(100.0)


def test_the_window_has_the_dialog_behind_a_key(qtbot: QtBot, window: Window) -> None:
    qtbot.keyClick(window, Qt.Key.Key_D, Qt.KeyboardModifier.ControlModifier)
    dialog = window.devices.open()
    assert isinstance(dialog, DeviceDialog)
    assert dialog.isVisible()
    qtbot.waitUntil(lambda: "Virtual camera" in rows(dialog))
    dialog.close()
