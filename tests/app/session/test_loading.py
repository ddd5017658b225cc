"""Work beside the GUI thread: results, failures, cancel, and what comes too late."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot

from slopegate.app.session import loading
from slopegate.app.session.durations import TimeLeft
from slopegate.app.session.loading import Loader, Progress
from slopegate.app.session.log import bug_sentence
from slopegate.app.session.session import Session
from slopegate.core.rig.checks import InputError


@pytest.fixture
def discarded() -> list[str]:
    return []


@pytest.fixture
def loader(qtbot: QtBot, discarded: list[str]) -> Iterator[Loader[str]]:
    made: Loader[str] = Loader(discarded.append)
    yield made
    made.close()


def test_result_and_progress_arrive_in_this_thread(qtbot: QtBot, loader: Loader[str]) -> None:
    said: list[tuple[float, str, int]] = []
    loader.progressed.connect(lambda share, text: said.append((share, text, threading.get_ident())))

    def job(progress: Progress) -> str:
        assert threading.get_ident() != said_here
        progress.step(0.5, "half")
        return "done"

    said_here = threading.get_ident()
    with qtbot.waitSignal(loader.finished) as got:
        loader.start(job)
        assert loader.busy
    assert got.args == ["done"]
    assert said == [(0.5, "half", said_here)]
    assert not loader.busy


def test_errors_for_the_user_are_sentences_and_bugs_are_logged(
    qtbot: QtBot, loader: Loader[str], bugs: list[logging.LogRecord]
) -> None:
    def fails(error: Exception) -> str:
        def job(progress: Progress) -> str:
            raise error

        with qtbot.waitSignal(loader.failed) as got:
            loader.start(job)
        return str(got.args[0])

    assert fails(InputError("thickness_m is 0")) == "thickness_m is 0"
    assert not bugs
    for error in (KeyError("x"), ValueError("x"), ImportError("x")):
        assert fails(error) == bug_sentence(type(error))
        assert bugs.pop().exc_info[1] is error


def test_cancel_is_at_once_and_the_late_result_is_discarded(
    qtbot: QtBot, loader: Loader[str], discarded: list[str]
) -> None:
    go = threading.Event()
    finished: list[str] = []
    loader.finished.connect(finished.append)
    loader.start(lambda progress: "late" if go.wait(10) else "never")
    with qtbot.waitSignal(loader.cancelled):
        loader.cancel()
    assert not loader.busy
    go.set()
    qtbot.waitUntil(lambda: discarded == ["late"])
    assert finished == []


def test_a_job_learns_that_it_was_cancelled(qtbot: QtBot, loader: Loader[str], discarded: list[str]) -> None:
    started, go, ended = threading.Event(), threading.Event(), threading.Event()

    def job(progress: Progress) -> str:
        started.set()
        go.wait(10)
        try:
            progress.step(0.5, "more")
        finally:
            ended.set()
        return "never"

    loader.start(job)
    assert started.wait(10)
    loader.cancel()
    go.set()
    assert ended.wait(10)
    loader.close()
    assert discarded == []


def test_the_latest_start_wins(qtbot: QtBot, loader: Loader[str], discarded: list[str]) -> None:
    go = threading.Event()
    loader.start(lambda progress: "old" if go.wait(10) else "")
    with qtbot.assertNotEmitted(loader.cancelled), qtbot.waitSignal(loader.finished) as got:
        loader.start(lambda progress: "new")
    assert got.args == ["new"]
    go.set()
    qtbot.waitUntil(lambda: discarded == ["old"])


def start_halting(loader: Loader[int], share: float) -> list[threading.Event]:
    """Start a job that halts twice, after it has told that nothing is done, and that this share is; what lets it go."""
    go_on = [threading.Event() for _ in range(2)]

    def job(progress: Progress) -> int:
        for done, event in zip((0.0, share), go_on, strict=True):
            progress.report(done, "Working ...")
            event.wait(30)
        return 1

    loader.start(job)
    return go_on


def test_the_time_left_is_told_as_soon_as_it_is_known(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(loading, "TimeLeft", lambda: TimeLeft(lambda: now[0]))
    loader: Loader[int] = Loader(lambda _: None)
    said: list[str] = []
    loader.progressed.connect(lambda share, text: said.append(text))
    go_on = start_halting(loader, 0.25)
    qtbot.waitUntil(lambda: said == ["Working ..."])
    now[0] = 4.0
    go_on[0].set()
    qtbot.waitUntil(lambda: len(said) == 2)
    assert said[1] == "Working ... (12 s left)"
    with qtbot.waitSignal(loader.finished):
        go_on[1].set()
    loader.close()


def test_the_time_left_runs_out_and_does_not_stand(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(loading, "TimeLeft", lambda: TimeLeft(lambda: now[0]))
    monkeypatch.setattr(loading, "_TICK_MS", 10)
    loader: Loader[int] = Loader(lambda _: None)
    said: list[str] = []
    loader.progressed.connect(lambda share, text: said.append(text))
    go_on = start_halting(loader, 0.5)
    qtbot.waitUntil(lambda: bool(said))
    now[0] = 3.0
    go_on[0].set()
    qtbot.waitUntil(lambda: said[-1] == "Working ... (3 s left)")
    now[0] = 5.0
    qtbot.waitUntil(lambda: said[-1] == "Working ... (1 s left)")
    now[0] = 7.0
    qtbot.waitUntil(lambda: said[-1] == "Working ...")
    with qtbot.waitSignal(loader.finished):
        go_on[1].set()
    loader.close()


def test_a_closed_loader_says_nothing_any_more(qtbot: QtBot, loader: Loader[str], discarded: list[str]) -> None:
    """The widget that listened may be gone by then."""
    started, go, answers = threading.Event(), threading.Event(), []

    def job(progress: Progress) -> str:
        started.set()
        go.wait(30)
        answers.append(progress.report(0.5, "more"))
        return "late"

    said: list[str] = []
    loader.progressed.connect(lambda share, text: said.append(text))
    loader.start(job)
    assert started.wait(30)
    loader.close(0.0)
    go.set()
    qtbot.waitUntil(lambda: discarded == ["late"])
    assert (answers, said) == ([False], [])


@pytest.mark.parametrize("ending", ["finished", "failed", "cancelled", "closed"])
def test_a_hold_is_ended_before_anybody_hears_how_the_job_ended(qtbot: QtBot, loader: Loader[str], ending: str) -> None:
    """Whoever hears it may begin to hold something else."""
    go, session = threading.Event(), Session()
    hold = session.hold("the job")
    held: list[bool] = []
    for told in (loader.finished, loader.failed, loader.cancelled):
        told.connect(lambda *_: held.append(session.held("gate") is not None))
    loader.release(hold)

    def job(progress: Progress) -> str:
        go.wait(10)
        if ending == "failed":
            raise InputError("it cannot be")
        return "done"

    hold.begin("gate")
    loader.start(job)
    assert session.held("gate") is hold
    if ending == "closed":
        go.set()
        loader.close()
    elif ending == "cancelled":
        loader.cancel()
    go.set()
    if ending != "closed":
        qtbot.waitUntil(lambda: held == [False])
    assert session.held("gate") is None
