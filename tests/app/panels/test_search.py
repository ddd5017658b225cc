"""The search panel in use: a target by mouse, a search beside the window's own work, its end, apply and restore."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from rigs import check_rig
from search_card import SearchCard, search_card
from slopegate.app.panels.panel import Desk
from slopegate.app.panels.search import SearchPanel
from slopegate.app.session.describe import outcome_text
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Intent, Session, intent_of
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.views.live_panel import LivePanel
from slopegate.core.rig.settings import gate
from slopegate.core.search.state import Outcome

LEFT = Qt.MouseButton.LeftButton
QUICK = Options(noise=True, rate_hz=math.inf)


@pytest.fixture(scope="module")
def card() -> SearchCard:
    return search_card(20.0, 0.9, rig=check_rig(480))


def make_source(card: SearchCard, options: Options = QUICK) -> Source:
    return build_source(Path("card.toml"), card.rig, card.scene, options, Progress(lambda share, text: None))


@pytest.fixture
def panel(qtbot: QtBot, card: SearchCard) -> Iterator[SearchPanel]:
    session = Session()
    live = LivePanel(session)
    made = SearchPanel(Desk(session, live))
    qtbot.addWidget(live)
    qtbot.addWidget(made)
    live.resize(640, 600)
    made.resize(540, 270)
    with qtbot.waitExposed(live), qtbot.waitExposed(made):
        live.show()
        made.show()
    with qtbot.waitSignal(live.first_image):
        session.adopt(make_source(card))
    made.test_parts = (session, live)  # type: ignore[attr-defined]
    yield made
    made.close()
    live.stop()
    live.close()
    session.close()


def parts(panel: SearchPanel) -> tuple[Session, LivePanel]:
    return panel.test_parts  # type: ignore[attr-defined, no-any-return]


def drag_target(qtbot: QtBot, panel: SearchPanel, card: SearchCard) -> None:
    x0, y0, x1, y1 = card.target
    qtbot.mouseClick(panel.choose, LEFT)
    assert panel.tool.active
    first, last = panel.tool.to_view(x0, y0).toPoint(), panel.tool.to_view(x1, y1).toPoint()
    qtbot.mousePress(panel.tool, LEFT, pos=first)
    move_pointer(qtbot, panel.tool, last)
    qtbot.mouseRelease(panel.tool, LEFT, pos=last)


def search(qtbot: QtBot, panel: SearchPanel) -> Outcome:
    with qtbot.waitSignal(panel.ended) as ended:
        qtbot.mouseClick(panel.start_button, LEFT)
    outcome = ended.args[0]
    assert isinstance(outcome, Outcome)
    return outcome


def at_first_step(panel: SearchPanel, act: Callable[[], None]) -> None:
    """In the midst of a search, however fast it is."""

    def once() -> None:
        panel.stepped.disconnect(connection)
        act()

    connection = panel.stepped.connect(once)


def test_a_dragged_target_is_found_applied_and_given_back(qtbot: QtBot, panel: SearchPanel, card: SearchCard) -> None:
    session, _ = parts(panel)
    before = session.intent
    drag_target(qtbot, panel, card)
    assert panel.target is not None
    assert max(abs(a - b) for a, b in zip(panel.target, card.target, strict=True)) <= 2
    assert not panel.choose.isChecked()
    states = []
    panel.stepped.connect(states.append)
    outcome = search(qtbot, panel)
    assert outcome.settings is not None
    assert card.overlap(outcome.settings) > 0.85
    assert session.resolved is not None
    assert session.resolved.sent == outcome.settings
    assert panel._desk.found == outcome.settings
    assert len(states) == outcome.frames
    assert panel.progress.value() == outcome.frames
    assert panel.layer.counts == (outcome.kept, outcome.keypoints - outcome.kept)
    assert "Found in" in panel.result.text()
    qtbot.mouseClick(panel.restore_button, LEFT)
    assert session.intent == before
    qtbot.mouseClick(panel.apply_button, LEFT)
    assert session.intent == Intent(outcome.settings)


def test_cancel_leaves_the_gate_from_before(qtbot: QtBot, panel: SearchPanel) -> None:
    session, _ = parts(panel)
    before = session.intent
    panel.method.setCurrentIndex(panel.method.findData("paper"))

    def cancel() -> None:
        assert panel.cancel_button.isEnabled()
        assert not panel.start_button.isEnabled()
        qtbot.mouseClick(panel.cancel_button, LEFT)

    at_first_step(panel, cancel)
    with qtbot.waitSignal(panel.ended) as ended:
        qtbot.mouseClick(panel.start_button, LEFT)
    assert ended.args[0].cause == "cancelled"
    assert session.intent == before
    assert panel.result.text().startswith("Cancelled after")
    assert panel.start_button.isEnabled()
    assert not panel.apply_button.isEnabled()


def test_the_gate_is_held_while_the_search_goes_on(qtbot: QtBot, panel: SearchPanel, card: SearchCard) -> None:
    session, _ = parts(panel)
    before = session.intent
    panel.method.setCurrentIndex(panel.method.findData("paper"))
    granted: list[bool] = []
    moved = Intent(gate(card.rig.camera.shutter.line.nearest(40.0), 1234.0, 777.0))

    def ask() -> None:
        granted.append(session.ask(moved))
        assert session.refusal == "The gate is held by the search: let it end, or end it there."
        panel.cancel()

    at_first_step(panel, ask)
    with qtbot.waitSignal(panel.ended):
        panel.start()
    assert granted == [False]
    assert session.intent == before
    assert session.held("program") is None
    assert session.ask(moved)


def test_another_scene_meanwhile_is_left_alone(qtbot: QtBot, panel: SearchPanel, card: SearchCard) -> None:
    session, _ = parts(panel)
    drag_target(qtbot, panel, card)
    other = make_source(card)
    at_first_step(panel, lambda: session.adopt(other))
    panel.start()
    qtbot.waitUntil(lambda: session.source is other and not panel.busy)  # cancelled, or its stream was gone before
    assert session.intent == intent_of(other.presets[0])
    assert (panel.target, panel.result.text(), panel.layer.counts) == (None, "", (0, 0))
    assert panel.start_button.isEnabled()


def test_too_few_keypoints_are_said_and_nothing_changes(qtbot: QtBot, panel: SearchPanel) -> None:
    session, _ = parts(panel)
    before = session.intent
    panel.set_target((0, 330, 30, 355))
    outcome = search(qtbot, panel)
    assert outcome.cause == "too few keypoints"
    assert "keypoints" in panel.result.text()
    assert session.intent == before


def test_a_tiny_target_is_refused_in_words(qtbot: QtBot, panel: SearchPanel) -> None:
    panel.set_target((10, 10, 14, 14))
    panel.start()
    assert not panel.busy
    assert "at least 16 pixels" in panel.result.text()


def test_closing_ends_a_search(qtbot: QtBot, panel: SearchPanel) -> None:
    with qtbot.waitSignal(panel.stepped):
        panel.start()
    panel.close()
    assert not panel.busy


def test_keypoints_are_drawn_only_while_the_panel_is_shown(qtbot: QtBot, panel: SearchPanel) -> None:
    assert panel.layer.isVisible()
    panel.hide()
    assert not panel.layer.isVisible()
    panel.show()
    assert panel.layer.isVisible()


def test_a_part_of_the_whole_image_is_shown_and_said_to_be_one(qtbot: QtBot, panel: SearchPanel) -> None:
    """The card stands before a wall that is as busy as the card: no gate of one of them shows both."""
    session, _ = parts(panel)
    before = session.intent
    outcome = search(qtbot, panel)
    assert (outcome.cause, outcome.found) == ("part", False)
    assert outcome.settings is not None
    told = f"Only a part of it, in {outcome.frames} frames. The gate shows {outcome.kept} of {outcome.keypoints} "
    assert panel.result.text().startswith(told)
    assert session.intent == Intent(outcome.settings)
    assert panel._desk.found == outcome.settings
    qtbot.mouseClick(panel.restore_button, LEFT)
    assert session.intent == before


def test_words_for_what_was_not_found() -> None:
    outcome = Outcome("not seen", "no clock shows it", None, None, None, 0, 50, 76)
    assert outcome_text(check_rig(640), outcome) == (
        "Not found in 76 frames, and the gate is the one from before: no clock shows it."
    )
