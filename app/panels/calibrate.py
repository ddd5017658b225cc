"""Panel that calibrates a rig, step by step: chart, poses, result."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Final

from PySide6.QtGui import QCloseEvent, QHideEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QButtonGroup, QFileDialog, QPushButton, QSizePolicy, QStackedWidget, QVBoxLayout, QWidget

from slopegate.app.panels.calibrate_chart import CONNECTED, PICTURES, PRACTICE, ChartStep
from slopegate.app.panels.calibrate_device import ConnectedDevice, PicturesDevice, PracticeDevice
from slopegate.app.panels.calibrate_poses import PosesStep
from slopegate.app.panels.calibrate_result import ResultStep
from slopegate.app.panels.calibrate_run import CalibrationRun, ChartLook, MakeDevice
from slopegate.app.panels.calibrate_timing import TimingStep, TimingWork
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.describe import as_sentence
from slopegate.app.session.saving import Saver
from slopegate.app.session.session import Change, Intent
from slopegate.app.views.overlay import Segment, SegmentLayer
from slopegate.app.widgets.chart_page import as_pdf, smallest_page
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.sentence import Sentence
from slopegate.core.calibration.chart import Chart
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.taking import next_pose_number, open_gate
from slopegate.drivers.files.durable import check_folder, write_durably
from slopegate.drivers.files.rig_files import calibrated_rig_file

CHART, POSES, RESULT, TIME = range(4)
STEPS: Final = ("1 Chart", "2 Poses", "3 Result", "4 Timing")
TRANSFER_US: Final = 50_000.0
"""How long a frame of a camera may be on its way."""
TURN_DEG: Final = 90.0
"""That the practice chart turns by when it is dragged over the width of the picture."""
PUSH: Final = 0.06
"""Of its distance, that a step of the wheel moves it."""


class CalibratePanel(Panel):
    """From an unpacked camera and projector to a rig file."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.run = CalibrationRun(desk.session, self)
        self.chart, self.poses, self.result = ChartStep(), PosesStep(self.run), ResultStep(self.run)
        self.gates = TimingWork(desk.session, self.run)
        self.timing = TimingStep(self.run, self.gates)
        self.layer = SegmentLayer(desk.live.view)
        self._saver = Saver(self)
        self._practice: PracticeDevice | None = None
        self._before: Rig | None = None
        """The rig that ran before another was applied."""
        self._steps = QButtonGroup(self)
        self.steps = [QPushButton(text) for text in STEPS]
        self._pages = QStackedWidget()
        self._arrange()
        self._connect()
        self._go(CHART)

    def _arrange(self) -> None:
        for number, button in enumerate(self.steps):
            button.setCheckable(True)
            self._steps.addButton(button, number)
        for page in self._all():
            self._pages.addWidget(page)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(6)
        column.addLayout(FlowLayout(self.steps))
        column.addWidget(self._pages, 1)

    def _all(self) -> tuple[QWidget, ...]:
        return self.chart, self.poses, self.result, self.timing

    def _connect(self) -> None:
        self._steps.idClicked.connect(self._go)
        self.chart.begin_wished.connect(self._begin)
        self.chart.save_wished.connect(self._ask_chart_file)
        self.chart.show_wished.connect(self._show_pattern)
        self.poses.take_wished.connect(self._take)
        self.poses.read_wished.connect(self._ask_folder)
        self.poses.done_wished.connect(lambda: self._go(RESULT))
        self.poses.go_there.clicked.connect(self._hold_there)
        self.result.save_wished.connect(self._ask_rig_file)
        self.result.apply_wished.connect(self._apply)
        self.result.back_wished.connect(self._back)
        self.timing.save_wished.connect(self._ask_rig_file)
        self.timing.apply_wished.connect(self._apply)
        self.gates.ended.connect(self._on_timed)
        self.run.looked.connect(self._on_look)
        self.run.changed.connect(self._on_changed)
        self.run.failed.connect(self._say)
        self._saver.finished.connect(lambda path: self._say(f"Saved as {path}."))
        self._saver.failed.connect(self._say)
        picture = self.poses.picture
        picture.moved.connect(self._on_moved)
        picture.turned.connect(self._on_turned)
        picture.pushed.connect(self._on_pushed)
        take = QShortcut(QKeySequence("Ctrl+Return"), self.poses)
        take.activated.connect(self._take)

    # The panel

    @property
    def step(self) -> int:
        """Which step is shown: CHART, POSES or RESULT."""
        return self._pages.currentIndex()

    def _go(self, step: int) -> None:
        """Show another step; only the page on show asks for room."""
        for number, page in enumerate(self._all()):
            kind = QSizePolicy.Policy.Preferred if number == step else QSizePolicy.Policy.Ignored
            page.setSizePolicy(kind, kind)
        if step != self.step:
            self._notes()[self.step].setText("")
        self._pages.setCurrentIndex(step)
        self.steps[step].setChecked(True)
        self._watch()

    def _watch(self) -> None:
        wanted = self.isVisible() and self.step == POSES and self.run.work is not None
        self.run.watch(wanted)
        if not wanted:
            self.layer.show_segments(())

    def follow(self, change: Change) -> None:
        source = self._session.source
        if source is not None and Change.SOURCE in change:
            if self.run.work is None:
                self.chart.place.suggest(source.scene)
                self.chart.show_raster(source.rig.projector.raster)
            self._show_able()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._watch()

    def hideEvent(self, event: QHideEvent) -> None:
        self._watch()

    def closeEvent(self, event: QCloseEvent) -> None:
        self.gates.close()
        self.run.close()
        self._saver.close()
        event.accept()

    def _say(self, sentence: str) -> None:
        """Say it on the page that is shown; what was said on others is no longer true."""
        for number, note in enumerate(self._notes()):
            note.setText(as_sentence(sentence) if number == self.step else "")

    def _notes(self) -> tuple[Sentence, ...]:
        return self.chart.note, self.poses.status, self.result.status, self.timing.note

    # Chart

    def _begin(self) -> None:
        try:
            chart, make = self.chart.chart(), self._device()
            if not self.chart.place.named:
                raise InputError("no folder is named: poses are kept in one")
            self._check_place(self.chart.place.path)
        except UserError as error:
            self.chart.say(as_sentence(error))
            return
        self._practice = None
        self.result.show_truth(None)
        self.chart.say("")
        self.gates.stop()
        self.gates.forget()
        self.timing.forget()
        reads = self.chart.chosen == PICTURES
        self.run.begin(chart, make, self.chart.place.path, self.chart.error.value(), reads)
        self._go(POSES)

    def _check_place(self, folder: Path) -> None:
        """Raise UserError where poses that are taken cannot be kept, or would stand beside those of another rig."""
        if self.chart.chosen == PICTURES:
            return
        check_folder(folder)
        if self.chart.chosen == PRACTICE and next_pose_number(folder):
            raise InputError(
                f"{folder} holds poses already, and every practice rig is another one: name another folder, or read "
                "those as pictures"
            )

    def _device(self) -> MakeDevice:
        """What makes the device that is chosen. Raises UserError."""
        source = self._session.source
        if source is None:
            raise InputError("there is no rig yet: wait for the first image")
        rig, chart = source.rig, self.chart.chart()
        if self.chart.chosen == PRACTICE:
            seed = secrets.randbelow(1_000_000)
            return lambda progress: PracticeDevice(rig, chart, seed, progress)
        if self.chart.chosen == CONNECTED:
            device = ConnectedDevice(self._desk, TRANSFER_US)
            gate = open_gate(source.rig, source.camera.info)
            if gate is not None:
                self._session.ask(Intent(gate))
            return lambda _: device
        return lambda _: PicturesDevice(rig, self.chart.raster())

    def _ask_chart_file(self) -> None:
        try:
            chart = self.chart.chart()
        except InputError as error:
            self.chart.say(as_sentence(error))
            return
        start = f"chart-{chart.columns}x{chart.rows}.pdf"
        name, _ = QFileDialog.getSaveFileName(self, "Save the chart for the printer", start, "PDF (*.pdf)")
        if name:
            self.save_chart(chart, Path(name))

    def save_chart(self, chart: Chart, path: Path) -> None:
        """Write the chart as a PDF, on the smallest usual paper that holds it."""
        try:
            page = smallest_page(chart)
        except UserError as error:
            self.chart.say(as_sentence(error))
            return
        data = as_pdf(page)
        target = path if path.suffix.lower() == ".pdf" else path.with_suffix(".pdf")

        def job(_: object) -> Path:
            write_durably(target, data)
            return target

        self._saver.start(job)

    def _show_pattern(self) -> None:
        work = self.run.work
        try:
            if work is None:
                raise InputError("nothing is calibrated yet: begin, and come back to show patterns")
            self.run.show(self.chart.drawn(work.device.raster))
            self.chart.say(f"{self.chart.pattern.currentText()} is shown until the next pose is taken.")
        except UserError as error:
            self.chart.say(as_sentence(error))

    # Poses

    def _take(self) -> None:
        try:
            self.run.take()
        except UserError as error:
            self._say(str(error))

    def _ask_folder(self) -> None:
        work = self.run.work
        start = str(work.folder) if work is not None else ""
        name = QFileDialog.getExistingDirectory(self, "A folder that holds a folder of pictures for every pose", start)
        if name:
            self.run.read(Path(name))

    def _on_changed(self) -> None:
        work = self.run.work
        device = None if work is None else work.device
        self._practice = device if isinstance(device, PracticeDevice) else None
        self.result.show_truth(None if self._practice is None else self._practice.truth)
        self._show_able()
        self._watch()

    def _show_able(self) -> None:
        practice, work = self._practice is not None, self.run.work
        reads = work is not None and isinstance(work.device, PicturesDevice)
        self.poses.picture.set_by_hand(practice)
        self.poses.picture.setVisible(not reads)
        self.poses.hint.setVisible(not reads)
        self.poses.go_there.setVisible(practice)
        self.poses.read.setVisible(reads)
        for widget in (self.poses.take, self.poses.auto, self.poses.skip, self.poses.again):
            widget.setVisible(not reads)
        source = self._session.source
        fixed = "" if source is None else source.own_rig
        why = "A practice rig is none that runs" if practice else fixed
        self.result.apply.setEnabled(work is not None and work.result is not None and not why and not self.run.busy)
        self.result.apply.setToolTip(why or "Look at what runs with these numbers from now on")
        self.result.back.setEnabled(self._before is not None)
        self.timing.apply.setEnabled(self.gates.outcome is not None and not why and not self.gates.busy)
        self.timing.apply.setToolTip(why or "Look at what runs with this timing from now on")

    def _on_timed(self) -> None:
        work = self.run.work
        if work is not None:
            self.timing.show_outcome(work.rig, None if self._practice is None else self._practice.truth)
        self._show_able()

    def _on_look(self, look: ChartLook) -> None:
        work, advice = self.run.work, self.run.advice
        live = work is not None and isinstance(work.device, ConnectedDevice) and self.step == POSES
        if live and advice is not None:
            ends = [(float(x), float(y)) for x, y in advice.outline]
            colour = self.poses.outline_colour(self.run.is_there(look))
            sides = zip(ends, [*ends[1:], ends[0]], strict=True)
            self.layer.show_segments(tuple(Segment(start, end, colour) for start, end in sides))
        if self.poses.auto.isChecked() and self.run.rests_there and not self.run.busy:
            self._take()

    def _hold_there(self) -> None:
        if self._practice is not None and self.run.advice is not None:
            self._practice.go_to(self.run.advice.pose)

    def _on_moved(self, right: float, down: float) -> None:
        practice = self._practice
        if practice is not None:
            lens, z = practice.believed.camera.lens, practice.pose.shift_m[2]
            across = lens.width / lens.fx * z
            practice.move(right * across, down * across)

    def _on_turned(self, right: float, down: float) -> None:
        if self._practice is not None:
            self._practice.turn(TURN_DEG * right, -TURN_DEG * down)

    def _on_pushed(self, steps: float) -> None:
        if self._practice is not None:
            self._practice.move(z_m=-PUSH * steps * self._practice.pose.shift_m[2])

    # Result

    def _rig(self) -> Rig | None:
        """What is saved and applied: with the timing where that is on show."""
        work, outcome = self.run.work, self.gates.outcome
        if self.step == TIME:
            return None if outcome is None else outcome.rig
        return None if work is None or work.result is None else work.result.rig

    def _ask_rig_file(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save the rig", "rig.toml", "Rig files (*.toml)")
        if name:
            self.save_rig(Path(name))

    def save_rig(self, path: Path) -> None:
        """Write the rig that was found."""
        rig = self._rig()
        if rig is None:
            return
        target = path if path.suffix.lower() == ".toml" else path.with_suffix(".toml")

        def job(_: object) -> Path:
            write_durably(target, calibrated_rig_file(rig, target))
            return target

        self._saver.start(job)

    def _apply(self) -> None:
        rig, source = self._rig(), self._session.source
        if rig is None or source is None:
            return
        before = source.rig
        self._desk.rig_wished.emit(rig)
        self._before = before
        self._say("What runs is looked at with the calibrated rig.")
        self._show_able()

    def _back(self) -> None:
        before, self._before = self._before, None
        if before is not None:
            self._desk.rig_wished.emit(before)
            self._say("What runs is looked at with the rig from before.")
        self._show_able()
