"""The record panel, by mouse and keyboard, on a running session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.panels.record import RecordPanel
from slopegate.app.session.session import Intent, Session
from slopegate.app.session.source import Options
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.film import open_film
from slopegate.drivers.captures.film_camera import FilmCamera
from small_window import make_desk, make_source


@pytest.fixture
def session(rig: Rig) -> Iterator[Session]:
    made = Session()
    made.adopt(make_source(rig, Options(noise=False, rate_hz=100.0)))
    yield made
    made.close()


@pytest.fixture
def panel(qtbot: QtBot, session: Session, tmp_path: Path) -> Iterator[RecordPanel]:
    made = RecordPanel(make_desk(session))
    qtbot.addWidget(made)
    made.resize(540, 270)
    with qtbot.waitExposed(made):
        made.show()
    type_folder(qtbot, made, tmp_path / "film")
    yield made
    made.close()


def type_folder(qtbot: QtBot, panel: RecordPanel, path: Path) -> None:
    panel.place.where.selectAll()
    qtbot.keyClicks(panel.place.where, str(path))


def click(qtbot: QtBot, widget: QWidget) -> None:
    assert widget.isEnabled()
    qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)


def choose(panel: RecordPanel, until: str) -> None:
    panel.until.setCurrentIndex(panel.until.findData(until))


def test_it_records_until_it_is_stopped_and_the_window_stays_live(
    qtbot: QtBot, panel: RecordPanel, session: Session, tmp_path: Path
) -> None:
    assert "GB free on this disk" in panel.status.text()
    assert not panel.stop.isEnabled()
    resolved = session.resolved
    assert resolved is not None
    held = resolved.sent
    click(qtbot, panel.start)
    assert not panel.place.isEnabled()
    qtbot.waitUntil(lambda: "Recording \u2013 " in panel.status.text() and not panel.status.text().startswith("0"))
    shown, other = 0, next(preset for preset in session.source.presets if preset.settings != held)
    assert not session.use(other)
    assert "held by the recording" in session.refusal

    def live() -> bool:
        nonlocal shown
        frame = session.newest()
        shown += frame is not None and frame.stamp.applied == held
        return shown > 10

    qtbot.waitUntil(live)
    assert ", 0 lost, " in panel.status.text()
    assert " GB free" in panel.status.text()
    assert not panel.bar.isVisible()
    click(qtbot, panel.stop)
    qtbot.waitUntil(lambda: not panel.run.busy)
    found = open_film(tmp_path / "film")
    assert len(found) > 10
    assert {found.record(number).applied for number in range(len(found))} == {found.manifest.gate}
    assert panel.status.text().startswith(f"It was stopped: {len(found)} frames, 0 lost")
    assert str(tmp_path / "film") in panel.status.text()
    assert panel.place.path.parent == tmp_path
    assert panel.place.path != tmp_path / "film"
    assert session.held("program") is None
    assert session.use(other)
    qtbot.waitUntil(lambda: (frame := session.newest()) is not None and frame.stamp.asked == other.settings)
    with qtbot.waitSignal(panel._desk.open_wished) as asked:
        click(qtbot, panel.open)
    assert asked.args == [tmp_path / "film"]


def test_a_number_of_frames_or_seconds_ends_it(qtbot: QtBot, panel: RecordPanel, tmp_path: Path) -> None:
    choose(panel, "frames")
    assert panel.frames.isVisible()
    panel.frames.setFocus()
    panel.frames.selectAll()
    qtbot.keyClicks(panel.frames, "7\r")
    click(qtbot, panel.start)
    qtbot.waitUntil(
        lambda: panel.status.text().startswith("All frames that were asked for are recorded: 7 frames, 0 lost")
    )
    assert len(open_film(tmp_path / "film")) == 7
    assert panel.bar.value() == panel.bar.maximum()
    choose(panel, "seconds")
    assert panel.seconds.isVisible()
    assert not panel.frames.isVisible()
    panel.seconds.setValue(0.2)
    type_folder(qtbot, panel, tmp_path / "second")
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.status.text().startswith("The time that was asked for is recorded: "))
    assert open_film(tmp_path / "second").counted().seconds == pytest.approx(0.2, abs=0.1)


def test_a_time_lapse_keeps_one_frame_every_so_often(qtbot: QtBot, panel: RecordPanel, tmp_path: Path) -> None:
    choose(panel, "frames")
    panel.frames.setValue(3)
    panel.lapse.click()
    assert panel.every.isEnabled()
    panel.every.setValue(0.1)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.status.text().startswith("All frames that were asked for are recorded"))
    found = open_film(tmp_path / "film")
    assert found.manifest.every_s == 0.1
    times = [found.record(number).time_s for number in range(3)]
    assert np.diff(times).min() > 0.05


def test_what_stands_in_the_folder_is_never_overwritten(qtbot: QtBot, panel: RecordPanel, tmp_path: Path) -> None:
    (tmp_path / "film").mkdir()
    (tmp_path / "film" / "mine.txt").write_text("x", "utf-8")
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: "is not empty: a recording needs a folder of its own" in panel.status.text())
    assert panel.start.isEnabled()


def test_another_source_ends_it_and_its_frames_stay(
    qtbot: QtBot, panel: RecordPanel, session: Session, rig: Rig, tmp_path: Path
) -> None:
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: "Recording \u2013 " in panel.status.text())
    qtbot.waitUntil((tmp_path / "film" / "frames_0000.tif").exists)
    session.adopt(make_source(rig, Options(noise=False, rate_hz=100.0)))
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert " was stopped: " in panel.status.text()
    assert open_film(tmp_path / "film").end is not None


def test_closing_ends_the_recording(qtbot: QtBot, panel: RecordPanel, tmp_path: Path) -> None:
    click(qtbot, panel.start)
    qtbot.waitUntil((tmp_path / "film" / "frames_0000.tif").exists)
    panel.close()
    found = open_film(tmp_path / "film")
    assert found.end is not None
    assert found.end.frames == len(found)


def test_a_recording_opens_in_the_window_and_plays(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    panel = window.docks.bring("record")
    assert isinstance(panel, RecordPanel)
    type_folder(qtbot, panel, tmp_path / "film")
    choose(panel, "frames")
    panel.frames.setValue(5)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.status.text().startswith("All frames that were asked for are recorded"))
    applied = open_film(tmp_path / "film").record(0).applied
    click(qtbot, panel.open)
    session = window.session
    qtbot.waitUntil(lambda: session.source is not None and isinstance(session.source.camera, FilmCamera))
    source, resolved = session.source, session.resolved
    assert source is not None
    assert resolved is not None
    assert applied is not None
    assert [preset.name for preset in source.presets] == ["The gate of the recording"]
    assert resolved.sent == applied.settings()
    assert source.scene.name == "A card before a wall (recorded)"
    qtbot.waitUntil(lambda: session.stream is not None and session.stream.counters.made > 8)
    assert not session.stream.error
    check_it_is_locked(qtbot, window, applied.settings())


FIXED = "The gate is fixed by the recording."


def check_it_is_locked(qtbot: QtBot, window: Window, recorded: GateSettings) -> None:
    """A gate that cannot be changed is shown, and nothing that would move it can be used."""
    session, gate, docks = window.session, window.gate, window.docks
    assert session.source is not None
    widgets: list[QWidget] = [gate.named.choice, gate.named.complement, *gate.plane.spins]
    for control in (gate.settings.line, gate.settings.delay, gate.settings.exposure):
        widgets += [control.slider, control.spin]
    assert {(widget.isEnabled(), widget.toolTip()) for widget in widgets} == {(False, FIXED)}
    assert gate.settings.delay.value == pytest.approx(recorded.delay_us, abs=1e-3)
    assert gate.named.warning.toolTip() == FIXED or FIXED in gate.named.warning.text()
    for key in ("mask", "search", "depth", "slices"):
        assert docks.docks[key].spec.missing(session.source) == FIXED
    assert docks.docks["timing"].spec.missing(session.source) == ""
    assert not session.ask(Intent(recorded, complement=True))
    assert session.refusal == FIXED
    assert window.messages.text == FIXED
    assert session.use(session.source.presets[0])
    assert not window.menus.rig_menu.isEnabled()
    qtbot.waitUntil(lambda: window.status.labels["lost"].text() == "lost 0 when recorded")
    assert window.status.labels["triggers"].text() == ""


def test_what_cannot_be_typed_is_said_once(qtbot: QtBot, window: Window) -> None:
    panel = window.docks.bring("record")
    assert isinstance(panel, RecordPanel)
    choose(panel, "seconds")
    panel.seconds.selectAll()
    qtbot.keyClicks(panel.seconds, "0\r")
    assert window.messages.text.startswith("Seconds of the recording: 0 is not possible")
    assert "not possible" not in panel.status.text()
