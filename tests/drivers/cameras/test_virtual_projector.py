"""What the projector of a scene promises beyond the contract of all projectors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fake_time import FakeTime
from rigs import LADDER, plain_rig, shutter
from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.contract.projector import ProjectorError

RIG = plain_rig(64, 48, 66.7, shutter(PixelClocks(996.67, LADDER)))
WALL = Scene("a wall", objects=(plane("wall", (0.0, 0.0, 1.2), (4.0, 3.0), turn()),), ambient=0.05)
WHITE = np.full((720, 1280), 255, np.uint8)


def camera(fake: FakeTime) -> VirtualCamera:
    made = VirtualCamera(RIG, WALL, rate_hz=20.0, noise=False, clock=fake.clock, sleep=fake.sleep)
    made.configure(whole_period(RIG, 10.0))
    made.start()
    return made


def take(made: VirtualCamera) -> tuple[NDArray[np.uint16], FrameStamp]:
    frame = np.empty((48, 64), np.uint16)
    stamp = made.read(frame, 5.0)
    assert stamp is not None
    return frame, stamp


def test_a_paced_camera_s_next_frame_certainly_saw_the_pattern() -> None:
    """The scene's clock stands still between frames, so the one that was under way when the pattern changed is over."""
    fake = FakeTime()
    made = camera(fake)
    projector = VirtualProjector(made, fake.clock)
    full, before = take(made)
    projector.load([WHITE // 2])
    showing = projector.show(0)
    assert showing.certain_from_s == fake.now_s
    assert not showing.certainly_in(before, 0.0)
    half, stamp = take(made)
    assert showing.certainly_in(stamp, 0.0)
    lit = full > full.min()
    assert (half[lit] < full[lit]).all()


def test_a_turned_projector_shows_patterns_on_their_heads() -> None:
    pattern = np.zeros((720, 1280), np.uint8)
    pattern[:200, :500] = 255
    frames = []
    for turned, picture in ((False, pattern), (True, pattern), (True, pattern[::-1, ::-1])):
        fake = FakeTime()
        made = camera(fake)
        projector = VirtualProjector(made, fake.clock, turned=turned)
        projector.load([picture])
        projector.show(0)
        frames.append(take(made)[0])
    np.testing.assert_array_equal(frames[0], frames[2])
    assert (frames[0] != frames[1]).any()


def test_white_and_stop_light_the_scene_as_without_a_projector() -> None:
    fake = FakeTime()
    made = camera(fake)
    projector = VirtualProjector(made, fake.clock)
    full = take(made)[0]
    for call in (projector.white, projector.stop):
        projector.black()
        dark = take(made)[0]
        assert 40 < dark.max() < 0.2 * full.max(), "ambient light stays"
        call()
        np.testing.assert_array_equal(take(made)[0], full)


def test_colours_are_refused() -> None:
    projector = VirtualProjector(camera(FakeTime()))
    red = np.zeros((720, 1280, 3), np.uint8)
    projector.load([red])
    red[5, 6, 0] = 1
    with pytest.raises(ProjectorError, match="Pattern 1 has colours: the projector of a scene shows grey"):
        projector.load([WHITE, red])
