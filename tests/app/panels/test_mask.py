"""Paint a region with the mouse, get the gate, see what it does: in the real window on a small scene."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.panels.mask import MaskPanel, Wanted, find, measure
from slopegate.app.panels.wipe import take_lit
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.measure.mask import overlap, recorded
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import KeyFrames, Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.stream.stream import Stream

LEFT = Qt.MouseButton.LeftButton


def source_of(rig: Rig, moving: bool = False) -> Source:
    """A wall at 2 m and a card at 1 m; if moving, the card goes to the right again and again."""
    card = plane("card", (0.0, 0.0, 1.0), (0.4, 0.3), turn())
    if moving:
        still = np.stack([np.eye(3)] * 2)
        path = KeyFrames(np.array([0.0, 4.0]), np.array([[0.0, 0, 0], [0.2, 0, 0]]), still, (0.0, 0.0, 1.0))
        card = replace(card, motion=path)
    wall = plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn())
    scene = Scene("A card", objects=(wall, card), ambient=0.03)
    return build_source(Path("card.toml"), rig, scene, Options(rate_hz=60.0), Progress(lambda share, text: None))


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig) -> Iterator[MaskPanel]:
    made = MaskPanel(window.desk)
    qtbot.addWidget(made)
    made.resize(540, 270)
    made.show()
    window.session.adopt(source_of(rig))
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame.image.shape == (240, 320))
    window.live.view.fit()
    yield made
    made.close()


def card_of(window: Window) -> np.ndarray:
    source = window.session.source
    assert source is not None
    return source.buffers.inverse_depth > 0.75


def drag_over_image(qtbot: QtBot, panel: MaskPanel, box: tuple[int, int, int, int]) -> None:
    tool = panel.rectangle
    first, last = tool.to_view(box[0], box[1]).toPoint(), tool.to_view(box[2], box[3]).toPoint()
    qtbot.mousePress(tool, LEFT, pos=first)
    move_pointer(qtbot, tool, QPoint((first.x() + last.x()) // 2, first.y()))
    qtbot.mouseRelease(tool, LEFT, pos=last)


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = np.nonzero(mask)
    return int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1


@pytest.mark.parametrize("hide", [False, True])
def test_a_rectangle_by_mouse_becomes_a_gate_that_keeps_or_masks_it(
    qtbot: QtBot, window: Window, panel: MaskPanel, hide: bool
) -> None:
    button = next(iter(panel.tools))
    qtbot.mouseClick(button, LEFT)
    assert panel.rectangle.active
    if hide:
        qtbot.mouseClick(panel.hide_it, LEFT)
    drag_over_image(qtbot, panel, box_of(card_of(window)))
    assert panel.region is not None
    assert panel.find_button.isEnabled()
    with qtbot.waitSignal(panel.applied):
        qtbot.mouseClick(panel.find_button, LEFT)
    qtbot.waitUntil(lambda: not panel.busy)
    source, resolved = window.session.source, window.session.resolved
    assert source is not None
    assert resolved is not None
    rows = source.buffers.projector_row
    seen = recorded(source.rig, resolved.sent, rows)
    assert overlap(~seen if hide else seen, panel.region, rows >= 0) > 0.95
    predicted, achieved = (
        float(re.findall(r"overlap (\d\.\d+)", label.text())[0]) for label in (panel.predicted, panel.achieved)
    )
    assert predicted > 0.95
    assert achieved == pytest.approx(predicted, abs=0.01)
    assert not panel.anyway.isVisible()
    assert ("all but" in panel.gate.text()) == hide
    # what is on the screen is the gate's own frame again
    sent = resolved.sent
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame.stamp.applied == sent)


def test_a_region_that_no_gate_keeps_is_said_and_the_nearest_is_at_hand(
    qtbot: QtBot, window: Window, panel: MaskPanel
) -> None:
    before = window.session.resolved
    panel.rectangle.chosen.emit(150, 20, 165, 35)
    panel.find_gate()
    qtbot.waitUntil(lambda: not panel.busy and panel.anyway.isVisible())
    assert panel.predicted.text().startswith("No gate can keep this region")
    assert window.session.resolved == before
    panel.check.setChecked(False)
    with qtbot.waitSignal(panel.applied):
        qtbot.mouseClick(panel.anyway, LEFT)
    assert window.session.resolved != before
    assert panel.achieved.text() == ""


def test_shapes_add_up_are_erased_and_undone(qtbot: QtBot, window: Window, panel: MaskPanel) -> None:
    panel.brush.radius_px = 10.0
    panel.brush.stroked.emit(np.array([[50.0, 60.0]]), 10.0)
    panel.brush.stroked.emit(np.array([[50.0, 60.0], [90.0, 60.0]]), 10.0)
    assert panel.region is not None
    area = np.count_nonzero(panel.region)
    assert area == pytest.approx(np.pi * 100 + 40 * 20, rel=0.1)
    panel.erase.setChecked(True)
    panel.polygon.chosen.emit(np.array([[40.0, 40.0], [70.0, 40.0], [70.0, 80.0], [40.0, 80.0]]))
    assert not panel.region[60, 50]
    assert panel.region[60, 80]
    qtbot.mouseClick(panel.undo, LEFT)
    assert np.count_nonzero(panel.region) == area
    qtbot.mouseClick(panel.undo, LEFT)
    assert panel.region is None
    assert not panel.undo.isEnabled()
    assert not panel.find_button.isEnabled()


def test_another_tool_or_scene_ends_the_one_at_work(qtbot: QtBot, window: Window, panel: MaskPanel, rig: Rig) -> None:
    rectangle, polygon, _ = panel.tools
    qtbot.mouseClick(rectangle, LEFT)
    qtbot.mouseClick(polygon, LEFT)
    assert not rectangle.isChecked()
    assert panel.polygon.active
    assert not panel.rectangle.active
    window.messages.say("Still to be read")
    window.activateWindow()
    panel.polygon.setFocus()
    # the window has a shortcut on the same key
    qtbot.keyClick(panel.polygon, Qt.Key.Key_Escape)
    assert not polygon.isChecked()
    assert window.messages.isVisible()
    panel.rectangle.chosen.emit(10, 10, 50, 50)
    window.session.adopt(source_of(rig))
    assert panel.region is None


def test_the_region_is_shown_with_its_panel_only(qtbot: QtBot, window: Window, panel: MaskPanel) -> None:
    panel.rectangle.chosen.emit(10, 10, 50, 50)
    qtbot.mouseClick(next(iter(panel.tools)), LEFT)
    assert panel.layer.isVisible()
    panel.hide()
    assert not panel.layer.isVisible()
    assert not panel.rectangle.active
    panel.show()
    assert panel.layer.isVisible()


def test_measured_depth_takes_the_place_of_the_bench(qtbot: QtBot, window: Window, panel: MaskPanel) -> None:
    source = window.session.source
    assert source is not None
    panel.rectangle.chosen.emit(*box_of(card_of(window)))
    panel.depth_source.setCurrentIndex(1)
    assert not panel.find_button.isEnabled()
    assert "measure it first" in panel.predicted.text()
    window.desk.keep_sweep(np.full((240, 320), -1, np.float32))
    panel.find_gate()
    qtbot.waitUntil(lambda: not panel.busy)
    assert "lit pixel" in panel.predicted.text()
    window.desk.keep_sweep(source.buffers.projector_row)
    with qtbot.waitSignal(panel.applied):
        panel.find_gate()
    qtbot.waitUntil(lambda: not panel.busy)


def test_a_job_under_way_ends_with_the_panel(qtbot: QtBot, window: Window, panel: MaskPanel) -> None:
    panel.rectangle.chosen.emit(10, 10, 300, 200)
    panel.find_gate()
    panel.close()
    assert not panel.busy


@pytest.mark.parametrize("moving", [False, True])
def test_the_wipe_shows_everything_lit_on_its_left(
    qtbot: QtBot, window: Window, panel: MaskPanel, rig: Rig, moving: bool
) -> None:
    if moving:
        window.session.adopt(source_of(rig, moving=True))
        qtbot.waitUntil(lambda: window.live.frame is not None)
    view = window.live.view
    qtbot.waitUntil(lambda: view.image is not None and view.image.mean() < 1000)
    wall_left, wall_right = (panel.wipe.before.to_view(*at).toPoint() for at in ((20, 20), (310, 20)))

    def brightness(at: QPoint) -> int:
        return view.grab().toImage().pixelColor(at).lightness()

    # the gate of the middle of the image records the card alone
    assert brightness(wall_left) < 70
    panel.wipe.setChecked(True)
    qtbot.waitUntil(lambda: panel.wipe.before.image is not None)
    assert brightness(wall_left) > 90
    assert brightness(wall_right) < 70
    handle = panel.wipe.handle
    qtbot.mousePress(handle, LEFT, pos=handle.rect().center())
    target = handle.mapFromGlobal(view.mapToGlobal(QPoint(round(view.width() * 0.7), 50)))
    move_pointer(qtbot, handle, target)
    qtbot.mouseRelease(handle, LEFT, pos=target)
    assert panel.wipe.before.share == pytest.approx(0.7, abs=0.01)
    first = panel.wipe.before.image
    if moving:
        qtbot.waitUntil(lambda: not np.array_equal(panel.wipe.before.image, first))
    panel.wipe.setChecked(False)
    assert handle.isHidden()
    assert panel.wipe.before.isHidden()


def test_a_camera_that_knows_nothing_takes_a_frame_for_the_wipe(
    qtbot: QtBot, window: Window, panel: MaskPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    from slopegate.app.panels import wipe

    monkeypatch.setattr(wipe, "known_buffers", lambda source: None)
    panel.wipe.setChecked(True)
    qtbot.waitUntil(lambda: panel.wipe.before.image is not None)
    image = panel.wipe.before.image
    assert image is not None
    assert image.shape == (240, 320)
    assert np.median(image) > 100


def test_a_camera_that_makes_other_gates_is_not_measured(rig: Rig) -> None:
    """As a capture that is played back: it gives what it has, whatever is asked for."""

    class Played(VirtualCamera):
        def configure(self, settings: GateSettings) -> GateSettings:
            applied = super().configure(replace(settings, exposure_us=1000.0))
            self._asked = settings
            return applied

    source = source_of(rig)
    region = source.buffers.inverse_depth > 0.75
    wanted = Wanted(region, False, source.buffers.projector_row)
    said = Progress(lambda share, text: None)
    with Stream(Played(rig, source.scene, rate_hz=math.inf)) as stream:
        sent = find(rig, wanted, said).best.sent
        with pytest.raises(CameraError, match="does not make the complement"):
            measure(stream, rig, 40.0, sent, wanted, said)
        with pytest.raises(CameraError, match="cannot light everything"):
            take_lit(stream, rig, source.camera.info, said)
        said.cancel()
        with pytest.raises(CancelledError):
            measure(stream, rig, 40.0, sent, wanted, said)
    source.close()
