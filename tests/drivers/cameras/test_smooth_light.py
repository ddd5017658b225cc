"""What the virtual camera's frames show of the parts of light that have no gate test of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigs import plain_rig, shutter
from slopegate.core.exposure.sensor import SensorModel, mono
from slopegate.core.gating.gate import RowWindows, row_windows, weights
from slopegate.core.light.part import PartName
from slopegate.core.render.render import Buffers, Region, render
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.settings import PixelClocks, gate
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.drivers.cameras.virtual import VirtualCamera

CLOCKS = PixelClocks(10 * 996.66866, (50.0, 76.0, 78.0, 80.0, 108.0))
RIG = plain_rig(160, 120, 500 / 3, shutter(CLOCKS))
SENSOR = SensorModel(counts_per_unit=1000.0)
ON_BALL, BEHIND = (gate(CLOCKS.line_time_us(78), delay, 700.0) for delay in (2400.0, 1500.0))


def scene(motion: KeyFrames | None = None) -> Scene:
    corners = np.array([[-2, -2, 1.3], [2, -2, 1.3], [2, 2, 1.3], [-2, 2, 1.3]], float)
    wall = Mesh("wall", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (0.5, 0.3, 0.1))
    return Scene("room", objects=(wall, Sphere("ball", (0.0, 0.0, 1.0), 0.15, motion=motion)), ambient=0.1)


class Glow:
    """Light from everywhere: 0.2 for a whole period, times the share of the projector's rows that a row records."""

    def __init__(self, name: PartName = "airlight", strength: float = 0.2) -> None:
        self.name: PartName = name
        self.strength = strength
        self.asked, self.followed = 0, 0

    def of(self, windows: RowWindows) -> Singles:
        rows = RIG.projector.lens.height
        low, high = np.clip(windows.low, 0, rows), np.clip(windows.high, 0, rows)
        share = windows.outside + (windows.inside - windows.outside) * (high - low) / rows
        return np.repeat((self.strength * share).astype(np.float32)[:, None], RIG.camera.lens.width, axis=1)

    def add(self, windows: RowWindows, out: Singles) -> None:
        self.asked += 1
        out += self.of(windows)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        self.followed += 1

    def light_with(self, pattern: Singles | None) -> None:
        """Alike whatever the projector shows."""


def running(made: Scene, **options: object) -> VirtualCamera:
    camera = VirtualCamera(RIG, made, SENSOR, rate_hz=math.inf, noise=False, **options)  # type: ignore[arg-type]
    camera.start()
    camera.configure(ON_BALL)
    return camera


def take(camera: VirtualCamera) -> Counts:
    image = np.zeros((120, 160), np.uint16)
    assert camera.read(image, 5.0) is not None
    return image


def radiance(camera: VirtualCamera, glow: float) -> Singles:
    buffers, windows = render(RIG, scene()), row_windows(RIG, ON_BALL)
    direct = weights(windows, buffers.projector_row) * mono(buffers.direct)
    return direct + np.float32(700 / RIG.projector.period_us) * mono(buffers.ambient) + glow * Glow().of(windows)


def assert_shows(image: Counts, light: Singles) -> None:
    """Half a count for the rounding to whole ones, and half a step of 1/8 count for each of the two planes."""
    off = np.abs(image - (1000.0 * light + 40.0))
    assert off.max() <= 0.5 + 0.125 + 1e-3


def test_a_part_that_is_shown_adds_its_light_to_the_frame() -> None:
    camera = running(scene())
    clear = take(camera)
    assert_shows(clear, radiance(camera, 0.0))
    camera.smooth.show({"direct", "ambient", "airlight"})
    np.testing.assert_array_equal(take(camera), clear)  # none is ready
    camera.smooth.put(Glow())
    assert_shows(take(camera), radiance(camera, 1.0))
    camera.smooth.put(Glow(strength=0.4))
    assert_shows(take(camera), radiance(camera, 2.0))
    camera.smooth.show({"direct", "ambient"})
    np.testing.assert_array_equal(take(camera), clear)


def test_direct_and_ambient_light_can_be_hidden_too() -> None:
    camera = running(scene())
    camera.smooth.put(Glow())
    camera.smooth.show({"airlight"})
    assert_shows(take(camera), 1.0 * Glow().of(row_windows(RIG, ON_BALL)))
    camera.smooth.show({"ambient"})
    assert_shows(take(camera), np.float32(700 / RIG.projector.period_us) * mono(render(RIG, scene()).ambient))
    camera.smooth.show(())
    assert (take(camera) == 40).all()


def test_a_gate_at_rest_asks_a_part_once() -> None:
    camera = running(scene())
    glow = Glow()
    camera.smooth.put(glow)
    camera.smooth.show({"direct", "airlight"})
    for _ in range(4):
        take(camera)
    assert glow.asked == 1
    camera.configure(BEHIND)
    take(camera)
    assert glow.asked == 2


def test_a_part_that_is_hidden_is_not_asked() -> None:
    camera = running(scene())
    glow = Glow()
    camera.smooth.put(glow)
    take(camera)
    assert glow.asked == 0


def test_a_covered_lens_sees_no_fog_either() -> None:
    camera = running(scene())
    camera.smooth.put(Glow())
    camera.smooth.show({"direct", "airlight"})
    camera.cover(True)
    assert (take(camera) == 40).all()


def test_the_parts_of_a_frame_add_up_to_it() -> None:
    camera = running(scene())
    camera.smooth.put(Glow())
    camera.smooth.put(Glow("indirect", 0.1))
    camera.smooth.show({"direct", "airlight", "indirect", "ambient"})
    image = take(camera)
    found = camera.light_by_part(ON_BALL)
    assert list(found) == ["direct", "airlight", "indirect", "ambient"]
    assert_shows(image, sum(found.values(), np.zeros((120, 160), np.float32)))


@pytest.mark.parametrize("skip", [True, False])
def test_parts_follow_what_moves(skip: bool) -> None:
    times, nowhere = np.array([0.0, 1.0]), np.stack([np.eye(3)] * 2)
    motion = KeyFrames(times, np.array([[-0.2, 0, 0], [0.2, 0, 0]]), nowhere, (0.0, 0.0, 0.0), loop=False)
    moving = scene(motion)
    now = 0.0
    camera = running(moving, clock=lambda: now, skip=skip)
    glow = Glow()
    camera.smooth.put(glow)
    camera.smooth.show({"direct", "airlight", "ambient"})
    take(camera)
    before = glow.followed
    now = 0.5
    image = take(camera)
    assert glow.followed > before
    buffers, windows = render(RIG, moving, 0.5), row_windows(RIG, ON_BALL)
    light = weights(windows, buffers.projector_row) * mono(buffers.direct) + Glow().of(windows)
    light += np.float32(700 / RIG.projector.period_us) * mono(buffers.ambient)
    assert_shows(image, light)


def test_the_gain_leaves_room_for_the_light_of_the_parts() -> None:
    camera = VirtualCamera(RIG, scene(), rate_hz=math.inf, noise=False)
    camera.smooth.put(Glow(strength=3.0))
    camera.smooth.show({"direct", "airlight", "ambient"})
    camera.start()
    assert 0.7 * 4095 < np.percentile(take(camera), 99.5) < 0.82 * 4095
