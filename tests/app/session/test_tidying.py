"""What only holds itself is freed some time after another scene has come."""

from __future__ import annotations

import gc
import weakref

import pytest
from pytestqt.qtbot import QtBot

from slopegate.app.session import tidying
from slopegate.app.session.session import Session
from slopegate.app.session.tidying import Tidying
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


def test_giving_back_memory_works_on_every_system() -> None:
    tidying.give_back()
