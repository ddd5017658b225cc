"""Named gates, the complement, and what the camera is told."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QCheckBox, QComboBox, QGroupBox, QVBoxLayout, QWidget
from slopegate.app.session.describe import gate_text, line_text
from slopegate.app.session.session import Intent, Resolved, Session
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.core.rig.rig import Rig
from slopegate.drivers.sync.board_delay import BoardDelay


class NamedBox(QGroupBox):
    """Named gates, the complement, and what the camera is told."""

    def __init__(self, session: Session, parent: QWidget) -> None:
        super().__init__("Gate", parent)
        self._session = session
        self.choice = QComboBox(self)
        self.choice.setPlaceholderText("Named gates ...")
        self.choice.setToolTip("Gates that suit this scene. Keys: Ctrl+1, Ctrl+2, ...")
        self.choice.setAccessibleName("Named gates")
        self.choice.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.choice.setMinimumContentsLength(14)
        self.choice.activated.connect(self._on_chosen)
        self.complement = QCheckBox("C&omplement", self)
        self.complement.setToolTip("Record all but this gate: the rest of the projector's period (Ctrl+M, Alt+O)")
        QShortcut(QKeySequence("Ctrl+M"), self).activated.connect(self.complement.click)
        self.complement.toggled.connect(session.ask_complement)
        self._why = ""
        self._hints: dict[QWidget, str] = {widget: widget.toolTip() for widget in (self.choice, self.complement)}
        self.sent = ElidedLabel(self)
        self.warning = ElidedLabel(self)
        layout = QVBoxLayout(self)
        layout.setSpacing(2)
        for widget in (self.choice, self.complement, self.sent, self.warning):
            layout.addWidget(widget)

    def set_missing(self, why: str) -> None:
        """Switch everything off, with the reason; on again with an empty one."""
        self._why = why
        for widget in (self.choice, self.complement):
            widget.setEnabled(not why)
            widget.setToolTip(why or self._hints[widget])

    def set_presets(self, names: list[str]) -> None:
        """The names of this scene's gates."""
        with QSignalBlocker(self.choice):
            self.choice.clear()
            self.choice.addItems(names)

    def refresh(self, rig: Rig, resolved: Resolved, intent: Intent) -> None:
        """Show the present gate's name, if it has one, and what is sent."""
        source = self._session.source
        assert source is not None
        now = (intent.wish, resolved.gate)
        named = [preset.settings in now and preset.complement == intent.complement for preset in source.presets]
        with QSignalBlocker(self.choice), QSignalBlocker(self.complement):
            self.choice.setCurrentIndex(named.index(True) if True in named else -1)
            self.complement.setChecked(intent.complement)
        line = line_text(rig, resolved.sent.line_time_us)
        told = source.camera.info.limits is not None
        by = " (delay by the board)" if isinstance(source.camera, BoardDelay) else ""
        self.sent.set_full_text(f"Sent: {line}, {gate_text(resolved.sent)}{by}" if told else "This camera has no gate.")
        self.warning.set_full_text(self._why or "; ".join(resolved.slab.warnings))

    def _on_chosen(self, index: int) -> None:
        source = self._session.source
        if source is not None and 0 <= index < len(source.presets):
            self._session.use(source.presets[index])
