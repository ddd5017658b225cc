"""Second step of a calibration: hold the chart in many ways, and see what each view is worth."""

from __future__ import annotations

from typing import Final

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPainter, QPixmap
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.calibrate_pictures import THERE, WANTED, ChartMarks, ChartPicture, CoverageMap
from slopegate.app.panels.calibrate_run import CalibrationRun, CalibrationWork, ChartLook
from slopegate.app.session.describe import as_sentence
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.sentence import ONE_LINE, Sentence, keep_place
from slopegate.core.calibration.advice import Judgement, Light, coverage, view_verdict
from slopegate.drivers.calibrations.geometry_run import LookedView, judgement

WORDS: Final[dict[Light, str]] = {"green": "good", "amber": "fair", "red": "bad"}
WHOLE_WORDS: Final[dict[Light, str]] = {"green": "Well", "amber": "Nearly", "red": "Not yet"}
LAMPS: Final[dict[Light, str]] = {"green": "#2e9e4f", "amber": "#d99a00", "red": "#d23b2f"}
LAMP_PX = 12
OUT, IN = "Leave out", "Take it in"
_LONGEST_HINT: Final = (
    "The chart is not seen. Hold the chart 0.88 m away in the upper right part of the picture, with its bottom edge "
    "30\u00b0 and its right edge 30\u00b0 away from the camera."
)
_LONG_VERDICT: Final = (
    "Nearly: 10 views, distances to 0.55 % (one standard error); corners cover 40 % of the camera's picture, half is "
    "better."
)


def lamp(light: Light) -> QIcon:
    """A disc of the light's colour; words stand beside it wherever it is shown."""
    picture = QPixmap(LAMP_PX, LAMP_PX)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setBrush(QColor(LAMPS[light]))
    painter.setPen(QColor("#00000080"))
    painter.drawEllipse(1, 1, LAMP_PX - 2, LAMP_PX - 2)
    painter.end()
    icon = QIcon(picture)
    icon.addPixmap(picture, QIcon.Mode.Selected)  # which would be tinted until no colour is left
    return icon


class PosesStep(QWidget):
    """The live chart, where to hold it, and the views that were taken."""

    take_wished = Signal()
    read_wished = Signal()
    done_wished = Signal()

    def __init__(self, run: CalibrationRun) -> None:
        super().__init__()
        self._run = run
        self._look: ChartLook | None = None
        self._listed = 0
        self._lent: tuple[QWidget | None, QWidget | None] = None, None
        """Whose keys Qt handed on, and to whom."""
        self.hint = Sentence()
        self.picture = ChartPicture()
        self.take, self.stop = QPushButton("Take this pose"), QPushButton("Stop")
        self.auto, self.skip = QCheckBox("When it rests there"), QPushButton("Another pose")
        self.go_there, self.read = QPushButton("Hold it there"), QPushButton("Read folder ...")
        self.bar, self.status = QProgressBar(), Sentence()
        self.camera = CoverageMap("Camera", "Where the camera's picture has corners of good views")
        self.projector = CoverageMap("Projector", "Where the projector's picture has corners of good views")
        self.list, self.why = QListWidget(), Sentence()
        self.out, self.again = QPushButton(OUT), QPushButton("Take again")
        self.lamp, self.told = QLabel(), Sentence()
        self.done = QPushButton("See the result")
        self._explain()
        self._arrange()
        self._connect()
        self.refresh()

    def _explain(self) -> None:
        big = self.hint.font()
        big.setPointSizeF(1.15 * big.pointSizeF())
        big.setBold(True)
        self.hint.setFont(big)
        self.hint.setAccessibleName("How to hold the chart")
        self.hint.keep_room_for(_LONGEST_HINT)
        self.told.keep_room_for(_LONG_VERDICT)
        for sentence in (self.status, self.why):
            sentence.keep_room_for(ONE_LINE)
        keep_place(self.bar)
        self.auto.setAccessibleName("Take a pose when the chart rests where it is wanted")
        self.list.setAccessibleName("Views")
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.setMinimumSize(120, 60)
        self.list.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Ignored)
        tips: list[tuple[QWidget, str]] = [
            (self.take, "Show the patterns and keep the pictures; hold the chart still meanwhile (Ctrl+Return)"),
            (self.auto, "Take a pose by itself as soon as the chart rests where it is wanted"),
            (self.skip, "Advise another pose: this one cannot be held"),
            (self.stop, "Stop what is under way; poses that were taken are kept"),
            (self.go_there, "Move the practice chart to where it is wanted, nearly, as a hand would"),
            (self.read, "Read poses that were taken before"),
            (self.list, "The poses that were taken, and what they are worth; choose one to see why"),
            (self.out, "Leave this view out of the result, or take it in again"),
            (self.again, "Leave this view out and take another one in its place"),
            (self.done, "Look at the numbers that the views tell"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)
        self.out.setText(IN)  # as wide as either of its texts
        self.out.setMinimumWidth(self.out.sizeHint().width())
        self.out.setText(OUT)
        self.out.setMinimumWidth(max(self.out.minimumWidth(), self.out.sizeHint().width()))

    def _arrange(self) -> None:
        maps = QHBoxLayout()
        maps.addWidget(self.camera, 1)
        maps.addWidget(self.projector, 1)
        verdict_row = QHBoxLayout()
        verdict_row.setSpacing(6)
        verdict_row.addWidget(self.lamp, 0, Qt.AlignmentFlag.AlignTop)
        verdict_row.addWidget(self.told, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(5)
        column.addWidget(self.hint)
        # buttons stand where no sentence that changes can move them: below the room of the longest hint, and at the end
        column.addLayout(FlowLayout([self.take, self.auto, self.go_there, self.skip, self.read, self.stop]))
        column.addWidget(self.picture, 3)
        doing = QHBoxLayout()
        doing.addWidget(self.bar, 1, Qt.AlignmentFlag.AlignTop)
        doing.addWidget(self.status, 3)
        column.addLayout(doing)
        below = QHBoxLayout()
        below.addLayout(maps, 3)
        below.addWidget(self.list, 2)
        column.addLayout(below, 2)
        column.addWidget(self.why)
        column.addLayout(verdict_row)
        column.addLayout(FlowLayout([self.out, self.again, self.done]))

    def _connect(self) -> None:
        self.take.clicked.connect(self.take_wished)
        self.read.clicked.connect(self.read_wished)
        self.done.clicked.connect(self.done_wished)
        self.stop.clicked.connect(self._run.stop_work)
        self.skip.clicked.connect(self._run.skip)
        self.out.clicked.connect(self._on_out)
        self.again.clicked.connect(self._on_again)
        self.list.currentRowChanged.connect(self._show_view)
        self._run.looked.connect(self.show_look)
        self._run.changed.connect(self.refresh)
        self._run.progressed.connect(self._on_progress)
        self._run.said.connect(self.status.setText)
        self._run.failed.connect(lambda sentence: self.status.setText(as_sentence(sentence)))

    # The live chart

    def show_look(self, look: ChartLook) -> None:
        """Show what was seen last, with where the chart is wanted."""
        self._look = look
        self.picture.show_picture(np.repeat(look.picture[:, :, None], 3, axis=2), look.size)
        self._show_marks()

    @property
    def there(self) -> bool:
        """Whether the chart was seen where it is wanted."""
        return self._look is not None and self._run.is_there(self._look)

    def _show_marks(self) -> None:
        look, advice, there = self._look, self._run.advice, self.there
        corners = None if look is None or look.corners is None else look.corners.points
        self.picture.show_marks(ChartMarks(corners, None if advice is None else advice.outline, there))
        self.hint.setText(self._hint(there))

    def _hint(self, there: bool) -> str:
        work = self._run.work
        if work is None:
            return "" if self._run.busy else "Choose a chart and a rig first."
        if self._run.advice is None:
            return "" if self._run.busy else f"No pose shows all of {work.chart} to both: a smaller chart is needed."
        if there:
            return "Here: hold it still."
        unseen = self._look is not None and self._look.corners is None
        return f"The chart is not seen. {self._run.hint(None)}" if unseen else self._run.hint(self._look)

    @staticmethod
    def outline_colour(there: bool) -> QColor:
        """Of the outline where the chart is wanted."""
        return THERE if there else WANTED

    # The views

    def refresh(self) -> None:
        """Show views, coverage and what may be done."""
        work, busy = self._run.work, self._run.busy
        able, had = work is not None and not busy, QApplication.focusWidget()
        for button in (self.take, self.go_there, self.skip, self.read):
            button.setEnabled(able)
        self.stop.setEnabled(busy)
        self.bar.setVisible(busy)
        self.done.setEnabled(able and work is not None and work.result is not None)
        if work is None:
            self._show_nothing()
        else:
            self._show_list(work)
            self._show_coverage(work)
            self._show_verdict(work)
        self._show_marks()
        self._show_view()
        self._return_focus(had, able)

    def _return_focus(self, had: QWidget | None, able: bool) -> None:
        """Qt hands the keys of a button that goes out to a neighbour: the button has them again when the work is done,
        unless somebody chose otherwise meanwhile. had: the widget that had them before buttons went out.
        """
        now = QApplication.focusWidget()
        if had is not None and had is not now:
            by, to = self._lent
            self._lent = (by if had is to else had), now
        if able:
            by, to = self._lent
            if by is not None and now is to:
                by.setFocus()
            self._lent = None, None

    def chosen(self) -> LookedView | None:
        """The view that is chosen in the list."""
        item = self.list.currentItem()
        work = self._run.work
        if item is None or work is None:
            return None
        name = item.data(Qt.ItemDataRole.UserRole)
        return next((view for view in work.views.views if view.name == name), None)

    def _show_nothing(self) -> None:
        """What was seen belongs to a calibration that is gone."""
        self.list.clear()
        self._listed, self._look = 0, None
        self.picture.show_picture(None)
        for covered in (self.camera, self.projector):
            covered.forget()
        self.lamp.clear()
        self.told.clear()

    def _show_list(self, work: CalibrationWork) -> None:
        chosen = self.chosen()
        self.list.blockSignals(True)
        self.list.clear()
        for view in work.views.views:
            found = verdict_of(work, view)
            state = "left out" if view.name in work.left_out else WORDS[found.light]
            item = QListWidgetItem(lamp(found.light), f"{view.name}: {state}")
            item.setData(Qt.ItemDataRole.UserRole, view.name)
            item.setToolTip(found.text)
            self.list.addItem(item)
            if chosen is not None and chosen.name == view.name:
                self.list.setCurrentItem(item)
        self.list.blockSignals(False)
        if self.list.count() > self._listed:  # the view that has just come
            self.list.setCurrentRow(self.list.count() - 1)
        self._listed = self.list.count()

    def _show_coverage(self, work: CalibrationWork) -> None:
        used = work.used
        lens, raster = work.rig.camera.lens, work.views.projector
        size = next((view.size for view in work.views.views), (lens.width, lens.height))
        self.camera.show_coverage(coverage((view.camera for view in used), size), size)
        there = (raster.width, raster.height)
        self.projector.show_coverage(coverage((view.projector for view in used), there), there)

    def _show_verdict(self, work: CalibrationWork) -> None:
        found = whole_verdict(work)
        self.lamp.setPixmap(lamp(found.light).pixmap(LAMP_PX, LAMP_PX))
        text = as_sentence(f"{WHOLE_WORDS[found.light]}: {found.text}")
        self.told.setText(f"{text} {as_sentence(work.why)}".rstrip())

    def _show_view(self) -> None:
        view, work = self.chosen(), self._run.work
        able = view is not None and not self._run.busy
        self.out.setEnabled(able)
        self.again.setEnabled(able)
        if view is None or work is None:
            self.why.setText("")
            self.out.setText(OUT)
            return
        self.why.setText(f"{view.name}: {verdict_of(work, view).text}.")
        self.out.setText(IN if view.name in work.left_out else OUT)

    def _on_out(self) -> None:
        view, work = self.chosen(), self._run.work
        if view is not None and work is not None:
            self._run.leave_out(view.name, view.name not in work.left_out)

    def _on_again(self) -> None:
        view, work = self.chosen(), self._run.work
        if view is None or work is None:
            return
        work.left_out.add(view.name)
        self.take_wished.emit()

    def _on_progress(self, share: float, text: str) -> None:
        self.bar.setRange(0, 100)
        self.bar.setValue(round(100 * share))
        self.status.setText(text)


def verdict_of(work: CalibrationWork, view: LookedView) -> Judgement:
    """The light of one view."""
    outliers = () if work.result is None else work.result.outliers
    return view_verdict(view, view.name in outliers)


def whole_verdict(work: CalibrationWork) -> Judgement:
    """The light of all of them together."""
    return judgement(work.chart, len(work.used), work.result)
