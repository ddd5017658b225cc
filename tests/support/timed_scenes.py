"""Planes before a small rig whose timing is hidden, for calibrations of it through the virtual camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigs import check_rig
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.rig.calibration import TIMING
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.rig.uncertainty import numbers_of
from slopegate.core.rig.variants import in_scan_order
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.calibrations.plane_gates import TimingOutcome
from slopegate.drivers.calibrations.timing_bench import TimingBench
from slopegate.drivers.cameras.faults import Faults

JITTER = Faults(jitter_us=5.0)
WIDTH = 160


@dataclass(frozen=True)
class HiddenPlane:
    """A plane, the rig that really looks at it, in scan order, and the one that is believed, as pictures come."""

    true: Rig
    believed: Rig
    camera_up: bool
    projector_up: bool
    target: FlatTarget
    scene: Scene

    def bench(self, seed: int = 0, faults: Faults | None = JITTER, believed: Rig | None = None) -> TimingBench:
        """Its camera and projector."""
        return TimingBench(
            self.scene, self.true, believed or self.believed, seed=seed, faults=faults,
            camera_up=self.camera_up, projector_up=self.projector_up,
        )  # fmt: skip


def hidden_plane(seed: int, width: int = WIDTH, fog: Fog | None = None) -> HiddenPlane:
    """A plane 0.8 to 1.2 m away, tilted each way, before the check rig, whose timing is another one by the seed."""
    draw = np.random.default_rng((seed, 0x71))
    rig = check_rig(width)
    line, shutter = rig.camera.shutter.line, rig.camera.shutter
    assert isinstance(line, PixelClocks)
    clocks = line.clocks_per_line * (1 + draw.uniform(-0.01, 0.01))
    true = replace(
        rig,
        camera=replace(
            rig.camera,
            shutter=replace(
                shutter,
                line=replace(line, clocks_per_line=clocks),
                delay_offset_us=float(draw.uniform(-8000, 8000)),
            ),
        ),
        projector=replace(
            rig.projector,
            active_fraction=float(draw.uniform(0.88, 0.96)),
            period_us=rig.projector.period_us * (1 + float(draw.uniform(-5e-4, 5e-4))),
        ),
    )
    camera_up, projector_up = (bool(one) for one in draw.random(2) < 0.5)
    facing = turn(*(float(one) for one in draw.uniform(-1, 1, 3) * (15, 25, 5)))
    middle = np.array([0.0, 0.0, draw.uniform(0.8, 1.2)])
    scene = Scene("A plane", objects=(plane("plane", tuple(middle), (5.0, 4.0), facing),), ambient=0.02, fog=fog)
    slopes = facing[:, 2] / float(facing[:, 2] @ (middle - true.camera_centre_m))
    # The axes of pictures that come turned by half a turn are turned with them.
    x, y, one = (slopes * (-1, -1, 1) if camera_up else slopes).tolist()
    believed = in_scan_order(rig, camera_up, projector_up)
    return HiddenPlane(true, believed, camera_up, projector_up, FlatTarget((x, y, one)), scene)


@dataclass(frozen=True, eq=False)
class TimingMisses:
    """By how much an outcome is off, of `TIMING`, the same in standard errors, and whether directions are right."""

    off: dict[str, float]
    sigmas: dict[str, float]
    directions: bool


def misses(outcome: TimingOutcome, hidden: HiddenPlane) -> TimingMisses:
    """How far an outcome is off."""
    known = outcome.rig.calibration
    assert known is not None
    gaps = (numbers_of(outcome.rig) - numbers_of(hidden.true))[-len(TIMING) :]
    gaps[-1] = math.remainder(gaps[-1], hidden.true.projector.period_us)
    off = dict(zip(TIMING, gaps.tolist(), strict=True))
    found = (outcome.timing.camera == "up", outcome.timing.projector == "up")
    sigmas = {name: gap / known.standard_errors[name] for name, gap in off.items()}
    return TimingMisses(off, sigmas, found == (hidden.camera_up, hidden.projector_up))
