"""A stream under trial: gates change all the time, and every frame is compared with what its settings make."""

from __future__ import annotations

import gc
import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slopegate.core.gating.gate import exact_upright_line_time
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import GateSettings, LineTimes, ShutterLimits, Steps, gate, quantise
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.stream.stream import Stream

PATIENCE_S = 120.0


def small_rig(width: int = 320, height: int = 240) -> Rig:
    """A camera with few pixels below a projector of 1280 x 720."""
    projector = RigProjector(Lens(1280, 720, 1000.0, 1000.0, 640.0, 360.0), 1e6 / 60)
    focal = width * 25 / 24
    limits = ShutterLimits(LineTimes(10.0, 2000.0, 0.1), Steps(-16667, 33334, 1), Steps(100, 50000, 1))
    return ideal_rig(RigCamera(Lens(width, height, focal, focal, width / 2, height / 2), limits), projector, 0.1)


def scene() -> Scene:
    """Something at every distance, so that no two gates see the same."""
    floor = plane("floor", (0.0, 0.35, 1.5), (3.0, 4.0), turn(80.0))
    wall = plane("wall", (0.0, 0.0, 2.5), (6.0, 4.0), turn(yaw_deg=20.0))
    return Scene("soak", objects=(floor, wall, Sphere("ball", (0.1, 0.0, 1.0), 0.15)), ambient=0.02)


def still_camera(rig: Rig, rate_hz: float, skip: bool = True) -> VirtualCamera:
    """Without noise: what a gate makes of the scene is known to the last count."""
    return VirtualCamera(rig, scene(), rate_hz=rate_hz, noise=False, skip=skip)


def gates(rig: Rig, count: int, seed: int = 7) -> list[GateSettings]:
    """Settings that the rig's camera accepts as they are."""
    random = np.random.default_rng(seed)
    level = exact_upright_line_time(rig.camera.lens, rig.projector)
    exact = (
        gate(level * random.uniform(0.8, 1.2), random.uniform(500, 3500), random.uniform(300, 2500))
        for _ in range(count)
    )
    return [quantise(rig.camera.shutter, settings, rig.projector.period_us) for settings in exact]


def references(rig: Rig, wanted: Sequence[GateSettings]) -> dict[GateSettings, Counts]:
    """What each gate makes, from a camera of its own that leaves nothing out; no two are the same."""
    camera, made = still_camera(rig, math.inf, skip=False), {}
    camera.start()
    for settings in wanted:
        assert camera.configure(settings) == settings
        image = np.zeros((camera.info.height, camera.info.width), np.uint16)
        assert camera.read(image, 1.0) is not None
        made[settings] = image
    camera.close()
    assert len({image.tobytes() for image in made.values()}) == len(wanted)
    return made


@dataclass
class Verdicts:
    """A tap that compares every frame with what its own stamp's settings make."""

    wanted: dict[GateSettings, Counts]
    right: int = 0
    wrong: int = 0
    unsettled: int = 0
    unknown: int = 0
    ended: str = ""

    def wants(self) -> GateSettings | None:
        return None

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        if not stamp.settled:
            self.unsettled += 1
        elif stamp.applied not in self.wanted:
            self.unknown += 1
        elif np.array_equal(image, self.wanted[stamp.applied]):
            self.right += 1
        else:
            self.wrong += 1

    def fail(self, sentence: str) -> None:
        self.ended = sentence


@dataclass(frozen=True)
class Usage:
    """What the process holds."""

    rss_mb: float
    threads: int
    files: int

    @classmethod
    def now(cls) -> Usage:
        with open("/proc/self/statm", encoding="ascii") as file:
            pages = int(file.read().split()[1])
        rss_mb = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
        return cls(round(rss_mb, 1), threading.active_count(), len(os.listdir("/proc/self/fd")))


@dataclass
class Trial:
    """What came of it."""

    tapped: Verdicts
    shown: Verdicts
    submitted: int = 0
    usage: list[tuple[float, Usage]] = field(default_factory=list)
    """After so many seconds."""


def soak(
    camera: Camera,
    wanted: dict[GateSettings, Counts],
    seconds: float,
    say: Callable[[str], None] = lambda _: None,
    seed: int = 3,
    enough: Callable[[Trial], bool] = lambda _: True,
) -> tuple[Trial, Stream]:
    """Stream for so long, and on until `enough` (for `PATIENCE_S` at most), with another gate up to twenty times a
    second; every frame is judged, and those on show twice.

    Their pixels are looked at when they are lent and again when the next one is taken. The stream is closed afterwards.
    """
    random, choices = np.random.default_rng(seed), list(wanted)
    trial = Trial(Verdicts(wanted), Verdicts(wanted))
    stream = Stream(camera)
    stream.attach(trial.tapped)
    stream.submit(choices[0])
    with stream:
        begun_s = time.monotonic()
        change_s = sample_s = begun_s
        last = None
        end_s = begun_s + seconds
        while (now_s := time.monotonic()) < end_s or (not enough(trial) and now_s < end_s + PATIENCE_S):
            if now_s >= change_s:
                stream.submit(choices[random.integers(len(choices))])
                trial.submitted += 1
                change_s = now_s + random.uniform(0.05, 0.5)
            if now_s >= sample_s:
                gc.collect()
                trial.usage.append((round(now_s - begun_s, 1), Usage.now()))
                say(f"{trial.usage[-1]} {stream.counters} right {trial.tapped.right} wrong {trial.tapped.wrong}")
                sample_s = now_s + max(seconds / 60, 0.5)
            frame = stream.newest()
            if frame is not None:
                if last is not None and stream.counters.made % 7 == 0:
                    trial.shown.see(frame.image, frame.stamp)
                last = frame
            assert stream.running, stream.error
            time.sleep(0.004)
        trial.usage.append((round(seconds, 1), Usage.now()))
    return trial, stream


def misattributing(camera: Camera) -> Camera:
    """A camera that stamps every frame with the settings asked for last: what the trial has to find."""

    class Wrong:
        info = camera.info
        start, stop, close = camera.start, camera.stop, camera.close
        last: GateSettings | None = None

        def configure(self, settings: GateSettings) -> GateSettings:
            self.last = camera.configure(settings)
            return self.last

        def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
            stamp = camera.read(buffer, timeout_s)
            return None if stamp is None else replace(stamp, asked=self.last, applied=self.last)

    return Wrong()
