"""The real window on aravis' fake GigE Vision camera, in a network namespace of its own."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

import fake_gige
from fake_gige import MEMORY, FakeCamera, rolling_shutter
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.aravis import open_aravis
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions

from .test_dialog import Lateness

HERE = Path(__file__)


@pytest.mark.timeout(900)
def test_the_window_on_a_gige_camera_inside_a_namespace() -> None:
    said = fake_gige.run_inside(str(HERE), "-m", "not slow")
    passed = re.search(r"(\d+) passed", said)
    assert passed, said
    assert int(passed[1]) >= 2, said


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_long_ones_inside_a_namespace() -> None:
    print(fake_gige.run_inside(str(HERE), "-m", "slow", "-s", "--timeout=600", timeout_s=800.0))


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., FakeCamera]]:
    yield from fake_gige.serving(tmp_path)


def stream_from(qtbot: QtBot, window: Window, server: FakeCamera, triggered: bool = False) -> None:
    window.devices.hub.set_triggered(triggered)
    address = Address("aravis", server.where)
    window.open(address)
    qtbot.waitUntil(lambda: window.devices.hub.running == address)
    qtbot.waitUntil(lambda: window.session.stream.counters.made > 2)
    qtbot.waitUntil(lambda: "Fake" in window.windowTitle())
    qtbot.waitUntil(lambda: window.live.frame is not None)


def brightest(exposure_us: float) -> float:
    """What the fake camera's 16-bit ramp reaches at this exposure."""
    return min(65535.0, max(0.0, 65289 * (1 + math.log10(exposure_us / 10000))))


def register(window: Window, name: str) -> int:
    """Straight from the server's memory."""
    camera: Any = window.session.source.camera
    return int(camera._device._transport._device.read_register(MEMORY[name]))


def exposed_as_asked(window: Window) -> bool:
    frame, resolved = window.live.frame, window.session.resolved
    if frame is None or not frame.stamp.settled or frame.stamp.asked != resolved.sent:
        return False
    return int(frame.image.max()) == pytest.approx(brightest(resolved.sent.exposure_us), rel=1e-3)


def test_the_gate_reaches_the_registers(qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]) -> None:
    stream_from(qtbot, window, serve(rolling_shutter()), triggered=True)
    assert window.session.source.no_gate == ""
    qtbot.keyClick(window.gate.named.choice, Qt.Key.Key_Down)
    assert window.gate.named.choice.currentText() == "Upright at 1 m"
    for key in ("[", ".", "."):
        qtbot.keyClick(window, key)
    sent = window.session.resolved.sent
    frame = lambda: window.live.frame.stamp  # noqa: E731
    qtbot.waitUntil(lambda: frame().asked == sent and frame().settled)
    assert register(window, "ExposureTime") == pytest.approx(sent.exposure_us, abs=1)
    start_us = sent.delay_us - sent.exposure_us / 2
    period_us = window.session.source.rig.projector.period_us
    assert (register(window, "TriggerDelay") - start_us) % period_us == pytest.approx(0.0, abs=1.0) or (
        start_us - register(window, "TriggerDelay")
    ) % period_us == pytest.approx(0.0, abs=1.0)
    clock = window.gate.settings.line.value
    assert register(window, "DeviceClockFrequency") + 10_000_000 == pytest.approx(clock * 1e6)


def goes_on_with(window: Window, name: str) -> bool:
    source, frame = window.session.source, window.live.frame
    marked = [action.text() for action in window.menus.formats.menu.actions() if action.isChecked()]
    return source.camera.info.modes.format == name and frame is not None and marked == [name]


def test_format_and_rate_are_chosen_by_the_keys_and_come_again(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera], rig: Rig, tmp_path: Path
) -> None:
    server = serve()
    stream_from(qtbot, window, server)
    formats, rates = window.menus.formats, window.menus.rates
    assert formats.box.currentText() == "Mono16"
    qtbot.keyClick(window.gate.settings.exposure.spin, Qt.Key.Key_PageDown)
    qtbot.waitUntil(lambda: exposed_as_asked(window))
    window.live.view.one_to_one()
    held, scale = window.session.resolved.gate, window.live.view.scale
    late = Lateness()
    qtbot.keyClick(formats.box, Qt.Key.Key_Up)
    qtbot.waitUntil(lambda: goes_on_with(window, "Mono8"))
    assert register(window, "PixelFormat") == 0x01080001
    assert (window.session.resolved.gate, window.live.view.scale) == (held, scale)
    assert (window.live.levels.white.maximum(), window.live.frame.image.max() <= 255) == (255, True)
    next(action for action in rates.menu.actions() if action.text() == "10 fps").trigger()
    qtbot.waitUntil(lambda: rates.box.currentText() == "10 fps" and window.session.stream is not None)
    qtbot.waitUntil(lambda: goes_on_with(window, "Mono8"))
    assert register(window, "FramePeriod") == 100_000
    assert window.session.resolved.gate == held
    late.stop()
    print(f"event loop at most {1000 * late.worst_s:.0f} ms late while format and rate were changed")
    window.close()
    closing = lambda: [thread for thread in threading.enumerate() if thread.name.startswith("closing ")]  # noqa: E731
    qtbot.waitUntil(lambda: not closing())
    again = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(again)
    again.show()
    again.open(Address("aravis", server.where))
    qtbot.waitUntil(lambda: again.devices.hub.running is not None)
    assert (again.menus.formats.box.currentText(), again.menus.rates.box.currentText()) == ("Mono8", "10 fps")
    again.close()


def test_a_format_that_is_refused_leaves_the_old_one_live(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]
) -> None:
    stream_from(qtbot, window, serve(rolling_shutter(pretends="Mono14")), triggered=True)
    box = window.menus.formats.box
    assert box.currentText() == "Mono12p"
    box.activated.emit(box.findText("Mono14"))
    qtbot.waitUntil(lambda: "goes on with Mono12p" in window.messages.text)
    assert "was told the pixel format Mono14 and has Mono8" in window.messages.text
    qtbot.waitUntil(lambda: goes_on_with(window, "Mono12p"))
    assert box.currentText() == "Mono12p"
    assert window.devices.hub.way_to_open(window.devices.hub.running).pixel_format is None
    # triggered, it has the projector's pace
    assert not window.menus.rates.box.isEnabled()
    assert "sync signal" in window.menus.rates.box.toolTip()


@pytest.mark.slow
def test_packets_that_are_lost_show_in_the_status(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]
) -> None:
    stream_from(qtbot, window, serve(lost_per_thousand=20))
    qtbot.waitUntil(lambda: "packets)" in window.status.labels["lost"].text())
    qtbot.wait(5000)
    counters, text = window.session.stream.counters, window.status.labels["lost"].text()
    print(f"20 in 1000 packets lost: {counters.made} frames received whole, {text}")
    assert window.session.stream.error is None


@pytest.mark.slow
def test_a_camera_in_use_elsewhere_leaves_what_runs(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera], rig: Rig
) -> None:
    server = serve()
    other = open_aravis(server.where, rig, OpenOptions(triggered=False))
    with qtbot.waitSignal(window.opener.failed):
        window.open(Address("aravis", server.where))
    assert "in use by another program" in window.messages.text
    assert not window.session.source.is_device
    other.close()
    stream_from(qtbot, window, server)
    with pytest.raises(CameraError, match="in use"):
        open_aravis(server.where, rig, OpenOptions(triggered=False))
    made = window.session.stream.counters.made
    qtbot.waitUntil(lambda: window.session.stream.counters.made > made + 5)


def live_through_kills(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera], pauses_s: list[float | None]
) -> None:
    server = serve()
    stream_from(qtbot, window, server)
    box = window.gate.settings
    assert not box.line.spin.isEnabled()
    assert "no pixel clock" in box.line.spin.toolTip()
    assert "without the projector's trigger" in box.delay.spin.toolTip()
    qtbot.waitUntil(lambda: window.docks.docks["slab"].missing != "")
    for _ in range(4):
        qtbot.keyClick(box.exposure.spin, Qt.Key.Key_PageDown)
        qtbot.waitUntil(lambda: exposed_as_asked(window))
    stream, threads = window.session.stream, threading.active_count()
    late, back_s = Lateness(), []
    for pause_s in pauses_s:
        server.kill()
        if pause_s is None:
            qtbot.waitUntil(lambda: "Not live" in window.live.view.stale)
            qtbot.waitUntil(lambda: "Trying again by itself" in window.messages.text)
        else:
            qtbot.wait(round(1000 * pause_s))
        server.start()
        started_s, last = time.monotonic(), window.live.frame.stamp.sequence
        painted = lambda last=last: window.live.frame.stamp.sequence > last + 5  # noqa: E731
        qtbot.waitUntil(lambda painted=painted: painted() and exposed_as_asked(window), timeout=40_000)
        back_s.append(time.monotonic() - started_s)
        assert window.session.stream is stream
        qtbot.waitUntil(lambda: window.live.view.stale == "" and stream.error is None)
        qtbot.wait(1000)
    late.stop()
    # aravis asks a camera that was killed for seconds before it lets go of it
    dropping = lambda: [thread for thread in threading.enumerate() if thread.name == "slopegate-aravis-drop"]  # noqa: E731
    qtbot.waitUntil(lambda: not dropping(), timeout=60_000)
    counters = stream.counters
    print(
        f"{len(pauses_s)} kills: {counters.made + counters.lost} frames sent, {counters.made} received, "
        f"{counters.lost} lost; live again {min(back_s):.2f} to {max(back_s):.2f} s after the restart; event loop at "
        f"most {1000 * late.worst_s:.0f} ms late in {late.ticks} ticks"
    )
    qtbot.waitUntil(lambda: threading.active_count() <= threads + 1)


def test_exposure_changes_live_and_a_killed_camera_comes_back_with_it(
    qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]
) -> None:
    live_through_kills(qtbot, window, serve, [None])


@pytest.mark.slow
def test_ten_kills(qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]) -> None:
    live_through_kills(qtbot, window, serve, [0.0, 0.5, 1.0, 2.0, None, 5.0, 8.0, 0.0, 1.5, 12.0])


@pytest.mark.slow
def test_minutes_at_the_full_rate(qtbot: QtBot, window: Window, serve: Callable[..., FakeCamera]) -> None:
    stream_from(qtbot, window, serve())
    camera: Any = window.session.source.camera
    with camera._lock:
        camera._device._transport.features.set_number("AcquisitionFrameRate", 100.0)
    late, before, started_s = Lateness(), window.session.stream.counters, time.monotonic()
    qtbot.wait(120_000)
    late.stop()
    after, seconds = window.session.stream.counters, time.monotonic() - started_s
    received, lost, shown = after.made - before.made, after.lost - before.lost, after.shown - before.shown
    print(
        f"{seconds:.0f} s at full rate: {received + lost} frames sent, {received} received ({received / seconds:.1f} a "
        f"second), {lost} lost, {shown} shown; event loop at most {1000 * late.worst_s:.0f} ms late"
    )
    assert received > 20 * seconds
    assert lost < 0.1 * received
    assert after.errors == 0
