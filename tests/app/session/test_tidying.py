"""What only holds itself is freed some time after another scene has come."""

from __future__ import annotations

import gc
import weakref

import pytest
from PySide6.QtCore import QTimer
from pytestqt.qtbot import QtBot

from slopegate.app.session import tidying
from slopegate.app.session.session import Session
from slopegate.app.session.tidying import Tidying, Unsearched
from slopegate.core.rig.rig import Rig
from small_window import make_source


class _Ring:
    """Holds itself."""

    def __init__(self) -> None:
        self.itself = self


def test_rings_are_freed_after_another_scene_and_memory_is_given_back(
    qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[bool] = []
    monkeypatch.setattr(tidying, "AFTER_MS", 1)
    monkeypatch.setattr(tidying, "give_back", lambda: given.append(True))
    session = Session()
    kept = Tidying(session, session)
    session.adopt(make_source(rig))
    gc.disable()
    try:
        ring = _Ring()
        alive = weakref.ref(ring)
        del ring
        session.adopt(make_source(rig))
        qtbot.waitUntil(lambda: alive() is None)
        qtbot.waitUntil(lambda: given == [True])
    finally:
        gc.enable()
    assert kept.parent() is session
    session.close()


def test_the_first_scene_is_not_searched_for_what_came_before_it(
    qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tidying, "AFTER_MS", 0)
    session, calls = Session(), list[str]()
    monkeypatch.setattr(tidying, "tidy", lambda: calls.append("tidy"))
    kept = Tidying(session, session)
    session.adopt(make_source(rig))
    QTimer.singleShot(20, lambda: calls.append("later"))
    qtbot.waitUntil(lambda: bool(calls))
    assert calls == ["later"]
    assert kept.parent() is session
    session.close()


def test_nothing_is_searched_until_the_last_start_has_ended() -> None:
    assert gc.isenabled()
    first, second = Unsearched(), Unsearched()
    first.end()
    first.end()
    assert not gc.isenabled()
    second.end_of_start()
    assert gc.isenabled()
    assert gc.get_freeze_count()


def test_giving_back_memory_works_on_every_system() -> None:
    tidying.give_back()
