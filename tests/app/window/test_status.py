"""The status bar's numbers."""

from __future__ import annotations

import pytest
from pytestqt.qtbot import QtBot

from slopegate.app.session.meter import Readings
from slopegate.app.window.status import StatusReadout


@pytest.mark.parametrize("rate_hz", [0.5, 20.0, 999.94, 999.96, 24273.04, 500_000.0])
def test_rates_need_no_more_room_than_there_is(qtbot: QtBot, rate_hz: float) -> None:
    status = StatusReadout()
    qtbot.addWidget(status)
    status.show_readings(Readings(rate_hz, rate_hz, 12345, 1234.0, 1.0))
    for label in status.labels.values():
        assert label.sizeHint().width() <= label.minimumWidth(), label.text()


def test_a_fast_rate_is_a_whole_number(qtbot: QtBot) -> None:
    status = StatusReadout()
    qtbot.addWidget(status)
    status.show_readings(Readings(24273.04, 59.94, 0, None, 0.0))
    assert status.labels["camera"].text() == "camera 24273 fps"
    assert status.labels["shown"].text() == "shown 59.9 fps"
