"""The real window on a rig where everything goes wrong: right pictures, words for what happened, and no growth."""

from __future__ import annotations

import gc
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

import soak
from slopegate.app.cli import main
from slopegate.app.devices.fault_menu import FaultMenu
from slopegate.app.panels.capture import CapturePanel
from slopegate.app.panels.plots import TimingPanel
from slopegate.app.session.source import Options
from slopegate.app.views.trigger_text import jitter_text, triggers_text
from slopegate.app.window.window import Window
from slopegate.core.rig.cadence import Cadence
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Preset
from slopegate.drivers.cameras.faults import PRESETS, Faults, FaultyCamera
from slopegate.drivers.captures.storage import open_capture
from slopegate.drivers.contract.tap import Counters
from slopegate.drivers.stream.stream import Stream
from small_window import make_source

EVERYTHING = Faults(0.05, 0.05, 0.05, 0.05, disconnected=0.01, late_s=0.006, away_s=0.2)
"""All that spoils no picture: jitter would move the gates."""


def faulty(window: Window, rig: Rig, faults: Faults = EVERYTHING) -> FaultyCamera:
    """Let the window look at the small scene through this."""
    source = make_source(rig, Options(noise=False, rate_hz=60.0, faults=faults))
    window.session.adopt(source)
    assert isinstance(source.streamed, FaultyCamera)
    return source.streamed


def choose(qtbot: QtBot, menu: FaultMenu, faults: Faults | None) -> None:
    menu.menu.popup(menu.menu.parentWidget().mapToGlobal(menu.menu.parentWidget().rect().center()))
    qtbot.waitUntil(menu.menu.isVisible)
    qtbot.mouseClick(menu.menu, Qt.MouseButton.LeftButton, pos=menu.menu.actionGeometry(menu.actions[faults]).center())


def test_every_picture_is_what_its_settings_make_and_nothing_grows(qtbot: QtBot, window: Window, rig: Rig) -> None:
    camera = faulty(window, rig)
    gates = [window.session.source.presets[k].settings for k in (0, 1)]
    seen: dict[GateSettings, set[bytes]] = {}
    alone = make_source(rig, Options(noise=False, rate_hz=math.inf)).camera
    alone.start()
    settled = dict.fromkeys(gates, 0)

    def look() -> None:
        frame = window.live.frame
        if frame is not None and frame.stamp.settled and frame.stamp.applied in gates:
            seen.setdefault(frame.stamp.applied, set()).add(frame.image.tobytes())
            settled[frame.stamp.applied] += 1

    window.live.view.painted.connect(look)
    usage = []
    for turn in range(20):
        window.session.use(window.session.source.presets[turn % 2])
        wanted = gates[turn % 2]
        enough = settled[wanted] + 3
        qtbot.waitUntil(lambda wanted=wanted, enough=enough: settled[wanted] >= enough)
        if sys.platform.startswith("linux"):
            gc.collect()
            usage.append(soak.Usage.now())
    assert set(seen) == set(gates)
    for gate, images in seen.items():
        image = np.zeros((240, 320), np.uint16)
        alone.configure(gate)
        assert alone.read(image, 5.0) is not None
        assert images == {image.tobytes()}
    assert camera.counts.disconnected + camera.counts.late + camera.counts.duplicated > 0
    if usage:
        warm, last = usage[9], usage[-1]
        assert last.threads <= warm.threads
        assert last.files <= warm.files
        assert last.rss_mb < warm.rss_mb + 20
    alone.close()


def test_the_menu_breaks_the_rig_and_mends_it(qtbot: QtBot, window: Window) -> None:
    menu = window.menus.faults
    assert menu.actions[None].isChecked()
    for wanted in (PRESETS["trigger"], None):
        gate = window.session.resolved.sent
        choose(qtbot, menu, wanted)
        qtbot.waitUntil(lambda wanted=wanted: window.session.source.options.faults == wanted)
        assert window.session.resolved.sent == gate
        assert [faults for faults, action in menu.actions.items() if action.isChecked()] == [wanted]


def test_jitter_and_missed_triggers_are_shown(qtbot: QtBot, window: Window, rig: Rig) -> None:
    faulty(window, rig, Faults(missed=0.2, jitter_us=200.0))
    timing = window.docks.bring("timing")
    assert isinstance(timing, TimingPanel)
    label = timing.view.triggers
    qtbot.waitUntil(lambda: "missed" in label.text() and "missed 0" not in label.text())
    qtbot.waitUntil(lambda: "Triggers: every 16." in label.text())
    status = window.status.labels["triggers"]
    qtbot.waitUntil(lambda: status.text().startswith("jitter ") and "\u00b5s, missed " in status.text())
    assert label.isVisible()
    qtbot.waitUntil(lambda: label.height() >= label.heightForWidth(label.width()))


def test_jitter_moves_the_gate_from_frame_to_frame(qtbot: QtBot, window: Window, rig: Rig) -> None:
    """The window makes the virtual camera so that late triggers open late, and tells the gate as it was set."""
    seen: set[bytes] = set()
    gates: set[GateSettings | None] = set()

    def look() -> None:
        frame = window.live.frame
        if frame is not None and frame.stamp.settled and frame.stamp.applied == window.session.resolved.sent:
            seen.add(frame.image.tobytes())
            gates.add(frame.stamp.applied)

    faulty(window, rig, Faults(jitter_us=150.0))
    upright = window.session.source.presets[1]
    leaning = replace(upright.settings, line_time_us=1.2 * upright.settings.line_time_us)
    window.session.use(Preset("Leaning", leaning))
    window.live.view.painted.connect(look)
    qtbot.waitUntil(lambda: len(seen) >= 5)
    assert len(gates) == 1


def test_a_healthy_virtual_camera_misses_no_trigger(
    qtbot: QtBot, window: Window, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitated = Options(noise=False, faults=Faults(missed=0.1))
    cases = ((Options(noise=False), False), (Options(rate_hz=math.inf), False), (imitated, True))
    for lost, (options, shown) in enumerate(cases, 40):
        window.session.adopt(make_source(rig, options))
        qtbot.waitUntil(lambda: window.live.frame is not None)
        monkeypatch.setattr(Stream, "counters", Counters(missed=30, lost=lost))
        qtbot.waitUntil(lambda lost=lost: window.status.labels["lost"].text() == f"lost {lost}")
        assert ("missed" in window.status.labels["triggers"].text()) is shown
    assert window.status.labels["dropped"].text().startswith("not shown ")


def test_a_loose_plug_is_told_and_the_picture_comes_back(qtbot: QtBot, window: Window, rig: Rig) -> None:
    faulty(window, rig, Faults(disconnected=0.05, away_s=0.8))
    qtbot.waitUntil(lambda: "does not answer" in window.messages.text)
    qtbot.waitUntil(lambda: "The virtual camera is back after" in window.messages.text)


def test_an_error_goes_with_the_stream_that_it_is_about(qtbot: QtBot, window: Window, rig: Rig) -> None:
    faulty(window, rig, Faults(disconnected=0.5, away_s=60.0))
    qtbot.waitUntil(lambda: "does not answer" in window.messages.text)
    window.session.adopt(make_source(rig, Options(noise=False, rate_hz=60.0)))
    qtbot.waitUntil(lambda: window.messages.text == "")


def test_a_capture_through_all_of_it_is_complete(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> None:
    camera = faulty(window, rig)
    panel = window.docks.bring("slices")
    assert isinstance(panel, CapturePanel)
    panel.where.selectAll()
    qtbot.keyClicks(panel.where, str(tmp_path / "capture"))
    qtbot.waitUntil(panel.start.isEnabled)
    qtbot.mouseClick(panel.start, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: panel.run.busy)
    qtbot.waitUntil(lambda: not panel.run.busy, timeout=60_000)
    folder, alone = open_capture(tmp_path / "capture"), make_source(rig, Options(noise=False, rate_hz=math.inf)).camera
    assert folder.missing() == []
    assert sum(vars(camera.counts).values()) > 0
    alone.start()
    for index, item in enumerate(folder.manifest.slices):
        image = np.zeros((240, 320), np.uint16)
        alone.configure(item.settings())
        assert alone.read(image, 5.0) is not None
        np.testing.assert_array_equal(folder.total(index), image.astype(np.uint32) * folder.manifest.frames)
    alone.close()


def test_the_numbers_in_words(qapp: QApplication) -> None:
    beat = Cadence(50_000.0, 151.6, 12_345.0, 128)
    counted = Counters(missed=3, lost=2, late=1, repeated=4)
    assert jitter_text(beat) == "152 \u00b5s"
    assert triggers_text(counted, beat) == (
        "Triggers: every 50.00 ms, jitter 152 \u00b5s, at worst 12.3 ms in 128 frames; "
        "since the start missed 3, lost 2, late 1, repeated 4."
    )
    free = Cadence(5_000.0, 900.0, 3_000.0, 128)
    assert jitter_text(free) == jitter_text(None) == "\u2013"
    assert triggers_text(counted, free).startswith("Frames come about every 5.0 ms, without a beat; ")
    assert triggers_text(counted, None).startswith("Triggers: too few frames yet; ")
    assert triggers_text(counted, beat, triggered=False).startswith("Frames: every 50.00 ms, ")
    assert triggers_text(counted, beat, triggered=False).endswith("since the start lost 2, late 1, repeated 4.")


def test_wrong_faults_are_refused_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--faults", "gremlins"]) == 2
    assert "faults is 'gremlins': it must be one of trigger, link, plug, all" in capsys.readouterr().err
    assert main(["--faults", "all", "scenes"]) == 2
