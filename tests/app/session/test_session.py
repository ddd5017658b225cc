"""What the session makes of intents, and what it sends."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slopegate.app.session.session import Change, Intent, PlaneWish, Session, plane_of, resolve
from slopegate.app.session.source import Source
from slopegate.core.gating.gate import complement, row_windows
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise
from small_window import small_rig

RIG = small_rig()


@pytest.fixture
def session(source: Source) -> Session:
    made = Session()
    made.adopt(source)
    yield made
    made.close()


def frame_made_with(session: Session, settings: GateSettings, timeout_s: float = 30.0) -> object:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        frame = session.newest()
        if frame is not None and frame.stamp.applied == settings:
            return frame
        time.sleep(0.002)
    raise AssertionError(f"no frame was made with {settings}")


@given(
    clock=st.floats(8, 140),
    delay=st.floats(-40_000, 60_000),
    exposure=st.floats(50, 60_000),
    everything_but=st.booleans(),
)
def test_what_is_sent_is_what_the_hardware_has(
    clock: float, delay: float, exposure: float, everything_but: bool
) -> None:
    line = RIG.camera.shutter.line
    assert isinstance(line, PixelClocks)
    asked = gate(line.line_time_us(clock), delay, exposure)
    period = RIG.projector.period_us
    assume(not (everything_but and exposure > 49_999))  # three whole periods: nothing is left
    got = resolve(RIG, Intent(asked, everything_but))
    assert got.asked == asked
    assert got.gate == quantise(RIG.camera.shutter, asked, period)
    assert got.sent == quantise(RIG.camera.shutter, got.sent, period)
    wanted = quantise(RIG.camera.shutter, complement(got.gate, period), period) if everything_but else got.gate
    assert got.sent == wanted


@given(tilt=st.floats(-60, 60), distance=st.floats(0.4, 5), share=st.floats(0.05, 0.5))
def test_both_views_of_a_gate_agree(tilt: float, distance: float, share: float) -> None:
    wish = PlaneWish(tilt, distance, share * distance)
    by_plane = resolve(RIG, Intent(wish))
    by_settings = resolve(RIG, Intent(by_plane.gate))
    assert by_plane.asked_plane == wish
    assert by_settings.gate == by_plane.gate
    assert by_settings.slab == by_plane.slab
    # going on from what is shown must not move the gate
    shown = plane_of(by_settings.slab)
    assume(shown is not None)
    assert shown is not None
    assume(all(math.isfinite(value) for value in (shown.tilt_deg, shown.distance_m, shown.thickness_m)))
    again = resolve(RIG, Intent(shown))
    assert again.gate.line_time_us == by_plane.gate.line_time_us
    assert float(again.gate.delay_us) == pytest.approx(float(by_plane.gate.delay_us), abs=1.0)
    assert again.gate.exposure_us == pytest.approx(by_plane.gate.exposure_us, abs=1.0)


def test_gate_and_complement_record_everything_together(rig: Rig, source: Source) -> None:
    own = source.presets[0].settings
    plain, rest = (resolve(rig, Intent(own, flag)).sent for flag in (False, True))
    both = [row_windows(rig, settings) for settings in (plain, rest)]
    assert [int(w.inside.max()) for w in both] == [1, 1]
    assert rest.exposure_us == pytest.approx(rig.projector.period_us - plain.exposure_us, abs=0.5)


def test_only_differences_are_sent(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[GateSettings] = []
    assert session.stream is not None
    monkeypatch.setattr(session.stream, "submit", lambda settings, rows: sent.append(settings))
    heard: list[Change] = []
    session.changed.connect(heard.append)
    held = session.resolved
    assert held is not None
    assert session.ask_wish(held.gate)
    assert (sent, heard) == ([], [])
    nearly = replace(held.gate, exposure_us=held.gate.exposure_us + 0.2)
    assert session.ask_wish(nearly)  # rounds to the same
    assert sent == []
    assert heard == [Change.GATE]  # but what was asked differs
    assert session.ask_wish(replace(held.gate, exposure_us=held.gate.exposure_us + 2))
    assert len(sent) == 1


def test_impossible_wish_keeps_the_gate_and_says_why(session: Session) -> None:
    heard: list[Change] = []
    session.changed.connect(heard.append)
    before = session.resolved
    assert not session.ask_wish(PlaneWish(89.9, 5.0, 0.1))
    assert session.resolved is before
    assert "tilt_deg" in session.refusal
    assert heard == [Change.REFUSED]
    assert not session.ask_wish(PlaneWish(0.0, -1.0, 0.1))
    assert "distance_m" in session.refusal
    assert session.ask_complement(True)
    assert session.refusal == ""


def test_frames_carry_the_gate_that_made_them(session: Session, source: Source) -> None:
    for preset in source.presets:
        session.use(preset)
        assert session.resolved is not None
        frame_made_with(session, session.resolved.sent)
    session.use(source.presets[0])
    session.ask_complement(True)
    assert session.resolved is not None
    rest = frame_made_with(session, session.resolved.sent)
    assert rest.stamp.applied != source.presets[0].settings


def test_paused_session_gives_no_frames(session: Session) -> None:
    assert session.resolved is not None
    frame_made_with(session, session.resolved.sent)
    session.pause(True)
    time.sleep(0.05)
    assert session.newest() is None
    session.pause(False)
    frame_made_with(session, session.resolved.sent)


def test_a_named_gate_that_the_next_scene_cannot_do_is_replaced(source: Source) -> None:
    session = Session()
    session.adopt(source, Intent(PlaneWish(89.99, 9.0, 0.1)))
    assert session.intent == Intent(source.presets[0].settings)
    session.close()
