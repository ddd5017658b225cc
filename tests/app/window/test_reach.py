"""What everybody must be able to see and to find: contrast, focus, keys, full screen, about."""

from __future__ import annotations

from collections import Counter
from importlib.metadata import version
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, QRect, Qt, QTimer
from PySide6.QtGui import QColor, QContextMenuEvent, QGuiApplication, QPalette
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QMessageBox,
    QPushButton,
    QRadioButton,
    QSlider,
    QTabBar,
    QToolButton,
    QWidget,
)
from pytestqt.qtbot import QtBot

from slopegate.app.widgets import theme
from slopegate.app.widgets.checked import MarkWhenChecked
from slopegate.app.widgets.focus_ring import FocusRing
from slopegate.app.widgets.menus import Menu
from slopegate.app.widgets.own_keys import HasOwnKeys
from slopegate.app.widgets.signs import ToolBar
from slopegate.app.window.about import AboutDialog
from slopegate.app.window.asking import ask_sure
from slopegate.app.window.keys import KeysDialog, keys_of
from slopegate.app.window.window import Window

ROLES, GROUPS = QPalette.ColorRole, QPalette.ColorGroup
THEMES = pytest.mark.parametrize("name", ["light", "dark"])


def contrast(one: QColor, other: QColor) -> float:
    """Of WCAG 2, from 1 to 21."""

    def luminance(colour: QColor) -> float:
        parts = [(x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4) for x in colour.getRgbF()[:3]]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def pixels(widget: QWidget, place: QRect) -> Counter[int]:
    image, ratio = widget.grab().toImage(), widget.devicePixelRatioF()
    left, top = round(place.left() * ratio), round(place.top() * ratio)
    right, bottom = min(round((place.right() + 1) * ratio), image.width()), round((place.bottom() + 1) * ratio)
    return Counter(image.pixel(x, y) for y in range(top, min(bottom, image.height())) for x in range(left, right))


@pytest.fixture
def board(qtbot: QtBot) -> QWidget:
    made = QWidget()
    qtbot.addWidget(made)
    made.setLayout(QHBoxLayout())
    made.layout().setSpacing(12)
    return made


def shown(qtbot: QtBot, board: QWidget, *widgets: QWidget) -> None:
    for widget in widgets:
        board.layout().addWidget(widget)
    with qtbot.waitExposed(board):
        board.show()


@THEMES
def test_words_can_be_read_in_the_palette(qapp: QApplication, name: theme.Theme) -> None:
    theme.apply(qapp, name)
    palette = QApplication.palette()
    for ground in (ROLES.Window, ROLES.Base, ROLES.Button, ROLES.AlternateBase):
        under = palette.color(ground)
        for role in (ROLES.WindowText, ROLES.Text, ROLES.ButtonText, ROLES.BrightText, ROLES.Link):
            assert contrast(palette.color(role), under) >= 4.5, (ground, role)
        for role in (ROLES.WindowText, ROLES.Text, ROLES.ButtonText):
            assert contrast(palette.color(GROUPS.Disabled, role), under) >= 3.0, (ground, role)
    assert contrast(palette.color(ROLES.PlaceholderText), palette.color(ROLES.Base)) >= 4.5
    assert contrast(palette.color(ROLES.HighlightedText), palette.color(ROLES.Highlight)) >= 4.5
    assert contrast(palette.color(ROLES.ToolTipText), palette.color(ROLES.ToolTipBase)) >= 4.5
    scheme = theme.colours(palette)
    for tone in ("text", "muted", "camera", "projector", "slab", "surface", "warning", "error", "focus"):
        assert contrast(QColor(getattr(scheme, tone)), QColor(scheme.background)) >= 4.5, tone
    assert contrast(QColor(scheme.muted), QColor(scheme.grid)) >= 4.5  # said in place of an image


@THEMES
@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize(
    "kind", [QRadioButton, QCheckBox, QLineEdit, QDoubleSpinBox, QComboBox, QPushButton, QSlider, QListWidget]
)
def test_parts_stand_out_from_the_window(
    qtbot: QtBot, qapp: QApplication, board: QWidget, kind: type[QWidget], name: theme.Theme, enabled: bool
) -> None:
    theme.apply(qapp, name)
    widget = kind()
    widget.setEnabled(enabled)
    shown(qtbot, board, QLabel(), widget)
    ground = QApplication.palette().color(ROLES.Window)
    seen = pixels(board, widget.geometry())
    assert sum(count for rgb, count in seen.items() if contrast(QColor(rgb), ground) >= 3.0) >= 8


@THEMES
def test_what_a_choice_box_drops_can_be_read(
    qtbot: QtBot, qapp: QApplication, board: QWidget, name: theme.Theme
) -> None:
    theme.apply(qapp, name)
    box = QComboBox()
    box.addItems(["MMMM", "WWWW", "NNNN"])
    shown(qtbot, board, QLabel(), box)
    box.showPopup()
    qtbot.waitUntil(box.view().isVisible)
    seen = pixels(box.view(), box.view().visualRect(box.model().index(1, 0)))
    under = QColor(seen.most_common(1)[0][0])
    assert max(contrast(QColor(rgb), under) for rgb in seen) >= 4.5
    box.hidePopup()


@THEMES
def test_boxes_for_ticks_stand_out_in_menus(
    qtbot: QtBot, qapp: QApplication, board: QWidget, name: theme.Theme
) -> None:
    theme.apply(qapp, name)
    shown(qtbot, board, QLabel())
    menu = Menu("Menu", board)
    action = menu.addAction("A")
    action.setCheckable(True)
    with qtbot.waitExposed(menu):
        menu.popup(board.mapToGlobal(board.rect().center()))
    room = menu.actionGeometry(action)
    seen = pixels(menu, room.adjusted(0, 0, room.height() - room.width(), 0))
    under = QColor(seen.most_common(1)[0][0])
    assert sum(count for rgb, count in seen.items() if contrast(QColor(rgb), under) >= 2.5) >= 8
    menu.close()


@THEMES
def test_what_is_chosen_can_be_read(qtbot: QtBot, qapp: QApplication, board: QWidget, name: theme.Theme) -> None:
    theme.apply(qapp, name)
    button = QPushButton("MMMM")
    button.setCheckable(True)
    button.setChecked(True)
    MarkWhenChecked(button)
    shown(qtbot, board, QLabel(), button)
    seen = pixels(board, button.geometry().adjusted(6, 6, -6, -6))
    under = QColor(seen.most_common(1)[0][0])
    assert max(contrast(QColor(rgb), under) for rgb in seen) >= 4.5


@THEMES
def test_the_button_for_what_a_tool_bar_has_no_room_for_is_seen(
    qtbot: QtBot, qapp: QApplication, board: QWidget, name: theme.Theme
) -> None:
    theme.apply(qapp, name)
    bar = ToolBar("Tools")
    for _ in range(9):
        bar.addAction("MMMMMM")
    bar.setFixedWidth(200)
    shown(qtbot, board, bar)
    more = bar.findChild(QToolButton, "qt_toolbar_ext_button")
    assert more is not None
    qtbot.waitUntil(more.isVisible)
    seen = pixels(bar, more.geometry())
    under = QColor(seen.most_common(1)[0][0])
    assert sum(count for rgb, count in seen.items() if contrast(QColor(rgb), under) >= 3.0) >= 8


@THEMES
def test_every_kind_of_widget_shows_that_it_has_the_focus(
    qtbot: QtBot, qapp: QApplication, board: QWidget, name: theme.Theme
) -> None:
    theme.apply(qapp, name)
    FocusRing.on(qapp)
    tabs = QTabBar()
    tabs.addTab("One")
    listed = QListWidget()
    listed.setFixedSize(80, 60)
    kinds = [QPushButton("A"), QLineEdit(), QDoubleSpinBox(), QComboBox(), QSlider(), QCheckBox("B"), QRadioButton("C")]
    shown(qtbot, board, *kinds, tabs, listed)
    with qtbot.waitActive(board):
        board.activateWindow()
    ground = QApplication.palette().color(ROLES.Window)
    for widget in (*kinds, tabs, listed):
        board.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        board.setFocus()
        place = widget.geometry().adjusted(-3, -3, 3, 3)
        before = pixels(board, place)
        widget.setFocus(Qt.FocusReason.TabFocusReason)
        qtbot.waitUntil(widget.hasFocus)
        after = pixels(board, place)
        new = sum(max(after[rgb] - before[rgb], 0) for rgb in after if contrast(QColor(rgb), ground) >= 3.0)
        assert new >= 2 * (widget.width() + widget.height()), widget


@THEMES
def test_the_live_image_and_all_that_tab_reaches_show_the_focus(
    qtbot: QtBot, window: Window, name: theme.Theme
) -> None:
    window.set_theme(name)
    window.live.view.setFocus()
    ring = QColor(theme.colours(QApplication.palette()).focus).rgb()
    view = window.live.view
    qtbot.waitUntil(lambda: pixels(view, view.rect())[ring] > view.width())  # the theme comes by events
    reached: set[int] = set()
    while id(window.focusWidget()) not in reached:
        widget = window.focusWidget()
        reached.add(id(widget))
        found = [one for one in window.findChildren(QWidget) if type(one).__name__ == "_Ring" and one.isVisible()]
        assert len(found) == 1, widget
        assert found[0].width() >= min(widget.width(), 8), widget
        qtbot.keyClick(widget, Qt.Key.Key_Tab)
    assert len(reached) > 15


def test_the_list_of_keys_is_read_from_what_understands_them(qtbot: QtBot, window: Window) -> None:
    window.docks.bring("slab")
    listed = keys_of(window)
    keys = {one.keys for one in listed}
    for menu in window.menuBar().actions():
        for action in menu.menu().actions():
            if not action.shortcut().isEmpty():
                assert action.shortcut().toString() in keys
    assert {"F1", "F6", "F7", "F8", "F9", "F11", "F12", "Alt+B", "Ctrl+1"} <= keys
    views = [one for one in window.findChildren(QWidget) if isinstance(one, HasOwnKeys)]
    assert window.live.view in views
    for view in views:
        for one in view.own_keys():
            assert any(found.keys == one.shown and view.accessibleName() in found.where for found in listed)
    assert all(one.does for one in listed)


def test_keys_are_found_by_what_they_do(qtbot: QtBot, window: Window) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F1)
    dialog = window.findChild(KeysDialog)
    assert dialog is not None
    qtbot.keyClicks(dialog.wanted, "saturated")
    left = [
        group.child(row).text(0)
        for group in dialog.groups
        for row in range(group.childCount())
        if not group.child(row).isHidden()
    ]
    assert "F9" in left
    assert "Ctrl+Q" not in left
    dialog.close()


def test_there_is_one_list_of_keys_however_often_it_is_asked_for(qtbot: QtBot, window: Window) -> None:
    for _ in range(3):
        KeysDialog.show_of(window)  # with no turn of the event loop between, as for keys that are held
    assert sum(dialog.isVisible() for dialog in window.findChildren(KeysDialog)) == 1


def test_a_question_shows_names_as_they_are_written(qtbot: QtBot, board: QWidget) -> None:
    formats: list[Qt.TextFormat] = []

    def look() -> None:
        box = QApplication.activeModalWidget()
        if not isinstance(box, QMessageBox):
            QTimer.singleShot(10, look)
            return
        text = box.findChild(QLabel, "qt_msgbox_label")
        assert text is not None
        formats.append(text.textFormat())
        box.button(QMessageBox.StandardButton.Yes).click()

    shown(qtbot, board)
    QTimer.singleShot(0, look)
    assert ask_sure(board, "My gates", "Forget the gate '<b>wall</b>'?")
    assert formats == [Qt.TextFormat.PlainText]


def test_full_screen_by_its_key_and_out_by_escape(qtbot: QtBot, window: Window) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F11)
    qtbot.waitUntil(window.isFullScreen)
    assert window.menus.full_screen.isChecked()
    window.messages.say("A message")
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert window.isFullScreen()
    assert not window.messages.isVisible()
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: not window.isFullScreen())
    assert not window.menus.full_screen.isChecked()


def test_about_says_what_it_is_and_where_things_are(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    help_menu = window.menuBar().actions()[-1].menu()
    next(action for action in help_menu.actions() if "About" in action.text()).trigger()
    dialog = window.findChild(AboutDialog)
    assert dialog is not None
    dialog.copy()
    told = QGuiApplication.clipboard().text()
    for part in (version("slopegate"), "Apache-2.0", str(tmp_path / "config"), "numpy", "Log", "Cache"):
        assert part in told
    dialog.close()


def test_pictures_of_plots_are_copied_and_saved_by_their_menu(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    panel = window.docks.bring("section")
    view = panel.view
    qtbot.waitUntil(lambda: view.isVisible() and view.width() > 100)
    event = QContextMenuEvent(QContextMenuEvent.Reason.Keyboard, QPoint(5, 5), view.mapToGlobal(QPoint(5, 5)))
    QApplication.sendEvent(view, event)
    qtbot.waitUntil(panel.menu.menu.isVisible)
    texts = [action.text() for action in panel.menu.menu.actions() if action.text()]
    assert texts == ["Fit", "&Copy picture", "&Save picture ..."]
    panel.menu.menu.close()
    panel.menu.copy()
    assert QGuiApplication.clipboard().image().size() == view.size() * view.devicePixelRatioF()
    panel.menu.save(tmp_path / "section.png")
    assert (tmp_path / "section.png").stat().st_size > 1000
    panel.menu.save(tmp_path / "nowhere" / "section.png")
    assert "nowhere" in window.messages.text
