"""The capture panel, by mouse and keyboard, on a running session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QStandardPaths, Qt
from PySide6.QtWidgets import QComboBox, QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.panels.capture import CapturePanel, progress_text
from slopegate.app.panels.capture_plan import PlanRow, Wish, read_delays, slices_of
from slopegate.app.session.session import Session
from slopegate.app.session.source import Options
from slopegate.core.gating.slices import share_edges
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.captures.recorder import CaptureProgress
from slopegate.drivers.captures.storage import open_capture
from slopegate.drivers.stream.sieve import Tally
from small_window import make_desk, make_source

LEFT = Qt.MouseButton.LeftButton
LONG = 100
"""Frames of each of ten slices that take half a second each."""


@pytest.fixture
def session(rig: Rig) -> Iterator[Session]:
    made = Session()
    made.adopt(make_source(rig, Options(noise=False, rate_hz=200.0)))
    yield made
    made.close()


@pytest.fixture
def panel(qtbot: QtBot, session: Session, tmp_path: Path) -> Iterator[CapturePanel]:
    made = CapturePanel(make_desk(session))
    qtbot.addWidget(made)
    made.resize(540, 270)
    with qtbot.waitExposed(made):
        made.show()
    type_folder(qtbot, made, tmp_path / "capture")
    yield made
    made.close()


def type_folder(qtbot: QtBot, panel: CapturePanel, path: Path) -> None:
    panel.where.selectAll()
    qtbot.keyClicks(panel.where, str(path))


def click(qtbot: QtBot, widget: QWidget) -> None:
    assert widget.isEnabled()
    qtbot.mouseClick(widget, LEFT)


def choose(qtbot: QtBot, box: QComboBox, text: str) -> None:
    box.setFocus()
    qtbot.keyClicks(box, text[:6])
    assert box.currentText().startswith(text)


def finish(qtbot: QtBot, panel: CapturePanel) -> None:
    qtbot.waitUntil(lambda: not panel.run.busy)


def test_the_plan_follows_the_live_gate_and_says_how(qtbot: QtBot, panel: CapturePanel, session: Session) -> None:
    resolved = session.resolved
    assert resolved is not None
    for clock in (70.0, 90.0):
        line = session.source.rig.camera.shutter.line
        session.ask_wish(gate(line.line_time_us(clock), resolved.gate.delay_us, resolved.gate.exposure_us))
        qtbot.waitUntil(lambda clock=clock: f"all at {clock:g} MHz" in panel.note.text())
        assert {item.line_time_us for item in slices_of(session, panel.plan.wish())} == {line.line_time_us(clock)}


def test_all_that_is_lit_is_recorded(qtbot: QtBot, panel: CapturePanel, session: Session, tmp_path: Path) -> None:
    qtbot.waitUntil(lambda: "sharing edges" in panel.note.text())
    assert "MB of" in panel.note.text()
    panel.frames.setFocus()
    panel.frames.selectAll()
    qtbot.keyClicks(panel.frames, "3\r")
    qtbot.mouseClick(panel.dark, LEFT, pos=panel.dark.rect().center() - panel.dark.rect().center() / 1.2)
    click(qtbot, panel.start)
    assert not panel.start.isEnabled()
    qtbot.waitUntil(lambda: panel.bar.isVisible() and panel.bar.value() >= 1)
    finish(qtbot, panel)
    folder = open_capture(tmp_path / "capture")
    assert folder.missing() == []
    assert folder.dark_record() is not None
    assert folder.manifest.frames == 3
    planned = tuple(item.settings() for item in folder.manifest.slices)
    assert share_edges(planned)
    assert f"All {len(planned)} slices are in {tmp_path / 'capture'}" in panel.status.text()
    assert panel.bar.value() == panel.bar.maximum() == len(planned)
    assert panel.open.isEnabled()
    with qtbot.waitSignal(panel._desk.open_wished) as asked:
        click(qtbot, panel.open)
    assert asked.args == [tmp_path / "capture"]
    resolved = session.resolved
    assert resolved is not None
    qtbot.waitUntil(lambda: (frame := session.newest()) is not None and frame.stamp.applied == resolved.sent)


def test_pause_cancel_and_resume_by_mouse(
    qtbot: QtBot, panel: CapturePanel, session: Session, rig: Rig, tmp_path: Path
) -> None:
    panel.frames.setValue(LONG)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.value() >= 1)
    click(qtbot, panel.pause)
    assert panel.pause.text() == "Continue"
    assert "Paused" in panel.status.text()
    most = panel.bar.value() + 1  # one may be on its way to the disk
    made, shown = session.stream.counters.made, 0

    def the_window_stays_live() -> bool:
        nonlocal shown
        shown += session.newest() is not None
        return shown >= 3 and session.stream.counters.made > made + 2 * LONG

    qtbot.waitUntil(the_window_stays_live)
    assert len(open_capture(tmp_path / "capture").records()) <= most
    click(qtbot, panel.pause)
    qtbot.waitUntil(lambda: panel.bar.value() > most)
    click(qtbot, panel.cancel)
    finish(qtbot, panel)
    assert "The capture was cancelled" in panel.status.text()
    assert "slices are kept" in panel.status.text()
    missing = open_capture(tmp_path / "capture").missing()
    assert missing
    assert panel.start.text() == "Resume"
    assert f"An unfinished capture: {len(missing)} of" in panel.note.text()
    assert not panel.plan.isEnabled()
    session.adopt(make_source(rig))  # the same, as fast as it can
    click(qtbot, panel.start)
    finish(qtbot, panel)
    assert open_capture(tmp_path / "capture").missing() == []
    assert panel.start.text() == "Start"


def test_a_range_a_list_and_gates_by_hand(qtbot: QtBot, panel: CapturePanel, session: Session, tmp_path: Path) -> None:
    choose(qtbot, panel.plan.kind, "List of delays")
    qtbot.keyClicks(panel.plan.delays, "1800, 2000 x")
    assert "'x' is not a number" in panel.note.text()
    assert not panel.start.isEnabled()
    qtbot.keyClick(panel.plan.delays, Qt.Key.Key_Backspace)
    assert "2 slices of" in panel.note.text()
    assert "not sharing edges" in panel.note.text()
    panel.plan.choose("hand")
    assert "no gate has been added yet" in panel.note.text()
    click(qtbot, panel.plan.add)
    source, first = session.source, session.resolved
    assert source is not None
    assert first is not None
    session.use(source.presets[1])
    click(qtbot, panel.plan.add)
    second = session.resolved
    assert second is not None
    assert panel.plan.held.text() == "2 gates"
    click(qtbot, panel.start)
    finish(qtbot, panel)
    folder = open_capture(tmp_path / "capture")
    assert [item.settings() for item in folder.manifest.slices] == [first.sent, second.sent]
    assert folder.total(0).max() > folder.total(1)[0].max()
    click(qtbot, panel.plan.clear)
    assert panel.plan.held.text() == "no gate yet"


def test_a_range_of_depth(session: Session) -> None:
    by_delay = slices_of(session, Wish("delay", 5, 0.8, 2.5, (), ()))
    by_depth = slices_of(session, Wish("depth", 3, 0.8, 2.5, (), ()))
    assert (len(by_delay), len(by_depth)) == (5, 3)
    assert share_edges(by_delay)
    assert share_edges(by_depth)
    assert len({item.exposure_us for item in by_depth}) == 3
    assert len(slices_of(session, Wish("delay", 5, 0.8, np.inf, (), ()))) == 5
    with pytest.raises(ValueError, match="far_m"):
        slices_of(session, Wish("delay", 5, 0.8, 0.5, (), ()))


def test_without_a_picture_there_is_nothing_to_plan(qtbot: QtBot) -> None:
    empty = CapturePanel(make_desk(Session()))
    qtbot.addWidget(empty)
    assert "there is no picture yet" in empty.note.text()
    assert not empty.start.isEnabled()
    empty.close()


def test_faults_are_told_and_the_panel_goes_on(qtbot: QtBot, panel: CapturePanel, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    type_folder(qtbot, panel, tmp_path / "file")
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: "is a file: a capture needs a folder" in panel.status.text())
    assert panel.start.isEnabled()
    type_folder(qtbot, panel, tmp_path / "vanishing")
    panel.frames.setValue(LONG)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.value() >= 1)
    (tmp_path / "vanishing").rename(tmp_path / "elsewhere")
    finish(qtbot, panel)
    assert "has vanished; " in panel.status.text()
    assert panel.start.isEnabled()


def test_another_scene_ends_the_capture_and_keeps_what_there_is(
    qtbot: QtBot, panel: CapturePanel, session: Session, rig: Rig, tmp_path: Path
) -> None:
    panel.frames.setValue(LONG)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.value() >= 1)
    session.adopt(make_source(rig))
    finish(qtbot, panel)
    assert "was stopped; " in panel.status.text()
    assert open_capture(tmp_path / "capture").missing()


def test_closing_the_panel_ends_the_capture(qtbot: QtBot, panel: CapturePanel, tmp_path: Path) -> None:
    panel.frames.setValue(LONG)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.value() >= 1)
    panel.close()
    folder = open_capture(tmp_path / "capture")
    assert folder.missing()
    assert folder.records()


def test_the_folder_is_named_after_the_scene(qtbot: QtBot, session: Session) -> None:
    made = CapturePanel(make_desk(session))
    qtbot.addWidget(made)
    pictures = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.PicturesLocation)
    assert made.where.text().startswith(str(Path(pictures) / "slopegate" / "a-card-before-a-wall-"))
    made.close()


def test_the_next_capture_goes_beside_the_one_named_by_hand(
    qtbot: QtBot, panel: CapturePanel, session: Session, tmp_path: Path
) -> None:
    type_folder(qtbot, panel, tmp_path / "mine" / "first")
    click(qtbot, panel.start)
    finish(qtbot, panel)
    assert not open_capture(tmp_path / "mine" / "first").missing()
    following = Path(panel.where.text())
    assert following.parent == tmp_path / "mine"
    assert following.name.startswith("a-card-before-a-wall-")


def test_it_fits_beside_the_plots(panel: CapturePanel) -> None:
    least = panel.minimumSizeHint()
    assert least.width() <= 540
    assert least.height() <= 270
    for kind in ("lit", "delay", "depth", "list", "hand"):
        panel.plan.choose(kind)  # type: ignore[arg-type]
        assert panel.minimumSizeHint().width() <= 540, kind


def test_delays_are_read_with_any_separator() -> None:
    assert read_delays("1, 2;3  -4.5") == (1.0, 2.0, 3.0, -4.5)
    assert read_delays("2028,5; 2030,") == (2028.5, 2030.0)  # a comma between digits is the decimal mark
    assert read_delays("  ") == ()
    with pytest.raises(ValueError, match="'nan' is not a number"):
        read_delays("1 nan")
    with pytest.raises(ValueError, match=r"'1\.800,5' has marks between groups of digits: write it with one decimal"):
        read_delays("1.800,5 2000")
    with pytest.raises(ValueError, match="10001 delays are too many: there must be at most 10000"):
        read_delays("1 " * 10_001)


def test_a_long_list_of_delays_is_not_cut(qtbot: QtBot, session: Session) -> None:
    row = PlanRow(session)
    qtbot.addWidget(row)
    row.choose("list")
    row.delays.setText(" ".join(str(delay) for delay in range(10_000)))
    assert row.wish().delays_us == tuple(range(10_000))


@pytest.mark.parametrize(("frames", "said"), [(0, "0 frames used"), (1, "1 frame used"), (2, "2 frames used")])
def test_one_frame_is_no_plural(frames: int, said: str) -> None:
    assert progress_text(CaptureProgress("running", "Recording", 0, 2, frames, Tally(), None)).endswith(f" {said}")
