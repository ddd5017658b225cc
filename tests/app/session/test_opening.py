"""What is asked for before there is a picture: whatever comes of it, there is one in the end."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from rigs import check_rig
from slopegate.app.session import opening
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.app.session.opening import Opener
from slopegate.app.session.session import Session
from slopegate.app.session.source import Options, Source
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.errors import SceneError
from small_window import make_source

BAD = Path("bad.toml")


class _Slow:
    """Opens every scene but the bad one; not before it may, and it counts how often it began."""

    def __init__(self) -> None:
        self.begun: list[tuple[str, Rig]] = []
        self.may = threading.Event()

    def open_source(self, where: Path, rig: Rig, options: Options, progress: Progress) -> Source:
        self.begun.append((where.name, rig))
        if where == BAD:
            raise SceneError("bad.toml is no scene")
        while not self.may.wait(0.01):
            if not progress.report(0.5, "Rendering"):
                raise CancelledError
        return make_source(rig)


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> _Slow:
    made = _Slow()
    monkeypatch.setattr(opening, "open_source", made.open_source)
    return made


@pytest.fixture
def opener(qtbot: QtBot, rig: Rig) -> Iterator[Opener]:
    session = Session()
    made = Opener(session, rig, session)
    yield made
    made.close()
    session.close()


def test_a_bad_file_opened_while_the_first_scene_loads_leaves_the_first_scene(
    qtbot: QtBot, opener: Opener, slow: _Slow
) -> None:
    opener.open_first(None, Options(), None)
    qtbot.waitUntil(lambda: len(slow.begun) == 1)
    with qtbot.waitSignal(opener.failed) as failed:
        opener.open(BAD, Options())
    assert failed.args == ["bad.toml is no scene"]
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        pass
    assert [name for name, _ in slow.begun] == [slow.begun[0][0], "bad.toml", slow.begun[0][0]]


def test_two_bad_files_leave_the_first_scene(qtbot: QtBot, opener: Opener, slow: _Slow) -> None:
    opener.open_first(None, Options(), None)
    for _ in range(2):
        with qtbot.waitSignal(opener.failed):
            opener.open(BAD, Options())
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        pass


def test_a_scene_that_is_cancelled_before_the_first_picture_leaves_the_first_one(
    qtbot: QtBot, opener: Opener, slow: _Slow
) -> None:
    opener.open_first(None, Options(), None)
    opener.open(Path("other.toml"), Options())
    qtbot.waitUntil(lambda: "other.toml" in [name for name, _ in slow.begun])
    opener.cancel()
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        pass
    assert slow.begun[-1][0] != "other.toml"


def test_the_first_scene_itself_can_be_cancelled_and_comes_after_a_bad_file(
    qtbot: QtBot, opener: Opener, slow: _Slow
) -> None:
    opener.open_first(None, Options(), None)
    with qtbot.waitSignal(opener.settled):
        opener.cancel()
    assert not opener.busy
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        opener.open(BAD, Options())


def test_what_opens_is_not_followed_by_the_first_scene(qtbot: QtBot, opener: Opener, slow: _Slow) -> None:
    opener.open_first(None, Options(), None)
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        opener.open(Path("other.toml"), Options())
    assert not opener.busy
    with qtbot.waitSignal(opener.settled):
        opener.open(BAD, Options())
    assert not opener.busy


def test_another_rig_chosen_meanwhile_is_that_of_the_first_scene(qtbot: QtBot, opener: Opener, slow: _Slow) -> None:
    opener.open_first(None, Options(), None)
    opener.rig = check_rig(160)
    opener.open_first_again()
    slow.may.set()
    with qtbot.waitSignal(opener.opened):
        pass
    assert slow.begun[-1][1] == check_rig(160)
