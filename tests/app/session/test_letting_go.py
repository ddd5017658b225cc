"""Closing beside the GUI thread: what goes wrong is logged, and only a bug as one."""

from __future__ import annotations

import logging

import pytest

from slopegate.app.session.letting_go import LettingGo
from slopegate.drivers.contract.camera import CameraError


def closed(error: Exception) -> bool:
    def close() -> None:
        raise error

    closing = LettingGo()
    closing.begin(close, "the camera")
    return closing.wait(60)


def test_a_device_that_is_gone_cannot_be_closed_and_that_is_no_bug(caplog: pytest.LogCaptureFixture) -> None:
    assert closed(CameraError("The cable is out."))
    assert caplog.messages == ["the camera was not closed: The cable is out."]


def test_a_bug_while_closing_is_logged(bugs: list[logging.LogRecord]) -> None:
    assert closed(KeyError("handle"))
    (record,) = bugs
    assert record.getMessage() == "Closing the camera failed"
    bugs.clear()
