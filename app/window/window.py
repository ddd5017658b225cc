"""The main window: makes its parts and passes on what one part wants of another."""

from __future__ import annotations

import logging
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QLocale, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QAction, QCloseEvent, QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QApplication, QMainWindow, QVBoxLayout, QWidget

from slopegate.app.devices.cameras import Cameras
from slopegate.app.devices.connection import Connection
from slopegate.app.devices.menu import DeviceMenu
from slopegate.app.devices.projector_menu import ProjectorMenu
from slopegate.app.panels.panel import Desk
from slopegate.app.session import preferences as remembered
from slopegate.app.session.device_source import timed_alike, with_rig
from slopegate.app.session.history import GateHistory
from slopegate.app.session.holding import Needs
from slopegate.app.session.my_gates import FILE_NAME as GATES_NAME
from slopegate.app.session.my_gates import MyGates
from slopegate.app.session.opening import Opener
from slopegate.app.session.preferences import Preferences
from slopegate.app.session.saving import Saver
from slopegate.app.session.session import Change, Session
from slopegate.app.session.session_file import SUFFIX
from slopegate.app.session.snapshot import save_numbered, save_snapshot, snapshot_metadata
from slopegate.app.session.source import Options
from slopegate.app.session.tidying import Tidying, Unsearched
from slopegate.app.views.live_panel import LivePanel
from slopegate.app.widgets import theme as themes
from slopegate.app.widgets.exposed import RepaintUncovered
from slopegate.app.widgets.focus_ring import FocusRing
from slopegate.app.widgets.messages import MessageStrip, ProgressStrip, StripsOver
from slopegate.app.widgets.scroll import SidewaysScroll
from slopegate.app.window.about import AboutDialog
from slopegate.app.window.actions import Actions, Handlers
from slopegate.app.window.asking import (
    ask_rig_file,
    ask_scene_file,
    ask_scene_folder,
    ask_snapshot_file,
    ask_to_end,
    snapshot_folder,
)
from slopegate.app.window.bugs import BugWatch, LogDialog
from slopegate.app.window.docks import Docks
from slopegate.app.window.files import Files
from slopegate.app.window.gate_controls import GateControls
from slopegate.app.window.gate_menu import GateMenu
from slopegate.app.window.keys import KeysDialog
from slopegate.app.window.screens import bring_onto_a_screen, first_size
from slopegate.app.window.state import kept_intent, kept_options, pack, unpack, with_session
from slopegate.app.window.status import StatusReadout
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.faults import Faults
from slopegate.drivers.contract.families import Address
from slopegate.drivers.files.rig_files import RigError, load_rig
from slopegate.drivers.scenes.scene_files import offered_scenes
from slopegate.drivers.transports.storage import is_transport

_log = logging.getLogger(__name__)

STATUS_MS = 250
LONGEST_START_MS = 30_000
"""A window that has shown nothing until then may go on for hours, and make garbage."""
DEFAULT_SIZE = QSize(1280, 800)


class Window(QMainWindow):
    """The main window. It shows one scene or camera at a time."""

    ready = Signal()
    """The first image of a source is on the screen, and the panels in front are made."""

    def __init__(self, rig: Rig, preferences_path: Path) -> None:
        super().__init__()
        self._start = Unsearched()
        self.ready.connect(self._start.end_of_start)
        QTimer.singleShot(LONGEST_START_MS, self, self._start.end)
        self._preferences_path = preferences_path
        self._preferences, notice = remembered.load(preferences_path, Preferences, "the window")
        self.session = Session(parent=self)
        self.opener = Opener(self.session, rig, self)
        self.history = GateHistory(self.session, self)
        self._asking = True
        self._refusal = ""
        """Why the last gate that was refused was: shown until another one is granted."""
        self.saver = Saver(self)
        Tidying(self.session, self)
        self.setWindowTitle("Slopegate")
        self.setLocale(QLocale.c())  # numbers have one notation, in progress bars and dialogs, too
        self.setAcceptDrops(True)
        self._arrange()
        menu, folder = self.menus.camera_menu, preferences_path.parent
        self.projector = ProjectorMenu(self, menu, folder, rig.projector, self.messages)
        self.desk.screen = self.projector.screen
        RepaintUncovered(self)
        self._connect()
        self.menus.show_rig(rig)
        self.set_theme(self._preferences.theme)
        self._restore()
        if notice:
            self.messages.say(notice, "warning")

    def _arrange(self) -> None:
        self.live, self.gate = LivePanel(self.session), GateControls(self.session)
        self.desk = Desk(self.session, self.live, self)
        self.desk.settings_folder = self._preferences_path.parent
        self.docks = Docks(self.desk)
        self.messages, self.progress, self.status = MessageStrip(), ProgressStrip(), StatusReadout()
        StripsOver(self.live.view, (self.progress, self.messages))
        middle = QWidget()
        column = QVBoxLayout(middle)
        column.setContentsMargins(6, 4, 6, 4)
        column.setSpacing(4)
        column.addWidget(self.docks, 1)
        column.addWidget(SidewaysScroll(self.gate))
        self.setCentralWidget(middle)
        self.statusBar().addPermanentWidget(self.status)
        scenes = offered_scenes()
        self.menus = Actions(self, scenes, self._handlers())
        self._fill_image_menu()
        self.devices = DeviceMenu(self, self.menus.camera_menu, self._preferences_path.parent)
        self.cameras = Cameras(
            self.session, self.opener, self.devices.hub, self.messages, self._options, self._may_end, self
        )
        self.connection = Connection(self.session, self.live.view, self.messages)
        self._arrange_files([entry.path for entry in scenes])

    def _arrange_files(self, offered: list[Path]) -> None:
        def may(doing: str) -> bool:
            return self._may_end("source", doing)

        recent, mine = self._preferences.recent, MyGates(self._preferences_path.with_name(GATES_NAME))
        self.files = Files(self, self.session, self.opener, self.docks, self.live, recent, offered, may)
        self.gate_menu = GateMenu(self, self.session, mine)
        menus, end = self.menus, self.menus.end_of_opening
        menus.file_menu.insertMenu(end, self.files.menu)
        menus.file_menu.insertAction(end, self.files.again)
        menus.file_menu.insertAction(end, self.files.save)
        menus.gates_below = self.gate_menu.menu
        menus.show_gates([])
        self.addActions([self.gate_menu.keep])
        if mine.problem:
            self.messages.say(mine.problem, "warning")

    def _fill_image_menu(self) -> None:
        view = self.live.view
        view.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)
        for action in self.menus.on_image:
            entry = action or QAction(view)
            entry.setSeparator(action is None)
            view.addAction(entry)

    def _handlers(self) -> Handlers:
        view, levels = self.live.view, self.live.levels
        return Handlers(
            open_file=lambda: self._open_if(ask_scene_file(self)),
            open_folder=lambda: self._open_if(ask_scene_folder(self)),
            snapshot=self._ask_snapshot,
            snapshot_now=self._snapshot_now,
            copy_shown=lambda: self.messages.say(self.live.copy_shown(), "note"),
            copy_counts=lambda: self.messages.say(self.live.copy_counts(), "note"),
            tool=self._take_up,
            show_as=self.live.show_as,
            full_screen=self._fill_screen,
            pause=self.session.pause,
            fit=view.fit,
            one_to_one=view.one_to_one,
            zoom_in=view.zoom_in,
            zoom_out=view.zoom_out,
            auto_levels=levels.set_auto,
            full_levels=levels.set_full,
            theme=self.set_theme,
            workspace=self.docks.switch,
            panel=self.docks.toggle,
            reset_layout=self.docks.reset,
            escape=self._escape,
            show_keys=lambda: KeysDialog.show_of(self),
            show_log=self.show_log,
            show_about=lambda: AboutDialog.show_of(self, self._preferences_path.parent),
            undo=self.history.undo,
            redo=self.history.redo,
            gate=self._use_gate,
            rig=self.use_rig,
            open_rig=self._ask_rig,
        )

    def _connect(self) -> None:
        self.bugs = BugWatch(self)
        # queued: one may be logged in the middle of anything
        self.bugs.found.connect(self._on_bug, Qt.ConnectionType.QueuedConnection)
        self.bugs.told.connect(self.messages.say, Qt.ConnectionType.QueuedConnection)
        self.messages.log_wished.connect(self.show_log)
        self.session.changed.connect(self._on_changed)
        self.history.changed.connect(self._show_history)
        self._show_history()
        self.menus.scene_chosen.connect(self.open)
        self.menus.options_chosen.connect(self.cameras.change_options)
        self.menus.mode_chosen.connect(self.cameras.change_mode)
        self.cameras.refused.connect(self._show_source)
        self.live.first_image.connect(self._on_first_image)
        self.live.display_changed.connect(lambda: self.menus.show_display(self.live.display))
        self.docks.switched.connect(self.menus.show_workspace)
        self.docks.ran.connect(self._on_panels)
        self.menus.panel_menu.aboutToShow.connect(self._tick_panels)
        self.desk.open_wished.connect(self.open)
        self.desk.warned.connect(self.messages.say)
        self.desk.rig_wished.connect(self._take_rig)
        self.desk.noted.connect(lambda text: self.messages.say(text, "note"))
        self.desk.transports.failed.connect(self.messages.say)
        self.opener.progressed.connect(self.progress.say)
        self.opener.opened.connect(self.progress.hide)
        self.messages.follow(self.gate.refused, self.gate.edited)
        self.messages.follow(self.desk.refused, self.desk.typed)
        for box in (self.live.levels.black, self.live.levels.white):
            self.messages.follow(box.refused, box.typed)
            box.withdrawn.connect(self.messages.take_back)
        for part in (self.gate, self.desk):
            part.withdrawn.connect(self.messages.take_back)
        self.opener.failed.connect(self._on_failed)
        self.opener.failed.connect(self.devices.say_failed)
        self.devices.connect_cameras(self.cameras.open)
        self.opener.cancelled.connect(self._on_cancelled)
        self.progress.cancelled.connect(self.opener.cancel)
        self.saver.finished.connect(lambda path: self.messages.say(f"Saved {path}", "note"))
        self.saver.failed.connect(self.messages.say)
        self.files.said.connect(self.messages.say)
        self.files.open_wished.connect(self.open)
        self.files.rig_wished.connect(self._look_with)
        self.gate_menu.said.connect(self.messages.say)
        self._status_timer = QTimer(self)
        self._status_timer.timeout.connect(self._show_status)
        self._status_timer.start(STATUS_MS)
        QApplication.styleHints().colorSchemeChanged.connect(self._on_desktop_scheme)

    def open_first(
        self, scene: str | None, skip: bool = True, camera: Address | None = None, faults: Faults | None = None
    ) -> None:
        """Open the scene or session asked for, else the one of the last time with its gate, else the first that ships.

        Light transport opens beside that scene. Then the camera asked for, or without a wish the one of the last time.
        """
        if scene is None or camera is not None:
            self.cameras.open_later(camera)
        later = None
        if scene is not None and (scene.lower().endswith(SUFFIX) or is_transport(Path(scene))):
            later, scene = Path(scene), None  # a scene comes beside transport, and where the session does not open
        kept = self._preferences
        same = scene in (None, kept.scene) and kept.rig in (None, self.opener.rig.name)
        intent = kept_intent(kept) if same else None
        self.opener.open_first(scene or kept.scene, kept_options(kept, skip, faults), intent)
        if later is not None:
            self.open(later)

    def open(self, where: Path | Address) -> None:
        """Load a scene, video or folder, or open a camera, beside what runs, or light transport beside any."""
        if isinstance(where, Address):
            self.cameras.open(where)
            return
        if is_transport(where):
            self.messages.hide()
            self.docks.bring("relight")
            self.desk.transports.read(where)
            return
        if where.suffix.lower() == SUFFIX:
            self.messages.hide()
            self.files.open_session(where)
            return
        if not self._may_end("source", f"Opening {where.name}"):
            self._show_source()
            return
        self.messages.hide()
        self.opener.open(where, self._options())

    def use_rig(self, rig: Rig) -> None:
        """Look at the same scene, video or camera with this rig, and its own first gate."""
        if not self._may_end("source", "Another rig"):
            self.menus.show_rig(self.opener.rig)
            return
        self._look_with(rig)
        source = self.session.source
        if source is None:
            self.opener.open_first_again()
        else:
            self.open(source.where)

    def _take_rig(self, rig: Rig) -> None:
        """Look at what runs with a rig that was calibrated: a camera goes on where its shutter stays the same."""
        source = self.session.source
        if source is None or not source.is_device or not timed_alike(source.rig, rig):
            self.use_rig(rig)
        elif self._may_end("source", "Another rig"):
            self.opener.rig = rig
            self.menus.show_rig(rig)
            self.session.see_with(with_rig(source, rig))

    def _look_with(self, rig: Rig) -> None:
        """What is opened from now on is looked at with this rig."""
        self.opener.rig = rig
        self.projector.use(rig.projector)
        self.menus.show_rig(rig)

    def set_theme(self, theme: str) -> None:
        """Light, dark, or what the desktop has."""
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        chosen = next(known for known in themes.THEMES if known == theme)
        self._preferences = self._preferences.model_copy(update={"theme": chosen})
        themes.apply(application, chosen)
        FocusRing.on(application)
        self.menus.show_theme(chosen)

    def save_frame(self, path: Path, raw: bool = False) -> None:
        """Write the frame on show to this file, in a thread of its own."""
        frame = self._frame_to_save()
        if frame is None:
            return
        counts, facts = frame
        self._keep_folder(path.parent)
        self.saver.start(lambda _: save_snapshot(path, counts, facts, raw))

    def _snapshot_now(self) -> None:
        frame = self._frame_to_save()
        if frame is None:
            return
        counts, facts = frame
        folder, now = snapshot_folder(self._preferences.snapshot_folder), datetime.now()
        self.saver.start(lambda _: save_numbered(folder, counts, facts, now))

    def _frame_to_save(self) -> tuple[Counts, dict[str, Any]] | None:
        """The frame on show, with what is saved of it; says so where there is none."""
        frame, source = self.live.copy_frame(), self.session.source
        if frame is None or source is None:
            self.messages.say("There is no frame to save yet.")
            return None
        return frame.image, snapshot_metadata(source.rig, source.scene, source.place, source.camera.info, frame.stamp)

    def _keep_folder(self, folder: Path) -> None:
        self._preferences = self._preferences.model_copy(update={"snapshot_folder": str(folder.absolute())})

    def show_log(self) -> None:
        """Open the log beside the window."""
        dialog = self.findChild(LogDialog) or LogDialog(self)
        dialog.refresh()
        dialog.show()
        dialog.raise_()

    def _may_end(self, needs: Needs, doing: str) -> bool:
        """Whether everything that holds this has ended, or may be ended: the user is asked."""
        return all(ask_to_end(self, hold, doing) for hold in self.session.holds(needs) if hold.asks)

    def _take_up(self, tool: str) -> None:
        panel = self.docks.open("measure")
        if panel is not None:
            panel.take_up(tool)

    def _fill_screen(self, wanted: bool) -> None:
        state = self.windowState()
        full = Qt.WindowState.WindowFullScreen
        self.setWindowState(state | full if wanted else state & ~full)  # a maximised window stays one

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.WindowStateChange:
            self.menus.full_screen.setChecked(self.isFullScreen())

    def _on_bug(self, sentence: str) -> None:
        self.messages.say_bug(sentence)
        _log.warning("That was with %s", self.session.facts)

    def _options(self) -> Options:
        source = self.session.source
        return kept_options(self._preferences) if source is None else source.options

    def _on_changed(self, change: Change) -> None:
        if Change.REFUSED in change:
            self._refusal = self.session.refusal
            self.messages.say(self._refusal, "warning")
        elif change & (Change.GATE | Change.SOURCE):
            self.messages.take_back(self._refusal)
        if Change.PAUSE in change:
            self.menus.show_paused(self.session.paused)
        if Change.HOLD in change:
            self._show_history()
        if Change.SOURCE in change:
            self._show_source()

    def _show_history(self) -> None:
        free = self.session.held("gate") is None
        self.menus.show_history(free and self.history.can_undo, free and self.history.can_redo)

    def _show_source(self) -> None:
        source = self.session.source
        if source is not None:
            self.menus.show_source(source)
            self.setWindowTitle(f"{source.scene.name} \u2013 Slopegate")
        else:
            self.menus.show_nothing()

    def _on_first_image(self) -> None:
        # after this paint has reached the screen, so that the import of the plots delays nothing
        QTimer.singleShot(0, self, self._run_panels)

    def _run_panels(self) -> None:
        if self.docks.running:
            self.ready.emit()
        else:
            self.docks.run()

    def _on_panels(self) -> None:
        self.session.meter.interrupt()
        self.ready.emit()

    def _tick_panels(self) -> None:
        for key, action in self.menus.panels.items():
            action.setChecked(not self.docks.docks[key].isHidden())

    def _on_failed(self, sentence: str) -> None:
        self.progress.hide()
        self.messages.say(sentence)
        self._show_source()

    def _on_cancelled(self) -> None:
        self.progress.hide()
        self.messages.say("Loading was cancelled; nothing has changed.", "note")
        self._show_source()

    def _show_status(self) -> None:
        now_s, stream, frame = time.monotonic(), self.session.stream, self.live.frame
        source = self.session.source
        renders = source is not None and source.rendered is not None
        self.status.show_readings(self.session.meter.readings(now_s), renders)
        if source is not None and source.replayed:
            self.status.show_replayed(source.lost_before)
        elif stream is not None and frame is not None and source is not None:
            self.status.show_losses(stream.counters, stream.beat, frame.stamp.lost_packets, source.triggered)
        else:
            self.status.show_no_losses()
        self.connection.look(now_s)

    def _use_gate(self, index: int) -> None:
        source = self.session.source
        if source is not None and index < len(source.presets):
            self.session.use(source.presets[index])

    def _escape(self) -> None:
        if self.opener.busy:
            self.opener.cancel()
        elif self.messages.isVisible():
            self.messages.hide()
        elif self.isFullScreen():
            self._fill_screen(False)

    def _ask_rig(self) -> None:
        where = ask_rig_file(self)
        if where is None:
            return
        try:
            self.use_rig(load_rig(where))
        except RigError as error:
            self.messages.say(str(error))

    def _open_if(self, where: Path | None) -> None:
        if where is not None:
            self.open(where)

    def _ask_snapshot(self, raw: bool) -> None:
        source = self.session.source
        start = snapshot_folder(self._preferences.snapshot_folder)
        path = None if source is None else ask_snapshot_file(self, source.scene, start)
        if path is not None:
            self.save_frame(path, raw)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if any(url.isLocalFile() for url in event.mimeData().urls()):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        if paths:
            event.acceptProposedAction()
            self.open(paths[0])

    def _on_desktop_scheme(self) -> None:
        if self._preferences.theme == "system":
            self.set_theme("system")

    def _restore(self) -> None:
        self.resize(first_size(DEFAULT_SIZE))
        if self._preferences.geometry:
            self.restoreGeometry(unpack(self._preferences.geometry))
        bring_onto_a_screen(self)
        self.docks.restore(self._preferences.layouts, self._preferences.workspace)
        self.live.levels.srgb.setChecked(self._preferences.srgb)
        self.live.show_as(self._preferences.display)
        self.menus.show_display(self.live.display)

    def _state(self) -> Preferences:
        update = {
            "geometry": pack(self.saveGeometry()),
            "srgb": self.live.levels.srgb.isChecked(),
            "display": self.live.display,
            "rig": self.opener.rig.name,
            "recent": tuple(self.files.recent),
            "workspace": self.docks.workspace,
            "layouts": {**self._preferences.layouts, **self.docks.layouts()},
        }
        return with_session(self._preferences.model_copy(update=update), self.session)

    def close_unasked(self) -> None:
        """Close, whatever is under way: what it has kept stays."""
        self._asking = False
        self.close()

    def closeEvent(self, event: QCloseEvent) -> None:
        if self._asking and not self._may_end("program", "Quitting"):
            event.ignore()
            return
        self._preferences = self._state()
        problem = remembered.save(self._preferences_path, self._preferences)
        if problem:
            print(f"slopegate: {problem}", file=sys.stderr)
        self.hide()
        self._start.end()
        self.docks.end()
        self.live.stop()
        self._status_timer.stop()
        transports = self.desk.transports
        for part in (self.opener, self.saver, transports, self.session, self.devices, self.projector, self.bugs):
            part.close()
        event.accept()
