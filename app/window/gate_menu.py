"""The menu of one's own gates: keep the gate that is set, use it again, hand it on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QFileDialog, QInputDialog, QWidget

from slopegate.app.session.my_gates import MyGates
from slopegate.app.session.session import Change, Session, asked_slab
from slopegate.app.widgets.menus import Menu
from slopegate.app.window.actions import menu_entry
from slopegate.app.window.asking import ask_sure
from slopegate.core.rig.checks import UserError
from slopegate.core.scene.scene import Preset

_KINDS = "Gates (*.toml);;All files (*)"


class GateMenu(QObject):
    """*My gates*: the gates by name, and what is done with them."""

    said = Signal(str, str)
    """A sentence, and what kind of message it is."""

    def __init__(self, window: QWidget, session: Session, mine: MyGates) -> None:
        super().__init__(window)
        self._window, self._session, self._mine = window, session, mine
        self.menu = Menu("&My gates", window)
        self.menu.setToolTipsVisible(True)
        self.keep = menu_entry(
            window, "&Keep this gate ...", "Ctrl+K", self._ask_name, "Give the gate that is set a name"
        )
        hint = "Add the gates of a file that somebody has handed on"
        self.load = menu_entry(window, "&Load from a file ...", "", self._ask_load, hint)
        self.save = menu_entry(
            window, "&Save to a file ...", "", self._ask_save, "Write all of them to a file, to hand on"
        )
        self.forget = Menu("&Forget", window)
        self.menu.aboutToShow.connect(self.refresh)
        session.changed.connect(self._on_changed)
        self.refresh()

    def keep_as(self, name: str) -> None:
        """Keep the gate that is set by this name, in place of one that has it."""
        source, resolved, intent = self._session.source, self._session.resolved, self._session.intent
        if source is None or resolved is None or intent is None:
            return
        preset = Preset(name, resolved.gate, intent.complement, asked_slab(intent))
        self._try(lambda: self._mine.keep(preset, source.rig), f"{name.strip()} is kept under Gate > My gates")

    def load_from(self, path: Path) -> None:
        """Add the gates of a file."""
        self._try(lambda: self._mine.load(path), f"The gates of {path.name} are under Gate > My gates")

    def save_to(self, path: Path) -> None:
        """Write all gates to a file."""
        self._try(lambda: self._mine.save_as(path), f"Saved {path}")

    def refresh(self) -> None:
        """List the gates as they are kept."""
        self.menu.clear()
        self.forget.clear()
        source = self._session.source
        presets, remarks = ((), ()) if source is None else self._mine.presets(source.rig)
        able = source is not None and not source.no_gate
        fixed = "" if source is None else source.fixed_gate
        for preset in presets:
            action = self.menu.addAction(preset.name.replace("&", "&&"))
            action.setEnabled(able)
            action.setToolTip(fixed or "; ".join(remark for remark in remarks if repr(preset.name) in remark))
            action.triggered.connect(lambda _=False, preset=preset: self._session.use(preset))
        for name in self._mine.names:
            action = self.forget.addAction(name.replace("&", "&&"))
            action.triggered.connect(lambda _=False, name=name: self._ask_forget(name))
        if presets:
            self.menu.addSeparator()
        self.keep.setEnabled(able or bool(fixed))
        self.save.setEnabled(bool(self._mine.names))
        self.forget.menuAction().setEnabled(bool(self._mine.names))
        self.menu.addAction(self.keep)
        self.menu.addMenu(self.forget)
        self.menu.addSeparator()
        self.menu.addActions([self.load, self.save])

    def _try(self, do: Callable[[], object], sentence: str) -> None:
        try:
            do()
        except UserError as error:
            self.said.emit(str(error), "error")
            return
        self.said.emit(sentence, "note")
        self.refresh()

    def _ask_name(self) -> None:
        name, given = QInputDialog.getText(self._window, "Keep this gate", "Name of the gate:")
        if given and (
            name.strip() not in self._mine.names
            or ask_sure(self._window, "My gates", f"Replace the gate {name.strip()!r}?")
        ):
            self.keep_as(name)

    def _ask_forget(self, name: str) -> None:
        if ask_sure(self._window, "My gates", f"Forget the gate {name!r}?"):
            self._try(lambda: self._mine.forget(name), f"{name} is forgotten")

    def _ask_load(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self._window, "Load gates", "", _KINDS)
        if name:
            self.load_from(Path(name))

    def _ask_save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self._window, "Save my gates", "gates.toml", _KINDS)
        if name:
            self.save_to(Path(name) if Path(name).suffix else Path(name).with_suffix(".toml"))

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            self.refresh()
