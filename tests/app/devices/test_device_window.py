"""The real window on devices: pictures, a GenTL camera, one that hangs, one whose board makes the delay."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import QMimeData, QPoint, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QLabel, QWidget
from pytestqt.qtbot import QtBot

import ueye_stub
import viky
from questions import answer_next
from rigs import check_rig
from search_card import search_card
from settings_inside import read_settings
from slopegate.app.devices.hub import DeviceChoices
from slopegate.app.panels.alarm import AlarmPanel
from slopegate.app.panels.capture import CapturePanel
from slopegate.app.panels.depth import DepthPanel
from slopegate.app.panels.mask import MaskPanel
from slopegate.app.panels.panels import PANELS
from slopegate.app.panels.plots import SectionPanel
from slopegate.app.panels.search import SearchPanel
from slopegate.app.session import opening, session
from slopegate.app.session.preferences import load
from slopegate.app.views.live_panel import pixel_text
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.storage import open_capture
from slopegate.drivers.contract.camera import Camera, CameraError, CameraGoneError
from slopegate.drivers.contract.families import Address, Family, Found
from slopegate.drivers.contract.frame import Abilities, Ability, FrameStamp, OpenOptions
from slopegate.drivers.devices import catalog
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.devices.survey import Surveyor
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import BoardChoice
from small_window import make_source, small_scene
from sync_instruments import DelayGenerator645

from .test_dialog import Lateness, rows, select

BAR = 30
"""Columns of the white bar in the pictures, so that frame k is told from the others."""


def pictures(folder: Path) -> Path:
    folder.mkdir()
    for k in range(4):
        image = np.full((120, 160), 20, np.uint8)
        image[:, k * BAR : (k + 1) * BAR] = 200
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return folder


def film(path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (160, 120))
    for k in range(5):
        writer.write(np.full((120, 160, 3), 40 * k, np.uint8))
    writer.release()
    return path


def drop(window: Window, path: Path) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path))])
    copy, left, none = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    enter = QDragEnterEvent(QPoint(9, 9), copy, data, left, none)
    window.dragEnterEvent(enter)
    assert enter.isAccepted()
    window.dropEvent(QDropEvent(QPoint(9, 9), copy, data, left, none))


def runs(window: Window, name: str) -> bool:
    source, frame = window.session.source, window.live.frame
    shape = None if source is None else (source.camera.info.height, source.camera.info.width)
    return source is not None and name in source.scene.name and frame is not None and frame.image.shape == shape


GATED = [spec.key for spec in PANELS if spec.needs]


def usable(window: Window, key: str) -> tuple[bool, str]:
    """Whether a panel is shown when it is brought to the front, and what stands there if not."""
    dock = window.docks.docks[key]
    window.docks.bring(key)
    shown = dock.panel is not None and dock.panel.isVisible()
    notes = [label.text() for label in dock.findChildren(QLabel) if label.isVisible()]
    assert shown if not dock.missing else dock.missing in notes
    return shown, dock.missing


@pytest.mark.parametrize("make", [lambda path: pictures(path / "walk"), lambda path: film(path / "film.avi")])
def test_pictures_and_films_play_when_dropped(
    qtbot: QtBot, window: Window, tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    path = make(tmp_path)
    drop(window, path)
    qtbot.waitUntil(lambda: runs(window, path.name))
    seen: set[int] = set()

    def moves() -> bool:
        assert window.live.frame is not None
        seen.add(int(window.live.frame.image[60].astype(int).argmax() // BAR + window.live.frame.image.max()))
        return len(seen) >= 3

    qtbot.waitUntil(moves)
    qtbot.waitUntil(lambda: window.live.travelled.text().endswith("no gate"))
    assert window.menus.scenes.currentText() == window.session.source.scene.name
    # a plain camera: no gate to set, and everything that needs one says so
    box = window.gate.settings
    for widget in (box.line.spin, box.delay.slider, box.exposure.spin, window.gate.plane.spins[0]):
        assert not widget.isEnabled()
        assert "no shutter" in widget.toolTip()
    assert "no shutter" in window.gate.named.warning.toolTip()
    for key in GATED:
        able, why = usable(window, key)
        assert not able
        assert "no shutter" in why
    assert usable(window, "alarm") == (True, "")
    for choice, why in ((window.menus.formats, "one pixel format only"), (window.menus.rates, "a pace of their own")):
        assert not choice.box.isEnabled()
        assert not choice.menu.menuAction().isEnabled()
        assert why in choice.box.toolTip()
    for key in ("]", ".", ";"):
        qtbot.keyClick(window, key)
    qtbot.keyClick(window, Qt.Key.Key_M, Qt.KeyboardModifier.ControlModifier)
    assert window.messages.text == ""
    assert not window.menus.noise.isEnabled()


def test_a_window_that_begins_with_pictures_begins_with_what_they_allow(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    made = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready):
        made.open_first(str(pictures(tmp_path / "walk")))
    alarm = made.docks.docks["alarm"].panel
    assert isinstance(alarm, AlarmPanel)
    assert alarm.isVisible()
    assert (alarm.level.maximum(), alarm.level.value()) == (255, round(300 * 255 / 4095))
    made.close()
    kept = json.loads((tmp_path / "config" / "window.json").read_text())
    assert kept["scene"] == str(tmp_path / "walk")


def test_a_scene_after_a_plain_camera_has_everything_again(
    qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path
) -> None:
    window.open(pictures(tmp_path / "walk"))
    qtbot.waitUntil(lambda: runs(window, "walk"))
    qtbot.waitUntil(lambda: window.docks.docks["alarm"].front)
    window.session.adopt(make_source(rig))
    qtbot.waitUntil(lambda: window.docks.docks["section"].front)
    assert all(usable(window, key)[0] for key in GATED)
    assert window.gate.settings.delay.spin.isEnabled()
    assert "Alt+D" in window.gate.settings.delay.spin.toolTip()
    assert window.menus.noise.isEnabled()


class Unseen:
    """The virtual camera as a device: it keeps the contract and nothing else, so nobody can ask it for its scene."""

    trouble = ""

    def __init__(self, rig: Rig, options: OpenOptions, scene: Scene | None = None) -> None:
        self.camera = VirtualCamera(rig, scene or small_scene(rig), rate_hz=100.0)
        self.camera.prepare(lambda share: True)
        trigger = Ability("" if options.triggered else "It runs by itself.")
        none = Abilities()
        can = replace(self.camera.info.can, delay=trigger, trigger=trigger, rows=none.rows, cover=none.cover)
        self.info = replace(self.camera.info, name="Unseen camera", can=can)
        self.gone, self.calls = False, []
        self.hang = threading.Event()
        self.hang.set()

    def _call(self, name: str) -> None:
        self.calls.append((name, threading.current_thread()))
        self.hang.wait(60)

    def configure(self, settings: GateSettings) -> GateSettings:
        self._call("configure")
        return self.camera.configure(settings)

    def start(self) -> None:
        self._call("start")
        self.camera.start()

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        self._call("read")
        if self.gone:
            raise CameraGoneError("Unseen camera does not answer")
        return self.camera.read(buffer, timeout_s)

    def stop(self) -> None:
        self._call("stop")
        self.camera.stop()

    def close(self) -> None:
        self._call("close")
        self.camera.close()


UNSEEN = Address("unseen", "42")


@pytest.fixture
def generator(tmp_path: Path) -> Iterator[DelayGenerator645]:
    made = DelayGenerator645(tmp_path / "port")
    yield made
    made.close()


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Unseen]:
    """Every unseen camera that was opened, by the family of that name."""
    made: list[Unseen] = []

    def open_it(where: str, rig: Rig, options: OpenOptions) -> Camera:
        made.append(Unseen(rig, options))
        return made[-1]

    monkeypatch.setitem(catalog.OPEN, "unseen", open_it)
    return made


def connect(qtbot: QtBot, window: Window, address: Address = UNSEEN) -> None:
    window.open(address)
    qtbot.waitUntil(lambda: window.devices.hub.running == address)
    qtbot.waitUntil(lambda: window.live.frame is not None and window.session.stream.counters.made > 2)


def panel(window: Window, kind: type[QWidget]) -> QWidget:
    key = next(spec.key for spec in PANELS if spec.place.endswith(f":{kind.__name__}"))
    found = window.docks.bring(key)
    assert isinstance(found, kind)
    return found


def test_a_camera_is_connected_in_the_dialog_and_let_go(
    qtbot: QtBot, window: Window, opened: list[Unseen], tmp_path: Path
) -> None:
    found = Found("camera", "unseen", "42", "Unseen camera", "port 42")
    hub = window.devices.hub
    hub._surveyor = Surveyor([VIRTUAL, Family("unseen", "camera", "Unseen", lambda: "", lambda: [found])])
    dialog = window.devices.open()
    qtbot.waitUntil(lambda: "Unseen camera" in rows(dialog))
    select(dialog, "Unseen camera")
    qtbot.mouseClick(dialog.connect_button, Qt.MouseButton.LeftButton)
    assert dialog.answer.text() == "Opening unseen:42 ..."
    qtbot.waitUntil(lambda: hub.running == UNSEEN)
    assert dialog.answer.text() == "\u2713 The window streams from unseen:42."
    assert rows(dialog)["Unseen camera"].text(2) == "streaming in this window"
    assert not dialog.test.isEnabled()
    assert not dialog.connect_button.isEnabled()
    assert window.windowTitle().startswith("Unseen camera")
    qtbot.waitUntil(lambda: window.live.travelled.text().startswith("frame"))
    # without the projector's trigger it is opened anew, with the gate that was set
    qtbot.waitUntil(lambda: window.session.source.no_gate == "")
    window.session.use(window.session.source.presets[1])
    held = window.session.resolved.gate
    dialog.triggered.click()
    qtbot.waitUntil(lambda: len(opened) == 2 and window.session.source.no_gate != "")
    assert window.session.resolved.gate.exposure_us == held.exposure_us
    assert not window.gate.settings.delay.spin.isEnabled()
    assert window.gate.settings.exposure.spin.isEnabled()
    choices, _ = load(tmp_path / "config" / "devices.json", DeviceChoices, "devices")
    assert (choices.camera, choices.camera_runs, choices.triggered) == (("unseen", "42"), True, False)
    qtbot.mouseClick(dialog.leave, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: window.opener.busy or window.messages.text != "")
    dialog.close()
    window.opener.cancel()


def test_a_camera_that_does_not_open_anew_can_be_connected_again(
    qtbot: QtBot, window: Window, opened: list[Unseen], monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(qtbot, window)
    able = catalog.OPEN["unseen"]

    def refuse(where: str, rig: Rig, options: OpenOptions) -> Camera:
        raise CameraError("Unseen camera is in use by another program")

    monkeypatch.setitem(catalog.OPEN, "unseen", refuse)
    with qtbot.waitSignal(window.opener.failed):
        window.devices.hub.set_triggered(False)
    assert "in use" in window.messages.text
    assert window.devices.hub.running is None
    qtbot.waitUntil(lambda: window.live.view.stale == "Unseen camera has been let go")
    assert window.devices.again.isEnabled()
    monkeypatch.setitem(catalog.OPEN, "unseen", able)
    window.devices.again.trigger()
    qtbot.waitUntil(lambda: window.devices.hub.running == UNSEEN and window.live.view.stale == "")


def test_no_device_is_called_in_the_gui_thread(qtbot: QtBot, window: Window, opened: list[Unseen], rig: Rig) -> None:
    connect(qtbot, window)
    for preset in (1, 0, 1):
        calls = len(opened[0].calls)
        window.session.use(window.session.source.presets[preset])
        qtbot.waitUntil(lambda calls=calls: "configure" in [name for name, _ in opened[0].calls[calls:]])
    window.session.adopt(make_source(rig))
    qtbot.waitUntil(
        lambda: ("close", threading.main_thread()) in [(n, threading.main_thread()) for n, _ in opened[0].calls]
    )
    names = {name for name, _ in opened[0].calls}
    assert names == {"configure", "start", "read", "stop", "close"}
    assert threading.main_thread() not in {thread for _, thread in opened[0].calls}


@pytest.mark.parametrize("device", [True, False])
def test_a_capture_under_way_keeps_its_camera(
    qtbot: QtBot, window: Window, opened: list[Unseen], tmp_path: Path, device: bool
) -> None:
    if device:
        connect(qtbot, window)
    slices = panel(window, CapturePanel)
    slices.where.setText(str(tmp_path / "slices"))
    slices.plan.choose("depth")
    slices.plan.count.setValue(3)
    slices.dark.setChecked(False)
    slices.frames.setValue(500)
    qtbot.waitUntil(slices.start.isEnabled)
    slices.start.click()
    qtbot.waitUntil(lambda: window.session.stream.tapped is not None)
    stream, box = window.session.stream, window.menus.formats.box
    asked = answer_next("Let it go on")
    box.activated.emit(1)
    assert asked == ["Changing the camera ends the capture. What it has taken is kept and can be resumed."]
    assert (box.currentText(), window.session.stream) == ("Mono sensor", stream)
    assert [action.isChecked() for action in window.menus.formats.menu.actions()] == [True, False]
    assert slices.run.busy
    slices.cancel.click()
    qtbot.waitUntil(lambda: not slices.run.busy)
    box.activated.emit(1)
    qtbot.waitUntil(lambda: window.session.stream not in (None, stream))
    assert window.messages.text == ""


def test_depth_slices_and_masks_work_on_a_camera_that_only_sees(
    qtbot: QtBot, window: Window, opened: list[Unseen], rig: Rig, tmp_path: Path
) -> None:
    connect(qtbot, window)
    assert window.gate.named.choice.currentText() == "Everything lit"
    assert window.live.frame.image.max() > 300
    assert "depth" not in pixel_text(window.session.source, window.live.frame.image, 160, 120)
    mask = panel(window, MaskPanel)
    mask.rectangle.chosen.emit(140, 100, 180, 140)
    assert "sweep of the Depth panel" in mask.predicted.text()
    depth = panel(window, DepthPanel)
    depth.start.click()
    qtbot.waitUntil(lambda: depth.result is not None)
    inverse = depth.result.found.inverse_depth
    assert 1 / inverse[120, 160] == pytest.approx(1.0, abs=0.03)
    assert 1 / inverse[120, 20] == pytest.approx(2.0, abs=0.1)
    # from now on the sweep's depth is what is known of the scene
    source = window.session.source
    shown = f"depth {1 / inverse[120, 160]:.4g} m"
    assert shown in pixel_text(source, window.live.frame.image, 160, 120)
    inverse[0, 0] = 0
    assert "depth not known" in pixel_text(source, window.live.frame.image, 0, 0)
    section = panel(window, SectionPanel)
    qtbot.waitUntil(lambda: len(section.view.surface.dots) > 100)
    panel(window, MaskPanel)
    mask.find_gate()
    qtbot.waitUntil(lambda: not mask.busy and mask.gate.text() != "")
    slices = panel(window, CapturePanel)
    slices.plan.choose("lit")
    slices.plan.count.setValue(3)
    slices.dark.setChecked(False)
    slices.where.setText(str(tmp_path / "slices"))
    qtbot.waitUntil(slices.start.isEnabled)
    slices.start.click()
    qtbot.waitUntil(lambda: not slices.run.busy)
    assert not open_capture(tmp_path / "slices").missing()
    window.open(tmp_path / "slices")
    qtbot.waitUntil(lambda: window.docks.docks["capture"].front and "captured" in window.windowTitle())


def test_a_search_needs_nothing_but_the_images(qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    card = search_card(20.0, 0.9, rig=check_rig(480))
    monkeypatch.setitem(catalog.OPEN, "unseen", lambda where, rig, options: Unseen(rig, options, card.scene))
    made = Window(card.rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready):
        made.open(UNSEEN)
    search = panel(made, SearchPanel)
    search.set_target(card.target)
    with qtbot.waitSignal(search.ended, timeout=30_000) as ended:
        search.start_button.click()
    outcome = ended.args[0]
    assert outcome.found
    assert outcome.target.tilt_deg == pytest.approx(20.0, abs=3.0)
    assert outcome.target.distance_m == pytest.approx(0.9, abs=0.05)
    made.close()


def test_a_lost_camera_is_told_over_the_picture_and_comes_back(
    qtbot: QtBot, window: Window, opened: list[Unseen]
) -> None:
    connect(qtbot, window)
    opened[0].gone = True
    qtbot.waitUntil(lambda: window.messages.text == "Unseen camera does not answer. Trying again by itself.")
    qtbot.waitUntil(lambda: "Not live: no frame for" in window.live.view.stale)
    opened[0].gone = False
    qtbot.waitUntil(lambda: "is back after" in window.messages.text)
    qtbot.waitUntil(lambda: window.live.view.stale == "")


def test_a_camera_that_waits_for_its_trigger_says_so(qtbot: QtBot, window: Window, opened: list[Unseen]) -> None:
    connect(qtbot, window)
    opened[0].camera.stop()
    qtbot.waitUntil(lambda: "waits for the projector's sync signal" in window.live.view.stale)
    assert window.messages.text == ""


def test_under_a_camera_that_sends_nothing_stands_no_other_picture(
    qtbot: QtBot, window: Window, opened: list[Unseen], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert window.live.view.image is not None
    monkeypatch.setattr(Unseen, "read", lambda self, buffer, timeout_s: time.sleep(timeout_s))
    window.open(UNSEEN)
    qtbot.waitUntil(lambda: window.devices.hub.running == UNSEEN)
    assert window.live.view.image is None
    window.save_frame(tmp_path / "frame.tif")
    assert window.messages.text == "There is no frame to save yet."


def test_a_camera_that_is_not_there_leaves_the_scene(qtbot: QtBot, window: Window) -> None:
    where = window.session.source.where
    for address, said in (
        (Address("video", "/no/such/file"), "does not exist"),
        (Address("yes", "1"), "no camera driver"),
    ):
        with qtbot.waitSignal(window.opener.failed):
            window.open(address)
        assert said in window.messages.text
    made = window.session.stream.counters.made
    qtbot.waitUntil(lambda: window.session.stream.counters.made > made)
    assert window.session.source.where == where


def wait_watching(qtbot: QtBot, seconds: float) -> float:
    """How late the event loop is at most, in ms."""
    late = Lateness()
    qtbot.wait(round(1000 * seconds))
    qtbot.waitUntil(lambda: late.ticks >= 20)
    late.stop()
    return 1000 * late.worst_s


def hang_everywhere(qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch, rig: Rig, hang_s: float) -> None:
    """Opening, reading and letting go hang in turn; the event loop goes on beside each."""
    release = threading.Event()
    made: list[Unseen] = []

    def slow(where: str, rig: Rig, options: OpenOptions) -> Camera:
        if where == "hang":
            release.wait(60)
            raise CameraError("it was hanging")
        made.append(Unseen(rig, options))
        return made[-1]

    monkeypatch.setitem(catalog.OPEN, "unseen", slow)
    scene = make_source(rig)
    window.open(Address("unseen", "hang"))
    opening_late = wait_watching(qtbot, hang_s)
    qtbot.waitUntil(window.progress.isVisible)
    assert "unseen:hang" in window.progress.findChild(QLabel).text()
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert not window.progress.isVisible()
    connect(qtbot, window)
    made[0].hang.clear()
    window.session.use(window.session.source.presets[1])
    reading_late = wait_watching(qtbot, hang_s)
    qtbot.keyClick(window, ".")
    assert "Not live" in window.live.view.stale or hang_s < 4
    window.session.adopt(scene)
    closing_late = wait_watching(qtbot, hang_s)
    print(
        f"a device that hangs for {hang_s:g} s: event loop at most {opening_late:.0f} ms late while it is opened, "
        f"{reading_late:.0f} ms while it is read, {closing_late:.0f} ms while it is let go"
    )
    monkeypatch.setattr(session, "CLOSE_S", 0.2)
    window.close()
    assert window.session.source is None
    made[0].hang.set()
    release.set()


def test_a_camera_that_hangs_leaves_the_window_responsive(
    qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    hang_everywhere(qtbot, window, monkeypatch, rig, 0.5)


@pytest.mark.slow
def test_a_camera_that_hangs_for_half_a_minute(
    qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    hang_everywhere(qtbot, window, monkeypatch, rig, 30.0)


def test_the_camera_of_the_last_time_comes_after_the_scene(
    qtbot: QtBot, window: Window, opened: list[Unseen], rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(qtbot, window)
    window.close()
    monkeypatch.setattr(opening, "open_source", lambda where, rig, options, progress: make_source(rig))
    for there in (True, False, True):
        if not there:
            monkeypatch.delitem(catalog.OPEN, "unseen")
        again = Window(rig, tmp_path / "config" / "window.json")
        qtbot.addWidget(again)
        again.show()
        again.open_first(None)
        if there:
            qtbot.waitUntil(lambda again=again: again.devices.hub.running == UNSEEN)
        else:
            qtbot.waitUntil(lambda again=again: "no camera driver" in again.messages.text)
            assert not again.session.source.is_device
            monkeypatch.setitem(catalog.OPEN, "unseen", lambda where, rig, options: Unseen(rig, options))
        again.close()
    # a scene that was opened since is what the next time begins with
    last = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(last)
    last.show()
    last.open_first(None)
    qtbot.waitUntil(lambda: last.devices.hub.running == UNSEEN)
    last.session.adopt(make_source(rig))
    last.close()
    assert not load(tmp_path / "config" / "devices.json", DeviceChoices, "devices")[0].camera_runs


def test_the_boards_delay_is_used_when_it_is_chosen(
    qtbot: QtBot, window: Window, opened: list[Unseen], generator: DelayGenerator645
) -> None:
    hub = window.devices.hub
    hub.connect_board(BoardChoice(where=str(generator.link), dialect="dg645", baud=9600))
    connect(qtbot, window)
    assert not isinstance(window.session.source.camera, BoardDelay)
    hub.set_delay_owner("board")
    qtbot.waitUntil(lambda: isinstance(window.session.source.camera, BoardDelay))
    resolved = window.session.resolved
    exposure_us = resolved.sent.exposure_us
    window.session.ask_wish(gate(resolved.gate.line_time_us, 3000.0 + exposure_us / 2, exposure_us))
    # the camera's own step leaves it up to half a microsecond
    qtbot.waitUntil(lambda: generator.pulse()[0] == pytest.approx(3000.0, abs=0.6))
    qtbot.waitUntil(lambda: window.live.frame.stamp.settled and window.live.frame.stamp.applied is not None)
    qtbot.waitUntil(lambda: f"delay {3000 + exposure_us / 2:g}" in window.live.travelled.text())
    assert "(delay by the board)" in window.gate.named.sent.toolTip()
    generator.unplug()
    qtbot.waitUntil(lambda: "so the gate is not known" in window.messages.text)
    qtbot.waitUntil(lambda: window.live.travelled.text().endswith("gate not confirmed yet"))
    generator.plug()
    qtbot.waitUntil(lambda: "The board is back after" in window.messages.text)
    hub.set_delay_owner("camera")
    qtbot.waitUntil(lambda: not isinstance(window.session.source.camera, BoardDelay))
    window.close()


def test_a_gentl_camera_runs_in_the_window(
    qtbot: QtBot, window: Window, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    viky.install(request)
    connect(qtbot, window, Address("gentl", viky.RED))
    source = window.session.source
    qtbot.waitUntil(lambda: window.live.frame.image.shape == (source.camera.info.height, source.camera.info.width))
    assert window.live.frame.image.max() > 0
    for control, ability in zip(
        (window.gate.settings.line, window.gate.settings.delay, window.gate.settings.exposure),
        (source.camera.info.can.line_time, source.camera.info.can.delay, source.camera.info.can.exposure),
        strict=True,
    ):
        assert control.spin.isEnabled() is bool(ability)
        assert bool(ability) or control.spin.toolTip() == ability.missing
    formats, rates = window.menus.formats.box, window.menus.rates.box
    assert (formats.currentText(), formats.isEnabled(), rates.isEnabled()) == ("Mono8", False, True)
    assert "no other pixel format" in formats.toolTip()
    rates.activated.emit(rates.findText("60 fps"))
    modes = lambda: window.session.source.camera.info.modes  # noqa: E731
    qtbot.waitUntil(lambda: modes().rate_hz == 60.0 and window.live.frame is not None)
    assert rates.currentText() == "60 fps"
    window.save_frame(tmp_path / "frame.tif")
    qtbot.waitUntil((tmp_path / "frame.tif").exists)
    assert read_settings(tmp_path / "frame.tif")["scene_file"] == f"gentl:{viky.RED}"


def test_a_ueye_camera_is_driven_by_the_keys_and_by_the_vendors_rules(qtbot: QtBot, window: Window) -> None:
    library = ueye_stub.stub()
    library.fresh()
    connect(qtbot, window, Address("ueye", ueye_stub.SERIAL))
    assert window.session.source.no_gate == ""
    qtbot.keyClick(window.gate.named.choice, Qt.Key.Key_Down)
    for key in "[[.,.;']":
        qtbot.keyClick(window, key)
    sent = window.session.resolved.sent
    qtbot.waitUntil(lambda: window.live.frame.stamp.asked == sent and window.live.frame.stamp.settled)
    formats = window.menus.formats.box
    assert [formats.itemText(index) for index in range(formats.count())] == ["BayerGR8", "BayerGR12"]
    formats.activated.emit(0)
    seen = lambda: window.session.source.camera.info.pixel_format  # noqa: E731
    qtbot.waitUntil(lambda: seen() == "bayer_gr8" and window.live.frame is not None)
    qtbot.waitUntil(lambda: window.live.frame.stamp.asked == sent and window.live.frame.stamp.settled)
    assert window.live.frame.image.max() <= 255
    library.plug(False)
    qtbot.waitUntil(lambda: "Not live" in window.live.view.stale)
    library.plug(True)
    qtbot.waitUntil(lambda: window.live.view.stale == "" and window.session.stream.error is None)
    qtbot.waitUntil(lambda: window.live.frame.stamp.asked == sent and window.live.frame.stamp.settled)
    window.close()
    qtbot.waitUntil(lambda: library.memories == 0)
    assert library.faults() == (0, "")
