"""Fog by sliders, four ways to look, NCC against exposure and the sharpness of an edge: in the real window."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.panels.fog import FogPanel
from slopegate.app.panels.fog_likeness import decades, edge_text, look
from slopegate.app.panels.marks import Mark
from slopegate.app.session.loading import Progress
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.light.four_ways import four_views
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from small_window import small_rig, small_scene

LEFT = Qt.MouseButton.LeftButton
EDGE, TARGET = (130, 90, 190, 150), (120, 80, 200, 160)


def source_of(rig: Rig, fog: Fog | None = None) -> Source:
    """A dark card at 1 m, its right border 5 degrees off the vertical, before a pale one at 1.05 m."""
    card = replace(plane("card", (-0.2, 0.0, 1.0), (0.4, 0.8), turn(roll_deg=5.0)), albedo=(0.2, 0.2, 0.2))
    pale = plane("pale", (0.0, 0.0, 1.05), (1.6, 1.2), turn())
    scene = Scene("An edge", objects=(pale, card), ambient=0.02, fog=fog, gates=small_scene(rig).gates[:1])
    options = Options(rate_hz=math.inf)
    return build_source(Path("edge.toml"), rig, scene, options, Progress(lambda share, text: None))


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """What fog needs is compiled once, which takes longer than any wait of a test, and is not what they are about."""
    rig = small_rig()
    source_of(rig, Fog(1.0)).close()
    four_views(rig, source_of(rig, Fog(1.0)).scene, lambda share: True).refine(lambda share: True)


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig) -> FogPanel:
    window.session.adopt(source_of(rig))
    made = window.docks.bring("fog")
    assert isinstance(made, FogPanel)
    qtbot.waitUntil(lambda: window.live.frame is not None and not made.busy and made.likeness.rendered is not None)
    window.live.view.fit()
    return made


def drag(qtbot: QtBot, mark: Mark, box: tuple[int, int, int, int]) -> None:
    qtbot.mouseClick(mark.button, LEFT)
    first, last = mark.tool.to_view(*box[:2]).toPoint(), mark.tool.to_view(*box[2:]).toPoint()
    qtbot.mousePress(mark.tool, LEFT, pos=first)
    move_pointer(qtbot, mark.tool, QPoint((first.x() + last.x()) // 2, first.y()))
    qtbot.mouseRelease(mark.tool, LEFT, pos=last)
    assert mark.box is not None


def fog_of(window: Window) -> Fog | None:
    return window.session.source.scene.fog


def settled(window: Window) -> bool:
    frame = window.live.frame
    return frame is not None and frame.stamp.settled and frame.stamp.applied == window.session.resolved.sent


def test_a_density_that_is_typed_comes_while_the_picture_goes_on(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    before, gate, sensor = window.session.source, window.session.resolved, window.session.source.rendered.sensor
    spin = panel.controls.density.spin
    spin.setFocus()
    spin.selectAll()
    qtbot.keyClicks(spin, "2")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert panel.controls.on.isChecked()
    assert panel.controls.visibility.value == pytest.approx(3.912 / 2, abs=1e-3)
    assert window.session.source is before  # nothing waits for it
    qtbot.waitUntil(lambda: fog_of(window) is not None and fog_of(window).scattering_per_m == 2.0)
    assert window.session.resolved == gate
    assert window.session.source.rendered.sensor == sensor
    qtbot.waitUntil(lambda: settled(window))
    qtbot.mouseClick(panel.controls.on, LEFT, pos=QPoint(8, panel.controls.on.height() // 2))
    qtbot.waitUntil(lambda: fog_of(window) is None)


def test_visibility_and_g_set_the_fog(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    panel.controls.visibility.edited.emit(1.0)
    assert panel.controls.fog.scattering_per_m == pytest.approx(3.912, abs=1e-3)
    panel.controls.g.edited.emit(0.8)
    qtbot.waitUntil(lambda: fog_of(window) is not None and fog_of(window).g == 0.8)
    assert fog_of(window).visibility_m == pytest.approx(1.0)
    panel.controls.own.click()
    qtbot.waitUntil(lambda: fog_of(window) is None)
    assert not panel.controls.own.isEnabled()


def test_another_fog_keeps_marks_and_what_is_switched_off(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    drag(qtbot, panel.likeness.target, TARGET)
    box = panel.likeness.target.box
    window.session.source.rendered.smooth.show(("ambient",))
    panel.controls.density.edited.emit(1.0)
    qtbot.waitUntil(lambda: fog_of(window) is not None)
    assert panel.likeness.target.box == box
    shown = window.session.source.rendered.smooth.shown
    assert "direct" not in shown
    assert {"ambient", "airlight"} <= shown


def test_a_fog_that_comes_late_does_not_replace_another_scene(
    qtbot: QtBot, window: Window, panel: FogPanel, rig: Rig
) -> None:
    panel.controls.density.edited.emit(5.0)
    window.session.adopt(source_of(rig, Fog(0.3)))
    qtbot.waitUntil(lambda: not panel.busy)
    assert fog_of(window) == Fog(0.3)
    assert panel.controls.density.value == 0.3


def test_four_pictures_follow_the_gate(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    qtbot.waitUntil(lambda: not panel.ways.busy)
    views = panel.ways.pictures
    assert all(view.grey is not None for view in views.values())
    assert "NCC 1.000" in panel.ways.captions["regular"].text()
    with qtbot.waitSignal(panel.ways.shown):
        window.session.use(window.session.source.presets[-1])
    assert np.array_equal(views["this"].grey, views["regular"].grey)


def test_likeness_and_the_best_exposure_are_measured(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    box = panel.likeness
    drag(qtbot, box.target, TARGET)
    qtbot.waitUntil(lambda: box.now.text().startswith("This frame: NCC"))
    assert "marked target" in box.reference.text()
    box.count.setValue(8)
    before = window.session.resolved.sent
    qtbot.mouseClick(box.start, LEFT)
    assert box.busy
    qtbot.waitUntil(lambda: not box.busy)
    swept = box.plot.swept
    assert swept is not None
    assert len(swept.exposures_us) == len(swept.measured) == len(swept.expected) == 8
    for one, other in zip(swept.measured, swept.expected, strict=True):
        assert one.ncc == pytest.approx(other.ncc, abs=0.03)
    assert swept.measured[-1].ncc == pytest.approx(swept.regular.ncc, abs=0.01)
    assert "Predicted before a frame was taken" in box.found.text()
    assert window.session.resolved.sent == before
    qtbot.waitUntil(lambda: settled(window))
    qtbot.mouseClick(box.use, LEFT)
    assert window.session.resolved.gate.exposure_us == swept.best_us


def test_a_sweep_is_cancelled_without_a_trace(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    box, before = panel.likeness, window.session.resolved.sent
    box.count.setValue(80)
    qtbot.mouseClick(box.start, LEFT)
    qtbot.waitUntil(lambda: box.bar.value() > 35)
    qtbot.mouseClick(box.cancel, LEFT)
    assert not box.busy
    assert box.plot.swept is None
    assert box.found.text() == "Cancelled; the exposure is as it was."
    qtbot.waitUntil(lambda: window.session.stream.tapped is None)
    qtbot.waitUntil(lambda: window.live.frame.stamp.applied == before)


def test_the_sharpness_of_an_edge_is_live(qtbot: QtBot, window: Window, panel: FogPanel) -> None:
    window.session.use(window.session.source.presets[-1])
    drag(qtbot, panel.likeness.edge, EDGE)
    qtbot.waitUntil(lambda: panel.likeness.sharp.text().startswith("MTF"))
    # one ray a pixel: as sharp as pixels are
    assert "off vertical" in panel.likeness.sharp.text()
    panel.likeness.edge.set_box((0, 0, 20, 20))
    qtbot.waitUntil(lambda: panel.likeness.sharp.text().startswith("No edge measured"))


def test_a_soft_edge_has_a_number() -> None:
    columns, rows = np.meshgrid(np.arange(60) + 0.5, np.arange(60) + 0.5)
    away = (columns - 30 - 0.1 * (rows - 30)) / 1.5
    edge = (500 + 1000 / (1 + np.exp(-1.702 * away))).astype(np.uint16)
    found = look(edge, None, edge, 0.0, 4095)
    assert found.ncc is None
    assert found.edge is not None
    assert edge_text(found.edge).startswith("MTF50 0.1")
    assert look(edge, None, edge[:, :20], 0.0, 4095).edge_why != ""


def test_a_kept_frame_is_the_reference_of_any_camera(qtbot: QtBot, window: Window, panel: FogPanel, rig: Rig) -> None:
    made = source_of(rig)
    window.session.adopt(replace(made, rendered=None, where=Path("lab.toml")))
    box = panel.likeness
    assert not panel.controls.isVisible()
    assert not panel.ways.isVisible()
    assert panel.note.isVisible()
    assert "Keep a frame" in box.reference.text()
    assert not box.start.isEnabled()
    window.session.use(window.session.source.presets[-1])
    qtbot.waitUntil(lambda: settled(window))
    qtbot.mouseClick(box.keep, LEFT)
    assert "the frame kept at" in box.reference.text()
    qtbot.waitUntil(lambda: box.now.text().startswith("This frame: NCC 0.99"))
    box.count.setValue(5)
    qtbot.mouseClick(box.start, LEFT)
    qtbot.waitUntil(lambda: not box.busy)
    assert box.plot.swept.expected == ()
    assert box.plot.swept.regular.ncc > 0.98
    assert "Predicted" not in box.found.text()
    qtbot.mouseClick(box.drop, LEFT)
    assert not box.start.isEnabled()


def test_ticks_are_few() -> None:
    assert [text for _, text in decades(100, 16667)] == ["100", "200", "500", "1000", "2000", "5000", "10000"]
