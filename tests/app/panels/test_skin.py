"""The window beside the direct row, and a vein's contrast: in the real window, by mouse, on a striped card."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QPushButton
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.panels.marks import Mark
from slopegate.app.panels.skin import SkinPanel, find_place
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Change
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.measure.offset import offset_rows, place_in
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn

LEFT = Qt.MouseButton.LeftButton
MIDDLE = (150, 110, 170, 130)
STRIPE, PALE = (120, 100, 140, 140), (180, 100, 200, 140)


def source_of(rig: Rig) -> Source:
    """A card at 1 m, its left half at 0.3 and its right half at 0.6."""
    dark = replace(plane("dark", (-0.15, 0.0, 1.0), (0.3, 0.6), turn()), albedo=(0.3, 0.3, 0.3))
    pale = replace(plane("pale", (0.15, 0.0, 1.0), (0.3, 0.6), turn()), albedo=(0.6, 0.6, 0.6))
    scene = Scene("Two tones", objects=(dark, pale), ambient=0.0)
    quick = Options(noise=False, rate_hz=math.inf)
    return build_source(Path("tones.toml"), rig, scene, quick, Progress(lambda share, text: None))


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig) -> SkinPanel:
    window.session.adopt(source_of(rig))
    made = window.docks.bring("skin")
    assert isinstance(made, SkinPanel)
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame.image.shape == (240, 320))
    qtbot.waitUntil(made.isVisible)
    window.live.view.fit()
    return made


def drag(qtbot: QtBot, mark: Mark, box: tuple[int, int, int, int]) -> None:
    qtbot.mouseClick(mark.button, LEFT)
    assert mark.tool.active
    first, last = mark.tool.to_view(*box[:2]).toPoint(), mark.tool.to_view(*box[2:]).toPoint()
    qtbot.mousePress(mark.tool, LEFT, pos=first)
    move_pointer(qtbot, mark.tool, QPoint((first.x() + last.x()) // 2, first.y()))
    qtbot.mouseRelease(mark.tool, LEFT, pos=last)
    assert mark.box is not None


def offset(window: Window, panel: SkinPanel) -> float:
    source, resolved = window.session.source, window.session.resolved
    assert source is not None
    assert resolved is not None
    assert panel.place is not None
    return offset_rows(source.rig, resolved.gate, panel.place)


def test_the_offset_moves_the_window_beside_the_direct_row(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    assert not panel.offset.spin.isEnabled()
    drag(qtbot, panel.at, MIDDLE)
    assert panel.offset.spin.isEnabled()
    panel.offset.spin.setFocus()
    panel.offset.spin.selectAll()
    qtbot.keyClicks(panel.offset.spin, "20")
    qtbot.keyClick(panel.offset.spin, Qt.Key.Key_Return)
    assert offset(window, panel) == pytest.approx(20, abs=0.05)  # a step of the delay is 0.047 rows
    assert "beside the direct row" in panel.beside.text()
    sent = window.session.resolved.sent
    qtbot.waitUntil(lambda: window.live.frame.stamp.applied == sent and window.live.frame.stamp.settled)
    x0, y0, x1, y1 = MIDDLE
    aside = window.live.frame.image[y0:y1, x0:x1].mean()
    qtbot.keyClicks(panel.offset.spin, "0")
    qtbot.keyClick(panel.offset.spin, Qt.Key.Key_Return)
    assert "holds the direct row" in panel.beside.text()
    sent = window.session.resolved.sent
    qtbot.waitUntil(lambda: window.live.frame.stamp.applied == sent and window.live.frame.stamp.settled)
    assert window.live.frame.image[y0:y1, x0:x1].mean() > 2 * aside


def test_the_tilt_keeps_the_offset_at_the_place(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    panel.at.set_box(MIDDLE)
    panel.offset.edited.emit(12.0)
    before, tilted = window.session.resolved.gate, window.session.resolved.slab.tilt_deg
    panel.line.spin.setFocus()
    qtbot.keyClick(panel.line.spin, Qt.Key.Key_Up)
    after = window.session.resolved.gate
    assert after.line_time_us < before.line_time_us
    assert window.session.resolved.slab.tilt_deg != tilted
    assert offset(window, panel) == pytest.approx(12.0, abs=0.05)


def test_the_read_out_follows_a_gate_set_elsewhere(window: Window, panel: SkinPanel) -> None:
    panel.at.set_box(MIDDLE)
    panel.offset.edited.emit(12.0)
    shown = panel.beside.text()
    window.session.ask_wish(replace(window.session.resolved.gate, exposure_us=900.0))
    assert panel.beside.text() != shown
    assert "holds the direct row" in panel.beside.text()


def test_the_direct_row_is_measured_as_it_is_known(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    drag(qtbot, panel.at, MIDDLE)
    known, gate_before = panel.place, window.session.resolved.sent
    assert known is not None
    assert "(known)" in panel.row.text()
    qtbot.mouseClick(panel.seek, LEFT)
    qtbot.waitUntil(lambda: not panel.busy)
    assert "(measured)" in panel.row.text()
    assert panel.place is not None
    assert panel.place.camera_row == known.camera_row
    assert panel.place.projector_row == pytest.approx(known.projector_row, abs=1.0)
    assert panel.place.projector_row != known.projector_row
    qtbot.waitUntil(lambda: window.live.frame.stamp.applied == gate_before)


def test_an_unlit_place_is_refused_in_a_sentence(window: Window, panel: SkinPanel) -> None:
    source, stream = window.session.source, window.session.stream
    assert source is not None
    assert stream is not None
    assert place_in(source.rig, source.buffers.projector_row, (0, 0, 10, 10)) is None
    with pytest.raises(InputError, match="no more of the projector's light"):
        find_place(
            stream,
            source.rig,
            window.session.resolved.gate,
            (0, 0, 10, 10),
            source.camera.info.black_count,
            Progress(lambda share, text: None),
        )


def test_the_contrast_of_a_vein_is_live_and_compared(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    assert not panel.both.isEnabled()
    drag(qtbot, panel.vein, STRIPE)
    drag(qtbot, panel.skin, PALE)
    assert window.session.use(window.session.source.presets[-1])  # everything lit: 0.3 and 0.6 give a third

    def shown() -> float:
        return float(panel.contrast.text().split("Contrast ")[1].split(" %")[0])

    qtbot.waitUntil(lambda: abs(shown() - 100 / 3) < 1.0)
    qtbot.mouseClick(panel.both, LEFT)
    qtbot.waitUntil(lambda: not panel.busy)
    assert "Everything lit: 33." in panel.against.text()


def test_named_gates_are_buttons(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    buttons = [button for button, _ in panel._gate_buttons]
    assert [button.text() for button in buttons] == [preset.name for preset in window.session.source.presets]
    qtbot.mouseClick(buttons[1], LEFT)
    assert window.session.resolved.gate == window.session.source.presets[1].settings
    assert [button.isChecked() for button in buttons] == [False, True]
    window.session.use(window.session.source.presets[0])
    assert [button.isChecked() for button in buttons] == [True, False]


def test_a_gate_that_is_told_before_its_scene_finds_the_buttons_of_the_one_before(
    qtbot: QtBot, window: Window, panel: SkinPanel
) -> None:
    source = window.session.source
    window.session._source = replace(source, presets=(*source.presets, *source.presets))
    panel.follow(Change.GATE)
    assert [button.text() for button, _ in panel._gate_buttons] == [preset.name for preset in source.presets]
    qtbot.mouseClick(panel._gate_buttons[0][0], LEFT)
    assert window.session.resolved.gate == source.presets[0].settings


def test_marks_are_drawn_only_while_the_panel_is_seen(qtbot: QtBot, window: Window, panel: SkinPanel) -> None:
    panel.vein.set_box(STRIPE)
    assert panel.vein.layer.isVisible()
    window.docks.switch("gate")
    qtbot.waitUntil(lambda: not panel.isVisible())
    assert not panel.vein.layer.isVisible()
    window.docks.bring("skin")
    qtbot.waitUntil(panel.vein.layer.isVisible)
    qtbot.mouseClick(panel.vein.button, LEFT)
    qtbot.mouseClick(panel.skin.button, LEFT)
    assert not panel.vein.tool.active
    assert panel.skin.tool.active
    qtbot.keyClick(panel.skin.tool, Qt.Key.Key_Escape)
    assert not panel.skin.button.isChecked()


def test_another_scene_has_other_places(window: Window, panel: SkinPanel, rig: Rig) -> None:
    panel.at.set_box(MIDDLE)
    assert panel.place is not None
    window.session.adopt(source_of(rig))
    assert panel.at.box is None
    assert panel.place is None


def test_a_scene_with_other_gates_opens_while_the_marked_panel_is_hidden(
    qtbot: QtBot, window: Window, panel: SkinPanel, rig: Rig
) -> None:
    drag(qtbot, panel.at, MIDDLE)
    window.docks.bring("light")
    qtbot.waitUntil(lambda: not panel.isVisible())
    gates = tuple(
        replace(preset, name=f"{preset.name} {n}") for n in range(2) for preset in window.session.source.presets
    )  # type: ignore[union-attr]
    window.session.adopt(replace(source_of(rig), presets=gates))
    assert window.docks.bring("skin") is panel
    qtbot.waitUntil(lambda: panel.isVisible() and len(panel.gates.findChildren(QPushButton)) == len(gates))
