"""What arrives, part by part: in the real window, by pointer, keys and switches; numbers against the rendered light."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.panels.bake_row import BakeRow, bake_text
from slopegate.app.panels.light import LOOKS, LightPanel, measure, what_is_missing
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.window.window import Window
from slopegate.core.gating.gate import RowWindows, row_windows, weights
from slopegate.core.light.part import PARTS, PartName
from slopegate.core.render.render import Buffers, Region
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import KeyFrames, Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.live_bake import BakeState
from small_window import make_source, small_scene


class EvenGlow:
    """A part that adds 0.1 wherever projector row 300 is recorded."""

    name: PartName = "indirect"

    def add(self, windows: RowWindows, out: Singles) -> None:
        out += np.float32(0.1) * weights(windows, np.full(len(out), 300.0))[:, None].astype(np.float32)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Nothing of it moves."""

    def light_with(self, pattern: Singles | None) -> None:
        """Alike whatever the projector shows."""


def lit_source(rig: Rig, ambient: float = 0.1) -> Source:
    scene = replace(small_scene(rig), ambient=ambient)
    made = build_source(Path("card.toml"), rig, scene, Options(noise=False, rate_hz=60.0), Progress(lambda a, b: None))
    assert made.rendered is not None
    made.rendered.smooth.put(EvenGlow())
    return made


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig) -> LightPanel:
    window.session.adopt(lit_source(rig))
    made = window.docks.bring("light")
    assert isinstance(made, LightPanel)
    qtbot.waitUntil(lambda: made.amounts is not None and "indirect" in made.amounts.names)
    return made


def number(panel: LightPanel, name: PartName, place: int) -> float:
    return float(panel.numbers[name][place].text().removesuffix(" %"))


def test_the_numbers_are_those_of_the_rendered_light(qtbot: QtBot, window: Window, panel: LightPanel) -> None:
    source, sent = window.session.source, window.session.resolved.sent
    buffers, rig = source.buffers, source.rig
    direct = buffers.direct.mean(axis=2)
    hit = weights(row_windows(rig, sent), buffers.projector_row) > 0
    periods = sent.exposure_us / rig.projector.period_us
    panel.unit.setCurrentIndex(1)
    move_pointer(qtbot, window.live.view, window.live.view.rect().center())
    column, row = panel.column.value(), panel.row.value()
    assert abs(column - 160) < 3
    assert abs(row - 120) < 3
    assert hit[row, column]
    assert number(panel, "direct", 0) == pytest.approx(direct[row, column], rel=1e-3)
    assert number(panel, "direct", 1) == 0
    assert number(panel, "ambient", 0) == pytest.approx(periods * 0.08, abs=1e-4)
    assert number(panel, "ambient", 1) == pytest.approx((1 - periods) * 0.08, abs=1e-4)
    assert number(panel, "direct", 2) == pytest.approx((direct * hit).mean(), abs=1e-4)
    assert number(panel, "direct", 3) == pytest.approx((direct * ~hit).mean(), abs=1e-4)
    total = sum(number(panel, name, place) for name in ("direct", "indirect", "ambient") for place in (2, 3))
    assert total == pytest.approx(direct.mean() + 0.1 + 0.08, abs=1e-3)


def test_the_bars_add_up_to_the_whole_width(window: Window, panel: LightPanel) -> None:
    pieces = panel.bars.pieces()
    for index in (0, 1):
        mine = [(key, area) for at, _, key, area in pieces if at == index]
        assert {key for key, _ in mine} <= {"direct", "indirect", "ambient"}
        for (_, before), (_, after) in pairwise(mine):
            assert after.left() == pytest.approx(before.right(), abs=1e-6)
    left, right = (min(area.left() for *_, area in pieces), max(area.right() for *_, area in pieces))
    assert left < 80
    assert 0 < panel.bars.width() - right < 80
    assert "kept Direct" in panel.bars.accessibleDescription()


def test_the_numbers_follow_the_gate(qtbot: QtBot, window: Window, panel: LightPanel) -> None:
    before = number(panel, "direct", 2)
    window.session.use(window.session.source.presets[-1])  # everything lit
    qtbot.waitUntil(lambda: number(panel, "direct", 3) < 0.05 < before < number(panel, "direct", 2))


def test_a_part_is_switched_off_in_the_live_image(qtbot: QtBot, window: Window, panel: LightPanel) -> None:
    window.session.use(window.session.source.presets[-1])

    def brightness() -> float:
        return float(window.live.frame.image[:, 100:220].mean())

    qtbot.waitUntil(lambda: window.live.frame.stamp.applied == window.session.resolved.sent)
    everything, black = brightness(), window.session.source.camera.info.black_count
    box = panel.switches["direct"]
    assert box.isChecked()
    assert not panel.switches["airlight"].isEnabled()
    assert "no fog" in panel.switches["airlight"].toolTip()
    box.setFocus()
    qtbot.keyClick(box, Qt.Key.Key_Space)
    assert not box.isChecked()
    qtbot.waitUntil(lambda: brightness() < everything / 2)
    room = brightness()
    assert room > black + 1
    glow = panel.switches["indirect"]
    assert not glow.isChecked()  # not asked for by this scene
    glow.setFocus()
    qtbot.keyClick(glow, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: brightness() > room + 10)
    assert number(panel, "direct", 2) > 0  # what arrives does not depend on what is shown


def test_the_pixel_is_typed_too(qtbot: QtBot, panel: LightPanel) -> None:
    for spin, value in ((panel.column, 5), (panel.row, 7)):
        spin.setFocus()
        spin.selectAll()
        qtbot.keyClicks(spin, str(value))
        qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert panel.bars.pairs[0].title == "At column 5, row 7"


def test_what_a_source_has_not_is_said(qtbot: QtBot, window: Window, panel: LightPanel, rig: Rig) -> None:
    source = window.session.source
    assert what_is_missing(source) == ""
    assert what_is_missing(replace(source, rendered=None, buffers=None)).startswith("A camera records the sum")
    plain = make_source(rig)
    window.session.adopt(replace(plain, rendered=None))
    assert panel.note.text().startswith("A camera records the sum")
    assert panel.note.isVisible()
    assert not panel.bars.isVisible()
    window.session.adopt(lit_source(rig))
    assert panel.bars.isVisible()
    assert window.session.source.scene.name in panel.note.text()


def test_a_moving_scene_is_measured_again(qtbot: QtBot, window: Window, panel: LightPanel, rig: Rig) -> None:
    still = np.stack([np.eye(3)] * 2)
    path = KeyFrames(np.array([0.0, 4.0]), np.array([[0.0, 0, 0], [1.0, 0, 0]]), still, (0.0, 0.0, 1.0))
    card = replace(plane("card", (0.0, 0.0, 1.0), (0.4, 0.3), turn()), motion=path)
    scene = Scene("A card", objects=(card,), gates=small_scene(rig).gates)
    made = build_source(Path("c.toml"), rig, scene, Options(rate_hz=60.0), Progress(lambda a, b: None))
    window.session.adopt(made)
    qtbot.waitUntil(lambda: panel.amounts is not None)
    before = panel.amounts.mean()
    qtbot.waitUntil(lambda: panel.amounts.mean()["direct"] != before["direct"])


def test_every_part_looks_different_without_colour_and_without_pattern() -> None:
    assert set(LOOKS) == set(PARTS)
    assert len({look.pattern for look in LOOKS.values()}) == len(PARTS)
    assert len({look.colour for look in LOOKS.values()}) == len(PARTS)


def test_the_bake_is_seen_stopped_and_gone_on_with(qtbot: QtBot, window: Window, rig: Rig) -> None:
    scene = replace(small_scene(rig), indirect=True)
    made = build_source(Path("card.toml"), rig, scene, Options(rate_hz=60.0), Progress(lambda a, b: None))
    bake = made.rendered.baking
    assert bake is not None
    window.session.adopt(made)
    panel = window.docks.bring("light")
    assert isinstance(panel, LightPanel)
    row = panel.bake
    qtbot.waitUntil(row.isVisible)
    bake._goal = replace(bake._goal, error_percent=1e-6)  # so that it does not end meanwhile
    if bake.state.doing == "done":
        bake._state = replace(bake.state, doing="stopped")
        bake.start()
    qtbot.waitUntil(lambda: row.button.isVisible() and row.text.text().startswith("Indirect light:"))
    qtbot.mouseClick(row.button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: "stopped" in row.text.text())
    before = bake.state.paths
    assert row.button.text() == "Go on"
    qtbot.mouseClick(row.button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: bake.state.paths > before)
    assert number(panel, "indirect", 2) >= 0
    window.session.adopt(lit_source(rig))
    qtbot.waitUntil(lambda: not row.isVisible())


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (BakeState("baking", 0.35, 40, error_percent=2.1), "Indirect light: 35 %, noise 2.1 %."),
        (
            BakeState("done", 1.0, 400, error_percent=0.9, stale=True),
            "ready, noise 0.9 %. What moves lights others as at time 0.",
        ),
        (BakeState("failed", why="the bake needs more memory"), "No indirect light: the bake needs more memory."),
    ],
)
def test_how_far_a_bake_is_in_words(state: BakeState, said: str) -> None:
    assert bake_text(state).endswith(said)


def test_a_bake_tells_how_long_it_still_takes_as_measured(qtbot: QtBot) -> None:
    """By the paths that are still needed, whose number changes with the noise that is found."""
    now_s, bake = [0.0], SimpleNamespace(state=BakeState("baking", 0.1, error_percent=4.0, needed=1000.0))
    row = BakeRow(lambda: now_s[0])
    qtbot.addWidget(row)

    def told(seconds: float, **changes: Any) -> str:
        now_s[0], bake.state = seconds, replace(bake.state, **changes)
        row.look(bake)  # type: ignore[arg-type]
        return row.text.text()

    assert told(0.0) == "Indirect light: 10 %, noise 4.0 %."
    assert told(10.0, share=0.2) == "Indirect light: 20 %, noise 4.0 %, 1 min 20 s left."
    assert told(20.0, share=0.15, needed=2000.0) == "Indirect light: 15 %, noise 4.0 %, 2 min 50 s left."
    assert told(30.0, doing="stopped") == "Indirect light: stopped, noise 4.0 %."
    assert told(1000.0, doing="baking") == "Indirect light: 15 %, noise 4.0 %."
    assert told(1010.0, share=0.2) == "Indirect light: 20 %, noise 4.0 %, 2 min 40 s left."


def test_light_of_a_scene_that_another_one_replaced_meanwhile_is_not_told(source: Source) -> None:
    camera, gate = source.rendered, source.presets[0].settings
    assert camera is not None

    def close(share: float, text: str) -> None:
        camera.close()  # as the window does between the two measurements

    with pytest.raises(CancelledError):
        measure(camera, source.rig, gate, Progress(close))
