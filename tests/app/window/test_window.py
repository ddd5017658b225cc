"""The whole window on a small scene, by mouse and keyboard."""

from __future__ import annotations

import json
import math
import sys
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QLocale, QMimeData, QPoint, Qt, QTimer, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QComboBox,
    QDialog,
    QFileDialog,
    QLabel,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot

from exact_transport import write_transport
from pointer import move_pointer
from settings_inside import read_settings
from slopegate.app.panels.panels import PANELS
from slopegate.app.panels.relight import RelightPanel
from slopegate.app.session import opening
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Intent, PlaneWish
from slopegate.app.session.source import Options
from slopegate.app.widgets import theme
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.widgets.number_box import NumberBox
from slopegate.app.window.window import Window
from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import LineTimes, PixelClocks
from slopegate.core.scene.scene import Preset
from small_window import make_source, small_rig, small_scene


def gate_of(window: Window) -> dict[str, float]:
    resolved = window.session.resolved
    assert resolved is not None
    line = small_rig().camera.shutter.line
    assert isinstance(line, PixelClocks)
    return {
        "clock": round(line.clock_mhz(resolved.gate.line_time_us), 6),
        "delay": float(resolved.gate.delay_us),
        "exposure": resolved.gate.exposure_us,
    }


def wait_for_frame(qtbot: QtBot, window: Window) -> None:
    """Until the frame on show was made with what is wanted now."""

    def shown() -> bool:
        frame, resolved = window.live.frame, window.session.resolved
        return frame is not None and resolved is not None and frame.stamp.applied == resolved.sent

    qtbot.waitUntil(shown)


def lit(window: Window) -> tuple[bool, bool]:
    """Whether the card in the middle and the wall at the side are bright."""
    assert window.live.frame is not None
    assert window.session.source is not None
    image = window.live.frame.image.astype(float)
    black = window.session.source.camera.info.black_count
    return bool(image[110:130, 150:170].mean() > black + 300), bool(image[110:130, 20:40].mean() > black + 100)


def test_controls_show_what_the_scene_starts_with(window: Window) -> None:
    box = window.gate.settings
    now = gate_of(window)
    assert (box.line.value, box.delay.value, box.exposure.value) == (now["clock"], now["delay"], now["exposure"])
    assert now["clock"] == 78.0
    assert window.gate.named.choice.currentText() == "The card"
    assert window.gate.plane.achieved[1].text() == "= 1.000 m"


def test_every_control_reaches_the_picture(qtbot: QtBot, window: Window) -> None:
    wait_for_frame(qtbot, window)
    assert lit(window) == (True, False)
    window.gate.named.choice.setFocus()
    qtbot.keyClick(window.gate.named.choice, Qt.Key.Key_Down)
    wait_for_frame(qtbot, window)
    assert window.gate.named.choice.currentText() == "The wall"
    assert lit(window) == (False, True)


def test_keys_move_clock_delay_and_exposure(qtbot: QtBot, window: Window) -> None:
    box = window.gate.settings
    before = gate_of(window)
    qtbot.keyClick(box.line.slider, Qt.Key.Key_Right)
    qtbot.keyClick(box.delay.spin, Qt.Key.Key_Up)
    qtbot.keyClick(box.delay.spin, Qt.Key.Key_PageDown)
    qtbot.keyClick(box.exposure.slider, Qt.Key.Key_PageUp)
    after = gate_of(window)
    assert after["clock"] == 80.0
    assert after["delay"] == before["delay"] + 1 - 100
    assert after["exposure"] > 1.2 * before["exposure"]
    found = slab(small_rig(), window.session.resolved.gate)
    spins = window.gate.plane.spins
    assert spins[0].value() == pytest.approx(found.tilt_deg, abs=0.006)
    assert spins[1].value() == pytest.approx(found.distance_m, abs=6e-4)
    qtbot.keyClick(window, "[")
    assert gate_of(window)["clock"] == 78.0
    qtbot.keyClick(window, ".")
    assert gate_of(window)["delay"] == after["delay"] + 10


def test_the_delays_on_the_slider_are_those_that_meet_the_scene(qtbot: QtBot, window: Window) -> None:
    box = window.gate.settings
    slider, spin, scale = box.delay.slider, box.delay.spin, box.delay._scale
    meeting = scale.value(slider.minimum()), scale.value(slider.maximum())
    assert -500 < meeting[0] < spin.value() < meeting[1] < 6000
    qtbot.mouseClick(box.whole, Qt.MouseButton.LeftButton)
    assert (slider.minimum(), slider.maximum()) == (0, scale.last)
    qtbot.mouseClick(box.whole, Qt.MouseButton.LeftButton)
    assert (scale.value(slider.minimum()), scale.value(slider.maximum())) == meeting
    spin.selectAll()
    qtbot.keyClicks(spin, "20000")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert slider.value() == slider.maximum() == scale.position(20_000.0)  # as long as it is set
    qtbot.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert (scale.value(slider.minimum()), scale.value(slider.maximum())) == meeting


def test_tab_walks_through_all_controls_in_reading_order(qtbot: QtBot, window: Window) -> None:
    box, plane, named = window.gate.settings, window.gate.plane, window.gate.named
    order: list[QWidget] = []
    for control in (box.line, box.delay, box.exposure):
        order += [control.slider, control.spin]
    order.insert(order.index(box.delay.spin), box.whole)
    order += [*plane.spins, named.choice, named.complement]
    window.activateWindow()
    order[0].setFocus()
    for widget in order[1:]:
        assert QApplication.focusWidget() is not None
        qtbot.keyClick(QApplication.focusWidget(), Qt.Key.Key_Tab)
        assert QApplication.focusWidget() is widget


def test_a_plane_wish_shows_asked_achieved_and_residual(qtbot: QtBot, window: Window) -> None:
    plane, box = window.gate.plane, window.gate.settings
    plane.spins[0].setFocus()
    plane.spins[0].selectAll()
    qtbot.keyClicks(plane.spins[0], "20")
    qtbot.keyClick(plane.spins[0], Qt.Key.Key_Return)
    resolved = window.session.resolved
    assert resolved is not None
    assert resolved.asked_plane is not None
    assert resolved.asked_plane.tilt_deg == 20.0
    assert plane.spins[0].value() == 20.0
    assert plane.achieved[0].text() == f"= {resolved.slab.tilt_deg:.2f}\u00b0"
    assert plane.residuals[0].text() == f"({resolved.slab.tilt_deg - 20:+.2f})"
    assert box.line.value == gate_of(window)["clock"]
    assert box.asked[0].text().startswith("asked ")
    # stepping goes on from the wish, not from what the ladder made of it
    qtbot.keyClick(plane.spins[0], Qt.Key.Key_Up)
    assert window.session.intent == Intent(
        PlaneWish(21.0, resolved.asked_plane.distance_m, resolved.asked_plane.thickness_m)
    )


def test_a_named_gate_by_its_plane_shows_what_it_asks_for(window: Window, rig: Rig) -> None:
    asked = (15.0, 1.0, 0.2)
    leaning = Preset("Leaning", plan_on_hardware(rig, *asked).applied, asked_slab=asked)
    window.session.adopt(replace(make_source(rig), presets=(leaning,)))
    plane, named = window.gate.plane, window.gate.named
    assert window.session.resolved is not None
    assert [spin.value() for spin in plane.spins] == list(asked)
    assert plane.residuals[0].text() == f"({window.session.resolved.slab.tilt_deg - 15:+.2f})"
    assert named.choice.currentText() == "Leaning"
    window.session.ask(Intent(leaning.settings))  # as it is remembered from the last time
    assert named.choice.currentText() == "Leaning"


def test_an_impossible_wish_leaves_a_message_and_the_gate(qtbot: QtBot, window: Window) -> None:
    before = gate_of(window)
    spin = window.gate.plane.spins[0]
    spin.selectAll()
    qtbot.keyClicks(spin, "89.9")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert "tilt_deg" in window.messages.text
    assert window.messages.kind == "warning"
    assert gate_of(window) == before
    assert spin.value() == pytest.approx(0.0, abs=0.01)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert window.messages.text == ""


@pytest.mark.parametrize(
    ("index", "typed", "said"),
    [
        (0, "95", "Tilt: 95 is not possible: -89.9 to 89.9\u00b0. It is still 0.00\u00b0."),
        (1, "-3", "Distance: -3 is not possible: 0.0001 to 999 m. It is still"),
        (2, "1e4", "Thickness: 10000 is not possible: 0.0001 to 999 m. It is still"),
        (2, "wide", "Thickness: 'wide' is not a number; 0.0001 to 999 m is possible. It is still"),
    ],
)
def test_a_plane_that_cannot_be_typed_is_refused_in_a_sentence(
    qtbot: QtBot, window: Window, index: int, typed: str, said: str
) -> None:
    before, spin = gate_of(window), window.gate.plane.spins[index]
    shown = spin.text()
    spin.selectAll()
    qtbot.keyClicks(spin, typed)
    assert spin.text().startswith(typed)
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert window.messages.text.startswith(said)
    assert (spin.text(), gate_of(window)) == (shown, before)
    other = window.gate.settings.exposure.spin
    other.selectAll()
    qtbot.keyClicks(other, "3")
    assert window.messages.text == ""


def type_in(qtbot: QtBot, spin: NumberBox, text: str) -> None:
    spin.selectAll()
    qtbot.keyClicks(spin, text)
    qtbot.keyClick(spin, Qt.Key.Key_Return)


def test_a_refusal_goes_when_its_field_shows_another_value(qtbot: QtBot, window: Window) -> None:
    tilt, distance = window.gate.plane.spins[:2]
    type_in(qtbot, tilt, "95")
    assert window.messages.text.endswith("It is still 0.00\u00b0.")
    assert window.session.ask_wish(PlaneWish(0.0, 1.5, 0.2))
    assert window.messages.text.endswith("It is still 0.00\u00b0."), "which it is"
    assert window.session.ask_wish(PlaneWish(-15.0, 1.5, 0.2))
    assert (tilt.value(), window.messages.text) == (-15.0, "")
    # an older refusal takes back none but its own sentence
    type_in(qtbot, tilt, "95")
    type_in(qtbot, distance, "-3")
    said = window.messages.text
    assert said.startswith("Distance: -3 is not possible")
    assert window.session.ask_wish(PlaneWish(10.0, 1.5, 0.2))
    assert window.messages.text == said
    assert window.session.ask_wish(PlaneWish(10.0, 1.2, 0.2))
    assert window.messages.text == ""


def test_why_no_gate_does_it_goes_when_one_is_granted(qtbot: QtBot, window: Window) -> None:
    type_in(qtbot, window.gate.plane.spins[0], "89.9")
    assert window.messages.text == window.session.refusal
    assert window.session.ask_wish(PlaneWish(10.0, 1.5, 0.2))
    assert window.messages.text == ""


def test_a_power_of_ten_is_a_number(qtbot: QtBot, window: Window) -> None:
    spin = window.gate.plane.spins[2]
    spin.selectAll()
    qtbot.keyClicks(spin, "2e-1")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert spin.value() == 0.2
    assert window.session.intent.wish.thickness_m == 0.2
    assert window.messages.text == ""


@pytest.mark.parametrize(
    ("name", "typed", "said"),
    [
        ("line", "200", "Pixel clock: 200 is not possible: 10 to 128 MHz. It is now 128 MHz."),
        ("line", "79", "Pixel clock: there is no 79 MHz, the nearest is set: 78 MHz."),
        ("delay", "9999999", "Delay: 9999999 is not possible: -16667 to 33334 \u00b5s. It is now 33334 \u00b5s."),
        ("delay", "2000.4", "Delay: there is no 2000.4 \u00b5s, the nearest is set: 2000 \u00b5s."),
        ("exposure", "0", "Exposure: 0 is not possible: 100 to 50000 \u00b5s. It is now 100 \u00b5s."),
    ],
)
def test_settings_that_the_camera_has_not_are_the_nearest_and_said(
    qtbot: QtBot, window: Window, name: str, typed: str, said: str
) -> None:
    spin = getattr(window.gate.settings, name).spin
    spin.selectAll()
    qtbot.keyClicks(spin, typed)
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert window.messages.text == said


def test_complement_shows_the_rest_and_what_is_sent(qtbot: QtBot, window: Window) -> None:
    wait_for_frame(qtbot, window)
    box = window.gate.named
    gate_before = gate_of(window)
    qtbot.mouseClick(box.complement, Qt.MouseButton.LeftButton, pos=QPoint(8, box.complement.height() // 2))
    wait_for_frame(qtbot, window)
    resolved = window.session.resolved
    assert resolved is not None
    assert gate_of(window) == gate_before
    assert resolved.sent.exposure_us > 16_000
    assert f"exposure {resolved.sent.exposure_us:.0f}" in box.sent.text()
    assert lit(window) == (False, True)
    qtbot.keyClick(window, "m", Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: not window.session.intent.complement)
    wait_for_frame(qtbot, window)
    assert lit(window) == (True, False)


def test_everything_beyond_infinity_is_shown_as_such_and_can_be_left(qtbot: QtBot, window: Window) -> None:
    window.session.use(window.session.source.presets[-1])
    assert window.gate.plane.achieved[2].text() == "= \u221e"
    assert window.gate.named.warning.toolTip() != ""
    spin = window.gate.plane.spins[2]
    spin.selectAll()
    qtbot.keyClicks(spin, "0.2")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert window.session.resolved.slab.thickness_m == pytest.approx(0.2, abs=0.01)


def test_hovering_reads_counts_row_column_and_depth(qtbot: QtBot, window: Window) -> None:
    wait_for_frame(qtbot, window)
    view = window.live.view
    window.menus.pause.setChecked(True)
    move_pointer(qtbot, view, view.rect().center())
    middle = window.live.frame.image[120, 160]
    text = window.live.pixel.text()
    assert "column 160  row 12" in text or "column 159  row 1" in text
    assert "depth 1 m" in text or "depth 1.000 m" in text
    counts = int(text.split("counts")[0].split()[-1])
    assert counts == pytest.approx(int(middle), rel=0.2)
    assert window.live.travelled.text().startswith("frame ")


def test_pause_holds_the_frame_and_goes_on(qtbot: QtBot, window: Window) -> None:
    wait_for_frame(qtbot, window)
    qtbot.keyClick(window, "p", Qt.KeyboardModifier.ControlModifier)
    assert window.session.paused
    held = window.live.frame.stamp.sequence
    made = window.session.stream.counters.made
    window.session.use(window.session.source.presets[1])
    qtbot.waitUntil(lambda: window.session.stream.counters.made > made)  # one that is not taken: the camera rests then
    assert window.live.frame.stamp.sequence == held
    qtbot.keyClick(window, "p", Qt.KeyboardModifier.ControlModifier)
    wait_for_frame(qtbot, window)
    assert window.live.frame.stamp.sequence > held


@pytest.mark.parametrize("suffix", [".tif", ".png"])
def test_snapshot_holds_the_counts_and_the_settings_that_made_them(
    qtbot: QtBot, window: Window, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait_for_frame(qtbot, window)
    window.session.pause(True)
    made_with = window.live.frame.stamp.applied
    window.session.use(window.session.source.presets[1])  # wanted since, but not what is on show
    path = tmp_path / f"held{suffix}"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), f"16-bit (*{suffix})"))
    with qtbot.waitSignal(window.saver.finished):
        window.menus.snapshot.trigger()
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert pixels.dtype == np.uint16
    np.testing.assert_array_equal(pixels, window.live.frame.image)
    facts = read_settings(path)
    assert facts["applied"]["delay_us"] == made_with.delay_us
    assert facts["applied"]["clock_mhz"] == pytest.approx(78.0)
    assert facts["scene"] == "A card before a wall"
    assert json.dumps(facts)
    assert str(path) in window.messages.text


def test_a_snapshot_that_cannot_be_written_says_so(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    wait_for_frame(qtbot, window)
    with qtbot.waitSignal(window.saver.failed):
        window.save_frame(tmp_path / "nowhere" / "frame.tif")
    assert "nowhere" in window.messages.text
    with qtbot.waitSignal(window.saver.failed):
        window.save_frame(tmp_path / "frame.jpg")
    assert "frame.jpg" in window.messages.text


def test_colour_sensor_is_chosen_and_kept_gate(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    before = gate_of(window)
    with qtbot.waitSignal(window.ready):
        window.menus.formats.box.activated.emit(1)
    assert window.session.source.camera.info.pixel_format == "bayer_rg12"
    assert gate_of(window) == before
    wait_for_frame(qtbot, window)
    for raw, wanted in ((False, (240, 320, 3)), (True, (240, 320))):
        path = tmp_path / f"colour-{raw}.tif"
        with qtbot.waitSignal(window.saver.finished):
            window.save_frame(path, raw)
        assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).shape == wanted


def test_a_scene_that_fails_leaves_the_old_one_running(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    running, held = window.session.source, gate_of(window)
    bad = tmp_path / "bad.toml"
    bad.write_text("nonsense = [1,")
    with qtbot.waitSignal(window.opener.failed):
        window.open(bad)
    assert "bad.toml" in window.messages.text
    assert "\n" not in window.messages.text
    assert window.session.source is running
    assert gate_of(window) == held
    assert window.menus.scenes.currentText() == "A card before a wall"
    assert window.progress.isHidden()
    sequence = window.live.frame.stamp.sequence
    qtbot.waitUntil(lambda: window.live.frame.stamp.sequence > sequence)
    good = tmp_path / "good.obj"
    good.write_text("v -1 -1 1\nv 1 -1 1\nv 1 1 1\nf 1 2 3\n")
    with qtbot.waitSignal(window.opener.opened):
        window.open(good)
    assert window.messages.text == ""


def test_a_late_picture_of_the_scene_before_is_not_the_first_of_the_next(
    qtbot: QtBot, window: Window, rig: Rig
) -> None:
    heard: list[object] = []
    window.live.first_image.connect(lambda: heard.append(window.live.frame))
    window.live.view.show_frame(window.live.view.image, "mono12")  # taken, and not painted yet
    window.session.adopt(make_source(rig))
    window.live.view.repaint()
    assert heard == []
    qtbot.waitUntil(lambda: len(heard) == 1)
    assert heard[0] is not None


def test_a_scene_with_an_impossible_gate_opens_and_says_so(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    path = tmp_path / "ball.toml"
    ball = '[[objects]]\ntype = "sphere"\ncentre_m = [0, 0, 1]\nradius_m = 0.2\n'
    path.write_text(f'{ball}[[gates]]\nname = "Flat"\ntilt_deg = 89\ndistance_m = 0.1\nthickness_m = 0.1\n')
    with qtbot.waitSignal(window.opener.opened):
        window.open(path)
    assert window.session.source.where == path
    assert "gates[0] ('Flat') is left out" in window.messages.text
    assert window.messages.kind == "warning"


def test_loading_shows_progress_and_cancels_without_a_trace(
    qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    go, running = threading.Event(), window.session.source

    def slow(where: Path, rig: Rig, options: Options, progress: Progress) -> object:
        progress.step(0.3, "Reading something large ...")
        assert go.wait(60)
        progress.step(0.6, "Rendering ...")
        raise AssertionError("a cancelled job must not get here")

    monkeypatch.setattr(opening, "open_source", slow)
    window.open(Path("large.toml"))
    qtbot.waitUntil(window.progress.isVisible)
    assert window.progress.bar.value() == 30
    with qtbot.waitSignal(window.opener.cancelled):
        qtbot.mouseClick(window.progress.cancel, Qt.MouseButton.LeftButton)
    go.set()
    assert window.progress.isHidden()
    assert window.session.source is running
    assert "cancelled" in window.messages.text


def test_dropping_a_scene_opens_it(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    mesh = tmp_path / "corner.obj"
    mesh.write_text("v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nf 1 2 3 4\n")
    mime = QMimeData()
    mime.setUrls([QUrl.fromLocalFile(str(mesh))])
    at, copy = QPoint(300, 300), Qt.DropAction.CopyAction
    held = (mime, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(window, QDragEnterEvent(at, copy, *held))
    with qtbot.waitSignal(window.ready):
        QApplication.sendEvent(window, QDropEvent(at.toPointF(), copy, *held))
    assert window.session.source.where == mesh
    assert window.menus.scenes.currentText() == window.session.source.scene.name
    wait_for_frame(qtbot, window)
    assert window.live.frame.image[120, 160] > 500  # the suggested gate lies on it


def test_everything_survives_a_restart(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> None:
    where = tmp_path / "kept.obj"
    where.write_text("v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nf 1 2 3 4\n")
    with qtbot.waitSignal(window.ready):
        window.open(where)
    window.set_theme("dark")
    with qtbot.waitSignal(window.opener.opened):
        window.menus.lit_rows.trigger()
    window.session.ask_wish(PlaneWish(5.0, 1.1, 0.3))
    window.session.ask_complement(True)
    window.docks.resizeDocks([window.docks.docks["slab"]], [600], Qt.Orientation.Horizontal)
    window.live.levels.srgb.setChecked(False)
    window.resize(1300, 850)
    qtbot.waitUntil(lambda: window.docks.docks["slab"].width() == 600)
    held = gate_of(window)
    window.close()
    again = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(again)
    again.show()
    with qtbot.waitSignal(again.ready):
        again.open_first(None)
    assert again.session.source.where == where
    assert gate_of(again) == held
    window.close()  # a second time writes nothing else
    assert again.session.intent == Intent(PlaneWish(5.0, 1.1, 0.3), complement=True)
    assert [spin.value() for spin in again.gate.plane.spins] == [5.0, 1.1, 0.3]
    if again.screen().availableGeometry().width() > 1400:  # a window is never restored larger than its screen
        assert (again.width(), again.height()) == (1300, 850)

        qtbot.waitUntil(lambda: again.docks.docks["slab"].width() == 600)
    assert not again.live.levels.srgb.isChecked()
    assert theme.is_dark(again.palette())
    assert again.session.source.options == Options(noise=False, rate_hz=math.inf, lit_rows=True)
    again.set_theme("light")
    again.close()


def test_a_saved_session_opens_first_in_a_new_window(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> None:
    where = tmp_path / "kept.obj"
    where.write_text("v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nf 1 2 3 4\n")
    with qtbot.waitSignal(window.ready):
        window.open(where)
    window.session.ask_wish(PlaneWish(5.0, 1.1, 0.3))
    kept, held = tmp_path / "kept.slopegate", gate_of(window)
    window.files.save_session(kept)
    window.close()
    again = Window(rig, tmp_path / "elsewhere" / "window.json")
    qtbot.addWidget(again)
    again.show()
    again.open_first(str(kept))
    qtbot.waitUntil(lambda: again.session.source is not None, timeout=60_000)
    assert again.session.source.where == where
    qtbot.waitUntil(lambda: gate_of(again) == held)
    assert not again.messages.isVisible()
    again.close_unasked()


def test_without_the_session_that_is_asked_for_the_first_scene_comes(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.slopegate"
    damaged.write_text('{"format": "slopegate-session", "scene"')
    made = Window(rig, tmp_path / "window.json")
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready, timeout=60_000):
        made.open_first(str(damaged))
    assert "damaged.slopegate cannot be opened as a session" in made.messages.text
    assert made.session.source is not None
    made.close_unasked()


def test_light_transport_opens_first_beside_a_scene(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    write_transport(tmp_path / "light", rig, small_scene(rig), 2)
    made = Window(rig, tmp_path / "window.json")
    qtbot.addWidget(made, before_close_func=Window.close_unasked)
    made.show()
    with qtbot.waitSignal(made.ready):
        made.open_first(str(tmp_path / "light"))
    panel = made.docks.docks["relight"].panel
    assert isinstance(panel, RelightPanel)
    qtbot.waitUntil(lambda: panel.relit is not None and not panel.busy)
    assert panel.relit is not None
    assert panel.relit.loaded.opened.folder.path == tmp_path / "light"
    assert made.session.source is not None
    assert not made.messages.isVisible()


def test_damaged_light_transport_that_opens_first_is_told(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "light").mkdir()
    (tmp_path / "light" / "transport.json").write_text("{", "utf-8")
    made = Window(rig, tmp_path / "window.json")
    qtbot.addWidget(made, before_close_func=Window.close_unasked)
    made.show()
    with qtbot.waitSignal(made.ready):
        made.open_first(str(tmp_path / "light"))
    qtbot.waitUntil(lambda: "transport.json cannot be used: it is cut short" in made.messages.text)
    assert made.session.source is not None


def test_a_remembered_scene_that_is_gone_gives_a_sentence_and_the_first_one(
    qtbot: QtBot, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "window.json"
    path.write_text(json.dumps({"scene": str(tmp_path / "gone.toml"), "noise": False, "rate_hz": 100}))
    made = Window(rig, path)
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready, timeout=60_000):
        made.open_first(None)
    assert "gone.toml" in made.messages.text
    assert made.session.source is not None
    made.close()


def test_without_a_ray_caster_the_window_begins_with_a_capture(
    qtbot: QtBot, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "embreex", None)
    made = Window(rig, tmp_path / "window.json")
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready, timeout=60_000):
        made.open_first(None)
    assert "rays are cast by the package embreex, which is not installed" in made.messages.text
    assert made.session.source is not None
    assert made.session.source.scene.capture is not None
    made.close()


def test_damaged_preferences_give_a_warning_and_a_window(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.write_text('{"geometry": "\u00fc%%%", "layouts": {"gate": "AAAA"}, "workspace": "kitchen"}')
    odd = Window(rig, path)
    qtbot.addWidget(odd)
    odd.show()
    odd.close()
    path.write_text("{broken")
    made = Window(rig, path)
    qtbot.addWidget(made)
    made.show()
    assert "window.json remembers of the window cannot be used" in made.messages.text
    made.close()
    assert json.loads(path.read_text())["theme"] == "system"


def test_a_line_time_camera_gets_a_line_time_control(qtbot: QtBot, tmp_path: Path) -> None:
    rig = small_rig(LineTimes(5.0, 200.0, 0.01))
    made = Window(rig, tmp_path / "window.json")
    qtbot.addWidget(made)
    made.show()
    with qtbot.waitSignal(made.ready):
        made.session.adopt(make_source(rig))
    control = made.gate.settings.line
    assert control.label.text() == "&Line time"
    before = made.session.resolved.gate.line_time_us
    qtbot.keyClick(control.spin, Qt.Key.Key_Up)
    assert made.session.resolved.gate.line_time_us == pytest.approx(before + 0.01)
    made.close()


def test_every_mnemonic_is_one_of_a_kind(window: Window) -> None:
    for spec in PANELS:  # what a panel brings along when it is made
        assert window.docks.bring(spec.key) is not None
    names = [action.text() for action in window.menuBar().actions()]
    names += [widget.text() for kind in (QLabel, QAbstractButton) for widget in window.findChildren(kind)]
    names += [tabs.tabText(index) for tabs in window.docks.findChildren(QTabBar) for index in range(tabs.count())]
    keys = [name[name.index("&") + 1].lower() for name in names if "&" in name and "<" not in name]
    assert len(keys) > 15
    assert sorted(keys) == sorted(set(keys))
    assert all("&" in action.text() for action in window.menuBar().actions())


def test_the_gate_moved_while_the_sensor_is_exchanged_is_kept(qtbot: QtBot, window: Window) -> None:
    with qtbot.waitSignal(window.opener.opened):
        window.opener.reopen(Options(pixel_format="bayer_rg12", noise=False, rate_hz=math.inf))
        assert window.session.use(window.session.source.presets[1])
    assert window.session.intent == Intent(window.session.source.presets[1].settings)
    wait_for_frame(qtbot, window)
    assert lit(window) == (False, True)


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080)])
@pytest.mark.parametrize("name", ["light", "dark"])
def test_no_label_is_clipped(qtbot: QtBot, window: Window, size: tuple[int, int], name: str) -> None:
    window.set_theme(name)
    window.resize(*size)
    window.gate.plane.spins[0].setValue(20.0)
    wait_for_frame(qtbot, window)
    qtbot.waitUntil(lambda: (window.width(), window.height()) == size)

    def nothing_is_clipped() -> None:
        for label in window.findChildren(QLabel):
            if label.isVisible() and label.text() and not label.wordWrap() and not isinstance(label, ElidedLabel):
                metrics = label.fontMetrics()
                assert label.width() >= metrics.horizontalAdvance(label.text().replace("&", "")) - 1, label.text()
                assert label.height() >= metrics.height() - 2, label.text()

    qtbot.waitUntil(nothing_is_clipped)  # a text that has just grown gets its room by events
    view = window.live.view
    assert view.width() > 0.5 * window.width()
    assert view.height() > 0.5 * window.height()
    window.set_theme("light")


def test_the_camera_menu_marks_what_runs(qtbot: QtBot, window: Window) -> None:
    def marked() -> list[str]:
        menus, bar = (window.menus.formats, window.menus.rates), ("Format", "Rate")
        ticked = [one.text() for choice in menus for one in choice.menu.actions() if one.isChecked()]
        assert ticked == [window.findChild(QComboBox, name).currentText() for name in bar]
        return ticked

    def choose(name: str) -> None:
        next(one for one in window.menus.rates.menu.actions() if one.text() == name).trigger()

    assert marked() == ["Mono sensor", "Full speed"]
    with qtbot.waitSignal(window.opener.opened):
        choose("60 fps")
    assert marked() == ["Mono sensor", "60 fps"]
    choose("60 fps")
    assert marked() == ["Mono sensor", "60 fps"]
    with qtbot.waitSignal(window.opener.opened):
        window.menus.formats.box.activated.emit(1)
    assert marked() == ["Colour sensor", "60 fps"]


def test_a_rate_that_is_not_in_the_list_is_typed(qtbot: QtBot, window: Window) -> None:
    box = window.menus.rates.box

    def answer(text: str) -> None:
        dialog = QApplication.activeModalWidget()
        if not isinstance(dialog, QDialog):
            QTimer.singleShot(10, lambda: answer(text))
            return
        spin = dialog.findChild(NumberBox)
        spin.selectAll()
        qtbot.keyClicks(spin, text)
        qtbot.keyClick(spin, Qt.Key.Key_Enter if text else Qt.Key.Key_Escape)

    answer("")
    box.activated.emit(box.findText("Other ..."))
    assert box.currentText() == "Full speed"
    answer("24.5")
    with qtbot.waitSignal(window.opener.opened):
        box.activated.emit(box.findText("Other ..."))
    assert box.currentText() == "24.5 fps"
    assert window.session.source.camera.info.modes.rate_hz == 24.5
    assert window.session.source.options.rate_hz == 24.5


def test_the_plots_stay_readable_in_the_smallest_window(qtbot: QtBot, window: Window) -> None:
    """They are scrolled there; and the window fits 1920 x 1080 at scale 2, with a title bar and a task bar."""
    timing = window.docks.bring("timing")
    window.resize(1, 1)
    assert timing is not None
    qtbot.waitUntil(lambda: timing.height() >= 200 and timing.width() >= 280)
    plot = timing.findChild(pg.PlotWidget)
    qtbot.waitUntil(lambda: plot.height() >= 100)
    assert window.width() <= 960
    assert window.height() <= 470


@pytest.mark.parametrize("language", ["de_DE", "en_US", "ar_EG", "de_CH"])
@pytest.mark.parametrize("mark", [".", ","])
def test_a_typed_distance_is_the_same_in_every_language(
    qtbot: QtBot, rig: Rig, tmp_path: Path, language: str, mark: str
) -> None:
    before = QLocale()
    QLocale.setDefault(QLocale(language))
    try:
        window = Window(rig, tmp_path / "window.json")
        qtbot.addWidget(window)
        with qtbot.waitSignal(window.ready):
            window.show()
            window.session.adopt(make_source(rig))
        for index, typed in ((1, f"1{mark}250"), (2, f"0{mark}05")):
            spin = window.gate.plane.spins[index]
            spin.selectAll()
            qtbot.keyClicks(spin, typed)
            qtbot.keyClick(spin, Qt.Key.Key_Return)
        wish = window.session.intent.wish
        assert (wish.distance_m, wish.thickness_m) == (1.25, 0.05)
        assert [spin.text() for spin in window.gate.plane.spins[1:]] == ["1.250 m", "0.0500 m"]
        assert all(box.accessibleName() for box in window.findChildren(NumberBox))
        window.close()
    finally:
        QLocale.setDefault(before)


def test_ctrl_z_brings_the_gate_from_before_back_wherever_the_focus_is(qtbot: QtBot, window: Window) -> None:
    control, redo = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
    before, spin = gate_of(window), window.gate.settings.delay.spin
    spin.setFocus()
    spin.selectAll()
    qtbot.keyClicks(spin, "2345")
    qtbot.keyClick(spin, Qt.Key.Key_Z, control)  # of what is typed, which is not the gate yet
    assert gate_of(window) == before
    spin.selectAll()
    qtbot.keyClicks(spin, "2345")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    after = gate_of(window)
    assert after["delay"] == 2345
    assert spin.hasFocus()
    qtbot.keyClick(spin, Qt.Key.Key_Z, control)
    assert gate_of(window) == before
    assert spin.value() == before["delay"]
    qtbot.keyClick(window.live.view, Qt.Key.Key_Z, control | redo)
    assert gate_of(window) == after
    assert window.menus.undo.isEnabled()
    assert not window.menus.redo.isEnabled()
