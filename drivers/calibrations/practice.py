"""A rig to practise with: virtual, near the one that is believed, and its numbers are not told before the end.

Both lenses, the pose between them, their blur, the clocks of the shutter, its delay and the projector's period differ
from those of the rig file, drawn by a seed. Pictures of a chart go through the renderer as all frames of the bench do:
shadows, fall-off, both lenses' blur, ambient light, light from a wall nearby, and the sensor's noise.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.chart_scene import ChartPose, chart_scene
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.light.lights import asked_parts
from slopegate.core.light.prepare import SeenScene
from slopegate.core.render.render import Progress, Renderer
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, matrix3
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.believed import BelievedCamera, any_gate
from slopegate.drivers.cameras.virtual import FILTERS, VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.capture_run import SceneClock
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, TriggerEdge
from slopegate.drivers.transports.bench import prepared_lights
from slopegate.drivers.transports.shots import CameraShots

AMBIENT: Final = 0.05
"""Light of the room: what a white sheet at 1 m returns of it, beside 1 of the projector's."""


@dataclass(frozen=True)
class PracticeWorld:
    """What makes a practice rig's pictures less than perfect.

    differs: by how much its numbers differ from the believed ones, 1 as usual, 0 not at all. bent: both lenses distort,
    beyond what the believed ones do. blur_px: the least and the most that either lens blurs, as of `RigCamera`. wall: a
    white wall stands beside the chart.
    camera_up, projector_up: pictures come, and are shown, with rows that count against the scan.
    """

    differs: float = 1.0
    bent: bool = True
    blur_px: tuple[float, float] = (0.3, 0.8)
    noise: bool = True
    ambient: float = AMBIENT
    wall: bool = False
    camera_up: bool = False
    projector_up: bool = False


def hidden_rig(believed: Rig, seed: int, world: PracticeWorld | None = None) -> Rig:
    """A rig near the believed one, in scan order: what a rig file with a few mistakes describes, by a seed."""
    world = world or PracticeWorld()
    draw = np.random.default_rng((seed, 0x51DE))
    camera = _hidden_lens(believed.camera.lens, draw, world, 0.12)
    projector = _hidden_lens(believed.projector.lens, draw, world, 0.05)
    blurs = draw.uniform(*world.blur_px, 2)
    turned = cv2.Rodrigues(np.radians(world.differs * draw.uniform(-2, 2, 3)))[0] @ believed.rotation
    aside = world.differs * draw.uniform(-0.04, 0.04, 3) * believed.baseline_m
    x, y, z = np.array(believed.projector_offset_m) + aside
    shutter = believed.camera.shutter
    line = shutter.line
    stretch, late, period, active = world.differs * draw.uniform(-1, 1, 4) * np.array([0.005, 300.0, 0.001, 0.02])
    if isinstance(line, PixelClocks):
        line = replace(line, clocks_per_line=line.clocks_per_line * (1 + float(stretch)))
    return replace(
        believed,
        camera=RigCamera(
            camera,
            replace(shutter, line=line, delay_offset_us=shutter.delay_offset_us + float(late)),
            float(blurs[0]),
        ),
        projector=RigProjector(
            projector,
            believed.projector.period_us * (1 + float(period)),
            min(1.0, believed.projector.active_fraction * (1 + float(active))),
            float(blurs[1]),
        ),
        projector_offset_m=(float(x), float(y), float(z)),
        projector_rotation=matrix3(turned),
        name=f"Practice rig {seed}",
        calibration=None,
    )


def _hidden_lens(lens: Lens, draw: np.random.Generator, world: PracticeWorld, bend: float) -> Lens:
    scale, shape = draw.uniform(-0.04, 0.04), draw.uniform(-0.005, 0.005)
    column, row = draw.uniform(-0.02, 0.02, 2) * lens.width
    bends = draw.uniform(-1, 1, 5) * np.array([bend, bend / 3, 0.0015, 0.0015, bend / 10])
    bent = np.zeros(5)
    bent[: len(lens.distortion)] = lens.distortion[:5]
    distortion = bent + world.differs * bends if world.bent else bent
    return replace(
        lens,
        fx=lens.fx * (1 + world.differs * scale),
        fy=lens.fy * (1 + world.differs * (scale + shape)),
        cx=lens.cx + world.differs * column,
        cy=lens.cy + world.differs * row,
        distortion=tuple(distortion.tolist()) if distortion.any() else (),
    )


class PracticeRig:
    """A hidden rig that looks at a chart which can be moved.

    `camera` is its camera, as whoever believes in the rig file meets it, `projector` its projector. `truth` is for the
    end.
    """

    def __init__(
        self,
        believed: Rig,
        chart: Chart,
        seed: int,
        world: PracticeWorld | None = None,
        *,
        live: bool = False,
        sensor: SensorModel | None = None,
        progress: Progress | None = None,
    ) -> None:
        """live: frames come at the pace of a camera; else as fast as they can be made. The chart is not there yet.

        sensor: the camera's; None: one whose gain suits every pose.
        """
        self.believed, self.chart, self._world, self._seed = believed, chart, world or PracticeWorld(), seed
        self._true = hidden_rig(believed, seed, self._world)
        self._clock = None if live else SceneClock()
        self._sensor = sensor
        self.camera = PracticeCamera(self._look_at(None, progress))
        self.projector = VirtualProjector(self.camera, self._now, self._world.projector_up)

    @property
    def truth(self) -> Rig:
        """The hidden rig, in scan order."""
        return self._true

    @property
    def world(self) -> PracticeWorld:
        """What makes its pictures less than perfect."""
        return self._world

    def move(self, pose: ChartPose, progress: Progress | None = None) -> None:
        """Hold the chart at a pose in the axes of the true camera; the next frame sees it there.

        Raises what a bake raises where there is a wall, and Cancelled when progress returns False.
        """
        self.camera.see(self._look_at(pose, progress))

    def shots(self) -> CameraShots:
        """Frames of the camera, which must be started and used by nobody else."""
        return CameraShots(self.camera, 0.0, self.camera.number_frames_from)

    def _now(self) -> float:
        return time.monotonic() if self._clock is None else self._clock.now()

    def _look_at(self, pose: ChartPose | None, progress: Progress | None) -> BelievedCamera:
        world, rig = self._world, any_gate(self._true)
        scene = _scene(self._true, self.chart, pose, world)
        renderer = Renderer(rig, scene)
        buffers, _ = renderer.at(0.0)
        view = SeenScene(rig, scene, buffers, FILTERS["mono12"])
        inner = VirtualCamera(
            rig,
            scene,
            self._sensor or (SensorModel() if pose is None else None),
            seed=self._seed,
            clock=self._now,
            sleep=None if self._clock is None else self._clock.sleep,
            noise=world.noise,
            renderer=renderer,
            parts=prepared_lights(view, asked_parts(scene), progress, keep=False),
        )
        return BelievedCamera(inner, self._true.camera.shutter, self.believed, world.camera_up)


def _scene(rig: Rig, chart: Chart, pose: ChartPose | None, world: PracticeWorld) -> Scene:
    if pose is None:
        return replace(_EMPTY, ambient=world.ambient)
    held_there = chart_scene(rig, chart, pose, wall=world.wall, ambient=world.ambient)
    return replace(held_there, name=_EMPTY.name)


_EMPTY: Final = Scene("Practice")


class PracticeCamera(Camera):
    """The camera of a practice rig: the same one whatever it looks at."""

    def __init__(self, now: BelievedCamera) -> None:
        self._now, self._lock = now, threading.RLock()
        self._running, self._covered, self._sequence = False, False, 0
        self._asked: GateSettings | None = None
        self._rows: tuple[int, int] | None = None
        self._edge: TriggerEdge = "rising"
        self._pattern: Singles | None = None

    def see(self, other: BelievedCamera) -> None:
        """Look at something else from now on, with gate, rows and pattern as they are."""
        with self._lock:
            before, self._now = self._now, other
            if self._asked is not None:
                other.configure(self._asked)
            if self._rows is not None:
                other.set_rows(*self._rows)
            other.cover(self._covered)
            if self._edge != "rising":
                other.trigger_on(self._edge)
            other.light_with(self._pattern)
            if self._running:
                other.start()
        before.close()

    @property
    def info(self) -> CameraInfo:
        """Fixed facts."""
        return self._now.info

    @property
    def rig(self) -> Rig:
        """The rig that is believed."""
        return self._now.rig

    def configure(self, settings: GateSettings) -> GateSettings:
        """As `BelievedCamera`."""
        with self._lock:
            self._asked = settings
            return self._now.configure(settings)

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """As `BelievedCamera`."""
        with self._lock:
            self._rows = first, last
            return self._now.set_rows(first, last)

    def cover(self, covered: bool) -> None:
        """As `BelievedCamera`."""
        with self._lock:
            self._covered = covered
            self._now.cover(covered)

    def trigger_on(self, edge: TriggerEdge) -> None:
        """As `BelievedCamera`."""
        with self._lock:
            self._edge = edge
            self._now.trigger_on(edge)

    def light_with(self, pattern: Singles | None) -> None:
        """As `BelievedCamera`."""
        with self._lock:
            self._pattern = pattern
            self._now.light_with(pattern)

    def number_frames_from(self, sequence: int) -> None:
        """As `BelievedCamera`."""
        self._now.number_frames_from(sequence)

    def start(self) -> None:
        """Begin to make frames."""
        with self._lock:
            self._running = True
            self._now.start()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The next frame of what it looks at now; frames are numbered on."""
        with self._lock:
            stamp = self._now.read(buffer, timeout_s)
            if stamp is None:
                return None
            self._sequence += 1
            return replace(stamp, sequence=self._sequence - 1)

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._running = False
        self._now.stop()

    def close(self) -> None:
        """Stop and let the scene go."""
        self.stop()
        self._now.close()
