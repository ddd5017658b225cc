"""The end of a thread is known, also where the waiting for it is interrupted."""

import os
import threading

import pytest

from interrupts import caught
from slopegate.drivers.files.workers import Worker

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no thread can be sent a signal there")


def test_it_runs_from_its_start_to_its_end() -> None:
    go_on = threading.Event()
    worker = Worker(lambda: go_on.wait(30), "a")
    assert not worker.running
    worker.start()
    assert worker.running
    assert not worker.wait(0.01)
    go_on.set()
    assert worker.wait(30)
    assert worker.finish()
    assert not worker.running


def test_one_whose_waiting_was_interrupted_still_runs() -> None:
    go_on = threading.Event()

    def work() -> None:
        interrupt.strike()
        assert go_on.wait(30)

    with caught() as interrupt:
        worker = Worker(work, "a")
        worker.start()
        worker.wait(30)
    assert worker.running
    go_on.set()
    assert worker.finish(30)


def test_an_interrupt_takes_effect_behind_the_end() -> None:
    with caught() as interrupt:
        worker = Worker(interrupt.strike, "a")
        worker.start()
        worker.finish(30)
    assert not worker.running
    assert not interrupt.early


def test_a_second_interrupt_takes_effect_at_once() -> None:
    go_on = threading.Event()

    def work() -> None:
        interrupt.strike()
        interrupt.strike()
        assert go_on.wait(30)

    with caught() as interrupt:
        worker = Worker(work, "a")
        worker.start()
        worker.finish(30)
    assert worker.running
    go_on.set()
    assert worker.finish(30)
