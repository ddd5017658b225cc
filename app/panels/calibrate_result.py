"""Third step of a calibration: the rig's numbers with their errors, what is doubtful, and what becomes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from slopegate.app.panels.calibrate_numbers import NumbersTable, TableRow
from slopegate.app.panels.calibrate_pictures import ResidualMap, Residuals
from slopegate.app.panels.calibrate_run import CalibrationRun, CalibrationWork
from slopegate.app.session.describe import as_sentence
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.sentence import ONE_LINE, Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.calibration.picture import picture_advice, picture_told
from slopegate.core.rig.calibration import GEOMETRY
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.geometry_run import CalibratedGeometry

NUMBERS_SHOWN, VIEWS_SHOWN, FACTS_SHOWN = "numbers", "views", "facts"
_KINDS: Final = {
    NUMBERS_SHOWN: "Numbers and their errors",
    VIEWS_SHOWN: "Views and their errors",
    FACTS_SHOWN: "Where it comes from",
}


class ResultStep(QWidget):
    """What the views tell."""

    save_wished = Signal()
    apply_wished = Signal()
    back_wished = Signal()

    def __init__(self, run: CalibrationRun) -> None:
        super().__init__()
        self._run = run
        self._truth: Rig | None = None
        self.told, self.shown, self.doubt, self.status = (Sentence() for _ in range(4))
        self.leave_out = QPushButton("Leave it out")
        self.kind, self.table = ChoiceBox(), NumbersTable("Numbers of the calibration")
        self.camera = ResidualMap("Camera", "How far the fit misses each corner of the camera's picture, magnified")
        self.projector = ResidualMap("Projector", "The same in the projector's picture")
        self.save, self.apply, self.back = (
            QPushButton("Save rig file ..."),
            QPushButton("Apply to the running camera"),
            QPushButton("Back to the rig before"),
        )
        self.status.keep_room_for(ONE_LINE)
        self._explain()
        self._arrange()
        self._connect()
        self.refresh()

    def _explain(self) -> None:
        for key, text in _KINDS.items():
            self.kind.addItem(text, key)
        self.kind.setAccessibleName("Table")
        tips: list[tuple[QWidget, str]] = [
            (self.kind, "What the table shows"),
            (self.save, "Keep this rig with its errors and where they come from in a file"),
            (self.apply, "Look at what runs with these numbers from now on; the live image goes on"),
            (self.back, "Look at it again with the rig that was there before"),
            (self.leave_out, "Fit anew without this view; it can be taken in again in the list of poses"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)

    def _arrange(self) -> None:
        maps = QHBoxLayout()
        maps.addWidget(self.camera, 1)
        maps.addWidget(self.projector, 1)
        doubts = QHBoxLayout()
        doubts.addWidget(self.doubt, 1)
        doubts.addWidget(self.leave_out)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(5)
        column.addWidget(self.told)
        column.addWidget(self.shown)
        column.addLayout(doubts)
        column.addLayout(maps, 2)
        column.addLayout(FlowLayout([self.kind]))
        column.addWidget(self.table, 3)
        column.addWidget(self.status)
        column.addLayout(FlowLayout([self.save, self.apply, self.back]))

    def _connect(self) -> None:
        self.kind.currentIndexChanged.connect(self._show_table)
        self.save.clicked.connect(self.save_wished)
        self.apply.clicked.connect(self.apply_wished)
        self.back.clicked.connect(self.back_wished)
        self.leave_out.clicked.connect(self._on_leave_out)
        self._run.changed.connect(self.refresh)

    def show_truth(self, truth: Rig | None) -> None:
        """The true numbers of a practice rig; None where nobody knows them."""
        self._truth = truth

    def refresh(self) -> None:
        """Show the result there is now."""
        work = self._run.work
        result = None if work is None else work.result
        able = result is not None and not self._run.busy
        for button in (self.save, self.apply):
            button.setEnabled(able)
        self._show_doubt(work, result)
        if work is None or result is None:
            why = "" if work is None else as_sentence(work.why)
            self.told.setText(f"There is no result yet: three good views of the chart are needed. {why}".rstrip())
            self.shown.setText("")
            self.table.clear()
            for picture in (self.camera, self.projector):
                picture.show_residuals((), (4, 3))
            return
        fit = result.geometry
        self.told.setText(
            f"{len(fit.views)} views, rms {fit.rms_px:.3f} px: camera {fit.camera_rms_px:.3f}, projector "
            f"{fit.projector_rms_px:.3f}. Numbers are given with one standard error."
        )
        self.shown.setText(_picture(work, result))
        self._show_residuals(result)
        self._show_table()

    def _show_doubt(self, work: CalibrationWork | None, result: CalibratedGeometry | None) -> None:
        outliers = () if result is None else result.outliers
        self.doubt.setVisible(bool(outliers))
        self.leave_out.setVisible(bool(outliers))
        if work is None or result is None or not outliers:
            return
        worst = outliers[0]
        held_out = next((view.held_out_px for view in result.geometry.views if view.name == worst), math.nan)
        self.doubt.setText(
            f"{worst} does not fit the others, which expect its corners {held_out:.2f} px elsewhere. Leave it out?"
        )
        self.leave_out.setEnabled(not self._run.busy)

    def _on_leave_out(self) -> None:
        work = self._run.work
        if work is not None and work.result is not None and work.result.outliers:
            self._run.leave_out(work.result.outliers[0], True)

    def _show_residuals(self, result: CalibratedGeometry) -> None:
        fit = result.geometry
        known = {view.name: view.view for view in result.views}
        camera, projector = [], []
        for error, missed in zip(fit.views, fit.residuals, strict=True):
            view = known[error.name]
            if view is not None:
                marked = error.name in result.outliers
                camera.append(Residuals(view.camera, missed[:, :2], marked))
                projector.append(Residuals(view.projector, missed[:, 2:], marked))
        self.camera.show_residuals(camera, (fit.camera.width, fit.camera.height))
        self.projector.show_residuals(projector, (fit.projector.width, fit.projector.height))

    # The table

    def _show_table(self) -> None:
        work = self._run.work
        if work is None or work.result is None:
            return
        kind, result = self.kind.currentData(), work.result
        if kind == NUMBERS_SHOWN:
            self.table.show_numbers(work.device.believed, result.rig, self._truth, GEOMETRY)
        elif kind == VIEWS_SHOWN:
            self.table.show_rows(*self._views(result))
        else:
            facts = result.rig.calibration.facts if result.rig.calibration is not None else ()
            self.table.show_rows(("", ""), [(fact, False) for fact in facts], figures=False)

    @staticmethod
    def _views(result: CalibratedGeometry) -> tuple[Sequence[str], list[TableRow]]:
        head = ("view", "camera px", "projector px", "held out px", "distance", "tilt")
        rows: list[TableRow] = []
        for view in result.geometry.views:
            held_out = "\u2013" if math.isnan(view.held_out_px) else f"{view.held_out_px:.3f}"
            texts = (
                view.name, f"{view.camera_px:.3f}", f"{view.projector_px:.3f}", held_out, f"{view.distance_m:.2f} m",
                f"{view.tilt_deg:.0f}\u00b0",
            )  # fmt: skip
            rows.append((texts, view.name in result.outliers))
        rows += [((one.why if one.asked else f"Left out: {one.why}",), True) for one in result.left_out]
        return head, rows


def _picture(work: CalibrationWork, result: CalibratedGeometry) -> str:
    """How sharp the projector's picture is, and how it answers grey levels."""
    told = picture_told(result.focus, work.response, result.rig.projector.blur_px, "\u00b1")
    said = [f"The projector's picture: {told}"] if told else []
    if work.response is None:
        said.append(f"Its gamma is not known: {work.no_response}")
    return " ".join(map(as_sentence, (*said, *picture_advice(result.focus, work.response))))
