"""Recent files, the scene file read again, and sessions kept as files."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from os.path import exists
from pathlib import Path
from typing import Literal

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QFileDialog, QWidget

from slopegate.app.session.opening import Opener
from slopegate.app.session.preferences import RememberedGate
from slopegate.app.session.session import Change, Session, asked_slab
from slopegate.app.session.session_file import SUFFIX, SavedSession, place_of, read_session, scene_in, write_session
from slopegate.app.session.source import Options, Source
from slopegate.app.views.live_panel import LivePanel
from slopegate.app.widgets.menus import Menu
from slopegate.app.window.actions import menu_entry
from slopegate.app.window.docks import Docks
from slopegate.app.window.state import intent_from, kept_rate, rate_of
from slopegate.core.rig.checks import UserError
from slopegate.drivers.contract.families import Address, read_address
from slopegate.drivers.files.rig_files import parse_rig, rig_to_toml

MOST_RECENT = 12


class Files(QObject):
    """What the *File* menu knows of files: those opened last, the one that is open, and sessions."""

    open_wished = Signal(object)
    """A Path or Address to open as if it were chosen anew."""
    rig_wished = Signal(object)
    """A Rig that what is opened next is looked at with."""
    said = Signal(str, str)
    """A sentence, and what kind of message it is."""

    def __init__(
        self,
        window: QWidget,
        session: Session,
        opener: Opener,
        docks: Docks,
        live: LivePanel,
        recent: Sequence[str],
        offered: Collection[Path],
        may: Callable[[str], bool],
    ) -> None:
        """`offered`: the scenes of the *Scene* menu, which are not remembered.

        `may` says whether what holds the source may be ended for what its argument tells."""
        super().__init__(window)
        self._window, self._session, self._opener, self._docks, self._may = window, session, opener, docks, may
        self._live, self._offered = live, offered
        self.recent = [path for path in recent if path][:MOST_RECENT]
        self._reopened: SavedSession | None = None
        self.menu = Menu("Open &recent", window)
        self.menu.setToolTipsVisible(True)
        self.menu.aboutToShow.connect(self._list_recent)
        hint = "Read the scene's file again, as after a change in an editor; the gate stays"
        self.again = menu_entry(window, "Read scene &again", "F5", self.reload, hint)
        hint = "Keep what is looked at, its rig, gate, panels and painted regions in a file that opens as it is now"
        self.save = menu_entry(window, "Save s&ession ...", "Ctrl+Alt+S", self._ask_save, hint)
        session.changed.connect(self._on_changed)
        opener.opened.connect(self._on_opened)
        opener.failed.connect(self._forget_reopened)
        opener.cancelled.connect(self._forget_reopened)

    def reload(self) -> None:
        """Read the scene that is open from its file again. On a mistake in it, what runs goes on."""
        source = self._session.source
        if source is None or not isinstance(source.where, Path) or not self._may("Reading the scene again"):
            return
        self._opener.open(source.where, source.options, keep_gate=True)

    def save_session(self, path: Path) -> None:
        """Write what is looked at and how the window stands to a file."""
        source, resolved, intent = self._session.source, self._session.resolved, self._session.intent
        if source is None or resolved is None or intent is None:
            self.said.emit("There is no scene yet: nothing can be kept.", "error")
            return
        options = source.options
        saved = SavedSession(
            **place_of(source.where, path),
            rig_toml=rig_to_toml(self._opener.rig),
            pixel_format=_kept_format(source),
            noise=options.noise,
            rate_hz=kept_rate(options.rate_hz),
            lit_rows=options.lit_rows,
            gate=RememberedGate.of(resolved.gate),
            slab=asked_slab(intent),
            complement=intent.complement,
            display=self._live.display,
            levels=(self._live.levels.black.value(), self._live.levels.white.value()),
            srgb=self._live.levels.srgb.isChecked(),
            workspace=self._docks.workspace,
            layouts=self._docks.layouts(),
            panels=self._docks.panel_states(),
        )
        try:
            write_session(path, saved)
        except UserError as error:
            self.said.emit(str(error), "error")
            return
        self.remember(path)
        self.said.emit(f"Saved {path}", "note")

    def open_session(self, path: Path) -> None:
        """Open what a session's file says, and have it as it was."""
        try:
            saved = read_session(path)
            rig = parse_rig(saved.rig_toml, f"the rig of {path}")
            address = None if saved.camera is None else read_address(saved.camera)
        except UserError as error:
            self.said.emit(str(error), "error")
            return
        where = address or scene_in(saved, path)
        if where is None or not self._may(f"Opening {path.name}"):
            return
        if isinstance(where, Path) and not exists(where):
            self.said.emit(f"{path.name} looks at {where}, which is missing", "error")
            return
        self.rig_wished.emit(rig)
        self._reopened = saved
        self._docks.restore({**self._docks.layouts(), **saved.layouts}, saved.workspace)
        if isinstance(where, Address):
            self.open_wished.emit(where)
        else:
            self._opener.open(where, _options(saved, self._session.source))
        self.remember(path)

    def remember(self, path: Path) -> None:
        """Put a file or folder at the top of those opened last."""
        text = str(path.absolute())
        self.recent = [text, *(other for other in self.recent if other != text)][:MOST_RECENT]

    def _list_recent(self) -> None:
        self.menu.clear()
        for text in self.recent:
            path = Path(text)
            action = self.menu.addAction(path.name.replace("&", "&&"))
            action.setToolTip(text)
            action.setEnabled(exists(path))
            action.triggered.connect(lambda _=False, path=path: self.open_wished.emit(path))
        if not self.recent:
            self.menu.addAction("Nothing was opened yet").setEnabled(False)
            return
        self.menu.addSeparator()
        self.menu.addAction("&Forget these").triggered.connect(self.recent.clear)

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        source = self._session.source
        file = None if source is None or not isinstance(source.where, Path) else source.where
        self.again.setEnabled(file is not None)
        if file is not None and file not in self._offered:
            self.remember(file)

    def _on_opened(self) -> None:
        reopened, self._reopened = self._reopened, None
        if reopened is None:
            return
        intent = intent_from(reopened.gate, reopened.slab, reopened.complement)
        if intent is not None:
            self._session.ask(intent)
        if reopened.display is not None:
            self._live.show_as(reopened.display)
        self._docks.set_panel_states(reopened.panels)
        levels = self._live.levels
        if reopened.srgb is not None:
            levels.srgb.setChecked(reopened.srgb)
        if reopened.levels is not None and reopened.levels[0] < reopened.levels[1] <= levels.white.maximum():
            levels.set_levels(*reopened.levels)

    def _forget_reopened(self, *_: object) -> None:
        self._reopened = None

    def _ask_save(self) -> None:
        source = self._session.source
        stem = "session" if source is None or not isinstance(source.where, Path) else source.where.stem
        kinds = f"Sessions (*{SUFFIX})"
        name, _ = QFileDialog.getSaveFileName(self._window, "Save the session", f"{stem}{SUFFIX}", kinds)
        if name:
            self.save_session(Path(name) if name.endswith(SUFFIX) else Path(name + SUFFIX))


def _kept_format(source: Source) -> Literal["mono12", "bayer_rg12"] | None:
    """The pixel format that the virtual camera was given."""
    if source.is_device:
        return None
    return "bayer_rg12" if source.options.pixel_format == "bayer_rg12" else "mono12"


def _options(saved: SavedSession, source: Source | None) -> Options:
    """The camera's options as they were; those that files do not keep stay."""
    now = Options() if source is None else source.options
    return Options(
        saved.pixel_format or now.pixel_format,
        saved.noise,
        rate_of(saved.rate_hz),
        saved.lit_rows,
        now.skip,
        now.faults,
    )
