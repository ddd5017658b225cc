"""Measure depth in the real window, look at it, turn it, save it; and the proximity alarm beside it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from questions import answer_next
from rigs import calibrated
from settings_inside import read_settings
from slopegate.app.panels.alarm import AlarmPanel
from slopegate.app.panels.depth import DepthPanel
from slopegate.app.panels.depth_picture import CloudPicture, coloured, depth_range
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Intent
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.gating.plan import plan
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.stream.search_run import SearchTap

LEFT = Qt.MouseButton.LeftButton


def source_of(rig: Rig, moving: bool = False) -> Source:
    """A wall at 2 m and a ball at 1.2 m; if moving, it comes to 0.7 m within half a second, goes back and rests, again
    and again."""
    ways = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, -0.5], [0, 0, 0]])
    path = KeyFrames(np.array([0.0, 0.5, 1.0, 1.5]), ways, np.stack([np.eye(3)] * 4), (0.0, 0.0, 1.2))
    ball = Sphere("ball", (0.0, 0.0, 1.2), 0.15, motion=path if moving else None)
    wall = plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn())
    scene = Scene("A ball", objects=(wall, ball), ambient=0.02)
    return build_source(Path("ball.toml"), rig, scene, Options(rate_hz=60.0), Progress(lambda share, text: None))


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig) -> Iterator[DepthPanel]:
    made = DepthPanel(window.desk)
    qtbot.addWidget(made)
    made.resize(540, 270)
    made.show()
    window.session.adopt(source_of(rig))
    yield made
    made.close()


def hover(widget: QWidget, at: QPoint) -> None:
    """A move without a button: the offscreen platform sends such moves to the topmost window."""
    none = Qt.MouseButton.NoButton
    where, everywhere = QPointF(at), QPointF(widget.mapToGlobal(at))
    move = QMouseEvent(QEvent.Type.MouseMove, where, everywhere, none, none, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(widget, move)


def begin_long_sweep(qtbot: QtBot, window: Window, panel: DepthPanel) -> None:
    """One of half a minute, and back when it holds the gate."""
    panel.repeats.setValue(64)
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: window.session.stream is not None and window.session.stream.tapped is not None)


def test_a_number_that_cannot_be_is_refused_in_a_sentence(qtbot: QtBot, window: Window) -> None:
    panel = window.docks.bring("depth")
    assert isinstance(panel, DepthPanel)
    before = panel.nearest.value()
    panel.nearest.selectAll()
    qtbot.keyClicks(panel.nearest, "-5")
    qtbot.keyClick(panel.nearest, Qt.Key.Key_Return)
    assert panel.nearest.value() == before
    assert window.messages.text == f"Nearest: -5 is not possible: 0.1 to 10 m. It is still {before:.2f} m."


def test_a_click_measures_depth_and_the_gate_comes_back(qtbot: QtBot, window: Window, panel: DepthPanel) -> None:
    source, before = window.session.source, window.session.resolved
    assert source is not None
    assert before is not None
    rows: list[np.ndarray] = []
    window.desk.swept.connect(lambda: rows.append(window.desk.projector_row))
    qtbot.mouseClick(panel.start, LEFT)
    assert panel.busy
    assert panel.cancel.isEnabled()
    qtbot.waitUntil(lambda: panel.result is not None)
    result = panel.result
    assert result is not None
    assert result.error is not None
    assert result.error.known_share > 0.99
    # a flat wall at 2 m is within half a row of the projector: 0.005 1/m
    assert result.error.p95_mm < 21
    assert f"{result.found.frames} settings; equal steps take {result.found.plain_frames}" in panel.report.text()
    assert "Error: median" in panel.report.text()
    assert np.count_nonzero(rows[0] >= 0) > 0.9 * np.count_nonzero(source.buffers.projector_row >= 0)
    assert window.session.resolved == before
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame.stamp.applied == before.sent)
    assert not panel.busy
    assert panel.start.isEnabled()


@pytest.fixture
def known_panel(qtbot: QtBot, window: Window, rig: Rig, panel: DepthPanel) -> DepthPanel:
    """On a rig that was calibrated, with a finished sweep."""
    window.session.adopt(source_of(calibrated(rig)))
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: panel.result is not None)
    return panel


def test_a_calibrated_rig_tells_how_well_each_depth_is_known(
    qtbot: QtBot, known_panel: DepthPanel, tmp_path: Path
) -> None:
    panel, picture = known_panel, known_panel.picture
    assert panel.result is not None
    errors = panel.result.errors
    assert errors is not None
    assert "Standard error: median " in panel.report.text()
    qtbot.waitUntil(panel.by_error.isVisible)
    place = picture.place().toRect()
    hover(picture, place.center())
    found = re.fullmatch(
        r"column (\d+)  row (\d+)  depth (1\.\d+) \u00b1 (0\.\d+) m",
        panel.pointer.text(),
    )
    assert found is not None, panel.pointer.text()
    assert float(found[4]) == pytest.approx(float(errors.total_m[int(found[2]), int(found[1])]), rel=0.05)
    deep = picture.grab().toImage()
    qtbot.mouseClick(panel.by_error, LEFT)
    assert panel.stack.currentWidget() is picture
    wrong = picture.grab().toImage()
    # near is red as a depth, and blue as an error, which grows with the depth
    near, far = place.center(), place.topLeft() + QPoint(9, 9)
    assert deep.pixelColor(near).red() > deep.pixelColor(far).red()
    assert wrong.pixelColor(near).blue() > wrong.pixelColor(near).red()
    assert wrong.pixelColor(far).red() > wrong.pixelColor(far).blue()
    hover(picture, place.center())
    assert "\u00b1" in panel.pointer.text()
    panel.save_to(tmp_path / "ball.npy")
    qtbot.waitUntil((tmp_path / "ball.npy").exists)
    np.testing.assert_array_equal(np.load(tmp_path / "ball_error.npy"), errors.total_m)


def test_errors_are_offered_only_where_they_are_known(
    qtbot: QtBot, window: Window, rig: Rig, known_panel: DepthPanel
) -> None:
    panel = known_panel
    qtbot.mouseClick(panel.by_error, LEFT)
    window.session.adopt(source_of(rig))
    assert not panel.by_error.isVisible()
    assert panel.flat.isChecked()
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: panel.result is not None)
    assert panel.result is not None
    assert panel.result.errors is None
    assert not panel.by_error.isVisible()
    assert "tandard error" not in panel.report.text()
    hover(panel.picture, panel.picture.place().toRect().center())
    assert re.fullmatch(r"column \d+  row \d+  depth 1\.\d+ m", panel.pointer.text())


def test_what_is_shown_can_be_read_turned_and_saved(
    qtbot: QtBot, window: Window, panel: DepthPanel, tmp_path: Path
) -> None:
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: panel.result is not None)
    picture = panel.picture
    place = picture.place().toRect()
    hover(picture, place.center())
    assert "depth 1.0" in panel.pointer.text()
    middle, corner = (
        picture.grab().toImage().pixelColor(at) for at in (place.center(), place.topLeft() + QPoint(9, 9))
    )
    assert middle.red() > middle.blue()
    assert corner.blue() > corner.red()
    qtbot.mouseClick(panel.solid, LEFT)
    assert panel.stack.currentWidget() is panel.cloud
    first = panel.cloud.grab().toImage()
    at = panel.cloud.rect().center()
    qtbot.mousePress(panel.cloud, LEFT, pos=at)
    move_pointer(qtbot, panel.cloud, at + QPoint(60, 10))
    qtbot.mouseRelease(panel.cloud, LEFT, pos=at + QPoint(60, 10))
    qtbot.keyClick(panel.cloud, Qt.Key.Key_Plus)
    assert panel.cloud.zoom > 1
    assert panel.cloud.grab().toImage() != first
    panel.save_to(tmp_path / "depth.tif")
    qtbot.waitUntil(lambda: window.messages.text == f"Saved {tmp_path / 'depth.tif'}")
    assert read_settings(tmp_path / "depth.tif")["scene"] == "A ball"


def test_what_was_swept_opens_as_a_scene(qtbot: QtBot, window: Window, panel: DepthPanel, tmp_path: Path) -> None:
    assert not panel.keep.isEnabled()
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: panel.result is not None)
    swept, result = window.session.source, panel.result
    assert swept is not None
    assert result is not None
    panel.keep_as(tmp_path / "ball")
    assert window.messages.text == "Saving ball ...", "at once: it may take seconds"
    qtbot.waitUntil(lambda: window.messages.text == f"Saved {tmp_path / 'ball'}")
    assert window.messages.isVisible()
    hover(panel.picture, panel.picture.place().toRect().center())
    assert window.messages.text == f"Saved {tmp_path / 'ball'}", "the pointer on its way takes nothing away"
    panel.keep_as(tmp_path / "ball" / "depth.exr" / "below")
    qtbot.waitUntil(lambda: window.messages.kind == "error" and "below" in window.messages.text)
    window.open(tmp_path / "ball")
    qtbot.waitUntil(lambda: window.session.source is not swept)
    opened = window.session.source
    assert opened is not None
    assert opened.rig == swept.rig
    assert opened.scene.name == "A ball (swept)"
    assert [one.settings for one in opened.scene.gates] == [one.settings for one in swept.presets]
    assert opened.buffers is not None
    np.testing.assert_allclose(opened.buffers.inverse_depth, result.found.inverse_depth, rtol=1e-6)


def test_a_sweep_can_be_cancelled_and_ends_with_its_scene(
    qtbot: QtBot, window: Window, panel: DepthPanel, rig: Rig
) -> None:
    begin_long_sweep(qtbot, window, panel)
    qtbot.mouseClick(panel.cancel, LEFT)
    assert not panel.busy
    assert panel.report.text().startswith("Cancelled")
    qtbot.waitUntil(lambda: window.session.stream is not None and window.session.stream.tapped is None)
    begin_long_sweep(qtbot, window, panel)
    window.session.adopt(source_of(rig, moving=True))
    assert not panel.busy
    assert panel.result is None
    qtbot.mouseClick(panel.start, LEFT)
    assert panel.report.text().startswith("Something moves")


def test_a_sweep_beside_another_says_so(qtbot: QtBot, window: Window, panel: DepthPanel) -> None:
    stream = window.session.stream
    assert stream is not None
    tap = SearchTap("mono12", gate(20.0, 2000.0, 500.0))
    stream.attach(tap)
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: not panel.busy)
    assert "something else sets the gate" in panel.report.text()
    stream.detach(tap)


def test_near_is_red_far_is_blue_and_unknown_is_grey() -> None:
    inverse = np.array([[0.5, 2.0, 0.0, 1.0]], np.float32)
    pixels = coloured(inverse, (0.5, 2.0))
    red, blue = (pixels >> 16) & 255, pixels & 255
    assert blue[0, 0] > red[0, 0]
    assert red[0, 1] > blue[0, 1]
    assert pixels[0, 2] == 0xFF303030
    assert np.all(pixels >> 24 == 255)


def test_a_flat_or_empty_map_has_a_range_all_the_same() -> None:
    low, high = depth_range(np.full((3, 3), 1.0, np.float32))
    assert low < 1.0 < high
    low, high = depth_range(np.zeros((3, 3), np.float32))
    assert 0 < low < high


def test_the_nearer_point_hides_the_farther(qtbot: QtBot) -> None:
    cloud = CloudPicture()
    qtbot.addWidget(cloud)
    cloud.resize(200, 200)
    points = np.array([[0, 0, 1.0], [0, 0, 2.0], [-0.5, 0, 1.5], [0.5, 0, 1.5]], np.float32)
    cloud.yaw_deg = cloud.pitch_deg = 0.0
    for order in ([0, 1, 2, 3], [1, 0, 2, 3]):
        cloud.show_points(points[order], 1 / points[order, 2])
        centre = cloud.grab().toImage().pixelColor(100, 100)
        assert centre.red() > centre.blue()


@pytest.fixture
def alarm(qtbot: QtBot, window: Window, rig: Rig) -> Iterator[AlarmPanel]:
    made = AlarmPanel(window.desk)
    qtbot.addWidget(made)
    made.resize(540, 270)
    made.show()
    window.session.adopt(source_of(rig, moving=True), Intent(plan(rig, 0.0, 0.7, 0.35)))
    qtbot.waitUntil(lambda: window.live.frame is not None)
    yield made
    made.close()


def learn(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    """While a frame without the ball is on show."""
    qtbot.waitUntil(lambda: bool(window.live.view.image.max() < 100))
    qtbot.mouseClick(alarm.learn, LEFT)


def set_off_by_nothing(alarm: AlarmPanel) -> None:
    """Levels that the ball does not reach."""
    alarm.level.setValue(4000)
    alarm.share.setValue(100.0)


def test_what_crosses_the_sheet_sets_the_alarm_off_and_it_stays(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, tmp_path: Path
) -> None:
    learn(qtbot, window, alarm)
    with qtbot.waitSignal(alarm.tripped) as caught:
        qtbot.mouseClick(alarm.arm, LEFT)
        assert alarm.state.text() == "Armed"
        assert not alarm.level.isEnabled()
    trip = caught.args[0]
    assert alarm.state.text() == "ALARM"
    assert f"frame {trip.sequence}" in alarm.detail.text()
    assert not alarm.preview.pixmap().isNull()
    alarm.save_to(tmp_path / "caught.tif")
    qtbot.waitUntil(lambda: "Saved" in alarm.where.text() or "Saved" in alarm.where.toolTip())
    facts = read_settings(tmp_path / "caught.tif")
    assert facts["sequence"] == trip.sequence
    assert facts["alarm_share"] == trip.share
    # the ball goes back and comes again, and each time is kept
    qtbot.waitUntil(lambda: len(alarm.events) >= 3)
    assert alarm.state.text() == "ALARM"
    first, second = (event.trip for event in alarm.events[:2])
    assert first == trip
    assert second.time_s - first.time_s > 0.5
    assert [alarm.list.item(row).text() for row in (0, 1)] == [event.title for event in alarm.events[:2]]
    alarm.list.setCurrentRow(0)
    assert alarm.detail.text() == alarm.events[0].text
    qtbot.mouseClick(alarm.reset, LEFT)
    assert alarm.state.text() == "Not armed"
    assert alarm.alarm is None
    assert not alarm.preview.pixmap().isNull()
    qtbot.mouseClick(alarm.clear, LEFT)
    assert alarm.list.count() == 0
    assert alarm.preview.pixmap().isNull()


def test_another_gate_is_no_alarm_and_its_own_is_watched_again(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    """A gate that shows the wall holds the alarm, however bright that is."""
    learn(qtbot, window, alarm)
    own = window.session.intent
    with qtbot.waitSignal(alarm.tripped):
        qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.mouseClick(alarm.reset, LEFT)
    qtbot.mouseClick(alarm.clear, LEFT)
    alarm.share.setValue(60.0)  # more than the ball covers
    qtbot.mouseClick(alarm.arm, LEFT)
    for wall in (gate(own.wish.line_time_us, 1000.0, 4000.0), gate(own.wish.line_time_us, 8333.0, 16666.0)):
        window.session.ask_wish(wall)
        qtbot.waitUntil(lambda: alarm.state.text() == "Held")
        sent = window.session.resolved.sent
        qtbot.waitUntil(lambda sent=sent: window.live.frame.stamp.applied == sent)
        assert float((window.live.frame.image > alarm.level.value()).mean()) > 0.6
    assert alarm.arm.isEnabled()
    judged = alarm.alarm.frames
    window.session.ask(own)
    qtbot.waitUntil(lambda: alarm.alarm.frames > judged + 10)
    assert alarm.state.text() == "Armed"
    assert alarm.events == ()


def test_pictures_are_saved_by_themselves_up_to_a_limit(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("slopegate.app.panels.alarm.MOST_SAVED", 2)
    alarm.keep_in(tmp_path / "events")
    learn(qtbot, window, alarm)
    with qtbot.waitSignal(window.desk.warned) as told:
        qtbot.mouseClick(alarm.arm, LEFT)
    assert "2 pictures of" in told.args[0]
    assert "no more are until it is armed again" in told.args[0]
    qtbot.waitUntil(lambda: len(list((tmp_path / "events").glob("*.tif"))) == 2)
    facts = [read_settings(path) for path in sorted((tmp_path / "events").glob("*.tif"))]
    assert [fact["sequence"] for fact in facts] == [event.trip.sequence for event in alarm.events[:2]]
    assert facts[0]["alarm_time"] == alarm.events[0].when.isoformat(timespec="milliseconds")


def test_only_so_many_frames_stay_in_memory_and_so_many_events_in_the_list(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn(qtbot, window, alarm)
    monkeypatch.setattr("slopegate.app.panels.alarm.MOST_EVENTS", 3)
    monkeypatch.setattr("slopegate.app.panels.alarm.MOST_BYTES", window.live.frame.image.nbytes)
    seen = []
    alarm.tripped.connect(seen.append)
    qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.waitUntil(lambda: len(seen) >= 4)
    assert [event.trip for event in alarm.events] == seen[-3:]
    assert alarm.list.count() == 3
    assert [event.frame is None for event in alarm.events] == [True, True, False]
    alarm.list.setCurrentRow(0)
    assert not alarm.preview.pixmap().isNull()
    assert not alarm.save.isEnabled()


def test_each_scene_keeps_its_level(qtbot: QtBot, window: Window, alarm: AlarmPanel, rig: Rig) -> None:
    alarm.level.setValue(777)
    alarm.share.setValue(1.5)
    other = source_of(rig)
    window.session.adopt(replace(other, where=Path("another.toml")))
    assert (alarm.level.value(), alarm.share.value()) == (300, 0.05)
    alarm.level.setValue(123)
    window.session.adopt(source_of(rig, moving=True))
    assert (alarm.level.value(), alarm.share.value()) == (777, 1.5)
    again = AlarmPanel(window.desk)
    qtbot.addWidget(again)
    assert again.level.value() == 777
    again.close()


def test_a_hidden_alarm_goes_on_watching_and_is_heard(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    learn(qtbot, window, alarm)
    qtbot.mouseClick(alarm.arm, LEFT)
    alarm.hide()
    qtbot.waitUntil(lambda: window.messages.text.startswith("ALARM at "))
    assert "of the region was bright" in window.messages.text
    alarm.show()
    assert alarm.state.text() == "ALARM"


def test_only_the_chosen_region_is_watched(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    qtbot.mouseClick(alarm.choose, LEFT)
    tool = alarm.tool
    first, last = tool.to_view(0, 0).toPoint(), tool.to_view(40, 40).toPoint()
    qtbot.mousePress(tool, LEFT, pos=first)
    qtbot.mouseRelease(tool, LEFT, pos=last)
    assert not tool.active
    assert not alarm.choose.isChecked()
    qtbot.mouseClick(alarm.arm, LEFT)
    assert alarm.alarm is not None
    watch = alarm.alarm.watch
    assert (watch.x0, watch.y0) == (0, 0)
    assert watch.x1 == pytest.approx(40, abs=1)
    frames = alarm.alarm.frames
    qtbot.waitUntil(lambda: alarm.alarm is not None and alarm.alarm.frames > frames + 80)
    assert alarm.alarm.trip is None


def reopen(qtbot: QtBot, window: Window, **otherwise: object) -> None:
    """As the Camera menu does."""
    with qtbot.waitSignal(window.opener.opened):
        window.opener.reopen(replace(window.session.source.options, **otherwise))


def test_what_set_it_off_outlives_another_sensor_and_another_scene(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, rig: Rig, tmp_path: Path
) -> None:
    learn(qtbot, window, alarm)
    with qtbot.waitSignal(alarm.tripped) as caught:
        qtbot.mouseClick(alarm.arm, LEFT)
    noise = window.session.source.options.noise
    reopen(qtbot, window, noise=not noise)
    assert alarm.state.text() == "Held"
    assert "noise" in alarm.detail.text()
    assert alarm.arm.isEnabled()
    window.session.adopt(source_of(rig))
    qtbot.waitUntil(lambda: window.live.frame is not None)
    assert alarm.state.text() == "ALARM"
    assert not alarm.preview.pixmap().isNull()
    alarm.list.setCurrentRow(0)
    alarm.save_to(tmp_path / "caught.tif")
    qtbot.waitUntil((tmp_path / "caught.tif").exists)
    assert read_settings(tmp_path / "caught.tif")["sequence"] == caught.args[0].sequence
    qtbot.mouseClick(alarm.reset, LEFT)
    assert alarm.state.text() == "Not armed"
    assert alarm.arm.isEnabled()


def test_an_armed_alarm_goes_on_with_the_same_scene_through_another_sensor(
    qtbot: QtBot, window: Window, alarm: AlarmPanel
) -> None:
    set_off_by_nothing(alarm)
    alarm.tool.chosen.emit(0, 0, 40, 40)
    qtbot.mouseClick(alarm.arm, LEFT)
    watch, old = alarm.alarm.watch, window.session.stream
    reopen(qtbot, window, rate_hz=30.0)
    assert window.session.stream is not old
    assert alarm.state.text() == "Armed"
    assert alarm.alarm.watch == watch
    qtbot.waitUntil(lambda: alarm.alarm.frames > 0)


def test_an_alarm_armed_while_there_is_no_camera_is_armed_when_it_comes(
    qtbot: QtBot, window: Window, alarm: AlarmPanel
) -> None:
    set_off_by_nothing(alarm)
    window.session.release()
    qtbot.mouseClick(alarm.arm, LEFT)
    assert alarm.state.text() == "Waiting"
    reopen(qtbot, window, rate_hz=30.0)
    assert alarm.state.text() == "Armed"
    assert alarm.alarm is not None


def test_an_alarm_ends_with_its_scene_and_says_so(qtbot: QtBot, window: Window, alarm: AlarmPanel, rig: Rig) -> None:
    set_off_by_nothing(alarm)
    qtbot.mouseClick(alarm.arm, LEFT)
    with qtbot.waitSignal(window.desk.warned) as told:
        window.session.adopt(source_of(rig))
    assert told.args == ["The alarm is off, nothing is watched any more: another scene or camera is looked at."]
    assert alarm.alarm is None
    assert alarm.arm.isEnabled()


def test_an_armed_alarm_lets_a_sweep_have_the_gate_and_goes_on_after_it(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, panel: DepthPanel
) -> None:
    set_off_by_nothing(alarm)
    qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.waitUntil(lambda: alarm.alarm.frames > 0)
    alarm.hide()
    told: list[str] = []
    window.desk.warned.connect(told.append)
    begin_long_sweep(qtbot, window, panel)
    qtbot.waitUntil(lambda: alarm.state.text() == "Held")
    assert alarm.detail.text() == "The depth sweep sets the gate: the alarm goes on when its own gate is back."
    assert window.messages.text == f"The alarm is held. {alarm.detail.text()}"
    assert panel.busy
    judged = alarm.alarm.frames
    qtbot.mouseClick(panel.cancel, LEFT)
    qtbot.waitUntil(lambda: alarm.alarm.frames > judged + 10)
    qtbot.waitUntil(lambda: alarm.state.text() == "Armed")
    assert alarm.events == ()
    assert len(told) == 1, "nothing else on the way back"
    assert window.messages.text == ""


def test_an_alarm_is_armed_during_a_sweep_for_the_gate_that_comes_back(
    qtbot: QtBot, window: Window, alarm: AlarmPanel, panel: DepthPanel
) -> None:
    set_off_by_nothing(alarm)
    begin_long_sweep(qtbot, window, panel)
    qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.waitUntil(lambda: alarm.state.text() == "Held")
    qtbot.mouseClick(panel.cancel, LEFT)
    qtbot.waitUntil(lambda: alarm.alarm.frames > 10)


def test_quitting_asks_while_the_alarm_is_armed(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    set_off_by_nothing(alarm)
    qtbot.mouseClick(alarm.arm, LEFT)
    asked = answer_next("Let it go on")
    window.close()
    assert [text.split(".")[0] for text in asked] == ["Quitting ends the armed alarm"]
    assert window.isVisible()
    assert alarm.state.text() == "Armed"
    assert window.session.held("source") is None
    qtbot.mouseClick(alarm.reset, LEFT)
    assert window.session.held("program") is None


def test_switching_parts_of_the_light_is_no_alarm(qtbot: QtBot, window: Window, alarm: AlarmPanel) -> None:
    """Direct light that is shown again is brighter than anything that there was without it."""
    session, view = window.session, window.live.view
    light = session.source.rendered.smooth
    everything = light.shown
    session.ask_wish(gate(session.intent.wish.line_time_us, 8333.0, 16666.0))
    alarm.level.setValue(150)
    alarm.share.setValue(60.0)

    def bright() -> bool:
        return float((view.image > 150).mean()) > 0.6

    light.show(everything - {"direct"})
    qtbot.waitUntil(lambda: not bright())
    qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.waitUntil(lambda: alarm.alarm.frames > 3)
    light.show(everything)
    qtbot.waitUntil(lambda: alarm.state.text() == "Held")
    assert alarm.detail.text().startswith("Other parts of the light are shown")
    qtbot.waitUntil(bright)
    judged = alarm.alarm.frames
    light.show(everything - {"direct"})
    qtbot.waitUntil(lambda: alarm.alarm.frames > judged + 10)
    assert alarm.state.text() == "Armed"
    assert alarm.events == ()
    light.show(everything)
    qtbot.waitUntil(lambda: alarm.state.text() == "Held")
    qtbot.mouseClick(alarm.arm, LEFT)
    qtbot.waitUntil(lambda: alarm.alarm is not None and alarm.alarm.trip is not None)
