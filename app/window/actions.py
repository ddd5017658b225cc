"""Menus and tool bar of the window: names, keys and hints. What they do is the window's business."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtGui import QAction, QActionGroup, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu, QToolButton, QWidget

from slopegate.app.devices.fault_menu import FaultMenu
from slopegate.app.devices.mode_choice import OTHER, Choice, format_items, rate_items
from slopegate.app.panels.panels import WORKSPACES
from slopegate.app.session.display import Display
from slopegate.app.session.source import Options, Source
from slopegate.app.widgets.checked import MarkWhenChecked
from slopegate.app.widgets.colour_maps import COLOUR_MAPS
from slopegate.app.widgets.menus import Menu
from slopegate.app.widgets.signs import ToolBar
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.app.widgets.theme import THEMES, Theme
from slopegate.app.window.asking import ask_rate
from slopegate.core.rig.rig import Rig
from slopegate.drivers.contract.frame import Abilities, Modes
from slopegate.drivers.files.rig_files import shipped_rigs
from slopegate.drivers.scenes.scene_files import SceneEntry

_RIG_HINT = "Which camera and projector look at the scene, and where they stand"


@dataclass(frozen=True)
class Handlers:
    """What the actions call."""

    open_file: Callable[[], None]
    open_folder: Callable[[], None]
    snapshot: Callable[[bool], None]
    """Whether to keep a mosaic raw."""
    snapshot_now: Callable[[], None]
    """Save without asking where."""
    copy_shown: Callable[[], None]
    copy_counts: Callable[[], None]
    tool: Callable[[str], None]
    """Take up a tool of the panel that measures, by its key."""
    show_as: Callable[[Display], None]
    full_screen: Callable[[bool], None]
    pause: Callable[[bool], None]
    fit: Callable[[], None]
    one_to_one: Callable[[], None]
    zoom_in: Callable[[], None]
    zoom_out: Callable[[], None]
    auto_levels: Callable[[], None]
    full_levels: Callable[[], None]
    theme: Callable[[str], None]
    workspace: Callable[[str], None]
    """Show a workspace by its key."""
    panel: Callable[[str], None]
    """Bring a panel to the front, or close it when it is there."""
    reset_layout: Callable[[], None]
    escape: Callable[[], None]
    show_keys: Callable[[], None]
    show_log: Callable[[], None]
    show_about: Callable[[], None]
    undo: Callable[[], None]
    redo: Callable[[], None]
    gate: Callable[[int], None]
    """A named gate by its number."""
    rig: Callable[[Rig], None]
    """Look at the scene with this rig."""
    open_rig: Callable[[], None]


def menu_entry(window: QWidget, text: str, keys: str, act: Callable[[], object] | None, hint: str) -> QAction:
    """An entry for a menu of this window, with its keys and hint."""
    action = QAction(text, window)
    if keys:
        action.setShortcut(QKeySequence(keys))
    action.setToolTip(f"{hint} ({keys})" if keys else hint)
    action.setStatusTip(hint)
    if act is not None:
        action.triggered.connect(lambda _=False: act())
    return action


class Actions(QObject):
    """Menus and tool bar, and the choices in them."""

    scene_chosen = Signal(object)
    """A Path, or the Address of a device."""
    options_chosen = Signal(object)
    """Options."""
    mode_chosen = Signal(object, object)
    """A device's pixel format and rate, as `OpenOptions` has them; None for what cannot be chosen."""

    def __init__(self, window: QMainWindow, scenes: list[SceneEntry], handlers: Handlers) -> None:
        super().__init__(window)
        self._window, self._handlers = window, handlers
        self._options, self._is_device = Options(), False
        self._display = Display()
        self._modes, self._can = Modes(), Abilities()
        self.gates_below: QMenu | None = None
        """A menu that stands below the scene's gates."""
        self._fill_menus(scenes)
        self._fill_bar(scenes)

    def _fill_menus(self, scenes: list[SceneEntry]) -> None:
        do = self._handlers
        bar = self._window.menuBar()
        file = Menu.below(bar, "&File")
        file_hint = "A TOML scene, a mesh or a video"
        self.open_file = self._add(file, "&Open scene file ...", "Ctrl+O", do.open_file, file_hint)
        folder_hint = "A folder with a photo, depth and scene.json, a capture, or pictures to play"
        self.open_folder = self._add(file, "Open scene &folder ...", "Ctrl+Shift+O", do.open_folder, folder_hint)
        self.end_of_opening = file.addSeparator()
        self.file_menu = file
        hint = "Save the frame on show as 16-bit TIFF or PNG with its settings inside"
        self.snapshot = self._add(file, "&Snapshot ...", "Ctrl+S", lambda: do.snapshot(False), hint)
        raw_hint = "The same without demosaicing: one count a pixel, as the sensor made it"
        self._add(file, "Snapshot of &raw counts ...", "Ctrl+Shift+S", lambda: do.snapshot(True), raw_hint)
        now_hint = "Save the frame on show at once, under a new name in the folder of the last snapshot"
        self.snapshot_now = self._add(file, "Snapshot &now", "F12", do.snapshot_now, now_hint)
        file.addSeparator()
        self._add(file, "&Quit", "Ctrl+Q", self._window.close, "Close the window")
        self._fill_view(Menu.below(bar, "&View"))
        self._fill_image(Menu.below(bar, "Im&age"))
        self.scene_menu = Menu.below(bar, "&Scene")
        self.scene_menu.setToolTipsVisible(True)
        for entry in scenes:
            action = self._add(self.scene_menu, entry.title.replace("&", "&&"), "", None, entry.description)
            action.setStatusTip("")  # too long for the status line
            action.triggered.connect(lambda _=False, entry=entry: self.scene_chosen.emit(entry.path))
        self.scene_menu.addSeparator()
        self._fill_rigs(self.scene_menu)
        self.gate_menu = Menu.below(bar, "&Gate")
        hint = "Go back to the gate from before, however it was changed"
        self.undo = self._add(self.gate_menu, "&Undo gate", "Ctrl+Z", do.undo, hint)
        self.redo = self._add(self.gate_menu, "&Redo gate", "Ctrl+Shift+Z", do.redo, "Take back the last undoing")
        self._gates: list[QAction] = []
        self.camera_menu = Menu.below(bar, "&Camera")
        self.camera_menu.setToolTipsVisible(True)
        about = Menu.below(bar, "&Help")
        self._add(about, "&Keys ...", "F1", do.show_keys, "Every key and what it does")
        log_hint = "What went wrong inside the program, to read or to send to whoever looks into it"
        self._add(about, "&Log ...", "", do.show_log, log_hint)
        self._add(about, "&About Slopegate ...", "", do.show_about, "Version, licence, folders and libraries")

    def _fill_view(self, view: QMenu) -> None:
        do = self._handlers
        self.pause = self._add(view, "&Pause", "Ctrl+P", None, "Hold the frame on show; the camera goes on")
        self.pause.setCheckable(True)
        self.pause.toggled.connect(do.pause)
        view.addSeparator()
        self.fit = self._add(view, "&Fit image", "Ctrl+0", do.fit, "Show the whole image (F in the image)")
        self.one = self._add(view, "&One to one", "Ctrl+Shift+0", do.one_to_one, "One screen pixel per image pixel")
        self._add(view, "Zoom &in", "Ctrl++", do.zoom_in, "Magnify about the mouse")
        self._add(view, "Zoom ou&t", "Ctrl+-", do.zoom_out, "Shrink about the mouse")
        self._add(view, "&Automatic levels", "Ctrl+L", do.auto_levels, "Black and white from the frame on show")
        self._add(view, "Full &range", "Ctrl+Shift+L", do.full_levels, "Black and white at the sensor's ends")
        view.addSeparator()
        self._fill_workspaces(view)
        view.addSeparator()
        themes = Menu.below(view, "T&heme")
        group = QActionGroup(self)
        self.themes = {name: self._radio(themes, group, name.capitalize()) for name in THEMES}
        for name, action in self.themes.items():
            action.triggered.connect(lambda _=False, name=name: do.theme(name))
        self.full_screen = self._add(view, "Full &screen", "F11", None, "The whole screen for this window; Esc ends it")
        self.full_screen.setCheckable(True)
        self.full_screen.triggered.connect(do.full_screen)
        self._add(view, "&Dismiss message or loading", "Esc", do.escape, "Close the message, or cancel loading")

    def _fill_image(self, menu: QMenu) -> None:
        """Tools on the live image, and how it is shown."""
        do = self._handlers
        hint = "Drag over the live image: mean, deviation, extremes and saturation follow in Measure"
        region = self._add(menu, "&Region of counts", "F6", lambda: do.tool("rectangle"), hint)
        hint = "Drag over the live image: the counts along the line follow in Measure"
        line = self._add(menu, "&Line of counts", "F7", lambda: do.tool("profile"), hint)
        hint = "Click two points: how far they are apart in space, by depth or by the gate's slab"
        distance = self._add(menu, "&Distance of two points", "F8", lambda: do.tool("distance"), hint)
        menu.addSeparator()
        hint = "Mark pixels at the camera's greatest count"
        self.saturated = self._toggle(menu, "Mark &saturated pixels", "F9", hint, "mark_saturated")
        hint = "Mark pixels near the camera's dark level; how near is set in Measure"
        self.dark = self._toggle(menu, "Mark pixels with &hardly any light", "Shift+F9", hint, "mark_dark")
        self.scale = self._toggle(menu, "Scale &bar", "", "How long things are at the slab's distance", "scale_bar")
        colours, group = Menu.below(menu, "&Colours"), QActionGroup(self)
        self.colours: dict[str, QAction] = {}
        for name in COLOUR_MAPS:
            action = self._radio(colours, group, name.capitalize(), "Colours of a grey image")
            action.triggered.connect(lambda _=False, name=name: self._show_as("colour_map", name))
            self.colours[name] = action
        menu.addSeparator()
        hint = "Put the image as it is seen, with marks, on the clipboard"
        copied = self._add(menu, "C&opy image as shown", "Ctrl+C", do.copy_shown, hint)
        hint = "Put the counts of the marked region, or of what is seen, on the clipboard as a table"
        counts = self._add(menu, "Copy coun&ts", "Ctrl+Shift+C", do.copy_counts, hint)
        self.on_image = (
            *(self.fit, self.one, None, copied, counts, self.snapshot_now, self.snapshot, None),
            *(region, line, distance, None, self.saturated, self.dark, self.scale, colours.menuAction()),
        )
        """What the context menu of the live image offers; None is a line between."""

    def _toggle(self, menu: QMenu, text: str, keys: str, hint: str, field: str) -> QAction:
        """An entry that ticks a field of `Display`."""
        action = self._add(menu, text, keys, None, hint)
        action.setCheckable(True)
        action.triggered.connect(lambda on: self._show_as(field, on))
        return action

    def _show_as(self, field: str, value: object) -> None:
        self._handlers.show_as(self._display.model_copy(update={field: value}))

    def show_display(self, display: Display) -> None:
        """Tick how the live image is shown."""
        self._display = display
        for action, on in (
            (self.saturated, display.mark_saturated),
            (self.dark, display.mark_dark),
            (self.scale, display.scale_bar),
            (self.colours[display.colour_map], True),
        ):
            action.setChecked(on)

    def _fill_rigs(self, scene: QMenu) -> None:
        self.rig_menu, self._rig_group = Menu.below(scene, "&Rig"), QActionGroup(self)
        self.rig_menu.menuAction().setToolTip(_RIG_HINT)
        self.rigs: dict[Rig, QAction] = {}
        self._last_shown: dict[Rig, Rig] = {}  # two of equal numbers may be known to other errors
        for entry in shipped_rigs():
            self._add_rig(entry.rig)
        self._end_of_rigs = self.rig_menu.addSeparator()
        hint = "Look at the same scene with the rig of a TOML file"
        self._add(self.rig_menu, "Open rig &file ...", "", self._handlers.open_rig, hint)

    def _add_rig(self, rig: Rig) -> None:
        title = (rig.name or "A rig without a name").replace("&", "&&")
        action = self._radio(self.rig_menu, self._rig_group, title, "Look at the same scene with this rig")
        action.triggered.connect(lambda _=False: self._handlers.rig(self._last_shown.get(rig, rig)))
        self.rigs[rig] = action

    def show_rig(self, rig: Rig) -> None:
        """Tick this rig; one that was opened from a file gets an entry of its own."""
        if rig not in self.rigs:
            self._add_rig(rig)
            self.rig_menu.insertAction(self._end_of_rigs, self.rigs[rig])
        self._last_shown[rig] = rig
        self.rigs[rig].setChecked(True)

    def _fill_workspaces(self, view: QMenu) -> None:
        do, group = self._handlers, QActionGroup(self)
        self.workspaces: dict[str, QAction] = {}
        for one in WORKSPACES:
            action = self._radio(view, group, f"{one.title} workspace", one.hint, one.keys)
            action.setIconText(one.title)
            action.triggered.connect(lambda _=False, key=one.key: do.workspace(key))
            self.workspaces[one.key] = action
        menu = Menu.below(view, "Pa&nels")
        self.panels: dict[str, QAction] = {}
        hint = "Bring this panel to the front, or close it when it is there"
        for one in WORKSPACES:
            if self.panels:
                menu.addSeparator()
            for spec in one.panels:
                action = self._add(menu, spec.title, spec.keys, None, hint)
                action.setCheckable(True)
                action.triggered.connect(lambda _=False, key=spec.key: do.panel(key))
                self.panels[spec.key] = action
        self.panel_menu = menu
        self._add(view, "Reset &layout", "", do.reset_layout, "Arrange the panels of this workspace as at first")

    def _fill_bar(self, scenes: list[SceneEntry]) -> None:
        bar = ToolBar("Tools")
        bar.setObjectName("tools")
        bar.setMovable(False)
        self._window.addToolBar(bar)
        for action in self.workspaces.values():
            bar.addAction(action)
            button = bar.widgetForAction(action)
            assert isinstance(button, QToolButton)
            MarkWhenChecked(button)
        bar.addSeparator()
        self.scenes = ChoiceBox()
        self.scenes.setToolTip("What the camera looks at; files and folders can be dropped on the window")
        self.scenes.setAccessibleName("Scene")
        self.scenes.setMinimumContentsLength(26)
        self.scenes.setSizeAdjustPolicy(ChoiceBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        for index, entry in enumerate(scenes):
            self.scenes.addItem(entry.title, entry.path)
            self.scenes.setItemData(index, entry.description, 3)  # Qt.ToolTipRole
        self.scenes.activated.connect(lambda index: self.scene_chosen.emit(self.scenes.itemData(index)))
        self.noise = self._add(self.camera_menu, "&Noise", "Ctrl+N", None, "Shot and read noise of the sensor")
        self.noise.setCheckable(True)
        self.noise.triggered.connect(self._emit_options)
        hint = "Leave out camera rows that the gate cannot light: frames come faster, those rows stay black"
        self.lit_rows = self._add(self.camera_menu, "Read only lit &rows", "", None, hint)
        self.lit_rows.setCheckable(True)
        self.lit_rows.triggered.connect(self._emit_options)
        self.camera_menu.addSeparator()
        hint = "Grey or with a colour mosaic, and how many bits: the camera is stopped and started again with it"
        self.formats = Choice(self.camera_menu, "Pi&xel format", "Format", hint)
        hint = "How many frames a second the camera makes while no trigger sets its pace"
        self.rates = Choice(self.camera_menu, "Frame ra&te", "Rate", hint)
        self.formats.chosen.connect(self._emit_mode)
        self.rates.chosen.connect(self._on_rate)
        self.camera_menu.addSeparator()
        self.faults = FaultMenu(self.camera_menu)
        self.faults.chosen.connect(lambda wanted: self.options_chosen.emit(replace(self.options(), faults=wanted)))
        choices = (self.formats.menu.menuAction(), self.rates.menu.menuAction())
        own = [action for action in self.camera_menu.actions() if not action.isSeparator() and action not in choices]
        self._virtual = {action: action.toolTip() for action in own}
        """Entries that only a virtual camera understands, with their tool tips."""
        bar.addWidget(self.scenes)
        bar.addAction(self.open_file)
        bar.addSeparator()
        for action in (self.pause, self.snapshot, self.fit, self.one):
            bar.addAction(action)
        bar.addSeparator()
        bar.addWidget(self.formats.box)
        bar.addAction(self.noise)
        bar.addWidget(self.rates.box)
        self.open_file.setIconText("Open ...")
        self.snapshot.setIconText("Snapshot")
        self.fit.setIconText("Fit")
        self.one.setIconText("1:1")

    def show_source(self, source: Source) -> None:
        """Tick what runs, and list its named gates."""
        where, options = source.where, source.options
        paths = [self.scenes.itemData(index) for index in range(self.scenes.count())]
        if where not in paths:
            self.scenes.addItem(source.scene.name, where)
            paths.append(where)
        self.scenes.setCurrentIndex(paths.index(where))
        self._modes, self._can = source.camera.info.modes, source.camera.info.can
        self.formats.show_items(format_items(self._modes), self._modes.format, self._can.choose_format)
        self._show_rate(self._modes.rate_hz)
        self.noise.setChecked(options.noise)
        self.lit_rows.setChecked(options.lit_rows)
        self.faults.show_faults(options.faults)
        self._options, self._is_device = options, source.is_device
        self.show_gates([preset.name for preset in source.presets])
        self.rig_menu.setEnabled(not source.own_rig)
        self.rig_menu.menuAction().setToolTip(source.own_rig or _RIG_HINT)
        for thing, hint in self._virtual.items():
            thing.setEnabled(not source.is_device)
            thing.setToolTip(f"{hint}. {source.scene.name} makes its frames itself." if source.is_device else hint)

    def show_nothing(self) -> None:
        """No scene is running."""
        self.scenes.setCurrentIndex(-1)

    def show_gates(self, names: list[str]) -> None:
        """The scene's named gates in the menu."""
        self.gate_menu.clear()
        for action in self._gates:
            action.deleteLater()
        self._gates.clear()
        self.gate_menu.addActions([self.undo, self.redo])
        self.gate_menu.addSeparator()
        for index, name in enumerate(names):
            keys = f"Ctrl+{index + 1}" if index < 9 else ""
            action = self._add(self.gate_menu, name.replace("&", "&&"), keys, None, "")
            action.triggered.connect(lambda _=False, index=index: self._handlers.gate(index))
            self._gates.append(action)
        if self.gates_below is not None:
            self.gate_menu.addSeparator()
            self.gate_menu.addMenu(self.gates_below)

    def show_history(self, can_undo: bool, can_redo: bool) -> None:
        """Whether there is a gate from before, and one that was undone."""
        self.undo.setEnabled(can_undo)
        self.redo.setEnabled(can_redo)

    def show_paused(self, paused: bool) -> None:
        """Tick *Pause* without emitting its signal."""
        with QSignalBlocker(self.pause):
            self.pause.setChecked(paused)

    def show_workspace(self, key: str) -> None:
        """Tick the workspace that is shown."""
        self.workspaces[key].setChecked(True)

    def show_theme(self, theme: Theme) -> None:
        """Tick the theme."""
        self.themes[theme].setChecked(True)

    def options(self) -> Options:
        """The options that are ticked."""
        return replace(
            self._options,
            pixel_format=self.formats.value or self._options.pixel_format,
            noise=self.noise.isChecked(),
            rate_hz=self.rates.value or self._options.rate_hz,
            lit_rows=self.lit_rows.isChecked(),
        )

    def _emit_options(self) -> None:
        self.options_chosen.emit(self.options())

    def _show_rate(self, rate_hz: float) -> None:
        able = self._can.choose_rate
        self.rates.show_items(rate_items(self._modes, rate_hz), rate_hz if able else None, able)

    def _on_rate(self) -> None:
        if self.rates.value != OTHER:
            self._emit_mode()
            return
        wanted = ask_rate(self._window, self._modes)
        self._show_rate(wanted or self._modes.rate_hz)
        if wanted is not None:
            self._emit_mode()

    def _emit_mode(self) -> None:
        if self._is_device:
            self.mode_chosen.emit(self.formats.value, self.rates.value)
        else:
            self._emit_options()

    def _radio(self, menu: QMenu, group: QActionGroup, text: str, hint: str = "", keys: str = "") -> QAction:
        action = self._add(menu, text, keys, None, hint)
        action.setCheckable(True)
        group.addAction(action)
        return action

    def _add(self, menu: QMenu, text: str, keys: str, act: Callable[[], object] | None, hint: str) -> QAction:
        action = menu_entry(self._window, text, keys, act, hint)
        menu.addAction(action)
        return action
