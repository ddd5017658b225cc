"""The dialog with the list of devices: what is plugged in and what could be, to connect and test."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QDialog,
    QDialogButtonBox,
    QFrame,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QRadioButton,
    QScrollArea,
    QTreeWidget,
    QTreeWidgetItem,
    QTreeWidgetItemIterator,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.devices.board_box import BoardBox
from slopegate.app.devices.hub import DeviceHub
from slopegate.app.widgets.wrapping_tree import WrappingTree
from slopegate.core.rig.checks import InputError
from slopegate.drivers.contract.families import Address, Found, Kind
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.devices.survey import Survey, changes
from slopegate.drivers.sync.board import BoardStatus
from slopegate.drivers.sync.boards import dialect_of

LOOK_MS, STATUS_MS = 3000, 200
COLUMN_SHARE = 0.35
"""Of the list's width, that names and addresses may take each: the state of a device has the rest."""
_GROUPS: tuple[tuple[Kind, str], ...] = (("camera", "Cameras"), ("board", "Serial ports"), ("usb", "USB"))
VIRTUAL_CAMERA = Address(VIRTUAL.key, VIRTUAL.key)
_DEVICE, _ADVICE = Qt.ItemDataRole.UserRole, Qt.ItemDataRole.UserRole + 1


class DeviceDialog(QDialog):
    """Shows the devices that the hub knows. It looks again by itself, so a device that is plugged in appears."""

    def __init__(
        self,
        hub: DeviceHub,
        parent: QWidget | None = None,
        open_camera: Callable[[Address], object] | None = None,
    ) -> None:
        """`open_camera` streams from a camera of the list; without it cameras are listed and tested only."""
        super().__init__(parent)
        self.setWindowTitle("Devices")
        self._hub, self._open_camera = hub, open_camera
        self._survey: Survey | None = None
        self._opening: Address | None = None
        """The camera that the window is opening for this dialog."""
        self._arrange()
        hub.surveyed.connect(self._on_surveyed)
        hub.tested.connect(self._on_tested)
        hub.changed.connect(self._refresh)
        self._look_timer, self._status_timer = QTimer(self), QTimer(self)
        self._look_timer.timeout.connect(hub.look)
        self._status_timer.timeout.connect(self._show_status)
        self.board.show_choice(hub.choices.board)
        self._refresh()
        if hub.notice:
            self.answer.setText(hub.notice)

    def _arrange(self) -> None:
        self.tree = WrappingTree()
        self.tree.setHeaderLabels(["Device", "Where", "State"])
        self.tree.setAccessibleName("Devices")
        self.tree.setRootIsDecorated(False)
        self.tree.currentItemChanged.connect(self._on_selected)
        self.answer = QLabel("Looking ...")
        self.answer.setWordWrap(True)
        self.answer.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.look, self.test = QPushButton("&Look again"), QPushButton("&Test")
        self.connect_button, self.disconnect_button = QPushButton("&Connect"), QPushButton("&Disconnect board")
        self.leave = QPushButton("Disconnect c&amera")
        self.leave.setToolTip("Stop streaming from the camera and show the last scene again")
        self.leave.clicked.connect(lambda: self._open(VIRTUAL_CAMERA))
        self.look.clicked.connect(self._hub.look)
        self.test.clicked.connect(self._on_test)
        self.connect_button.clicked.connect(self._on_connect)
        self.disconnect_button.clicked.connect(self._hub.disconnect_board)
        self.board = BoardBox(self)
        for box in (self.board.output, self.board.width_us, self.board.level_v):
            box.refused.connect(self.answer.setText)
        self.triggered = QCheckBox("The projector's &sync signal triggers the camera")
        self.triggered.setToolTip("Without it the camera runs by itself, and where the slab lies is not known")
        self.triggered.setChecked(self._hub.choices.triggered)
        self.triggered.toggled.connect(self._hub.set_triggered)
        self.by_camera, self.by_board = QRadioButton("the &camera's own trigger delay"), QRadioButton("the &board")
        self.by_camera.clicked.connect(lambda: self._hub.set_delay_owner("camera"))
        self.by_board.clicked.connect(lambda: self._hub.set_delay_owner("board"))
        self.delay, self.status = QLabel(), QLabel()
        self.status.setWordWrap(True)
        owner = QGroupBox("Camera")
        owners = QVBoxLayout(owner)
        for widget in (
            self.triggered,
            QLabel("The gate's delay is made by"),
            self.by_camera,
            self.by_board,
            self.delay,
        ):
            owners.addWidget(widget)
        owners.addStretch(1)
        close = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        close.rejected.connect(self.reject)
        buttons = QHBoxLayout()
        for button in (self.look, self.test, self.connect_button, self.leave, self.disconnect_button):
            button.setAutoDefault(False)
            buttons.addWidget(button)
        below = QHBoxLayout()
        below.addWidget(owner)
        below.addWidget(self.board)
        self.tree.setMinimumHeight(120)
        content = QWidget()
        column = QVBoxLayout(content)
        column.addWidget(self.tree, 1)
        column.addWidget(self.answer)
        column.addLayout(buttons)
        column.addLayout(below)
        column.addWidget(self.status)
        self._fit(content, close)

    def _fit(self, content: QWidget, close: QWidget) -> None:
        """Show the content above the button, scrolled on screens that are lower than all of it."""
        scroll = QScrollArea()
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setWidgetResizable(True)
        scroll.setWidget(content)
        around = QVBoxLayout(self)
        around.addWidget(scroll)
        around.addWidget(close)
        room = self.screen().availableSize()
        self.resize(min(max(760, content.sizeHint().width() + 40), room.width() - 20), min(660, room.height() - 60))

    @property
    def device(self) -> Found | None:
        """The device that is selected."""
        item = self.tree.currentItem()
        found = None if item is None else item.data(0, _DEVICE)
        return found if isinstance(found, Found) else None

    def showEvent(self, event: QShowEvent) -> None:
        self._look_timer.start(LOOK_MS)
        self._status_timer.start(STATUS_MS)
        self._hub.look()
        self._show_status()
        super().showEvent(event)

    def hideEvent(self, event: QHideEvent) -> None:
        self._look_timer.stop()
        self._status_timer.stop()
        self._hub.stop_test()
        super().hideEvent(event)

    def _on_selected(self, row: QTreeWidgetItem | None) -> None:
        """Show the advice of the selected row in full, to be read and copied."""
        if row is not None and not self._hub.testing:
            self.answer.setText(row.data(0, _ADVICE) or "")
        self._refresh()

    def _on_surveyed(self, survey: Survey) -> None:
        if self.answer.text() == "Looking ...":
            self.answer.setText("")
        if survey != self._survey:
            if self._survey is not None and not self._hub.testing:
                self._say_changes(self._survey, survey)
            self._survey = survey
            self._fill(survey)
        self._refresh()

    def _say_changes(self, before: Survey, after: Survey) -> None:
        news = [
            f"{', '.join(device.name for device in devices)} {verb}."
            for devices, verb in zip(changes(before, after), ("plugged in", "pulled"), strict=True)
            if devices
        ]
        if news:
            self.answer.setText(" ".join(news))

    def _fill(self, survey: Survey) -> None:
        kept = self.device
        self.tree.clear()
        for kind, title in _GROUPS:
            group = self._row(self.tree, title)
            for device in survey.found:
                if device.kind == kind:
                    row = self._row(group, device.name, device.detail, self._state(device))
                    row.setData(0, _DEVICE, device)
                    row.setData(0, _ADVICE, device.problem)
                    if kept is not None and (kept.family, kept.where) == (device.family, device.where):
                        self.tree.setCurrentItem(row)
        if survey.missing:
            group = self._row(self.tree, "What could be")
            for missing in survey.missing:
                self._row(group, missing.title, "", missing.sentence).setData(0, _ADVICE, missing.sentence)
        self.tree.expandAll()
        self.tree.fit_columns(COLUMN_SHARE)

    def _show_states(self) -> None:
        rows = QTreeWidgetItemIterator(self.tree)
        while (row := rows.value()) is not None:
            device = row.data(0, _DEVICE)
            if isinstance(device, Found):
                row.setText(2, self._state(device))
            rows += 1

    def _state(self, device: Found) -> str:
        if device.problem:
            return device.problem
        if device.address == (self._hub.running or VIRTUAL_CAMERA):
            return "streaming in this window"
        return "part of the program" if device.address == VIRTUAL_CAMERA else "plugged in"

    def _row(self, parent: QTreeWidget | QTreeWidgetItem, *texts: str) -> QTreeWidgetItem:
        return QTreeWidgetItem(parent, list(texts))

    def _refresh(self) -> None:
        """Switch the buttons on that the selected device can use."""
        hub, device, chosen = self._hub, self.device, self._hub.choices.board
        if self._opening is not None and self._opening == hub.running:
            self._opening = None
            self._answer(f"The window streams from {hub.running}.", True)
        runs = device is not None and device.address == (hub.running or VIRTUAL_CAMERA)
        connected = runs or (device is not None and chosen is not None and chosen.where == device.where)
        testable = device is not None and device.kind != "usb" and device.address != VIRTUAL_CAMERA
        self.test.setEnabled(testable and not connected and not hub.testing)
        self.test.setToolTip(
            "This window uses it already" if connected else "Open it, ask what it is, and close it again"
        )
        usable = device is not None and (
            device.kind == "board" or (device.kind == "camera" and bool(self._open_camera))
        )
        self.connect_button.setEnabled(usable and not runs)
        self.leave.setEnabled(hub.running is not None and self._open_camera is not None)
        self._show_states()
        self.disconnect_button.setEnabled(chosen is not None)
        able = chosen is not None and dialect_of(chosen.dialect).limits is not None
        self.by_board.setEnabled(able)
        self.by_board.setToolTip("" if able else "Connect a board that sets a delay first")
        (self.by_board if hub.delay_owner == "board" else self.by_camera).setChecked(True)
        self._show_status()

    def _show_status(self) -> None:
        status = self._hub.board_status
        self.status.setText(board_sentence(status))
        applied = status.applied if status is not None else None
        if self._hub.delay_owner == "camera":
            self.delay.setText("" if status is None else "The board passes the trigger on without delay.")
        elif applied is None:
            self.delay.setText("Not known: the board has not confirmed it.")
        else:
            self.delay.setText(f"{applied.delay_us:.2f} \u00b5s from trigger to pulse, read back")

    def _on_test(self) -> None:
        device = self.device
        if device is not None:
            self.answer.setText(f"Testing {device.name} ...")
            self._hub.test(device)
            self._refresh()

    def _on_tested(self, sentence: str, works: bool) -> None:
        self._answer(sentence, works)
        self._refresh()

    def _answer(self, sentence: str, works: bool) -> None:
        self.answer.setText(("\u2713 " if works else "\u2716 ") + sentence)

    def _on_connect(self) -> None:
        device = self.device
        if device is None:
            return
        try:
            if device.kind == "board":
                self._hub.connect_board(self.board.choice(device.where))
            else:
                self._open(device.address)
                return
        except InputError as error:
            self._answer(str(error), False)
            return
        self.answer.setText(self._hub.notice)

    def _open(self, address: Address) -> None:
        if self._open_camera is not None:
            self._opening = address
            self.answer.setText(f"Opening {address} ..." if address != VIRTUAL_CAMERA else "")
            self._open_camera(address)

    def say_failed(self, sentence: str) -> None:
        """Show why the window could not open the camera that was asked for here last."""
        if self._opening is not None:
            self._opening = None
            self._answer(sentence, False)


def board_sentence(status: BoardStatus | None) -> str:
    """The state of the board in a sentence."""
    if status is None:
        return "No board is connected."
    if status.state != "ready":
        again = " Trying again by itself." if status.state == "lost" else ""
        return f"Board: {status.sentence or 'connecting ...'}{again}"
    return f"Board: {status.identity} is ready. {status.sentence}".strip()
