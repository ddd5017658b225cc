"""Workspaces and their panels in the real window, by mouse and keyboard; what is hidden costs nothing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QMainWindow, QTabBar, QToolBar, QWidget
from pytestqt.qtbot import QtBot

from fits import complaints, on_screen
from slopegate.app.panels.capture import CapturePanel
from slopegate.app.panels.panels import PANELS, WORKSPACES
from slopegate.app.panels.plots import SectionPanel, SlabPanel, TimingPanel
from slopegate.app.views import histogram
from slopegate.app.widgets.theme import marked_button
from slopegate.app.window import docks as docks_module
from slopegate.app.window.docks import PanelDock
from slopegate.app.window.screens import held
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import make_source

LEFT, ALT = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.AltModifier
FAR = QPoint(9000, 7000)
ROOT = Path(__file__).resolve().parents[3]


def front(window: Window) -> set[str]:
    """The panels that are seen."""
    seen = {key for key, dock in window.docks.docks.items() if dock.front}
    for key, dock in window.docks.docks.items():
        assert (dock.panel is not None and dock.panel.isVisible()) == (key in seen and not dock.missing), key
    return seen


def shows(qtbot: QtBot, window: Window, *keys: str) -> None:
    """Wait until these panels are seen and no others."""

    def all_and_only() -> None:
        assert front(window) == set(keys)

    qtbot.waitUntil(all_and_only)


def press(qtbot: QtBot, dock: PanelDock, name: str) -> None:
    """A click on a button of its title bar."""
    button = dock.findChild(QAbstractButton, f"qt_dockwidget_{name}button")
    assert button is not None
    assert button.isVisible()
    qtbot.mouseClick(button, LEFT)


def click_tab(qtbot: QtBot, window: Window, title: str) -> None:
    for tabs in window.docks.findChildren(QTabBar):
        for index in range(tabs.count() if tabs.isVisible() else 0):
            if tabs.tabText(index) == title:
                qtbot.mouseClick(tabs, LEFT, pos=tabs.tabRect(index).center())
                return
    raise AssertionError(f"there is no tab {title}")


def begin(qtbot: QtBot, rig: Rig, path: Path) -> Window:
    """A window on these preferences, with its first image."""
    made = Window(rig, path)
    qtbot.addWidget(made)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitActive(made):
        made.activateWindow()
    with qtbot.waitSignal(made.ready):
        made.session.adopt(make_source(rig))
    return made


# The table


def test_every_panel_of_the_table_is_made_by_its_line(window: Window) -> None:
    assert len({spec.key for spec in PANELS}) == len(PANELS)
    assert {spec.workspace for spec in PANELS} == {workspace.key for workspace in WORKSPACES}
    for spec in PANELS:
        panel = window.docks.bring(spec.key)
        assert panel is not None
        assert type(panel).__name__ == spec.place.partition(":")[2]
        assert window.docks.workspace == spec.workspace


def test_every_key_is_one_of_a_kind(window: Window) -> None:
    keys = [action.shortcut().toString() for menu in window.menuBar().actions() for action in menu.menu().actions()]
    keys += [action.shortcut().toString() for action in window.menus.panels.values()]
    used = [key for key in keys if key]
    assert {"Alt+1", "Alt+2", "Alt+3", "Alt+4", "Alt+5", "Alt+N", "Alt+M"} <= set(used)
    assert sorted(used) == sorted(set(used))


# Switching, closing, floating


def test_workspaces_by_keys_and_buttons_keep_what_was_changed(qtbot: QtBot, window: Window) -> None:
    shows(qtbot, window, "slab", "section")
    assert window.menus.workspaces["gate"].isChecked()
    click_tab(qtbot, window, "Mask")
    shows(qtbot, window, "slab", "mask")
    qtbot.keyClick(window, Qt.Key.Key_2, ALT)
    shows(qtbot, window, "depth", "slices")
    assert window.menus.workspaces["capture"].isChecked()
    assert not window.menus.workspaces["gate"].isChecked()
    press(qtbot, window.docks.docks["depth"], "close")
    shows(qtbot, window, "capture", "slices")
    bar = window.findChild(QToolBar, "tools")
    qtbot.mouseClick(bar.widgetForAction(window.menus.workspaces["gate"]), LEFT)
    shows(qtbot, window, "slab", "mask")
    qtbot.keyClick(window, Qt.Key.Key_2, ALT)
    shows(qtbot, window, "capture", "slices")


def test_a_closed_panel_comes_back_by_the_menu(qtbot: QtBot, window: Window) -> None:
    menu, entry = window.menus.panel_menu, window.menus.panels["slab"]

    def ticked() -> bool:
        menu.aboutToShow.emit()
        return entry.isChecked()

    assert ticked()
    press(qtbot, window.docks.docks["slab"], "close")
    shows(qtbot, window, "section")
    assert not ticked()
    entry.trigger()
    shows(qtbot, window, "slab", "section")
    assert ticked()
    window.menus.panels["alarm"].trigger()  # open behind another tab: it comes to the front
    shows(qtbot, window, "slab", "alarm")
    window.menus.panels["alarm"].trigger()  # and is closed from there
    qtbot.waitUntil(window.docks.docks["alarm"].isHidden)
    window.menus.panels["depth"].trigger()  # any panel can be had in any workspace
    qtbot.waitUntil(lambda: "depth" in front(window))
    assert window.docks.workspace == "gate"


def test_timing_and_section_have_keys(qtbot: QtBot, window: Window) -> None:
    qtbot.keyClick(window, Qt.Key.Key_M, ALT)
    shows(qtbot, window, "slab", "timing")
    qtbot.keyClick(window, Qt.Key.Key_N, ALT)
    shows(qtbot, window, "slab", "section")


@pytest.mark.parametrize("key", ["slab", "section"])
def test_a_panel_floats_works_and_is_docked_again(qtbot: QtBot, window: Window, key: str) -> None:
    dock = window.docks.docks[key]
    press(qtbot, dock, "float")
    qtbot.waitUntil(lambda: dock.isWindow() and key in front(window))
    before = drawn_gate(window, key)
    window.session.use(window.session.source.presets[1])
    qtbot.waitUntil(lambda: drawn_gate(window, key) != before)
    dock.activateWindow()
    qtbot.keyClick(dock, Qt.Key.Key_2, ALT)  # keys of the window work there too
    qtbot.waitUntil(lambda: window.docks.workspace == "capture")
    qtbot.waitUntil(lambda: not dock.isVisible())
    qtbot.keyClick(window, Qt.Key.Key_1, ALT)
    qtbot.waitUntil(lambda: dock.isFloating() and dock.front)
    is_painted(qtbot, dock)
    dock.setFloating(False)
    shows(qtbot, window, "slab", "section")
    window.close()


def test_nothing_is_arranged_anew_while_a_mouse_button_is_held(qtbot: QtBot, window: Window) -> None:
    """Qt would go on moving the dock that is dragged, which ends the process."""
    handle = window.windowHandle()
    at = window.docks.docks["slab"].mapTo(window, QPoint(40, 8))
    QTest.mousePress(handle, LEFT, Qt.KeyboardModifier.NoModifier, at)
    qtbot.keyClick(window, Qt.Key.Key_2, ALT)
    window.docks.reset()
    qtbot.wait(4 * docks_module.HELD_MS)
    assert window.docks.workspace == "gate"
    QTest.mouseRelease(handle, LEFT, Qt.KeyboardModifier.NoModifier, at)
    qtbot.waitUntil(lambda: window.docks.workspace == "capture")


def test_a_panel_that_is_brought_while_a_mouse_button_is_held_stays_in_front(qtbot: QtBot, window: Window) -> None:
    handle, at = window.windowHandle(), QPoint(5, 5)
    QTest.mousePress(handle, LEFT, Qt.KeyboardModifier.NoModifier, at)
    window.docks.bring("record")
    QTest.mouseRelease(handle, LEFT, Qt.KeyboardModifier.NoModifier, at)
    qtbot.waitUntil(lambda: window.docks.workspace == "capture")
    record = window.docks.docks["record"]
    assert record.front
    qtbot.waitUntil(lambda: record.panel is not None and record.panel.isVisible())


def test_reset_layout_arranges_this_workspace_as_at_first(qtbot: QtBot, window: Window) -> None:
    docks = window.docks.docks
    at_first = {key: dock.geometry() for key, dock in docks.items() if dock.front}
    press(qtbot, docks["slab"], "float")
    docks["section"].close()
    window.docks.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, docks["timing"])
    window.menus.panels["slices"].trigger()
    qtbot.waitUntil(lambda: {"slab", "timing", "slices"} <= front(window))
    next(one for one in window.menuBar().actions()[1].menu().actions() if "layout" in one.text()).trigger()
    shows(qtbot, window, "slab", "section")
    qtbot.waitUntil(lambda: {key: dock.geometry() for key, dock in docks.items() if dock.front} == at_first)


def test_messages_and_progress_move_nothing(qtbot: QtBot, window: Window) -> None:
    def places() -> list[tuple[int, ...]]:
        moved: list[QWidget] = [window.live.view, window.gate, *window.docks.docks.values()]
        return [widget.geometry().getRect() for widget in moved]

    before = places()
    window.messages.say("What cannot be done, in a sentence that is longer than the image is wide. " * 4)
    window.progress.say(0.3, "Reading ...")
    qtbot.waitUntil(lambda: window.messages.isVisible() and window.progress.isVisible())
    qtbot.wait(50)
    assert places() == before
    assert complaints(window) == []
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    window.progress.hide()
    qtbot.waitUntil(lambda: window.messages.text == "")
    assert not window.messages.parentWidget().isVisible()


# Restarts


def test_each_workspace_is_there_again_after_a_restart(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    window = begin(qtbot, rig, path)
    docks = window.docks.docks
    press(qtbot, docks["slab"], "float")
    docks["slab"].move(300, 200)
    click_tab(qtbot, window, "Timing")
    with qtbot.waitActive(window):
        window.activateWindow()
    qtbot.keyClick(window, Qt.Key.Key_2, ALT)
    shows(qtbot, window, "depth", "slices")
    press(qtbot, docks["slices"], "close")
    shows(qtbot, window, "depth", "record")  # what was behind it
    press(qtbot, docks["record"], "close")
    shows(qtbot, window, "depth")
    window.close()
    again = begin(qtbot, rig, path)
    assert again.docks.workspace == "capture"
    shows(qtbot, again, "depth")
    qtbot.keyClick(again, Qt.Key.Key_1, ALT)
    shows(qtbot, again, "slab", "timing")
    assert again.docks.docks["slab"].isFloating()
    assert again.docks.docks["slab"].pos() == QPoint(300, 200)
    is_painted(qtbot, again.docks.docks["slab"])
    again.close()


def test_layouts_of_a_version_with_fewer_panels_open(
    qtbot: QtBot, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "window.json"
    with monkeypatch.context() as former:
        former.setattr(docks_module, "PANELS", tuple(spec for spec in PANELS if spec.workspace != "light"))
        former.setattr(docks_module, "WORKSPACES", tuple(one for one in WORKSPACES if one.key != "light"))
        window = begin(qtbot, rig, path)
        press(qtbot, window.docks.docks["slab"], "float")
        click_tab(qtbot, window, "Timing")
        window.docks.switch("capture")
        for key in ("slices", "record"):
            press(qtbot, window.docks.docks[key], "close")
        shows(qtbot, window, "depth")
        window.close()
    again = begin(qtbot, rig, path)
    shows(qtbot, again, "depth")
    again.docks.switch("gate")
    shows(qtbot, again, "slab", "timing")
    assert again.docks.docks["slab"].isFloating()
    qtbot.keyClick(again, Qt.Key.Key_3, ALT)
    shows(qtbot, again, next(spec.key for spec in PANELS if spec.workspace == "light"))
    again.docks.switch("capture")
    shows(qtbot, again, "depth")
    again.close()


def test_what_floated_on_a_screen_that_is_gone_comes_back(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    window = begin(qtbot, rig, path)
    press(qtbot, window.docks.docks["slab"], "float")
    window.docks.docks["slab"].move(FAR)
    window.move(FAR)
    qtbot.waitUntil(lambda: window.docks.docks["slab"].pos() == FAR)
    window.close()
    again = begin(qtbot, rig, path)
    qtbot.waitUntil(lambda: again.docks.docks["slab"].front)
    assert on_screen(again)
    assert on_screen(again.docks.docks["slab"])
    again.close()


def foreign_state() -> str:
    other = QMainWindow()
    kept = bytes(other.saveState(1).toBase64().data()).decode("ascii")
    other.deleteLater()
    return kept


@pytest.mark.parametrize("state", ["", "AAAA", "\u00fc%%%", "x" * 500, "foreign", "half"])
def test_a_layout_that_is_none_is_ignored(qtbot: QtBot, rig: Rig, tmp_path: Path, state: str) -> None:
    path = tmp_path / "window.json"
    if state == "half":
        window = begin(qtbot, rig, path)
        window.close()
        whole = json.loads(path.read_text())["layouts"]["gate"]
        state = whole[: len(whole) // 2]
    given = foreign_state() if state == "foreign" else state
    path.write_text(json.dumps({"layouts": {"gate": given, "garden": given}, "workspace": "garden"}))
    made = begin(qtbot, rig, path)
    assert made.docks.workspace == "gate"
    assert made.messages.text == ""
    shows(qtbot, made, "slab", "section")
    made.close()
    assert json.loads(path.read_text())["layouts"]["gate"] != given


@pytest.mark.parametrize(
    ("place", "wanted"),
    [
        (QRect(100, 100, 400, 300), QRect(100, 100, 400, 300)),
        (QRect(5000, -900, 400, 300), QRect(880, 40, 400, 300)),
        (QRect(-300, 700, 400, 300), QRect(0, 500, 400, 300)),
        (QRect(10, 10, 3000, 2000), QRect(0, 40, 1280, 760)),
        (QRect(1300, 90, 400, 300), QRect(1300, 90, 400, 300)),
        (QRect(1100, 90, 900, 700), QRect(1280, 0, 720, 600)),
    ],
)
def test_places_are_held_within_a_screen(place: QRect, wanted: QRect) -> None:
    screens = [QRect(0, 40, 1280, 760), QRect(1280, 0, 720, 600)]
    assert held(place, screens) == wanted


# What is hidden costs nothing


def drawn_gate(window: Window, key: str) -> object:
    """The gate that a plot shows."""
    panel = window.docks.docks[key].panel
    if isinstance(panel, SlabPanel):
        assert panel.view._gate is not None
        return panel.view._gate[1]
    assert isinstance(panel, SectionPanel | TimingPanel)
    return panel.view._settings


class Paints(QObject):
    """Sees what is painted inside panels."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint:
            above: QObject | None = watched
            while above is not None and not isinstance(above, PanelDock):
                above = above.parent()
            if above is not None:
                self.seen.append(f"{above.objectName()}: {type(watched).__name__}")
        return False


def is_painted(qtbot: QtBot, dock: PanelDock) -> None:
    """Wait until the panel paints what it is asked to paint anew."""
    paints = Paints()
    QApplication.instance().installEventFilter(paints)
    try:
        dock.panel.update()
        qtbot.waitUntil(lambda: any(seen.startswith(f"{dock.objectName()}:") for seen in paints.seen))
    finally:
        QApplication.instance().removeEventFilter(paints)


@contextmanager
def work_in_panels() -> Iterator[set[str]]:
    """The names of all functions of panels and their plots that are called, and what is painted there."""
    called: set[str] = set()
    plots = ("section_view", "slab_view", "gl_view", "gl_items", "slab_geometry", "timing_view")
    rooms = [os.sep + os.path.join("app", "panels") + os.sep]
    rooms += [os.sep + os.path.join("app", "views", f"{name}.py") for name in plots]
    paints = Paints()

    def note(frame: object, event: str, _: object) -> None:
        code = frame.f_code  # type: ignore[attr-defined]
        if event == "call" and any(room in code.co_filename for room in rooms):
            called.add(code.co_qualname)

    QApplication.instance().installEventFilter(paints)
    sys.setprofile(note)
    try:
        yield called
    finally:
        sys.setprofile(None)
        QApplication.instance().removeEventFilter(paints)
        called |= set(paints.seen)


def wait_for_frames(qtbot: QtBot, window: Window, count: int = 10) -> None:
    seen = window.session.stream.counters.made
    qtbot.waitUntil(lambda: window.session.stream.counters.made >= seen + count)
    taken = window.live.frame
    qtbot.waitUntil(lambda: window.live.frame is not None and window.live.frame is not taken)


def close_all(qtbot: QtBot, window: Window) -> None:
    """Make every panel, and close them all."""
    for spec in PANELS:
        assert window.docks.bring(spec.key) is not None
    window.docks.switch("gate")
    for dock in window.docks.docks.values():
        dock.close()
    qtbot.waitUntil(lambda: front(window) == set())
    qtbot.wait(100)


def test_panels_are_made_when_they_are_first_shown(qtbot: QtBot, window: Window) -> None:
    docks = window.docks.docks
    assert {key for key, dock in docks.items() if dock.panel is not None} == {"slab", "section"}
    click_tab(qtbot, window, "Search")
    shows(qtbot, window, "slab", "search")
    assert {key for key, dock in docks.items() if dock.panel is not None} == {"slab", "section", "search"}


def test_hidden_panels_do_nothing(qtbot: QtBot, window: Window) -> None:
    close_all(qtbot, window)
    with work_in_panels() as frames:
        wait_for_frames(qtbot, window, 30)
    assert frames == set()
    with work_in_panels() as changes:
        for preset in (1, 0, 1):
            window.session.use(window.session.source.presets[preset])
            wait_for_frames(qtbot, window)
    told = {name for name in changes if not name.endswith(("._on_any_change", "._on_source", "._on_changed", ".busy"))}
    assert told == set()
    running = [(key, timer) for key, dock in window.docks.docks.items() for timer in dock.findChildren(QTimer)]
    assert [key for key, timer in running if timer.isActive()] == []


def test_the_watch_for_work_sees_it(qtbot: QtBot, window: Window) -> None:
    """So that the test above can fail."""
    window.docks.bring("timing")
    with work_in_panels() as work:
        window.session.use(window.session.source.presets[1])
        qtbot.waitUntil(lambda: drawn_gate(window, "timing") == window.session.resolved.sent)
        wait_for_frames(qtbot, window)
    assert {"TimingView.show_gate", "timing: PlotWidget", "slab: GlView"} & work >= {"TimingView.show_gate"}
    assert any(name.startswith("timing: ") for name in work)


@pytest.mark.parametrize("away", ["closed", "behind", "elsewhere"])
def test_what_was_hidden_is_up_to_date_when_shown(qtbot: QtBot, window: Window, rig: Rig, away: str) -> None:
    plots = ("slab", "section", "timing")
    for key in plots:
        window.docks.bring(key)
    before = {key: drawn_gate(window, key) for key in plots}
    hide: dict[str, Callable[[], object]] = {
        "closed": lambda: [window.docks.docks[key].close() for key in plots],
        "behind": lambda: [
            window.docks.tabifyDockWidget(window.docks.docks["mask"], window.docks.docks["slab"]),
            window.docks.bring("mask"),
        ],
        "elsewhere": lambda: window.docks.switch("capture"),
    }
    hide[away]()
    qtbot.waitUntil(lambda: not front(window) & set(plots))
    window.session.adopt(make_source(rig))
    window.session.use(window.session.source.presets[1])
    wait_for_frames(qtbot, window)
    assert {key: drawn_gate(window, key) for key in plots} == before
    for key in plots:
        panel = window.docks.bring(key)
        assert panel is not None
        assert drawn_gate(window, key) == window.session.resolved.sent
        qtbot.waitUntil(lambda key=key: key in front(window))


def test_a_plan_of_slices_follows_when_it_is_shown(qtbot: QtBot, window: Window) -> None:
    panel = window.docks.bring("slices")
    assert isinstance(panel, CapturePanel)
    panel.plan.choose("delay")
    qtbot.waitUntil(lambda: not panel._settle.isActive())
    before = panel.note.text()
    window.docks.switch("gate")
    qtbot.waitUntil(lambda: not panel.isVisible())
    window.session.ask_wish(
        window.session.source.presets[1].settings.__class__(
            window.session.resolved.gate.line_time_us * 1.5, window.session.resolved.gate.delay_us, 400.0
        )
    )
    wait_for_frames(qtbot, window)
    assert panel.note.text() == before
    assert not panel._settle.isActive()
    window.docks.bring("slices")
    qtbot.waitUntil(lambda: panel.note.text() != before)


def test_a_hidden_histogram_is_not_counted(qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []
    real = histogram.sample_histogram
    monkeypatch.setattr(histogram, "sample_histogram", lambda *given: counted.append(1) or real(*given))
    window.live.levels.hide()
    wait_for_frames(qtbot, window, 30)
    assert counted == []
    window.live.levels.show()
    assert counted == [1]
    qtbot.waitUntil(lambda: len(counted) > 2)


# It fits


def fits_everywhere(qtbot: QtBot, window: Window) -> None:
    for theme in ("light", "dark"):
        window.set_theme(theme)
        for spec in PANELS:
            window.docks.bring(spec.key)
            qtbot.waitUntil(lambda key=spec.key: key in front(window))

            def all_has_room() -> None:
                assert complaints(window) == []

            qtbot.waitUntil(all_has_room)  # what has just been shown gets its room by events
    window.set_theme("light")


@pytest.mark.parametrize("size", [(1280, 800), (960, 500), (1920, 1080)])
def test_nothing_is_clipped_at(qtbot: QtBot, window: Window, size: tuple[int, int]) -> None:
    window.resize(*size)
    window.docks.reset()
    qtbot.waitUntil(lambda: (window.width(), window.height()) == size)
    fits_everywhere(qtbot, window)


INSIDE = "SLOPEGATE_TEST_FIRST_START"


@pytest.mark.skipif(INSIDE not in os.environ, reason="run on a screen of its own by the test below")
def test_the_first_start_fits_the_screen(qtbot: QtBot, rig: Rig, tmp_path: Path) -> None:
    window = begin(qtbot, rig, tmp_path / "window.json")
    ratio = window.screen().devicePixelRatio()
    assert (window.screen().size() * ratio).toTuple() == tuple(map(int, os.environ[INSIDE].split("x")))
    fits_everywhere(qtbot, window)
    assert window.live.view.width() > 0.4 * window.width()
    window.close()


@pytest.mark.parametrize(("screen", "scale"), [("1280x800", 1), ("1920x1080", 2), ("1366x768", 1)])
def test_a_first_start_on_another_screen(screen: str, scale: int) -> None:
    if shutil.which("xvfb-run") is None:
        pytest.skip("xvfb-run is not here (apt-get install xvfb)")
    kept = {name: value for name, value in os.environ.items() if name not in ("WAYLAND_DISPLAY", "DISPLAY")}
    given = {INSIDE: screen, "QT_QPA_PLATFORM": "xcb", "QT_SCALE_FACTOR": str(scale), "LIBGL_ALWAYS_SOFTWARE": "1"}
    test = f"{__file__}::{test_the_first_start_fits_the_screen.__name__}"
    command = [
        "xvfb-run",
        "-a",
        "-s",
        f"-screen 0 {screen}x24",
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
    ]
    done = subprocess.run(
        [*command, test], cwd=ROOT, env={**kept, **given}, capture_output=True, text=True, check=False, timeout=250
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert "1 passed" in done.stdout, done.stdout


# Colours


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_what_is_chosen_and_how_to_close_are_seen_in_each_theme(qtbot: QtBot, window: Window, theme: str) -> None:
    bar = window.findChild(QToolBar, "tools")
    for key in ("capture", "gate"):
        window.docks.switch(key)
        for name in (theme, "light", theme):
            window.set_theme(name)
        chosen = marked_button(QApplication.palette())
        for other, action in window.menus.workspaces.items():
            assert (bar.widgetForAction(action).palette().button().color() == chosen) == (other == key)
    shows(qtbot, window, "slab", "section")
    for name in ("float", "close"):
        button = window.docks.docks["slab"].findChild(QAbstractButton, f"qt_dockwidget_{name}button")
        picture = button.icon().pixmap(16, 16).toImage()
        drawn = [picture.pixelColor(x, y) for x in range(16) for y in range(16)]
        written = window.palette().windowText().color().lightness()
        assert any(one.alpha() > 200 and abs(one.lightness() - written) < 40 for one in drawn), name
    window.set_theme("light")
