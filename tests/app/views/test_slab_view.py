"""The 3D picture, drawn and read back, and what stands in for it where it cannot be drawn."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QMouseEvent, QVector3D
from PySide6.QtWidgets import QApplication, QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from pointer import double_click
from slopegate.app.views import gl_view, opengl, slab_view
from slopegate.app.views.opengl import opengl_missing
from slopegate.app.views.slab_view import SlabView
from slopegate.app.widgets.theme import DARK, LIGHT
from slopegate.core.render.render import Buffers
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Mesh, Scene, Sphere
from slopegate.drivers.files.rig_files import load_rig

FLAT_US = 996.66866 / 78
WANTED = gate(FLAT_US, 2028.2, 600)
NOWHERE = gate(FLAT_US, -300, 100)
RED, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(None)


def board(name: str, albedo: tuple[float, float, float], x: float, y: float, z: float, half: float) -> Mesh:
    corners = np.array(
        [[x - half, y - half, z], [x + half, y - half, z], [x + half, y + half, z], [x - half, y + half, z]]
    )
    return Mesh(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), albedo)


# Behind the slab (1.05 m) a red board on the left and a blue one on the right; in front of it a small white one.
BOARDS = Scene(
    "boards",
    objects=(
        board("red", RED, -0.15, 0.0, 1.6, 0.1),
        board("blue", BLUE, 0.15, 0.0, 1.6, 0.1),
        board("white", WHITE, 0.0, -0.1, 0.8, 0.03),
    ),
)


def shown_view(qtbot: QtBot, rig: Rig, scene: Scene, direction: str, buffers: Buffers | None = None) -> SlabView:
    view = SlabView()
    qtbot.addWidget(view)
    view.resize(500, 400)
    with qtbot.waitExposed(view):
        view.show()
    assert view.has_opengl
    view.set_scene(rig, scene, buffers)
    view.set_view(direction)
    qtbot.waitUntil(lambda: view.settled)
    return view


def picture(view: SlabView) -> NDArray[np.int64]:
    """The 3D picture, (H, W, 3) of 0..255."""
    assert view.gl is not None
    image = view.gl.grabFramebuffer().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).astype(np.int64)


def place(view: SlabView, x: float, y: float, z: float) -> tuple[int, int]:
    """Row and column of a world point in the picture."""
    gl = view.gl
    assert gl is not None
    at = (gl.projectionMatrix(gl.getViewport(), gl.getViewport()) * gl.viewMatrix()).map(QVector3D(x, z, -y))
    return round((1 - at.y()) / 2 * gl.height()), round((at.x() + 1) / 2 * gl.width())


@pytest.mark.usefixtures("opengl")
def test_what_lies_behind_the_slab_shines_through(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, BOARDS, "Front")
    view.show_gate(rig, NOWHERE)
    red, blue = place(view, -0.21, 0.0, 1.6), place(view, 0.21, 0.0, 1.6)
    white, air = place(view, 0.0, -0.1, 0.8), place(view, 0.0, -0.2, 1.6)
    without = picture(view)
    for at, channel in ((red, 0), (blue, 2)):
        assert without[at][channel] > 80
        assert np.delete(without[at], channel).max() < 20
    view.show_gate(rig, WANTED)
    through = picture(view)
    assert np.abs(through[air] - without[air]).max() > 20
    for at in (red, blue):
        assert np.abs(through[at] - without[at]).max() > 20
    seen = np.abs(through[red] - through[blue])[[0, 2]]
    assert np.all(seen > 0.4 * np.abs(without[red] - without[blue])[[0, 2]])
    np.testing.assert_array_equal(through[white], without[white])


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("azimuth", [-90, 90])
def test_near_and_far_surface_are_both_seen_from_either_side(qtbot: QtBot, rig: Rig, azimuth: float) -> None:
    view = shown_view(qtbot, rig, Scene("empty"), "Front")
    view.show_gate(rig, WANTED)
    view.gl.setCameraPosition(azimuth=azimuth)  # type: ignore[union-attr]
    tone = np.array([int(LIGHT.slab[k : k + 2], 16) for k in (1, 3, 5)])
    expected = 255 * 0.78**2 + tone * (1 - 0.78**2)
    assert np.abs(picture(view)[place(view, 0.25, 0.0, 1.05)] - expected).max() < 4


@pytest.mark.usefixtures("opengl")
def test_the_slab_leaves_no_depth_behind(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, BOARDS, "3D")
    view.show_gate(rig, WANTED)
    first = picture(view)
    for _ in range(2):
        np.testing.assert_array_equal(picture(view), first)
    view.show_gate(rig, NOWHERE)
    assert np.any(picture(view) != first)
    view.show_gate(rig, WANTED)
    np.testing.assert_array_equal(picture(view), first)


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("direction", ["3D", "Side", "Front"])
def test_up_is_up(qtbot: QtBot, rig: Rig, direction: str) -> None:
    balls = Scene(
        "balls", objects=(Sphere("high", (0.0, -0.2, 1.0), 0.1, RED), Sphere("low", (0.0, 0.2, 1.0), 0.1, BLUE))
    )
    view = shown_view(qtbot, rig, balls, direction)
    seen = picture(view)
    red = (seen[..., 0] > 80) & (seen[..., 1:].max(axis=-1) < 20)
    blue = (seen[..., 2] > 80) & (seen[..., :2].max(axis=-1) < 20)
    assert red.sum() > 50
    assert blue.sum() > 50
    assert np.nonzero(red)[0].max() < np.nonzero(blue)[0].min()


@pytest.mark.usefixtures("opengl")
def test_from_the_side_forward_is_to_the_right_and_from_the_front_right_is_right(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, BOARDS, "Side")
    assert place(view, 0, 0, 0.5)[1] < place(view, 0, 0, 1.5)[1]
    view.set_view("Front")
    assert place(view, -0.2, 0, 1)[1] < place(view, 0.2, 0, 1)[1]
    view.set_view("Top")
    assert place(view, 0, 0, 1.5)[0] < place(view, 0, 0, 0.5)[0]
    assert place(view, -0.2, 0, 1)[1] < place(view, 0.2, 0, 1)[1]


def half_seen(rig: Rig) -> Buffers:
    """A white board at 1.05 m that fills the upper half of the image."""
    made = Buffers.empty(1200, 1600)
    made.inverse_depth[:600] = 1 / 1.05
    rows = np.arange(600)[:, None] + 0.5
    row = rig.to_projector(rig.camera_centre_m + rig.camera_rays(800.0, rows) * 1.05)[1]
    made.projector_row[:600] = np.where(row < 0, -1, row)
    made.direct[:600] = 1 / 1.05**2
    return made


@pytest.mark.usefixtures("opengl")
def test_points_in_the_slab_are_marked(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, Scene("points"), "Front", half_seen(rig))
    view.set_dark(True)
    view.show_gate(rig, gate(FLAT_US, 1000, 100))
    at = place(view, 0.2, -0.15, 1.05)  # beside the labels
    plain = picture(view)[at]
    view.show_gate(rig, WANTED)
    marked = picture(view)[at]
    assert np.ptp(plain) < 40
    assert marked[1] - marked[[0, 2]].max() > 40


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize(("dark", "colours"), [(True, DARK), (False, LIGHT)])
def test_both_themes(qtbot: QtBot, rig: Rig, dark: bool, colours: SimpleNamespace) -> None:
    view = shown_view(qtbot, rig, Scene("empty"), "3D")
    view.set_dark(dark)
    view.show_gate(rig, NOWHERE)
    seen = picture(view)
    names = ("background", "camera", "projector")
    for name in names:
        tone = [int(getattr(colours, name)[k : k + 2], 16) for k in (1, 3, 5)]
        assert (np.abs(seen - tone).max(axis=-1) < 12).sum() > 100, name


@pytest.mark.usefixtures("opengl")
def test_labels_are_in_a_grab_of_the_window_too(qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    view = shown_view(qtbot, rig, Scene("empty"), "Side")
    view.set_dark(True)
    with_labels = view.gl.grab().toImage()  # type: ignore[union-attr]
    monkeypatch.setattr(gl_view, "write_labels", lambda *_: None)
    assert view.gl.grab().toImage() != with_labels  # type: ignore[union-attr]


@pytest.mark.usefixtures("opengl")
def test_dragging_turns_and_double_click_returns(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, BOARDS, "3D")
    gl = view.gl
    assert gl is not None
    start = dict(gl.opts)
    gl.mousePos = QPointF(100, 100)
    left = Qt.MouseButton.LeftButton
    to, no_keys = QPointF(160, 120), Qt.KeyboardModifier.NoModifier
    gl.mouseMoveEvent(QMouseEvent(QEvent.Type.MouseMove, to, to, left, left, no_keys))
    assert gl.opts["azimuth"] != start["azimuth"]
    view.resize(600, 420)
    assert gl.opts["azimuth"] != start["azimuth"]
    view.resize(500, 400)
    double_click(qtbot, gl, QPoint(50, 50))
    assert {k: gl.opts[k] for k in ("azimuth", "elevation", "distance")} == pytest.approx(
        {k: start[k] for k in ("azimuth", "elevation", "distance")}
    )
    qtbot.keyClick(gl, Qt.Key.Key_Plus)
    assert gl.opts["distance"] < start["distance"]


@pytest.mark.usefixtures("opengl")
def test_moving_to_another_window_keeps_the_picture(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, BOARDS, "3D")
    view.show_gate(rig, WANTED)
    QApplication.processEvents()
    first = picture(view)
    other = QWidget()
    qtbot.addWidget(other)
    QVBoxLayout(other).addWidget(view)
    other.layout().setContentsMargins(0, 0, 0, 0)
    other.resize(500, 400)
    with qtbot.waitExposed(other):
        other.show()
    qtbot.waitUntil(lambda: view.settled)
    QApplication.processEvents()
    assert view.has_opengl
    assert np.abs(picture(view) - first).mean() < 2


@pytest.mark.usefixtures("opengl")
def test_the_first_picture_is_drawn_in_several_turns(qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_view, "FIRST_TURN_S", 0.0)
    seen: list[int] = []
    drawn = gl_view.GlView.drawItemTree

    def draw(view: gl_view.GlView, *words: Any, **named: Any) -> None:
        before = view._drawn
        drawn(view, *words, **named)
        seen.append(view._drawn - before)

    monkeypatch.setattr(gl_view.GlView, "drawItemTree", draw)
    view = shown_view(qtbot, rig, BOARDS, "3D")
    assert view.gl is not None
    assert sum(seen) == len(view.gl.items)
    assert max(seen) <= 1


@pytest.mark.usefixtures("opengl")
def test_a_failure_while_drawing_turns_into_the_section(
    qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = shown_view(qtbot, rig, BOARDS, "3D")
    view.show_gate(rig, WANTED)

    def broken(*_: object) -> None:
        raise RuntimeError("the driver is gone")

    monkeypatch.setattr(gl_view, "write_labels", broken)
    view.gl.update()  # type: ignore[union-attr]
    qtbot.waitUntil(lambda: not view.has_opengl)
    assert view.section is not None
    assert view.section.isVisible()
    assert "the driver is gone" in view.note.text()
    assert "distance 1.050 m" in view.section.note.text()


@pytest.mark.usefixtures("opengl")
def test_a_bug_while_drawing_turns_into_the_section_and_is_logged(
    qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    view = shown_view(qtbot, rig, BOARDS, "3D")

    def broken(*_: object) -> None:
        raise KeyError("label")

    monkeypatch.setattr(gl_view, "write_labels", broken)
    view.gl.update()  # type: ignore[union-attr]
    qtbot.waitUntil(lambda: not view.has_opengl)
    assert "Something went wrong inside the program (KeyError)" in view.note.text()
    (record,) = bugs
    assert record.exc_info[0] is KeyError
    bugs.clear()


ODD = [
    gate(FLAT_US, 2028.2, 1e-3),
    gate(FLAT_US, -300, 100),
    gate(FLAT_US, 700, 1600),
    gate(FLAT_US, 2028.2, 20000),
    gate(FLAT_US, 2028.2, 16400),
    gate(996.66866 / 10, 0, 400),
    gate(1e-3, 2000, 300),
    gate(1e3, 2000, 300),
]


@pytest.mark.usefixtures("opengl")
def test_odd_gates_are_drawn(qtbot: QtBot, rig: Rig) -> None:
    view = shown_view(qtbot, rig, Scene("empty"), "3D", Buffers.empty(1200, 1600))
    for wanted in ODD:
        view.show_gate(rig, wanted)
        assert np.ptp(picture(view)) > 50
        assert view.has_opengl


@pytest.fixture
def without_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slab_view, "opengl_missing", lambda: "there is no driver")


@pytest.mark.usefixtures("without_opengl")
@pytest.mark.parametrize("wanted", [WANTED, *ODD])
def test_without_opengl_the_section_serves(qtbot: QtBot, rig: Rig, wanted: GateSettings) -> None:
    view = SlabView()
    qtbot.addWidget(view)
    view.resize(500, 350)
    view.show()
    assert not view.has_opengl
    view.set_view("Top")
    view.set_dark(True)
    view.set_scene(rig, BOARDS, None)
    view.show_gate(rig, wanted)
    assert view.section is not None
    assert view.section.isVisible()
    assert view.note.text() == "No 3D picture: there is no driver. The section shows the same geometry."
    assert view.section.height() > 200
    image = view.grab().toImage()
    tones = {image.pixelColor(x, y).name() for x in range(0, 500, 5) for y in range(0, 350, 5)}
    assert len(tones) > 3


def test_the_offscreen_platform_is_known_to_draw_nothing(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl.QGuiApplication, "platformName", lambda: "offscreen")
    assert "offscreen" in opengl_missing()
