"""Panel for the automatic search: choose a target, watch the keypoints, use the gate that was found."""

from __future__ import annotations

import threading

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QCloseEvent, QColor, QHideEvent, QPainter, QPaintEvent, QPen, QShowEvent
from PySide6.QtWidgets import (
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.panel_state import Values, numbers_text, text_box
from slopegate.app.session.describe import outcome_text
from slopegate.app.session.loading import Loader
from slopegate.app.session.session import Change, Intent
from slopegate.app.views.draw_tools import RectangleTool
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import Layer
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.plot_theme import dress, fill, pen, plot_colours
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.app.widgets.theme import is_dark
from slopegate.core.rig.arrays import Bools
from slopegate.core.rig.checks import InputError
from slopegate.core.search.keypoints import Keypoints, Rectangle
from slopegate.core.search.search import begin
from slopegate.core.search.state import METHODS, MIN_KEYPOINTS, Method, Outcome, State
from slopegate.drivers.stream.search_run import run_search
from slopegate.drivers.stream.stream import Stream

SEEN, LOST, TARGET = QColor("#39d353"), QColor("#ff6b6b"), QColor("#ffd400")
_RADIUS_PX = 3.0
_METHOD_TEXTS: dict[Method, tuple[str, str]] = {
    "fast": ("Fast", "Cuts the scene with half-period windows, then computes the gate: about 20 frames"),
    "paper": ("Paper", "The paper's steps: clock up, then delay, then exposure: 100 frames and more"),
}


class SearchLayer(Layer):
    """Circles for keypoints that are seen, crosses for those that are lost."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self._target: Rectangle | None = None
        self._places: list[tuple[float, float, bool]] = []

    @property
    def counts(self) -> tuple[int, int]:
        """Keypoints drawn as seen and as lost."""
        seen = sum(place[2] for place in self._places)
        return seen, len(self._places) - seen

    def show_target(self, target: Rectangle | None) -> None:
        """Outline this rectangle of the image; None for the whole image."""
        self._target = target
        self.update()

    def show_keypoints(self, points: Keypoints | None, seen: Bools | None) -> None:
        """Draw these (K) with what the last frame showed; None draws none."""
        self._places = []
        if points is not None:
            shown = seen if seen is not None and len(seen) == len(points) else [False] * len(points)
            self._places = [
                (float(column), float(row), bool(one))
                for column, row, one in zip(points.columns, points.rows, shown, strict=True)
            ]
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self.viewport() is None:
            return
        painter = QPainter(self)
        if self._target is not None:
            x0, y0, x1, y1 = self._target
            painter.setPen(QPen(TARGET, 1.5, Qt.PenStyle.DashLine))
            painter.drawRect(QRectF(self.to_view(x0, y0), self.to_view(x1, y1)))
        painter.setPen(QPen(LOST, 1.2))
        for column, row, seen in self._places:
            if not seen:
                self._cross(painter, self.to_view(column, row))
        painter.setPen(QPen(SEEN, 1.2))
        for column, row, seen in self._places:
            if seen:
                painter.drawEllipse(self.to_view(column, row), _RADIUS_PX, _RADIUS_PX)

    def _cross(self, painter: QPainter, at: QPointF) -> None:
        reach = 0.7 * _RADIUS_PX
        painter.drawLine(at + QPointF(-reach, -reach), at + QPointF(reach, reach))
        painter.drawLine(at + QPointF(-reach, reach), at + QPointF(reach, -reach))


class SearchPanel(Panel):
    """Target, method, start and cancel; the count of keypoints against the frame; the result."""

    stepped = Signal(object)
    """A State, after each frame of the search."""
    _told = Signal(object)
    """The same, from the thread that searches."""
    ended = Signal(object)
    """The Outcome, when the search has ended and the gate is where it is to stay."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._target: Rectangle | None = None
        self._before: Intent | None = None
        self._outcome: Outcome | None = None
        self._stop = threading.Event()
        self._stream: Stream | None = None
        self._state: State | None = None
        """What the last frame of the search told."""
        self._runner: Loader[State] = Loader(lambda _: None, self)
        self._hold = desk.session.hold("the search", "The gate goes back to the one from before.", self.cancel)
        self._runner.release(self._hold)
        self.layer = SearchLayer(desk.live.view)
        self.tool = RectangleTool(desk.live.view)
        self._make_widgets()
        self._arrange()
        self._connect()
        self._dress()
        self._refresh()

    @property
    def busy(self) -> bool:
        """Whether a search is under way."""
        return self._runner.busy

    @property
    def target(self) -> Rectangle | None:
        """What is searched for; None is the whole image."""
        return self._target

    def _make_widgets(self) -> None:
        self.choose, self.whole = QPushButton("Rectangle"), QPushButton("Whole image")
        self.choose.setCheckable(True)
        self.choose.setToolTip("Drag a rectangle about the target over the live image. Esc or the right button end it.")
        self.whole.setToolTip("Search for whatever fills most of the image")
        self.where = QLabel()
        self.method = ChoiceBox()
        self.method.setAccessibleName("Search method")
        for index, name in enumerate(METHODS):
            text, hint = _METHOD_TEXTS[name]
            self.method.addItem(text, name)
            self.method.setItemData(index, hint, Qt.ItemDataRole.ToolTipRole)
        self.method.setToolTip(_METHOD_TEXTS[METHODS[0]][1])
        self.start_button, self.cancel_button = QPushButton("Search"), QPushButton("Cancel")
        self.cancel_button.setToolTip("Stop and go back to the gate from before")
        self.plot = pg.PlotWidget(self)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.setLabel("bottom", "frame")
        self.plot.setLabel("left", "keypoints seen")
        self.plot.setLimits(xMin=0, yMin=0, minXRange=8, minYRange=MIN_KEYPOINTS)
        self.plot.setMinimumHeight(60)
        self._curve = self.plot.plot([], [])
        self.result = QLabel()
        self.result.setWordWrap(True)
        self.result.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.result.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.apply_button, self.restore_button = QPushButton("Apply"), QPushButton("Restore")
        self.apply_button.setToolTip("Use the gate that was found")
        self.restore_button.setToolTip("Go back to the gate from before the search")
        self.progress = QProgressBar()
        self.progress.setFormat("%v / %m frames")
        self.progress.setFixedWidth(160)
        self.doing = ElidedLabel()
        self.doing.setMinimumWidth(100)

    def _arrange(self) -> None:
        top = FlowLayout([self.choose, self.whole, self.method, self.start_button, self.cancel_button])
        result = QVBoxLayout()
        result.addWidget(self.result, 1)
        buttons = QHBoxLayout()
        buttons.addWidget(self.apply_button)
        buttons.addWidget(self.restore_button)
        result.addLayout(buttons)
        middle = QGridLayout()
        middle.addWidget(self.plot, 0, 0)
        middle.addLayout(result, 0, 1)
        middle.setColumnStretch(0, 3)
        middle.setColumnStretch(1, 2)
        bottom = QHBoxLayout()
        bottom.setSpacing(16)
        bottom.addWidget(self.where)
        bottom.addWidget(self.doing, 1)
        bottom.addWidget(self.progress)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(4)
        column.addLayout(top)
        column.addLayout(middle, 1)
        column.addLayout(bottom)

    def _connect(self) -> None:
        self.choose.toggled.connect(lambda on: self.tool.start() if on else self.tool.stop())
        self.tool.ended.connect(lambda: self.choose.setChecked(False))
        self.tool.chosen.connect(self._choose)
        self.whole.clicked.connect(lambda: self.set_target(None))
        self.start_button.clicked.connect(self.start)
        self.cancel_button.clicked.connect(self.cancel)
        self.apply_button.clicked.connect(self._apply)
        self.restore_button.clicked.connect(self._restore)
        self._told.connect(self._on_told)
        self._runner.finished.connect(self._on_finished)
        self._runner.failed.connect(self._on_failed)
        self._session.changed.connect(self._on_changed)

    def set_target(self, target: Rectangle | None) -> None:
        """Search for what this rectangle of the image shows; None for the whole image."""
        self._target = target
        self.layer.show_target(target)
        self._refresh()

    def start(self) -> None:
        """Search from the gate that is set now."""
        source, stream = self._session.source, self._session.stream
        if source is None or stream is None or self.busy:
            return
        info, method = source.camera.info, self.method.currentData()
        try:
            state = begin(source.rig, self._target, method, info.black_count)
        except InputError as error:
            self.result.setText(str(error))
            return
        self.choose.setChecked(False)
        self._before, self._outcome, self._stream = self._session.intent, None, stream
        self._stop = stop = threading.Event()
        self.progress.setRange(0, state.task.max_frames)
        self._show(state)
        self.result.clear()
        self._hold.begin("gate")
        self._runner.start(lambda progress: run_search(stream, info.pixel_format, state, self._told.emit, stop.is_set))
        self._refresh()

    def cancel(self) -> None:
        """End the search; the gate goes back to what it was."""
        self._stop.set()

    def _choose(self, x0: int, y0: int, x1: int, y1: int) -> None:
        self.tool.stop()
        self.set_target((x0, y0, x1, y1))

    def kept_state(self) -> Values:
        """The fields, and the target where it is not the whole image."""
        return super().kept_state() | ({} if self._target is None else {"target": numbers_text(self._target)})

    def set_state(self, values: Values) -> None:
        """Set the fields and the target."""
        super().set_state(values)
        source = self._session.source
        if source is not None and not self.busy:
            self.set_target(text_box(values.get("target"), source.shape))

    def _on_told(self, state: State) -> None:
        if self._session.stream is self._stream:
            self._show(state)
            self.stepped.emit(state)

    def _show(self, state: State) -> None:
        self._state = state
        if self.isVisible():
            self._draw(state)

    def _draw(self, state: State) -> None:
        self.progress.setValue(state.frames)
        self.doing.set_full_text(f"{state.phase.doing.capitalize()} ..." if state.wish is not None else "")
        self._curve.setData(range(1, len(state.history) + 1), [step.seen for step in state.history])
        self.layer.show_keypoints(state.points, state.seen)

    def _on_finished(self, state: State) -> None:
        if self._stop.is_set():
            state = state.ending("cancelled", "the search was cancelled")  # it may have come to its end before it heard
        outcome, source = state.outcome, self._session.source
        assert outcome is not None
        if source is not None and self._session.stream is self._stream:
            self._show(state)
            self._outcome = outcome
            self._desk.keep_found(outcome.settings)
            self._apply()
            if outcome.cause == "cancelled":  # what was seen last is not what is on show now
                self._state = None
                self.layer.show_keypoints(None, None)
            self.result.setText(outcome_text(source.rig, outcome))
        self._refresh()
        self.ended.emit(outcome)

    def _on_failed(self, sentence: str) -> None:
        if self._session.stream is self._stream:  # not that of a scene that is gone
            self.result.setText(sentence)
        self.doing.set_full_text("")
        self._refresh()

    def _apply(self) -> None:
        if self._outcome is not None and self._outcome.settings is not None:
            self._session.ask(Intent(self._outcome.settings))

    def _restore(self) -> None:
        if self._before is not None:
            self._session.ask(self._before)

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            self.cancel()
            self._before = self._outcome = None
            self._state = None
            self.result.clear()
            self.progress.setValue(0)
            self._curve.setData([], [])
            self.layer.show_keypoints(None, None)
            self.set_target(None)

    def follow(self, change: Change) -> None:
        self._refresh()

    def _refresh(self) -> None:
        source, busy = self._session.source, self.busy
        gated = source is not None and source.camera.info.limits is not None
        for widget in (self.choose, self.whole, self.method):
            widget.setEnabled(gated and not busy)
        self.start_button.setEnabled(gated and not busy)
        self.cancel_button.setEnabled(busy)
        found = self._outcome is not None and self._outcome.settings is not None
        self.apply_button.setEnabled(found and not busy)
        self.restore_button.setEnabled(found and not busy and self._before is not None)
        box = self._target
        self.where.setText(
            "Target: whole image" if box is None else f"Target: {box[2] - box[0]} \u00d7 {box[3] - box[1]} pixels"
        )

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self._state is not None:
            self._draw(self._state)
        self.layer.show()
        self.layer.raise_()

    def hideEvent(self, event: QHideEvent) -> None:
        self.choose.setChecked(False)
        if not event.spontaneous():
            self.layer.hide()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def closeEvent(self, event: QCloseEvent) -> None:
        self.cancel()
        self._runner.close()
        event.accept()

    def _dress(self) -> None:
        colours = plot_colours(is_dark(self.palette()))
        dress(self.plot, colours)
        self._curve.setPen(pen(colours.slab, 1.5))
        self._curve.setSymbol("o")
        self._curve.setSymbolSize(4)
        self._curve.setSymbolBrush(fill(colours.slab, 255))
        self._curve.setSymbolPen(None)
