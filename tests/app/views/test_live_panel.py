from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from slopegate.app.session.session import Session
from slopegate.app.session.source import Options
from slopegate.app.views import live_panel
from slopegate.app.views.live_panel import LivePanel
from slopegate.core.rig.rig import Rig
from small_window import make_source


@pytest.fixture
def panel(qtbot: QtBot, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> Iterator[LivePanel]:
    """On the screen, before a scene whose camera runs free; hidden, it takes a frame only when the gate changes."""
    monkeypatch.setattr(live_panel, "UNSEEN_S", math.inf)
    session = Session()
    made = LivePanel(session)
    qtbot.addWidget(made)
    made.resize(640, 480)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitSignal(made.first_image):
        session.adopt(make_source(rig, Options(noise=False, rate_hz=math.inf)))
    yield made
    made.stop()
    session.close()


def test_frames_on_demand_are_taken_while_they_are_painted(qtbot: QtBot, panel: LivePanel) -> None:
    seen: set[int] = set()
    panel.view.painted.connect(lambda: seen.add(panel.frame.stamp.sequence if panel.frame else -1))
    qtbot.waitUntil(lambda: len(seen) >= 20)
    assert max(seen) - min(seen) == len(seen) - 1, "every frame that is made is painted"


def test_a_hidden_view_lets_a_camera_that_runs_free_rest(qtbot: QtBot, panel: LivePanel) -> None:
    session = panel._session
    stream, source = session.stream, session.source
    assert stream is not None
    assert source is not None
    panel.hide()
    QApplication.processEvents()

    def taken() -> set[int]:
        numbers = set()
        for _ in range(100):
            panel._pull()
            qtbot.wait(1)
            assert panel.frame is not None
            numbers.add(panel.frame.stamp.sequence)
        return numbers

    assert len(taken()) <= 2, "the last one painted, and one that nobody saw"
    made = stream.counters.made
    assert len(taken()) == 1
    assert stream.counters.made == made
    other = source.presets[1]
    assert session.use(other)
    qtbot.waitUntil(lambda: panel.frame is not None and panel.frame.stamp.asked == other.settings)
    panel.show()
    qtbot.waitUntil(lambda: stream.counters.made > made + 10)
