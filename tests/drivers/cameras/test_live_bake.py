"""The bake beside a running camera: shown at once, refined, stopped, gone on with, kept."""

from __future__ import annotations

import gc
import math
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigs import plain_rig, shutter
from slopegate.core.light.bake import MOST_PATHS
from slopegate.core.light.part import LightPart
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.drivers.cameras import live_bake
from slopegate.drivers.cameras.live_bake import LiveBake
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.scenes.bakes import BakeGoal
from waiting import until

RIG = plain_rig(48, 36, 50.0, shutter(PixelClocks(10 * 996.66866, (78.0,))))


def corner() -> Scene:
    floor = plane("floor", (0.0, 0.3, 1.2), (2.0, 1.2), turn(tilt_deg=90.0), Finish((0.7, 0.7, 0.7)))
    wall = plane("wall", (0.0, 0.0, 1.6), (2.0, 1.2), turn(), Finish((0.6, 0.6, 0.6)))
    return Scene("corner", objects=(floor, wall, Sphere("ball", (0.1, 0.1, 1.2), 0.1)), indirect=True)


@pytest.fixture
def shown() -> list[LightPart]:
    return []


@pytest.fixture
def baking(shown: list[LightPart], tmp_path: Path) -> Iterator[LiveBake]:
    made = LiveBake(RIG, corner(), "mono", shown.append, BakeGoal(error_percent=1.0), tmp_path)
    yield made
    made.close()


def test_the_first_pass_is_shown_and_then_refined(baking: LiveBake, shown: list[LightPart], tmp_path: Path) -> None:
    baking.begin(lambda share: True)
    assert len(shown) == 1
    first = baking.state
    assert first.paths > 0
    assert 1.0 < first.error_percent < 50
    baking.start()
    until(lambda: baking.state.doing == "done")
    assert baking.state.error_percent <= 1.0
    assert baking.state.paths > first.paths
    assert baking.state.share == 1.0
    assert len(shown) > 1
    baking.close()
    again = LiveBake(RIG, corner(), "mono", shown.append, BakeGoal(error_percent=1.0), tmp_path)
    again.begin(lambda share: True)
    assert again.state.doing == "done"
    assert again.state.paths == baking.state.paths


def test_how_far_it_is_is_counted_in_paths(baking: LiveBake) -> None:
    baking.begin(lambda share: True)
    baking._goal = replace(baking._goal, error_percent=1e-6)
    told = baking._tell(2 * baking.state.paths, 0.75)
    assert told
    assert baking.state.needed == MOST_PATHS
    assert baking.state.share == pytest.approx(1.5 * baking.state.paths / MOST_PATHS)
    baking._goal = replace(baking._goal, error_percent=baking.state.error_percent / 3)
    baking._tell(2 * baking.state.paths, 0.75)
    assert baking.state.needed == pytest.approx(9 * baking.state.paths)
    assert baking.state.share == pytest.approx(1 / 6)
    seen: list[float] = []

    def far() -> bool:
        state = baking.state
        if state.doing == "baking":
            seen.append(state.share * state.needed / state.paths)
        return state.doing == "done"

    baking.start()
    until(far)
    assert max(seen) < 2.1, "a pass traces at most as many paths as there are"


def test_stopped_it_keeps_what_it_has_and_goes_on_when_told(tmp_path: Path) -> None:
    baking = LiveBake(RIG, corner(), "mono", lambda part: None, BakeGoal(error_percent=1e-6), tmp_path)
    baking.begin(lambda share: True)
    baking.start()
    until(lambda: baking.state.paths > 64)
    baking.stop()
    until(lambda: baking.state.doing == "stopped")
    baking.close()
    paths = baking.state.paths
    assert list(tmp_path.glob("*.npz"))
    baking.start()
    until(lambda: baking.state.paths > paths)
    baking.close()


def test_opening_can_be_cancelled(baking: LiveBake, shown: list[LightPart]) -> None:
    with pytest.raises(Cancelled):
        baking.begin(lambda share: False)
    assert shown == []
    baking.start()
    assert baking.state.doing == "beginning"


def test_a_lack_of_memory_is_told_and_the_camera_runs_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise InputError("the bake of indirect light needs 99 MB of memory, and 9 MB are free")

    monkeypatch.setattr(live_bake, "begin_bake", refuse)
    camera = VirtualCamera(RIG, corner(), rate_hz=math.inf, bake=True)
    camera.start()
    assert camera.read(np.zeros((36, 48), np.uint16), 5.0) is not None
    assert camera.baking is not None
    assert camera.baking.state.doing == "failed"
    assert "99 MB" in camera.baking.state.why
    camera.close()


def frames(camera: VirtualCamera) -> Counts:
    image = np.zeros((36, 48), np.uint16)
    assert camera.read(image, 5.0) is not None
    return image


def test_a_camera_shows_what_is_baked_and_a_plain_scene_has_no_bake() -> None:
    camera = VirtualCamera(RIG, corner(), rate_hz=math.inf, noise=False, bake=True)
    camera.start()
    everything = frames(camera).astype(int)
    assert camera.smooth.ready == ("direct", "indirect", "ambient")
    camera.smooth.show({"direct", "ambient"})
    plain = frames(camera).astype(int)
    assert (everything >= plain - 1).all()
    assert (everything - plain).mean() > 1
    camera.close()
    assert VirtualCamera(RIG, replace(corner(), indirect=False), bake=True).baking is None
    assert VirtualCamera(RIG, corner()).baking is None


def test_where_things_move_the_bake_says_that_it_is_stale() -> None:
    still = LiveBake(RIG, corner(), "mono", lambda part: None)
    floor, wall, ball = corner().objects
    times, turns = np.array([0.0, 1.0]), np.stack([np.eye(3)] * 2)
    ball = replace(ball, motion=KeyFrames(times, np.array([[0.0, 0, 0], [0.1, 0, 0]]), turns, (0.0, 0.0, 0.0)))
    moving = LiveBake(RIG, replace(corner(), objects=(floor, wall, ball)), "mono", lambda part: None)
    assert (still.state.stale, moving.state.stale) == (False, True)


def test_a_closed_camera_is_gone_with_all_its_light_at_once() -> None:
    """Without a search for what holds only each other, which may be minutes away."""
    gc.collect()
    gc.disable()
    try:
        camera = VirtualCamera(RIG, corner(), rate_hz=math.inf, noise=False, bake=True)
        camera.start()
        frames(camera)
        kept = weakref.ref(camera), weakref.ref(camera.baking)
        camera.close()
        del camera
        until(lambda: [one() for one in kept] == [None, None])
    finally:
        gc.enable()
