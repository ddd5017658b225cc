"""A window on a rig that was calibrated: read-outs carry their standard errors, and lose them with the rig."""

from __future__ import annotations

import re

import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from clipping import clipped, settle
from rigs import calibrated
from slopegate.app.session.session import PlaneWish
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import make_source, small_rig

WISH = PlaneWish(14.0, 1.05, 0.0612)


@pytest.fixture
def rig() -> Rig:
    return calibrated(small_rig())


@pytest.fixture
def known(qtbot: QtBot, window: Window) -> Window:
    window.session.ask_wish(WISH)
    return window


def test_read_outs_tell_one_standard_error_and_have_room_for_it(qtbot: QtBot, known: Window) -> None:
    resolved, plane = known.session.resolved, known.gate.plane
    assert resolved is not None
    slab = resolved.slab
    assert slab is not None
    assert slab.errors is not None
    distance = slab.errors.distance_m
    assert distance is not None
    assert plane.achieved[1].text() == f"= {slab.distance_m:.4f} \u00b1 {distance:.4f} m"
    assert plane.achieved[0].text() == f"= {slab.tilt_deg:.2f} \u00b1 {slab.errors.tilt_deg:.2f}\u00b0"
    assert re.fullmatch(r"= 0\.06\d+ \u00b1 0\.000\d+ m", plane.achieved[2].text())
    assert "one standard error" in plane.achieved[1].toolTip()

    def has_room(label: QLabel) -> bool:
        return label.contentsRect().width() >= label.fontMetrics().horizontalAdvance(label.text())

    qtbot.waitUntil(lambda: all(map(has_room, plane.achieved)))
    assert plane.residuals[2].text() != "", "what rounding to the hardware costs is told beside it, as before"


@pytest.mark.parametrize("wish", [PlaneWish(14.0, 0.5, 0.003), PlaneWish(14.0, 900.0, 80)])
def test_read_outs_with_many_figures_are_not_cut(qtbot: QtBot, known: Window, wish: PlaneWish) -> None:
    """A gate that goes on with another rig may be as thin, or lie as far away, as it likes."""
    known.session.ask_wish(wish)
    achieved = known.gate.plane.achieved
    qtbot.waitUntil(lambda: "1.05" not in achieved[1].text())
    settle()
    assert clipped(known.gate) == []


def test_a_rig_that_tells_no_errors_is_read_as_before(qtbot: QtBot, known: Window) -> None:
    """The same numbers in a file without a calibration: no error is left on the screen."""
    with qtbot.waitSignal(known.ready):
        known.session.adopt(make_source(small_rig()))
    known.session.ask_wish(WISH)
    plane = known.gate.plane
    assert known.session.source is not None
    assert known.session.source.rig.calibration is None
    assert not any("\u00b1" in label.text() for label in plane.achieved)
    resolved = known.session.resolved
    assert resolved is not None
    assert resolved.slab is not None
    assert plane.achieved[1].text() == f"= {resolved.slab.distance_m:.3f} m"
    assert "standard error" not in plane.achieved[1].toolTip()
