"""The dialog that chooses the projector's screen and its pattern."""

from __future__ import annotations

import math
from pathlib import Path

from PySide6.QtCore import QEvent, Qt, QTimer
from PySide6.QtGui import QGuiApplication, QPalette, QScreen, QShowEvent
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QLabel,
    QMessageBox,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.devices.pattern_box import PatternBox
from slopegate.app.devices.projector_memory import ProjectorChoice
from slopegate.app.devices.projector_screens import facts, objections
from slopegate.app.devices.projector_window import ProjectorWindow
from slopegate.app.session import preferences
from slopegate.app.session.loading import Loader
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.rig import RigProjector
from slopegate.drivers.contract.projector import MAX_SETTLE_FRAMES, read_picture

ONE_SCREEN = "A second screen is needed: connect the projector and let it extend the desktop, not mirror it."
GONE = "The chosen screen is not there any more."
COVERING = "That is this window's screen: the pattern covers it until you press Escape. Show it there?"


class ProjectorDialog(QDialog):
    """Changes are shown at once while a pattern is on. Closing the dialog leaves the pattern where it is."""

    def __init__(self, window: ProjectorWindow, projector: RigProjector, path: Path, control: QWidget) -> None:
        """`projector` is the rig's, to compare screens with; `path` keeps the choice, `control` must stay seen."""
        super().__init__(control)
        self.setWindowTitle("Projector")
        self._window, self._projector, self._path, self._control = window, projector, path, control
        self.choice, notice = preferences.load(path, ProjectorChoice, "the projector")
        self._listed: list[QScreen] = []
        self._wanted: QScreen | None = None
        self._number = 0
        self._settling = QTimer(self)
        self._settling.setSingleShot(True)
        self._settling.timeout.connect(self._on_settled)
        self._reader: Loader[Bytes] = Loader(lambda _: None, self)
        self._reader.finished.connect(self._put)
        self._reader.failed.connect(self._say)
        self._arrange()
        self._list_screens()
        self.screens.activated.connect(self._on_screen)
        self.settle.valueChanged.connect(self._on_settle)
        self.pattern.edited.connect(self._on_pattern)
        self.toggle.clicked.connect(self._on_toggle)
        window.drawn.connect(self._on_drawn)
        window.uncovered.connect(self._on_uncovered)
        application = QGuiApplication.instance()
        assert isinstance(application, QGuiApplication)
        for changed in (application.screenAdded, application.screenRemoved):
            changed.connect(self._list_screens, Qt.ConnectionType.QueuedConnection)
        self._say(notice)

    def _arrange(self) -> None:
        self.screens, self.settle, self.toggle = ChoiceBox(), CountBox(), QPushButton("&Show")
        self.warnings, self.status = QLabel(), QLabel()
        for label in (self.warnings, self.status):
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.settle.setRange(1, MAX_SETTLE_FRAMES)
        self.settle.setValue(self.choice.settle_frames)
        self.settle.setToolTip("Frames from drawing a pattern until the projector surely shows it")
        form = QFormLayout()
        form.addRow("S&creen", self.screens)
        form.addRow(self.warnings)
        self.pattern = PatternBox(form, self.choice, facts(self._control.screen()).raster, self)
        form.addRow("Settle &time", self.settle)
        self.settle.setAccessibleName("Settle time")
        for box in (self.settle, self.pattern.number):
            box.setKeyboardTracking(True)  # what is typed is seen at once
            box.refused.connect(self.status.setText)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.addButton(self.toggle, QDialogButtonBox.ButtonRole.ActionRole)
        buttons.rejected.connect(self.reject)
        for button in (self.pattern.browse, *buttons.findChildren(QPushButton)):
            button.setAutoDefault(False)  # or Enter in a field would press one
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addStretch(1)
        column.addWidget(self.status)
        column.addWidget(buttons)
        self.resize(520, 260)

    @property
    def screen_chosen(self) -> QScreen | None:
        """The screen that is selected, if it is there."""
        index = self.screens.currentIndex()
        listed = self._listed[index] if 0 <= index < len(self._listed) else None
        return listed if listed in QGuiApplication.screens() else None

    def showEvent(self, event: QShowEvent) -> None:
        self._list_screens()
        super().showEvent(event)

    def done(self, result: int) -> None:
        self._reader.cancel()
        super().done(result)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    def _list_screens(self) -> None:
        """Select the screen in use, else the remembered one, else the first that the control window is not on."""
        here, shown, name = self._control.screen(), self._window.screen_covered, self.choice.screen
        self._listed = QGuiApplication.screens()
        self.screens.clear()
        for screen in self._listed:
            self.screens.addItem(f"{facts(screen)}{' (this window)' if screen is here else ''}", screen.name())
        # two may have the same name
        best = [(screen is shown, screen.name() == name, screen is not here) for screen in self._listed]
        self.screens.setCurrentIndex(max(range(len(best)), key=best.__getitem__, default=-1))
        self._show_screen()

    def _show_screen(self) -> None:
        """Show what is wrong with the selected screen, and switch the buttons."""
        screens, selected, shown = QGuiApplication.screens(), self.screen_chosen, self._window.covers
        problems = [ONE_SCREEN] if len(screens) < 2 else []
        if selected is not None:
            chosen = facts(selected)
            others = [facts(screen) for screen in screens if screen is not selected]
            problems = problems or list(objections(chosen, others, self._projector))
            self.pattern.use_raster(chosen.raster)
            self.settle.setSuffix(f" frames ({self.settle.value() * chosen.period_us / 1000:.0f} ms)")
        self.warnings.setText("\n".join(f"\u26a0 {sentence}" for sentence in problems))
        self.warnings.setVisible(bool(problems))
        self.toggle.setText("&Show" if shown is None else "&Hide")
        self.toggle.setEnabled(shown is not None or len(screens) > 1)
        self.toggle.setToolTip("" if self.toggle.isEnabled() else ONE_SCREEN)
        self._dress()

    def _dress(self) -> None:
        palette, tone = self.warnings.palette(), colours(self.palette()).warning
        if palette.color(QPalette.ColorRole.WindowText).name() != tone:
            palette.setColor(QPalette.ColorRole.WindowText, tone)
            self.warnings.setPalette(palette)

    def _on_screen(self) -> None:
        if self._window.covers is not None:
            self._show()
        else:
            self._keep(screen=self.screens.currentData())
            self._show_screen()

    def _on_pattern(self) -> None:
        self._keep(**self.pattern.changes())
        if self._window.covers is not None:
            self._draw()

    def _on_settle(self) -> None:
        self._keep(settle_frames=self.settle.value())
        self._show_screen()

    def _on_toggle(self) -> None:
        if self._window.covers is not None:
            self._window.uncover()
        else:
            self._show()

    def _show(self) -> None:
        """Put the pattern on the selected screen; ask before it covers the control window."""
        screen = self.screen_chosen
        if screen is None or screen is not self._control.screen():
            self._cover(screen)
            return
        buttons = QMessageBox.StandardButton.Yes | QMessageBox.StandardButton.No
        box = QMessageBox(QMessageBox.Icon.Question, "Projector", COVERING, buttons, self)
        box.setDefaultButton(QMessageBox.StandardButton.No)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.accepted.connect(lambda: self._cover(screen))
        box.rejected.connect(self._list_screens)
        box.open()

    def _cover(self, screen: QScreen | None) -> None:
        self._wanted = screen
        if screen is not None:
            self._keep(screen=screen.name())
        self._draw()

    def _draw(self) -> None:
        """Make the picture, or read it from its file in another thread; `_put` shows it."""
        screen = self._wanted
        self._reader.cancel()
        self._settling.stop()
        if screen is None or screen not in QGuiApplication.screens():
            self._say(GONE)
            return
        raster = facts(screen).raster
        drawn = self.pattern.draw(raster)
        if drawn is None:
            self._say("Choose a picture file.")
        elif isinstance(drawn, Path):
            path = drawn
            self._reader.start(lambda _: read_picture(path, raster))
        else:
            self._put(drawn)

    def _put(self, picture: Bytes) -> None:
        screen = self._wanted
        if screen is None or screen not in QGuiApplication.screens():
            self._say(GONE)
            return
        self._window.load([picture])
        self._number = self._window.display(0)
        if self._window.screen_covered is not screen:
            self._window.cover(screen)
            if screen is self._control.screen():
                self._window.requestActivate()
        self._list_screens()
        self._say(f"{self.pattern.title} is on its way to {screen.name()} ...")

    def _on_drawn(self, number: int) -> None:
        shown = self._window.covers
        if shown is not None and number == self._number:
            self._settling.start(math.ceil(self.settle.value() * shown.period_us / 1000))

    def _on_settled(self) -> None:
        if self._window.covers is not None:
            name = self._window.covers.name
            self._say(f"{self.pattern.title} is on {name}. Hide ends it, or Escape there.")

    def _on_uncovered(self, why: str) -> None:
        self._reader.cancel()
        self._settling.stop()
        self._say(why)
        self._show_screen()

    def _say(self, sentence: str) -> None:
        self.status.setText(sentence)

    def _keep(self, **changes: object) -> None:
        self.choice = self.choice.model_copy(update=changes)
        self._say(preferences.save(self._path, self.choice))
