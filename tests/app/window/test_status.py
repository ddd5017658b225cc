"""The status bar's numbers."""

from __future__ import annotations

import pytest
from pytestqt.qtbot import QtBot

from slopegate.app.session.meter import Readings
from slopegate.app.window.status import StatusReadout
from slopegate.drivers.contract.tap import Counters


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


def test_what_means_nothing_is_blank_and_every_number_explains_itself(qtbot: QtBot) -> None:
    status = StatusReadout()
    qtbot.addWidget(status)
    assert {label.text() for label in status.labels.values()} == {""}
    assert all(label.toolTip() for label in status.labels.values())
    status.show_readings(Readings(20.0, 20.0, 0, None, 0.0), renders=False)
    status.show_losses(Counters(), None, 0, triggered=False)
    shown = {key for key, label in status.labels.items() if label.text()}
    assert shown == {"camera", "shown", "dropped", "lost"}
    status.show_losses(Counters(missed=2), None, 0)
    assert status.labels["triggers"].text() == "missed 2"
    status.show_readings(Readings(None, None, 7, 31.0, 0.4))
    texts = [status.labels[key].text() for key in ("camera", "dropped", "latency", "skipped")]
    assert texts == ["", "", "latency 31 ms", ""]


def test_what_is_replayed_tells_what_was_lost_and_misses_no_trigger(qtbot: QtBot) -> None:
    status = StatusReadout()
    qtbot.addWidget(status)
    status.show_losses(Counters(lost=1, missed=2), None, 0)
    status.show_replayed(3)
    assert (status.labels["lost"].text(), status.labels["triggers"].text()) == ("lost 3 when recorded", "")
    assert status.labels["lost"].sizeHint().width() <= status.labels["lost"].minimumWidth()
    status.show_replayed(None)
    assert status.labels["lost"].text() == ""
