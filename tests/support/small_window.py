"""A rig and a scene that are quick to render, for tests of the window."""

from __future__ import annotations

import math
from pathlib import Path

from rigs import check_rig
from slopegate.app.panels.panel import Desk
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Session
from slopegate.app.session.source import Options, Source, build_source
from slopegate.app.views.live_panel import LivePanel
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import plan
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import LineTimes, PixelClocks, gate
from slopegate.core.scene.scene import Preset, Scene
from slopegate.core.scene.shapes import plane, turn


def small_rig(lines: PixelClocks | LineTimes | None = None) -> Rig:
    """The check rig with 320 x 240 pixels."""
    return check_rig(320, lines)


def small_scene(rig: Rig) -> Scene:
    """A wall at 2 m and a card at 1 m before its middle, with gates that light one or both."""
    level = upright_line_time(rig)
    wall = plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn())
    card = plane("card", (0.0, 0.0, 1.0), (0.4, 0.3), turn())
    near, far = (plan(rig, 0.0, z, 0.2, level) for z in (1.0, 2.0))
    gates = (
        Preset("The card", gate(level, round(near.delay_us), round(near.exposure_us))),
        Preset("The wall", gate(level, round(far.delay_us), round(far.exposure_us))),
    )
    return Scene("A card before a wall", objects=(wall, card), gates=gates)


def make_source(rig: Rig, options: Options | None = None) -> Source:
    """The small scene, rendered."""
    quick = options or Options(noise=False, rate_hz=math.inf)
    return build_source(Path("card.toml"), rig, small_scene(rig), quick, Progress(lambda share, text: None))


def make_desk(session: Session) -> Desk:
    """What a panel needs, without a window: its live image takes no frames."""
    live = LivePanel(session)
    live.stop()
    return Desk(session, live)
