"""The calibration in the real window: a practice rig, a connected camera, pictures of others, and what goes wrong."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from clipping import clipped, settle
from slopegate.app.panels.calibrate import CHART, POSES, RESULT, TIME, CalibratePanel
from slopegate.app.panels.calibrate_chart import CONNECTED, PICTURES, PRACTICE
from slopegate.app.panels.calibrate_device import PracticeDevice
from slopegate.app.session.device_source import device_source
from slopegate.app.session.source import Options
from slopegate.app.widgets.theme import DARK, LIGHT
from slopegate.app.window.window import Window
from slopegate.core.calibration.advice import next_pose
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.chart_scene import ChartPose
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.uncertainty import numbers_of
from slopegate.drivers.calibrations.pictures import pose_folders
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.cameras.believed import PULSE_US
from slopegate.drivers.contract.families import Address
from slopegate.drivers.files.rig_files import load_rig

LEFT = Qt.MouseButton.LeftButton
CHART_TEXT = "6x5:40"


@pytest.fixture
def panel(qtbot: QtBot, window: Window, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CalibratePanel:
    monkeypatch.setattr("slopegate.app.panels.calibrate.secrets.randbelow", lambda _: 7)  # the same rig every time
    made = window.docks.bring("calibrate")
    assert isinstance(made, CalibratePanel)
    type_text(qtbot, made.chart.text, CHART_TEXT)
    type_text(qtbot, made.chart.place.where, str(tmp_path / "poses"))
    return made


def type_text(qtbot: QtBot, field: QWidget, text: str) -> None:
    field.selectAll()  # type: ignore[attr-defined]
    qtbot.keyClicks(field, text)


def click(qtbot: QtBot, widget: QWidget) -> None:
    qtbot.waitUntil(lambda: widget.isVisible() and widget.isEnabled())
    qtbot.mouseClick(widget, LEFT)


def choose(panel: CalibratePanel, key: str) -> None:
    panel.chart.device.setCurrentIndex(panel.chart.device.findData(key))
    assert panel.chart.chosen == key


def begin(qtbot: QtBot, panel: CalibratePanel) -> None:
    click(qtbot, panel.chart.begin)
    assert panel.step == POSES
    qtbot.waitUntil(lambda: panel.run.work is not None and not panel.run.busy)


def take(qtbot: QtBot, panel: CalibratePanel) -> None:
    """Hold the chart where it is wanted, and take that pose."""
    work = panel.run.work
    assert work is not None
    before = len(work.views.views)
    click(qtbot, panel.poses.go_there)
    qtbot.waitUntil(lambda: panel.poses.picture._marks_over.there)
    click(qtbot, panel.poses.take)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert len(work.views.views) == before + 1, panel.poses.status.text()


@pytest.fixture
def practised(qtbot: QtBot, panel: CalibratePanel) -> CalibratePanel:
    """With four views of a practice rig."""
    begin(qtbot, panel)
    for _ in range(4):
        take(qtbot, panel)
    return panel


def test_a_practice_rig_is_calibrated_and_saved(qtbot: QtBot, practised: CalibratePanel, tmp_path: Path) -> None:
    panel = practised
    work = panel.run.work
    assert work is not None
    assert isinstance(work.device, PracticeDevice)
    told = [panel.poses.list.item(row).text() for row in range(4)]
    assert [text in {f"pose_{k:02d}: good", f"pose_{k:02d}: fair"} for k, text in enumerate(told, 1)] == [True] * 4
    assert len(pose_folders(tmp_path / "poses")) == 4
    assert "distances to" in panel.poses.told.text()
    assert panel.poses.camera._count is not None
    assert panel.poses.camera._count.sum() > 60
    click(qtbot, panel.poses.done)
    assert panel.step == RESULT
    assert work.result is not None
    assert work.response is not None
    assert work.response.gamma == pytest.approx(1.0, abs=0.01)
    assert re.search(r"blur [\d.]+ \u00b1 .* gamma (1\.00|0\.99)\d* \u00b1 ", panel.result.shown.text())
    assert work.result.geometry.rms_px < 0.2
    assert panel.result.table.topLevelItemCount() == 24
    found, true = (numbers_of(rig)[:24] for rig in (work.result.rig, work.device.truth))
    assert np.median(np.abs(found - true) / work.result.geometry.standard_errors) < 2
    assert float(panel.result.table.topLevelItem(0).text(3)) == pytest.approx(true[0], rel=1e-3)
    assert not panel.result.apply.isEnabled()
    panel.save_rig(tmp_path / "mine")
    qtbot.waitUntil(lambda: "Saved" in panel.result.status.text())
    assert numbers_of(load_rig(tmp_path / "mine.toml"))[:24] == pytest.approx(found)
    assert load_rig(tmp_path / "mine.toml").name == "mine"


def test_every_table_of_the_result_is_filled(qtbot: QtBot, practised: CalibratePanel) -> None:
    panel = practised
    click(qtbot, panel.steps[RESULT])
    for key, word in (("views", "pose_02"), ("facts", CHART_TEXT), ("numbers", "camera fx, px")):
        panel.result.kind.setCurrentIndex(panel.result.kind.findData(key))
        table = panel.result.table
        texts = [
            table.topLevelItem(row).text(column)
            for row in range(table.topLevelItemCount())
            for column in range(table.columnCount())
        ]
        assert word in texts


def test_a_view_is_left_out_and_taken_in_again(qtbot: QtBot, window: Window, practised: CalibratePanel) -> None:
    panel = practised
    work = panel.run.work
    assert work is not None
    panel.poses.list.setCurrentRow(1)
    click(qtbot, panel.poses.out)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert panel.poses.list.item(1).text() == "pose_02: left out"
    assert work.result is not None
    assert len(work.result.geometry.views) == 3
    panel.result.kind.setCurrentIndex(panel.result.kind.findData("views"))
    table = panel.result.table
    assert table.topLevelItem(3).text(0) == "pose_02: left out as asked"
    assert table.isFirstColumnSpanned(3, table.rootIndex())  # a reason makes no column of figures wider
    for theme, found in (("dark", DARK), ("light", LIGHT)):  # and it can be read in both
        window.set_theme(theme)
        assert table.topLevelItem(3).foreground(0).color() == QColor(found.error)
    panel.poses.list.setCurrentRow(1)
    assert panel.poses.out.text() == "Take it in"
    click(qtbot, panel.poses.out)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert work.result is not None
    assert len(work.result.geometry.views) == 4
    panel.poses.list.setCurrentRow(0)
    click(qtbot, panel.poses.again)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert work.left_out == {"pose_01"}
    assert len(work.views.views) == 5


def test_a_button_has_the_keys_again_after_its_work(qtbot: QtBot, panel: CalibratePanel) -> None:
    begin(qtbot, panel)
    click(qtbot, panel.poses.go_there)
    qtbot.waitUntil(lambda: panel.poses.picture._marks_over.there)
    panel.poses.take.setFocus()
    qtbot.keyClick(panel.poses.take, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: panel.run.busy)
    assert not panel.poses.take.hasFocus()
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert panel.poses.take.hasFocus()
    panel.poses.out.setFocus()
    qtbot.keyClick(panel.poses.out, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: panel.poses.out.text() == "Take it in" and not panel.run.busy)
    assert panel.poses.out.hasFocus()


def test_a_pose_is_taken_by_itself_where_the_chart_rests(qtbot: QtBot, panel: CalibratePanel) -> None:
    begin(qtbot, panel)
    panel.poses.auto.setChecked(True)
    click(qtbot, panel.poses.go_there)
    work = panel.run.work
    assert work is not None
    qtbot.waitUntil(lambda: len(work.views.views) == 1)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert not panel.run.rests_there  # the next pose is elsewhere


def test_stopping_in_the_middle_keeps_what_was_taken(qtbot: QtBot, panel: CalibratePanel, tmp_path: Path) -> None:
    begin(qtbot, panel)
    take(qtbot, panel)
    click(qtbot, panel.poses.go_there)
    click(qtbot, panel.poses.take)
    qtbot.waitUntil(lambda: "picture" in panel.poses.status.text())
    click(qtbot, panel.poses.stop)
    assert not panel.run.busy
    assert "not kept" in panel.poses.status.text()
    work = panel.run.work
    assert work is not None
    assert [view.name for view in work.views.views] == ["pose_01"]
    take(qtbot, panel)
    assert len(pose_folders(tmp_path / "poses")) == len(work.views.views) == 2


def test_the_program_is_held_while_a_pose_is_taken_and_the_gate_is_free(
    qtbot: QtBot, window: Window, panel: CalibratePanel
) -> None:
    begin(qtbot, panel)
    click(qtbot, panel.poses.take)
    assert window.session.held("program") is not None
    assert window.session.held("gate") is None
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert window.session.held("program") is None


def test_the_chart_is_moved_by_mouse_and_keys(qtbot: QtBot, panel: CalibratePanel) -> None:
    begin(qtbot, panel)
    work = panel.run.work
    assert work is not None
    device, picture = work.device, panel.poses.picture
    assert isinstance(device, PracticeDevice)
    qtbot.waitUntil(lambda: picture._image is not None)
    x, y, z = device.pose.shift_m
    middle = picture.rect().center()
    qtbot.mousePress(picture, LEFT, pos=middle)
    QTest.mouseMove(picture, middle + QPoint(30, 0))
    qtbot.waitUntil(lambda: device.pose.shift_m[0] > x)
    qtbot.mouseRelease(picture, LEFT, pos=middle + QPoint(30, 0))
    assert device.pose.shift_m[1:] == pytest.approx((y, z))
    qtbot.keyClick(picture, Qt.Key.Key_Down)
    assert device.pose.shift_m[1] > y
    qtbot.keyClicks(picture, "+")
    assert device.pose.shift_m[2] < z
    flat = np.array(device.pose.rotation)[:, 2]
    qtbot.keyClick(picture, Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier)
    assert np.array(device.pose.rotation)[0, 2] != flat[0]
    qtbot.waitUntil(lambda: device._shown == device.pose)


def test_what_is_hidden_does_not_look(qtbot: QtBot, window: Window, panel: CalibratePanel) -> None:
    begin(qtbot, panel)
    with qtbot.waitSignal(panel.run.looked):
        pass
    window.docks.switch("gate")
    qtbot.waitUntil(lambda: not panel.isVisible() and not panel.run._looks.busy)
    seen: list[object] = []
    panel.run.looked.connect(seen.append)
    frames = window.live.frame.stamp.sequence if window.live.frame else 0
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame.stamp.sequence > frames + 50)
    assert not seen
    window.docks.switch("rig")
    qtbot.waitUntil(lambda: bool(seen))


def test_a_pattern_is_shown_to_aim_by(qtbot: QtBot, panel: CalibratePanel) -> None:
    click(qtbot, panel.chart.show_it)
    assert "begin" in panel.chart.note.text()
    begin(qtbot, panel)
    work = panel.run.work
    assert work is not None
    assert isinstance(work.device, PracticeDevice)
    camera = work.device.rig.camera
    click(qtbot, panel.steps[CHART])
    panel.chart.pattern.setCurrentIndex(panel.chart.pattern.findText("All off"))
    click(qtbot, panel.chart.show_it)
    qtbot.waitUntil(lambda: camera._pattern is not None and not camera._pattern.any())
    click(qtbot, panel.steps[POSES])
    click(qtbot, panel.poses.take)  # which lights the chart again
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert camera._pattern is None
    assert panel.poses.list.count() == 1


# A connected camera


@pytest.fixture
def live(window: Window, rig: Rig) -> PracticeRig:
    """A camera that stands for a real one, and a screen."""
    made = PracticeRig(rig, chart_from(CHART_TEXT), 5)
    made.move(advised(rig, []))
    window.session.adopt(device_source(Address("sim", "practice"), rig, made.camera, Options()))
    window.desk.screen = lambda: (made.projector, 0)
    return made


def advised(rig: Rig, taken: list[ChartPose]) -> ChartPose:
    pose = next_pose(rig, chart_from(CHART_TEXT), taken)
    assert pose is not None
    return pose


def test_a_connected_camera_is_calibrated_and_goes_on_with_the_new_rig(
    qtbot: QtBot, window: Window, live: PracticeRig, panel: CalibratePanel, rig: Rig
) -> None:
    choose(panel, CONNECTED)
    begin(qtbot, panel)
    work, stream = panel.run.work, window.session.stream
    assert work is not None
    held: list[ChartPose] = []
    for number in range(4):
        held.append(advised(rig, held))
        live.move(held[-1])
        qtbot.waitUntil(lambda: panel.poses._look is not None and panel.poses._look.corners is not None)
        click(qtbot, panel.poses.take)
        assert window.session.held("gate") is not None
        qtbot.waitUntil(lambda: not panel.run.busy)
        assert len(work.views.views) == number + 1, panel.poses.status.text()
    assert window.session.held("gate") is None
    click(qtbot, panel.poses.done)
    assert work.result is not None
    click(qtbot, panel.result.apply)
    source = window.session.source
    assert source is not None
    assert source.rig == work.result.rig
    assert source.rig.calibration is not None
    assert window.session.stream is stream
    frame = window.live.frame
    qtbot.waitUntil(lambda: window.live.frame is not frame and window.live.frame is not None)
    click(qtbot, panel.result.back)
    assert window.session.source is not None
    assert window.session.source.rig == rig


def test_without_a_camera_or_a_screen_it_says_so(qtbot: QtBot, window: Window, panel: CalibratePanel) -> None:
    choose(panel, CONNECTED)
    click(qtbot, panel.chart.begin)
    assert "No camera is connected" in panel.chart.note.text()
    assert panel.step == CHART


def test_a_camera_that_goes_is_told_of(
    qtbot: QtBot, window: Window, live: PracticeRig, panel: CalibratePanel, rig: Rig
) -> None:
    choose(panel, CONNECTED)
    begin(qtbot, panel)
    source = window.session.source
    assert source is not None
    other = PracticeRig(rig, chart_from(CHART_TEXT), 6)
    window.session.adopt(replace(source, camera=other.camera))
    click(qtbot, panel.poses.take)
    assert "has gone" in panel.poses.status.text()


# Bad input


@pytest.mark.parametrize("text", ["", "9x7", "2x7:30", "9x7:-1", "9x7:30:90", "charuco:9x7:30:40", "x" * 500])
def test_a_chart_that_is_none_is_refused_in_one_sentence(qtbot: QtBot, panel: CalibratePanel, text: str) -> None:
    panel.chart.text.clear()
    qtbot.keyClicks(panel.chart.text, text)
    assert "chart" in panel.chart.note.text().lower()
    click(qtbot, panel.chart.begin)
    assert panel.step == CHART
    assert "chart" in panel.chart.note.text().lower()


def test_fields_and_text_of_the_chart_say_the_same(qtbot: QtBot, panel: CalibratePanel) -> None:
    page = panel.chart
    assert (page.columns.value(), page.rows.value(), page.square.value()) == (6, 5, 40.0)
    page.kind.setCurrentIndex(page.kind.findData("charuco"))
    page.columns.setValue(8)
    assert page.text.text() == "charuco:8x5:40"
    type_text(qtbot, page.text, "charuco:7x6:25:15:5x5_100")
    assert (page.columns.value(), page.rows.value(), page.square.value()) == (7, 6, 25.0)
    assert page.text.text() == "charuco:7x6:25:15:5x5_100"


def test_a_folder_has_to_be_named(qtbot: QtBot, panel: CalibratePanel) -> None:
    panel.chart.place.where.clear()
    click(qtbot, panel.chart.begin)
    assert panel.chart.note.text() == "No folder is named: poses are kept in one."


def test_a_chart_that_is_too_large_or_too_fine_is_refused(qtbot: QtBot, panel: CalibratePanel) -> None:
    type_text(qtbot, panel.chart.text, "60x60:1")
    click(qtbot, panel.chart.begin)
    qtbot.waitUntil(lambda: "nowhere seen whole" in panel.poses.status.text())
    assert panel.run.work is None


def test_a_folder_that_cannot_be_written_to_is_refused_at_once(
    qtbot: QtBot, panel: CalibratePanel, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("no folder")
    type_text(qtbot, panel.chart.place.where, str(tmp_path / "file" / "poses"))
    click(qtbot, panel.chart.begin)
    assert "file" in panel.chart.note.text()
    assert panel.step == CHART
    assert not panel.run.busy


def test_a_folder_that_cannot_be_written_to_any_more_stops_the_pose_and_not_the_window(
    qtbot: QtBot, panel: CalibratePanel, tmp_path: Path
) -> None:
    (tmp_path / "late").mkdir()
    type_text(qtbot, panel.chart.place.where, str(tmp_path / "late" / "poses"))
    begin(qtbot, panel)
    (tmp_path / "late").rmdir()
    (tmp_path / "late").write_text("no folder")
    click(qtbot, panel.poses.take)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert "late" in panel.poses.status.text()
    work = panel.run.work
    assert work is not None
    assert not work.views.views


def test_another_practice_rig_takes_no_poses_beside_those_of_the_first(qtbot: QtBot, panel: CalibratePanel) -> None:
    begin(qtbot, panel)
    take(qtbot, panel)
    click(qtbot, panel.steps[CHART])
    click(qtbot, panel.chart.begin)
    assert "holds poses already" in panel.chart.note.text()
    assert panel.step == CHART


def test_nothing_of_the_calibration_before_is_on_show_where_another_fails(
    qtbot: QtBot, panel: CalibratePanel, tmp_path: Path
) -> None:
    begin(qtbot, panel)
    take(qtbot, panel)
    assert panel.poses.list.count() == 1
    panel.timing.status.setText("Known well enough.")
    click(qtbot, panel.steps[CHART])
    choose(panel, PICTURES)
    type_text(qtbot, panel.chart.place.where, str(tmp_path / "nothing"))
    click(qtbot, panel.chart.begin)
    qtbot.waitUntil(lambda: "is no folder" in panel.poses.status.text())
    assert panel.poses.list.count() == 0
    assert panel.poses.told.text() == panel.timing.status.text() == ""
    assert panel.poses.camera._count is None
    assert panel.poses.picture._image is None


# Pictures of others


def test_poses_are_read_from_a_folder(qtbot: QtBot, practised: CalibratePanel, tmp_path: Path) -> None:
    panel = practised
    before = panel.run.work
    assert before is not None
    assert before.result is not None
    click(qtbot, panel.steps[CHART])
    choose(panel, PICTURES)
    begin(qtbot, panel)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert not panel.poses.take.isVisible()
    work = panel.run.work
    assert work is not None
    assert work.result is not None
    assert work.result.geometry.rms_px == pytest.approx(before.result.geometry.rms_px, rel=0.05)
    panel.run.read(tmp_path / "nothing")
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert "is no folder" in panel.poses.status.text()
    other = panel.run.work
    assert other is not None
    assert other.result is None, "what is on show is not of another folder than the one named"
    panel.run.read(tmp_path / "poses")
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert panel.poses.status.text() == ""
    assert panel.run.work is not None
    assert panel.run.work.result is not None


def test_the_chart_is_saved_for_the_printer(qtbot: QtBot, panel: CalibratePanel, tmp_path: Path) -> None:
    panel.save_chart(chart_from("9x7:20"), tmp_path / "chart")
    qtbot.waitUntil(lambda: "Saved" in panel.chart.note.text())
    assert (tmp_path / "chart.pdf").read_bytes().startswith(b"%PDF")
    panel.save_chart(chart_from("90x70:50"), tmp_path / "large.pdf")
    assert "does not fit" in panel.chart.note.text()
    assert not (tmp_path / "large.pdf").exists()


# What is seen


def test_nothing_is_cut_in_any_step(qtbot: QtBot, window: Window, practised: CalibratePanel) -> None:
    panel = practised
    work = panel.run.work
    assert work is not None
    for size in (window.minimumSizeHint(), window.size()):
        window.resize(size)
        for step in (CHART, POSES, RESULT, TIME):
            click(qtbot, panel.steps[step])
            settle()
            assert clipped(window) == []
    assert panel.chart.chosen == PRACTICE


def places(panel: CalibratePanel) -> list[QRect]:
    """Where the buttons of the page of poses are."""
    settle()
    poses = panel.poses
    buttons = (poses.take, poses.auto, poses.go_there, poses.skip, poses.stop, poses.out, poses.again, poses.done)
    return [QRect(button.mapTo(panel, QPoint(0, 0)), button.size()) for button in buttons]


def test_the_buttons_of_the_poses_stay_where_they_are(qtbot: QtBot, practised: CalibratePanel) -> None:
    """However many lines a sentence takes: who takes one pose after the other does not look for the button."""
    panel, poses = practised, practised.poses
    panel.run.watch(False)
    poses.hint.setText("Here: hold it still.")
    before = places(panel)
    poses.hint.setText(
        "Move it 10 cm farther away, 20 cm to the right and 10 cm down, and hold it with its right edge 30\u00b0 and "
        "its bottom edge 30\u00b0 away from the camera."
    )
    assert places(panel) == before
    many = "Words that take as many lines as a fault may take. " * 3
    for sentence in (poses.status, poses.why, poses.told):
        sentence.setText(many)
        assert places(panel) == before
    poses.bar.show()
    assert places(panel) == before
    click(qtbot, poses.out)
    qtbot.waitUntil(lambda: not panel.run.busy and poses.out.text() == "Take it in")
    panel.run.watch(False)
    assert places(panel) == before


# Timing


def test_the_timing_needs_a_geometry_first(qtbot: QtBot, panel: CalibratePanel) -> None:
    click(qtbot, panel.steps[TIME])
    assert not panel.timing.start.isEnabled()
    click(qtbot, panel.steps[CHART])
    begin(qtbot, panel)
    click(qtbot, panel.steps[TIME])
    click(qtbot, panel.timing.start)
    assert "There is no geometry yet" in panel.timing.status.text()
    assert not panel.gates.busy


def test_gates_are_taken_and_stopped_and_tell_what_they_can(
    qtbot: QtBot, window: Window, practised: CalibratePanel
) -> None:
    panel = practised
    click(qtbot, panel.steps[TIME])
    assert panel.timing.plot.pages.currentIndex() == 0, "an empty plot says what it is for"
    click(qtbot, panel.timing.start)
    assert window.session.held("program") is not None
    qtbot.waitUntil(lambda: panel.timing.bar.value() > 20)
    click(qtbot, panel.timing.stop)
    qtbot.waitUntil(lambda: not panel.gates.busy)
    assert window.session.held("program") is None
    assert panel.timing.start.isEnabled()
    outcome = panel.gates.outcome
    if outcome is None:  # so few gates may tell nothing, which is said then
        assert "timing" in panel.timing.status.text()
    else:
        assert panel.timing.table.topLevelItemCount() == 4
        assert "gates" in panel.timing.status.text()


def test_the_timing_is_told_with_and_without_the_geometry_and_by_both_edges(
    qtbot: QtBot, window: Window, practised: CalibratePanel, tmp_path: Path
) -> None:
    panel = practised
    click(qtbot, panel.steps[TIME])
    assert panel.timing.edges.isEnabled()
    panel.timing.edges.setChecked(True)
    click(qtbot, panel.timing.start)
    qtbot.waitUntil(lambda: panel.timing.status.text().startswith("Falling edge"), timeout=90_000)
    qtbot.waitUntil(lambda: not panel.gates.busy, timeout=90_000)
    found = panel.gates.found
    assert found is not None
    assert found.pulse is not None
    assert found.pulse.width is not None
    assert found.pulse.width.width_us == pytest.approx(PULSE_US, abs=5 * found.pulse.width.error_us)
    told, table = panel.timing.status.text(), panel.timing.table
    rows = {table.topLevelItem(row).text(0): table.topLevelItem(row).text(2) for row in range(4)}
    offset = rows["delay offset, \u00b5s"]
    assert f"with the geometry's errors, as in the table, the delay offset is known to {offset} \u00b5s." in told
    assert "The trigger's pulse is high for 1" in told
    assert " us" not in told
    plot = panel.timing.plot
    assert len(plot.lacks) > 1
    frames = [one.frames for one in plot.lacks]
    assert frames == sorted(set(frames))
    assert plot.lacks[-1].known.offset_us <= plot.lacks[-1].wanted.offset_us
    assert plot.plot.getAxis("bottom").labelText == "gates taken"
    assert plot.plot.getAxis("left").labelText == "standard error, \u00b5s"
    settle()
    assert clipped(window) == []
    panel.save_rig(tmp_path / "timed")
    qtbot.waitUntil(lambda: panel.timing.note.text() == f"Saved as {tmp_path / 'timed.toml'}.")
    click(qtbot, panel.steps[RESULT])
    click(qtbot, panel.steps[TIME])
    assert panel.timing.status.text() == told


def test_both_edges_are_off_with_a_reason_where_nothing_can_be_told_of_them(
    qtbot: QtBot, practised: CalibratePanel
) -> None:
    panel = practised
    assert panel.timing.edges.isEnabled()
    click(qtbot, panel.steps[CHART])
    choose(panel, PICTURES)
    begin(qtbot, panel)
    assert not panel.timing.edges.isEnabled()
    assert "Nothing is connected" in panel.timing.edges.toolTip()
    click(qtbot, panel.steps[RESULT])
    assert "gamma is not known: pictures that were taken before do not tell it." in panel.result.shown.text()
