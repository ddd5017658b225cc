"""The section, drawn and read back; it needs no OpenGL."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QMouseEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from pointer import double_click
from slopegate.app.views.section_view import SectionView, distance_marks, outline, polygon
from slopegate.app.views.slab_geometry import LEAVING, NO_CLOUD, extent, read_out, side_cloud
from slopegate.app.views.slab_view import SlabView
from slopegate.app.widgets.plot_theme import dress
from slopegate.app.widgets.theme import DARK, LIGHT
from slopegate.core.gating.gate import complement, slab
from slopegate.core.gating.slab_mesh import slab_pieces
from slopegate.core.render.render import Buffers
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.rig_files import load_rig

FLAT_US = 996.66866 / 78
WANTED = gate(FLAT_US, 2028.2, 600)
EMPTY = Scene("empty")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(None)


@pytest.fixture
def view(qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> SectionView:
    monkeypatch.setitem(pg.CONFIG_OPTIONS, "mouseRateLimit", 0)  # no move of the pointer comes too fast
    made = SectionView()
    qtbot.addWidget(made)
    made.resize(500, 350)
    with qtbot.waitExposed(made):
        made.show()
    made.set_scene(rig, EMPTY, None)
    return made


def ball_above(rig: Rig) -> Buffers:
    """A surface at 1.05 m in the upper quarter of the image only."""
    made = Buffers.empty(1200, 1600)
    made.inverse_depth[:300] = 1 / 1.05
    rows = np.arange(300)[:, None] + 0.5
    made.projector_row[:300] = rig.to_projector(rig.camera_centre_m + rig.camera_rays(800.0, rows) * 1.05)[1]
    made.direct[:300] = 0.5
    return made


def colour_at(view: SectionView, z: float, height: float) -> QColor:
    at = view.plot.mapFromScene(view.plot.getViewBox().mapViewToScene(QPointF(z, height)))
    return view.plot.grab().toImage().pixelColor(at)


@pytest.mark.parametrize(("dark", "colours"), [(True, DARK), (False, LIGHT)])
def test_the_slab_stands_between_near_and_far(view: SectionView, rig: Rig, dark: bool, colours: object) -> None:
    view.set_dark(dark)
    view.show_gate(rig, WANTED)
    found = slab(rig, WANTED)
    assert found.near_m is not None
    assert found.far_m is not None
    background = QColor(colours.background)  # type: ignore[attr-defined]
    for z in (found.near_m + 0.03, found.far_m - 0.03):
        shown = colour_at(view, z, -0.1)
        assert shown.green() - shown.red() > background.green() - background.red() + 20
    for z in (found.near_m - 0.05, found.far_m + 0.05):
        assert colour_at(view, z, -0.1) == background


def test_up_is_up_and_metres_are_equal(view: SectionView, rig: Rig) -> None:
    box = view.plot.getViewBox()
    origin, up, ahead = (box.mapViewToScene(QPointF(*at)) for at in ((1, 0), (1, 0.5), (1.5, 0)))
    assert up.y() < origin.y()
    assert ahead.x() - origin.x() == pytest.approx(origin.y() - up.y(), rel=0.01)
    view.set_scene(rig, EMPTY, ball_above(rig))
    shown = view.surface.dots.boundingRect()
    assert shown.top() > 0
    assert shown.left() == pytest.approx(1.05)


def test_the_label_at_the_end_of_an_axis_has_room(view: SectionView) -> None:
    plot = view.plot
    assert plot.getPlotItem().vb.geometry().top() >= plot.fontMetrics().height() / 2


def test_points_in_the_slab_are_marked(view: SectionView, rig: Rig) -> None:
    view.set_scene(rig, EMPTY, ball_above(rig))
    view.show_gate(rig, WANTED)
    assert view.lit.dots.boundingRect().height() > 0.1
    view.show_gate(rig, gate(FLAT_US, 2500, 100))
    assert view.lit.dots.boundingRect() == QRectF()


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        (WANTED, "distance 1.050 m"),
        (gate(FLAT_US, -300, 300), "The slab lies behind the rig"),
        (gate(FLAT_US, 700, 1600), "The slab reaches to infinity"),
        (gate(FLAT_US, 2028.2, 20000), "distance"),
        (gate(FLAT_US, 1e5, 1e-3), "distance"),
        (gate(1e-3, 2000, 300), "tilt"),
        (gate(1e3, 2000, 300), "tilt"),
    ],
)
def test_odd_gates_are_drawn_and_explained(view: SectionView, rig: Rig, wanted: GateSettings, text: str) -> None:
    view.show_gate(rig, wanted)
    assert text in view.note.text()
    assert not view.grab().isNull()


def test_a_slab_to_infinity_leaves_the_view_and_another_ends_in_it(view: SectionView, rig: Rig) -> None:
    right = view.plot.viewRect().right()
    view.show_gate(rig, gate(FLAT_US, 700, 1600))
    assert view._body.path().boundingRect().right() > 2 * right
    view.show_gate(rig, WANTED)
    assert view._body.path().boundingRect().right() < right


def test_the_hinge_is_shown_when_in_reach(view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, gate(FLAT_US * 1.56, -1697.2, 500))
    assert view.hinge.isVisible()
    hinge = slab(rig, gate(FLAT_US * 1.56, -1697.2, 500)).hinge_y_m
    assert hinge is not None
    assert view.hinge.dots.boundingRect().y() == pytest.approx(-hinge)
    view.show_gate(rig, WANTED)
    assert not view.hinge.isVisible()


def test_the_outline_closes_round_the_centre(rig: Rig) -> None:
    (piece,) = slab_pieces(rig, WANTED, 0.3, 3.0, column=800.0)
    assert polygon(outline(piece)).containsPoint(QPointF(1.05, 0.0), Qt.FillRule.OddEvenFill)
    assert not polygon(outline(piece)).containsPoint(QPointF(1.05, 0.5), Qt.FillRule.OddEvenFill)


def test_marks_stand_at_near_and_far(rig: Rig) -> None:
    found = slab(rig, WANTED)
    marks = distance_marks(found, 3.0)
    assert set(marks[np.isfinite(marks[:, 0]), 0]) == {found.near_m, found.far_m}
    cut = distance_marks(found, 1.0)
    assert cut[np.isfinite(cut[:, 0]), 0].max() == LEAVING
    assert distance_marks(found, 0.5).shape == (0, 2)


def test_another_rig_is_taken_up(view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, WANTED)
    before = view.baseline.yData.copy()
    wide = type(rig)(rig.camera, rig.projector, (0.0, -0.3, 0.0))
    view.show_gate(wide, WANTED)
    assert np.ptp(view.baseline.yData) == pytest.approx(3 * np.ptp(before))


def drag(qtbot: QtBot, view: SectionView, start: QPointF, end: QPointF, keys: Qt.KeyboardModifier) -> None:
    """Press, move in steps and release in section coordinates."""
    port, box = view.plot.viewport(), view.plot.getViewBox()
    points = [start + (end - start) * k / 5 for k in range(6)]
    pixels = [QPointF(view.plot.mapFromScene(box.mapViewToScene(at))) for at in points]
    left, none = Qt.MouseButton.LeftButton, Qt.MouseButton.NoButton
    kinds = [(QEvent.Type.MouseMove, none, none), (QEvent.Type.MouseButtonPress, left, left)]
    kinds += [(QEvent.Type.MouseMove, none, left)] * 5 + [(QEvent.Type.MouseButtonRelease, left, none)]
    for (kind, button, held), at in zip(kinds, [pixels[0], *pixels, pixels[-1]], strict=True):
        QApplication.sendEvent(port, QMouseEvent(kind, at, port.mapToGlobal(at), button, held, keys))


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (Qt.KeyboardModifier.NoModifier, (0.0, 1.25, None)),
        (Qt.KeyboardModifier.ShiftModifier, (63.4, 1.05, None)),
    ],
)
def test_a_drag_on_the_slab_asks_for_another(
    qtbot: QtBot, view: SectionView, rig: Rig, keys: Qt.KeyboardModifier, expected: tuple[float, float, None]
) -> None:
    view.show_gate(rig, WANTED)
    wishes: list[tuple[float, float, float]] = []
    view.gate_wished.connect(lambda *wish: wishes.append(wish))
    before = view.plot.viewRange()
    drag(qtbot, view, QPointF(1.05, 0.1), QPointF(1.25, 0.1), keys)
    assert wishes
    tilt, distance, thickness = wishes[-1]
    assert tilt == pytest.approx(expected[0], abs=3)
    assert distance == pytest.approx(expected[1], abs=0.01)
    assert thickness == pytest.approx(slab(rig, WANTED).thickness_m)
    assert view.plot.viewRange() == before


def test_a_drag_beside_the_slab_moves_the_view(qtbot: QtBot, view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, WANTED)
    wishes: list[object] = []
    view.gate_wished.connect(lambda *wish: wishes.append(wish))
    before = view.plot.viewRange()
    drag(qtbot, view, QPointF(1.6, 0.1), QPointF(1.7, 0.1), Qt.KeyboardModifier.NoModifier)
    assert not wishes
    assert view.plot.viewRange() != before


def test_a_thin_slab_is_caught_a_few_pixels_beside_it(qtbot: QtBot, view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, gate(FLAT_US, 2028.2, 100))
    wishes: list[object] = []
    view.gate_wished.connect(lambda *wish: wishes.append(wish))
    box = view.plot.getViewBox()
    pixel = 1 / (box.mapViewToScene(QPointF(1, 0)).x() - box.mapViewToScene(QPointF(0, 0)).x())
    edge = view._body.path().boundingRect().right()
    drag(qtbot, view, QPointF(edge + 9 * pixel, 0.1), QPointF(edge + 30 * pixel, 0.1), Qt.KeyboardModifier.NoModifier)
    assert not wishes
    drag(qtbot, view, QPointF(edge + 3 * pixel, 0.1), QPointF(edge + 30 * pixel, 0.1), Qt.KeyboardModifier.NoModifier)
    assert wishes


def test_dots_are_repainted_with_their_size_on_the_screen(view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, gate(FLAT_US * 1.56, -1697.2, 500))
    box = view.plot.getViewBox()
    pixel = 1 / (box.mapViewToScene(QPointF(1, 0)).x() - box.mapViewToScene(QPointF(0, 0)).x())
    assert view.hinge.boundingRect().width() >= 10 * pixel
    view.plot.setXRange(0, 10)
    view.grab()
    assert view.hinge.boundingRect().width() >= 30 * pixel


def test_the_caption_of_a_complement_says_what_is_left_out(qtbot: QtBot, opengl: None, rig: Rig) -> None:
    rest, shown = complement(WANTED, rig.projector.period_us), f"all but {read_out(slab(rig, WANTED))}"
    for view in (SectionView(), SlabView()):
        qtbot.addWidget(view)
        view.set_scene(rig, Scene("nothing"), None)
        view.show_gate(rig, rest, WANTED)
        assert view.note.text().startswith(shown)
        if isinstance(view, SectionView):
            shown_m = extent(rig, Scene("nothing"), NO_CLOUD).z_max
            marked = np.stack(view.distance.getData(), axis=-1)
            np.testing.assert_array_equal(marked, distance_marks(slab(rig, WANTED), shown_m))
        view.show_gate(rig, rest)
        assert not view.note.text().startswith("all but")


def shown_range(view: SectionView) -> list[float]:
    return [end for axis in view.plot.viewRange() for end in axis]


def pan_away(qtbot: QtBot, view: SectionView) -> None:
    """A drag beside the slab."""
    port = view.plot.viewport()
    begin = view.plot.mapFromScene(view.plot.getViewBox().mapViewToScene(QPointF(0.4, -0.2)))
    for kind, at, held in (
        (QEvent.Type.MouseMove, begin, Qt.MouseButton.NoButton),
        (QEvent.Type.MouseButtonPress, begin, Qt.MouseButton.LeftButton),
        *((QEvent.Type.MouseMove, begin - QPoint(step, 0), Qt.MouseButton.LeftButton) for step in (100, 500, 1500)),
        (QEvent.Type.MouseButtonRelease, begin - QPoint(1500, 0), Qt.MouseButton.NoButton),
    ):
        button = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseMove else Qt.MouseButton.LeftButton
        event = QMouseEvent(kind, QPointF(at), port.mapToGlobal(QPointF(at)), button, held, Qt.KeyboardModifier(0))
        QApplication.sendEvent(port, event)


def test_a_view_that_was_panned_away_comes_back(qtbot: QtBot, view: SectionView, rig: Rig) -> None:
    view.show_gate(rig, WANTED)
    qtbot.waitUntil(lambda: view.note.height() >= view.note.heightForWidth(view.note.width()))
    whole = shown_range(view)
    pan_away(qtbot, view)
    assert shown_range(view)[0] > 3
    double_click(qtbot, view.plot.viewport(), view.plot.viewport().rect().center())
    assert shown_range(view) == pytest.approx(whole)
    pan_away(qtbot, view)
    view.show_gate(rig, gate(FLAT_US, 2128.2, 600))
    assert shown_range(view) == pytest.approx(whole)
    assert view.plot.getPlotItem().buttonsHidden


def test_the_width_is_used(qtbot: QtBot, view: SectionView, rig: Rig) -> None:
    buffers = ball_above(rig)
    view.set_scene(rig, EMPTY, buffers)
    view.resize(700, 300)
    shown_m = extent(rig, EMPTY, side_cloud(rig, buffers)).z_max

    def fits() -> None:
        left, right, *heights = shown_range(view)
        assert right - left < 1.2 * (shown_m + 0.05)
        dots = view.surface.dots.boundingRect()
        assert heights[0] < dots.top()
        assert dots.bottom() < heights[1]

    qtbot.waitUntil(fits)


def test_another_theme_leaves_the_figures_of_the_axes_alone(qtbot: QtBot) -> None:
    plot = pg.PlotWidget()
    qtbot.addWidget(plot)
    plot.setLabel("left", "height (m)")
    plot.setYRange(-0.5, 0.5)
    with qtbot.waitExposed(plot):
        plot.show()
    dress(plot, DARK)
    assert plot.getAxis("left").autoSIPrefixScale == 1.0
