"""Undo and redo of gates: what is one step, what is kept, and what begins anew."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from slopegate.app.session.history import MOST, ONE_STEP_S, GateHistory
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import PlaneWish, Session
from slopegate.app.session.source import Options, Source, build_source
from slopegate.core.rig.rig import Rig
from small_window import make_source


@dataclass
class Hand:
    now_s: float = 0.0
    down: bool = False


@pytest.fixture
def hand() -> Hand:
    return Hand()


@pytest.fixture
def session(qapp: object, source: Source) -> Iterator[Session]:
    made = Session()
    made.adopt(source)
    yield made
    made.close()


@pytest.fixture
def history(session: Session, hand: Hand) -> GateHistory:
    made = GateHistory(session, session, lambda: hand.now_s, lambda: hand.down)
    assert session.ask_wish(PlaneWish(0.0, 1.0, 0.1))
    hand.now_s += 10 * ONE_STEP_S
    return made


def set_distance(session: Session, hand: Hand, distance_m: float) -> None:
    assert session.ask_wish(PlaneWish(0.0, distance_m, 0.1))
    hand.now_s += 10 * ONE_STEP_S


def distance(session: Session) -> float:
    assert session.intent is not None
    assert isinstance(session.intent.wish, PlaneWish)
    return session.intent.wish.distance_m


def test_each_way_back_and_forth(session: Session, history: GateHistory, hand: Hand) -> None:
    set_distance(session, hand, 1.2)
    assert session.ask_complement(True)
    hand.now_s += 10 * ONE_STEP_S
    set_distance(session, hand, 1.4)
    history.undo()
    assert (distance(session), session.intent.complement) == (1.2, True)
    history.undo()
    assert (distance(session), session.intent.complement) == (1.2, False)
    history.redo()
    assert session.intent.complement
    set_distance(session, hand, 1.6)
    assert not history.can_redo
    history.undo()
    history.undo()
    history.undo()
    assert distance(session) == 1.0


def test_a_drag_is_one_step_however_long_it_rests(session: Session, history: GateHistory, hand: Hand) -> None:
    set_distance(session, hand, 1.1)
    hand.down = True
    for place in range(20):
        set_distance(session, hand, 1.2 + place / 100)
    hand.down = False
    history._look()
    set_distance(session, hand, 2.0)
    history.undo()
    assert distance(session) == pytest.approx(1.39)
    history.undo()
    assert distance(session) == 1.1


def test_a_key_that_is_held_down_is_one_step(session: Session, history: GateHistory, hand: Hand) -> None:
    for place in range(10):
        assert session.ask_wish(PlaneWish(0.0, 1.2 + place / 100, 0.1))
        hand.now_s += ONE_STEP_S / 3
    history.undo()
    assert distance(session) == 1.0


def test_the_oldest_steps_are_forgotten(session: Session, history: GateHistory, hand: Hand) -> None:
    for place in range(MOST + 50):
        set_distance(session, hand, 1.0 + (place + 1) / 1000)
    count = 0
    while history.can_undo:
        history.undo()
        count += 1
    assert count == MOST - 1


def test_a_gate_that_is_held_stays(session: Session, history: GateHistory, hand: Hand) -> None:
    set_distance(session, hand, 1.2)
    hold = session.hold("the capture")
    hold.begin("gate")
    history.undo()
    assert distance(session) == 1.2
    hold.end()
    history.undo()
    assert distance(session) == 1.0


def test_other_options_keep_the_steps_and_another_scene_does_not(
    session: Session, history: GateHistory, hand: Hand, rig: Rig
) -> None:
    set_distance(session, hand, 1.2)
    source = session.source
    quick = Options(noise=True, rate_hz=math.inf)
    again = build_source(source.where, rig, source.scene, quick, Progress(lambda share, text: None))
    session.adopt(again, session.intent)
    assert history.can_undo
    session.adopt(make_source(rig), session.intent)
    assert not history.can_undo
