"""The projector's window and dialog on a second virtual screen, its pixels read back from the X server's memory."""

from __future__ import annotations

import itertools
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import QRect, Qt
from PySide6.QtGui import QGuiApplication, QScreen
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QMessageBox, QWidget
from pytestqt.qtbot import QtBot

import two_screens
from slopegate.app.devices import projector_window
from slopegate.app.devices.projector_dialog import ONE_SCREEN, ProjectorDialog
from slopegate.app.devices.projector_memory import ProjectorChoice
from slopegate.app.devices.projector_screens import ScreenFacts, facts, objections
from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector
from slopegate.app.session.preferences import load
from slopegate.app.widgets.number_box import NumberBox
from slopegate.app.window.window import Window
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.patterns import KINDS, Raster, checkerboard, one_line
from slopegate.core.rig.rig import Lens, RigProjector
from slopegate.drivers.contract.projector import ProjectorError, Showing
from slopegate.drivers.files.images import save_image
from two_screens import CONTROL, PROJECTOR, Screens, screen_pixels

HERE = str(Path(__file__))
RASTER = Raster(1280, 720)
RIGS = RigProjector(Lens(1280, 720, 1000, 1000, 640, 360), 16666.7)
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first tests of this file")
unscaled = pytest.mark.skipif(os.environ.get("QT_SCALE_FACTOR", "1.0") != "1.0", reason="needs to be tried once only")


def passed(said: str) -> int:
    found = re.search(r"(\d+) passed", said)
    assert found, said
    return int(found[1])


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert passed(two_screens.run_inside(HERE)) >= 25


@pytest.mark.timeout(900)
@pytest.mark.parametrize("scale", [1.5, *(pytest.param(scale, marks=pytest.mark.slow) for scale in (1.25, 2.0))])
def test_pixels_are_exact_on_a_scaled_desktop(scale: float) -> None:
    assert passed(two_screens.run_inside(HERE, "-k", "bit_by_bit", scale=scale)) == 4


@pytest.fixture
def screens() -> Iterator[Screens]:
    made = Screens.here()
    yield made
    if PROJECTOR[0] not in [screen.name() for screen in QGuiApplication.screens()]:
        made.add(*PROJECTOR)
    made.close()


@pytest.fixture
def projector_screen() -> QScreen:
    return next(screen for screen in QGuiApplication.screens() if screen.name() == PROJECTOR[0])


@pytest.fixture
def projector(qapp: object) -> Iterator[ProjectorWindow]:
    made = ProjectorWindow()
    yield made
    made.uncover()
    made.close()


@pytest.fixture
def control(qtbot: QtBot) -> QWidget:
    """Stands for the program's window."""
    made = QWidget()
    qtbot.addWidget(made)
    made.setGeometry(0, 0, 1200, 780)
    made.show()
    return made


@pytest.fixture
def dialog(qtbot: QtBot, projector: ProjectorWindow, control: QWidget, tmp_path: Path) -> ProjectorDialog:
    made = ProjectorDialog(projector, RIGS, tmp_path / "projector.json", control)
    with qtbot.waitExposed(made):
        made.show()
    return made


def opened(window: Window) -> ProjectorDialog:
    """The dialog of the real window, with the keyboard."""
    QTest.keyClick(window, Qt.Key.Key_J, Qt.KeyboardModifier.ControlModifier)
    return next(child for child in window.children() if isinstance(child, ProjectorDialog))


def seen(qtbot: QtBot, picture: Bytes) -> None:
    """The projector's screen shows this picture, and nothing else, bit by bit."""
    colour = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    qtbot.waitUntil(lambda: np.array_equal(screen_pixels(PROJECTOR), colour))


def is_dark() -> bool:
    """Nothing is on it: without a desktop the X server keeps black there, but for its pointer in the middle."""
    pixels = screen_pixels(PROJECTOR).copy()
    pixels[350:430, 30:110] = 0
    return not pixels.any()


def dark(qtbot: QtBot) -> None:
    """Nothing is left of it."""
    qtbot.waitUntil(is_dark)


def lit(qtbot: QtBot) -> None:
    """Something is on it."""
    qtbot.waitUntil(lambda: not is_dark())


def covering() -> list[ProjectorWindow]:
    windows = QGuiApplication.topLevelWindows()
    return [window for window in windows if isinstance(window, ProjectorWindow) and window.isVisible()]


def choose(box: QComboBox, data: str) -> None:
    """With the keyboard, as a user does."""
    box.setFocus()
    wanted = box.findData(data)
    while box.currentIndex() != wanted:
        QTest.keyClick(box, Qt.Key.Key_Down if wanted > box.currentIndex() else Qt.Key.Key_Up)


def type_in(box: NumberBox, number: int) -> None:
    box.setFocus()
    box.selectAll()
    QTest.keyClicks(box, str(number))


def press(dialog: ProjectorDialog) -> None:
    QTest.mouseClick(dialog.toggle, Qt.MouseButton.LeftButton)


def beside(task: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=task)
    thread.start()
    return thread


@needs_two_screens
@pytest.mark.parametrize("kind", ["noise", "colour noise", "checkerboard", "row"])
def test_a_pattern_is_shown_bit_by_bit(
    qtbot: QtBot, projector: ProjectorWindow, projector_screen: QScreen, kind: str
) -> None:
    random = np.random.default_rng(5)
    picture = {
        "noise": random.integers(0, 256, (720, 1280), dtype=np.uint8),
        "colour noise": random.integers(0, 256, (720, 1280, 3), dtype=np.uint8),
        "checkerboard": checkerboard(RASTER, 1),
        "row": one_line(RASTER, "rows", 719),
    }[kind]
    before = screen_pixels(CONTROL)
    projector.load([picture])
    projector.display(0)
    projector.cover(projector_screen)
    seen(qtbot, picture)
    assert np.array_equal(screen_pixels(CONTROL), before)


@needs_two_screens
@unscaled
def test_every_kind_of_pattern_reaches_the_screen(
    qtbot: QtBot, projector: ProjectorWindow, projector_screen: QScreen
) -> None:
    pictures = [kind.draw(RASTER, kind.number.usual(RASTER) if kind.number else 0) for kind in KINDS]
    projector.load(pictures)
    projector.cover(projector_screen)
    for index, picture in enumerate(pictures):
        projector.display(index)
        seen(qtbot, picture)


@needs_two_screens
@unscaled
def test_the_contract_from_another_thread(
    qtbot: QtBot, projector: ProjectorWindow, projector_screen: QScreen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each pattern was on the screen before `show` returned, and is certain only after the settle count."""
    monkeypatch.setattr(projector_window, "DRAW_TIMEOUT_S", 60.0)
    random = np.random.default_rng(6)
    pictures = [random.integers(0, 256, (720, 1280), dtype=np.uint8) for _ in range(5)]
    projector.cover(projector_screen)
    driver = ScreenProjector(projector, settle_frames=4)
    assert (driver.info.name, driver.info.raster) == ("HDMI-1", RASTER)
    shown: list[Showing] = []
    problems: list[str] = []

    def arrives(wanted: NDArray[np.uint8] | int) -> bool:
        """The X server may still be copying."""
        end = time.monotonic() + 20
        while not (screen_pixels(PROJECTOR)[..., 0] == wanted).all() and time.monotonic() < end:
            time.sleep(0.002)
        return time.monotonic() < end

    def work() -> None:
        driver.load(pictures)
        for index in (3, 0, 4, 1, 2, 2):
            asked_s = time.monotonic()
            showing = driver.show(index)
            returned_s = time.monotonic()
            if not arrives(pictures[index]) or not asked_s <= showing.drawn_s <= returned_s:
                problems.append(f"pattern {index}")
            shown.append(showing)
        for flood, level in ((driver.black, 0), (driver.white, 255)):
            shown.append(flood())
            if not arrives(level):
                problems.append(f"level {level}")
        driver.stop()

    thread = beside(work)
    qtbot.waitUntil(lambda: not thread.is_alive(), timeout=100_000)
    assert problems == []
    assert [showing.index for showing in shown] == [3, 0, 4, 1, 2, 2, -1, -1]
    for showing in shown:
        assert showing.certain_from_s - showing.drawn_s == pytest.approx(4 / 60, rel=0.01)
    for one, following in itertools.pairwise(shown):
        assert one.drawn_s < following.drawn_s
    qtbot.waitUntil(lambda: projector.covers is None)
    dark(qtbot)


@needs_two_screens
@unscaled
def test_the_contract_refuses_in_sentences(
    qtbot: QtBot,
    projector: ProjectorWindow,
    projector_screen: QScreen,
    screens: Screens,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(projector_window, "DRAW_TIMEOUT_S", 25.0)
    with pytest.raises(ProjectorError, match="No screen is chosen for the projector"):
        ScreenProjector(projector, 3)
    projector.cover(projector_screen)
    driver = ScreenProjector(projector, 3)
    with pytest.raises(ProjectorError, match="Pattern 1 has 640 x 480 pixels and the projector has 1280 x 720"):
        driver.load([checkerboard(RASTER, 8), checkerboard(Raster(640, 480), 8)])
    with pytest.raises(IndexError, match="pattern 0 was not loaded"):
        driver.show(0)
    driver.load([checkerboard(RASTER, 8)])
    with pytest.raises(RuntimeError, match="cannot wait for its own drawing"):
        driver.show(0)
    answers: list[object] = []

    def work() -> None:
        try:
            answers.append(driver.show(0))
        except ProjectorError as error:
            answers.append(str(error))

    def ask() -> object:
        thread = beside(work)
        qtbot.waitUntil(lambda: not thread.is_alive())
        return answers.pop()

    assert isinstance(ask(), Showing)
    projector.load([checkerboard(RASTER, 16)])
    assert ask() == "Something else was put on HDMI-1 meanwhile"
    screens.remove("HDMI-1")
    qtbot.waitUntil(lambda: projector.covers is None)
    assert ask() == "HDMI-1 is not covered any more: nothing can be shown on it"


@needs_two_screens
@unscaled
def test_from_the_menu_to_the_wall_and_back(qtbot: QtBot, window: Window, screens: Screens) -> None:
    window.resize(1200, 780)
    window.move(0, 0)
    dialog = opened(window)
    assert dialog.screens.currentData() == "HDMI-1"
    assert "HDMI-1: 1280 x 720, 60.00 Hz" in dialog.screens.currentText()
    assert dialog.warnings.isHidden()
    choose(dialog.pattern.kinds, "row")
    assert dialog.pattern.number.value() == 360
    press(dialog)
    seen(qtbot, one_line(RASTER, "rows", 360))
    assert dialog.toggle.text() == "&Hide"
    settled = "One row is on HDMI-1. Hide ends it, or Escape there."
    qtbot.waitUntil(lambda: dialog.status.text() == settled)
    QTest.keyClick(dialog.pattern.number, Qt.Key.Key_Up)
    seen(qtbot, one_line(RASTER, "rows", 361))
    type_in(dialog.pattern.number, 719)
    seen(qtbot, one_line(RASTER, "rows", 719))
    QTest.keyClick(dialog.pattern.number, Qt.Key.Key_Return)
    choose(dialog.pattern.kinds, "checkerboard")
    type_in(dialog.pattern.number, 7)
    seen(qtbot, checkerboard(RASTER, 7))
    press(dialog)
    dark(qtbot)
    assert (dialog.toggle.text(), dialog.status.text()) == ("&Show", "")
    press(dialog)
    seen(qtbot, checkerboard(RASTER, 7))
    dialog.close()
    assert not is_dark()
    screens.remove("HDMI-1")
    qtbot.waitUntil(lambda: window.messages.text == "HDMI-1 was unplugged: nothing is projected any more.")
    screens.add(*PROJECTOR)
    qtbot.waitUntil(lambda: len(QGuiApplication.screens()) == 2)
    assert opened(window).isVisible()
    press(dialog)
    seen(qtbot, checkerboard(RASTER, 7))
    window.close()
    dark(qtbot)


@needs_two_screens
@unscaled
def test_the_dialog_keeps_the_keys_and_escape_on_the_projector_hides_it(qtbot: QtBot, dialog: ProjectorDialog) -> None:
    with qtbot.waitActive(dialog):
        dialog.activateWindow()
    press(dialog)
    lit(qtbot)
    qtbot.wait(200)
    assert dialog.isActiveWindow()
    (shown,) = covering()
    QTest.keyClick(shown, Qt.Key.Key_Escape)
    dark(qtbot)
    assert dialog.toggle.text() == "&Show"
    # and it can be shown again, also after it was closed like any other window
    press(dialog)
    lit(qtbot)
    shown.close()
    dark(qtbot)
    press(dialog)
    lit(qtbot)


@needs_two_screens
@unscaled
def test_a_cable_pulled_ten_times(qtbot: QtBot, dialog: ProjectorDialog, control: QWidget, screens: Screens) -> None:
    """The pattern never lands on the control window; nothing comes back by itself but the screen in the list."""
    for _ in range(10):
        assert dialog.screens.currentData() == "HDMI-1"
        press(dialog)
        qtbot.waitUntil(lambda: dialog.toggle.text() == "&Hide")
        screens.remove("HDMI-1")
        qtbot.waitUntil(lambda: dialog.toggle.text() == "&Show")
        assert dialog.status.text() == "HDMI-1 was unplugged: nothing is projected any more."
        qtbot.waitUntil(lambda: not dialog.toggle.isEnabled())
        assert ONE_SCREEN in dialog.warnings.text()
        assert covering() == []
        screens.add(*PROJECTOR)
        qtbot.waitUntil(dialog.toggle.isEnabled)
        assert dialog.warnings.isHidden()
    assert control.isVisible()


@needs_two_screens
@unscaled
def test_a_screen_that_changes_its_mode_shows_nothing(
    qtbot: QtBot, dialog: ProjectorDialog, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Qt's notice of it is imitated: RandR's monitors go and come, but never change."""
    press(dialog)
    lit(qtbot)
    smaller = replace(facts(dialog.screen_chosen), width_px=1024, height_px=600)
    monkeypatch.setattr(projector_window, "facts", lambda screen: smaller)
    dialog.screen_chosen.geometryChanged.emit(QRect(1280, 60, 1024, 600))
    dark(qtbot)
    assert dialog.status.text() == "HDMI-1 changed from 1280 x 720 to 1024 x 600 pixels: nothing is projected now."


@needs_two_screens
@unscaled
def test_a_screen_of_another_size_is_said_and_filled(qtbot: QtBot, dialog: ProjectorDialog, screens: Screens) -> None:
    screens.remove("HDMI-1")
    qtbot.waitUntil(lambda: not dialog.toggle.isEnabled())
    screens.add("HDMI-2", 1280, 60, 1024, 600)
    qtbot.waitUntil(dialog.toggle.isEnabled)
    assert "HDMI-2 has 1024 x 600 pixels and the rig's projector 1280 x 720" in dialog.warnings.text()
    choose(dialog.pattern.kinds, "checkerboard")
    press(dialog)
    wanted = np.zeros((720, 1280), np.uint8)
    wanted[:600, :1024] = checkerboard(Raster(1024, 600), 40)
    seen(qtbot, wanted)
    screens.remove("HDMI-2")
    qtbot.waitUntil(lambda: dialog.toggle.text() == "&Show")


@needs_two_screens
@unscaled
def test_the_control_windows_screen_is_covered_only_when_allowed(qtbot: QtBot, dialog: ProjectorDialog) -> None:
    choose(dialog.pattern.kinds, "white")
    choose(dialog.screens, "control")
    assert "(this window)" in dialog.screens.currentText()
    dialog.screens.activated.emit(dialog.screens.currentIndex())

    def answer(key: Qt.Key) -> None:
        press(dialog)
        (box,) = [child for child in dialog.findChildren(QMessageBox) if child.isVisible()]
        assert "the pattern covers it until you press Escape" in box.text()
        assert not (screen_pixels(CONTROL) == 255).all()
        QTest.keyClick(box, key)
        qtbot.waitUntil(lambda: dialog.findChildren(QMessageBox) == [])

    answer(Qt.Key.Key_Return)
    assert dialog.toggle.text() == "&Show"
    answer(Qt.Key.Key_Y)
    qtbot.waitUntil(lambda: bool((screen_pixels(CONTROL) == 255).all()))
    (shown,) = covering()
    qtbot.waitUntil(lambda: QGuiApplication.focusWindow() is shown)
    QTest.keyClick(shown, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: not (screen_pixels(CONTROL) == 255).all())


@needs_two_screens
@unscaled
def test_a_picture_file_of_the_right_size_only(qtbot: QtBot, dialog: ProjectorDialog, tmp_path: Path) -> None:
    picture = np.random.default_rng(8).integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    save_image(tmp_path / "good.png", picture)
    save_image(tmp_path / "big.png", np.full((768, 1024), 255, np.uint8))
    choose(dialog.pattern.kinds, "file")
    press(dialog)
    assert dialog.status.text() == "Choose a picture file."
    dark(qtbot)

    def name(path: Path) -> None:
        dialog.pattern.file.setFocus()
        dialog.pattern.file.selectAll()
        QTest.keyClicks(dialog.pattern.file, str(path))
        QTest.keyClick(dialog.pattern.file, Qt.Key.Key_Return)

    name(tmp_path / "good.png")
    press(dialog)
    seen(qtbot, picture)
    name(tmp_path / "big.png")
    qtbot.waitUntil(lambda: "big.png has 1024 x 768 pixels and the projector has 1280 x 720" in dialog.status.text())
    seen(qtbot, picture)


@needs_two_screens
@unscaled
def test_the_choice_is_remembered(qtbot: QtBot, control: QWidget, dialog: ProjectorDialog, tmp_path: Path) -> None:
    choose(dialog.pattern.kinds, "column")
    type_in(dialog.pattern.number, 17)
    type_in(dialog.settle, 5)
    assert dialog.settle.text() == "5 frames (83 ms)"
    type_in(dialog.settle, 60)
    asked_s = time.monotonic()
    press(dialog)
    assert dialog.status.text() == "One column is on its way to HDMI-1 ..."
    qtbot.waitUntil(lambda: dialog.status.text().startswith("One column is on HDMI-1."))
    assert time.monotonic() - asked_s > 0.9  # of 60 frames, a second
    type_in(dialog.settle, 5)
    path = tmp_path / "projector.json"
    assert load(path, ProjectorChoice, "the projector")[0].numbers == {"column": 17}
    shown = ProjectorWindow()
    again = ProjectorDialog(shown, RIGS, path, control)
    qtbot.addWidget(again)
    assert (again.pattern.kinds.currentText(), again.pattern.number.value()) == ("One column", 17)
    assert again.settle.value() == 5


@pytest.mark.skipif(two_screens.inside(), reason="needs one screen")
def test_with_one_screen_a_second_is_asked_for(qtbot: QtBot, window: Window) -> None:
    if len(QGuiApplication.screens()) > 1:
        pytest.skip("there is a second screen here")
    dialog = opened(window)
    assert ONE_SCREEN in dialog.warnings.text()
    assert not dialog.toggle.isEnabled()
    assert dialog.toggle.toolTip() == ONE_SCREEN
    # a key in a field presses nothing
    QTest.keyClick(dialog.pattern.number, Qt.Key.Key_Return)
    assert dialog.isVisible()


GOOD = ScreenFacts("HDMI-1", 1920, 0, 1280, 720, 1.0, 60.0)
LAPTOP = ScreenFacts("eDP-1", 0, 0, 1920, 1200, 1.25, 60.01)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, ()),
        ({"rate_hz": 60.02}, ()),
        ({"x": 0}, ("HDMI-1 shows the same as another screen",)),
        ({"scale": 1.5}, ("HDMI-1 is scaled to 150 %: set it to 100 %",)),
        ({"width_px": 1920, "height_px": 1080}, ("HDMI-1 has 1920 x 1080 pixels and the rig's projector 1280 x 720",)),
        ({"rate_hz": 59.94}, ("HDMI-1 refreshes at 59.940 Hz and the rig's projector at 60.000 Hz",)),
        ({"rate_hz": 59.94, "scale": 2.0}, ("HDMI-1 is scaled to 200 %", "write period_us = 16683.4 into")),
    ],
)
def test_what_speaks_against_a_screen(changed: dict[str, float], said: tuple[str, ...]) -> None:
    screen = ScreenFacts(**{**vars(GOOD), **changed})  # type: ignore[arg-type]
    sentences = list(objections(screen, [LAPTOP], RIGS))
    assert len(sentences) == len(said)
    for sentence, part in zip(sentences, said, strict=True):
        assert part in sentence


@pytest.mark.parametrize(
    ("text", "notice"),
    [
        ("{", "cannot be used"),
        ('{"settle_frames": 0}', "it must be at least 1"),
        ('{"pattern": "spots", "screen": "DP-2"}', ""),
    ],
)
def test_a_damaged_memory_is_no_obstacle(tmp_path: Path, text: str, notice: str) -> None:
    path = tmp_path / "projector.json"
    path.write_text(text)
    choice, said = load(path, ProjectorChoice, "the projector")
    assert notice in said
    assert bool(said) == bool(notice)
    assert choice == ProjectorChoice(screen="" if notice else "DP-2")
