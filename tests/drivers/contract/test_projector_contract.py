"""One suite for every projector: a new one is done when it passes. `KINDS` says how each is made."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

import two_screens
from rigs import LADDER, plain_rig, shutter
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.patterns import LIT, Raster, even
from slopegate.core.rig.rig import Lens
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.contract.projector import Projector, ProjectorError, Showing

HERE = str(Path(__file__))
PATIENCE_S = 30.0
T = TypeVar("T")


@dataclass
class Wall:
    """A projector and what it shows on its wall."""

    projector: Projector
    do: Callable[[Callable[[], Any]], Any]
    """Calls in a thread from which the projector may be called, and returns or raises what the call does."""
    picture: Callable[[], Bytes]
    """What is on the wall now (height, width)."""

    def shows(self, wanted: Bytes) -> bool:
        """Whether this picture comes to the wall."""
        end = time.monotonic() + PATIENCE_S
        while not (found := np.array_equal(self.picture(), wanted)) and time.monotonic() < end:
            time.sleep(0.002)
        return found


def virtual(request: pytest.FixtureRequest) -> Wall:
    """A virtual camera that sees every pixel of a small projector on a white wall, and tells its level."""
    rig = plain_rig(64, 48, 66.7, shutter(PixelClocks(996.67, LADDER)))
    rig = replace(rig, projector=replace(rig.projector, lens=Lens(20, 15, 30, 30, 10, 7.5)))
    scene = Scene("a wall", objects=(plane("wall", (0.0, 0.0, 1.2), (4.0, 3.0), turn()),))
    camera = VirtualCamera(rig, scene, SensorModel(counts_per_unit=3000.0), rate_hz=math.inf, noise=False)
    camera.configure(whole_period(rig, 10.0))
    camera.start()
    request.addfinalizer(camera.close)
    frame = np.empty((48, 64), np.uint16)

    def light() -> Singles:
        assert camera.read(frame, PATIENCE_S) is not None
        return frame.astype(np.float32) - np.float32(camera.info.black_count)

    full = light()
    assert camera.buffers is not None
    rows, columns = (place.astype(int) for place in (camera.buffers.projector_row, camera.buffers.projector_column))
    places = np.full((15, 20), -1)
    lit = full > 0
    places[rows[lit], columns[lit]] = np.flatnonzero(lit)
    assert (places >= 0).all()

    def picture() -> Bytes:
        share = np.zeros_like(full)
        np.divide(light(), full, out=share, where=lit)
        return np.rint(LIT * share.reshape(-1)[places]).astype(np.uint8)

    return Wall(VirtualProjector(camera), lambda task: task(), picture)


def screen(request: pytest.FixtureRequest) -> Wall:
    """The window's projector on the second of two virtual screens."""
    if not two_screens.inside():
        pytest.skip("run inside by the last test of this file")
    from PySide6.QtGui import QGuiApplication

    from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector

    qtbot = request.getfixturevalue("qtbot")
    window = ProjectorWindow()
    request.addfinalizer(window.close)
    window.cover(next(one for one in QGuiApplication.screens() if one.name() == two_screens.PROJECTOR[0]))

    def do(task: Callable[[], T]) -> T:
        """The screen draws in this thread, so the projector is called in another."""
        answers: list[T] = []
        errors: list[Exception] = []

        def work() -> None:
            try:
                answers.append(task())
            except Exception as error:
                errors.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        qtbot.waitUntil(lambda: not thread.is_alive(), timeout=round(1000 * PATIENCE_S))
        if errors:
            raise errors[0]
        return answers[0]

    def picture() -> Bytes:
        return two_screens.screen_pixels(two_screens.PROJECTOR)[..., 0].copy()

    return Wall(ScreenProjector(window, 3), do, picture)


KINDS: dict[str, Callable[[pytest.FixtureRequest], Wall]] = {"virtual": virtual, "screen": screen}


@pytest.fixture(params=KINDS)
def wall(request: pytest.FixtureRequest) -> Wall:
    return KINDS[request.param](request)


def noise(raster: Raster, seed: int) -> Bytes:
    return np.random.default_rng(seed).integers(0, 256, (raster.height, raster.width), dtype=np.uint8)


def test_facts_are_there(wall: Wall) -> None:
    facts = wall.projector.info
    assert facts.name
    assert facts.raster.width > facts.raster.height > 1
    assert 1000 < facts.period_us < 100_000


def test_every_loaded_pattern_comes_to_the_wall_level_by_level(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    pictures = [noise(raster, seed) for seed in range(3)]
    wall.do(lambda: projector.load(pictures))
    for index in (2, 0, 1, 1):
        showing = wall.do(lambda index=index: projector.show(index))
        assert showing.index == index
        assert wall.shows(pictures[index]), index


def test_black_and_white_need_no_pattern(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    for flood, level in ((projector.black, 0), (projector.white, LIT), (projector.black, 0)):
        assert wall.do(flood).index == -1
        assert wall.shows(even(raster, level)), level


def test_a_grey_picture_of_three_channels_is_shown_as_it_is(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    picture = noise(raster, 4)
    wall.do(lambda: projector.load([np.repeat(picture[:, :, None], 3, axis=2)]))
    wall.do(lambda: projector.show(0))
    assert wall.shows(picture)


def test_what_is_loaded_takes_the_place_of_what_was(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    wall.do(lambda: projector.load([noise(raster, 1), noise(raster, 2)]))
    wall.do(lambda: projector.load([noise(raster, 3)]))
    wall.do(lambda: projector.show(0))
    assert wall.shows(noise(raster, 3))
    with pytest.raises(IndexError, match="pattern 1 was not loaded: there are 1"):
        wall.do(lambda: projector.show(1))


@pytest.mark.parametrize("index", [-1, 1])
def test_a_pattern_that_was_not_loaded_is_the_callers_fault(wall: Wall, index: int) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    with pytest.raises(IndexError, match=f"pattern {index} was not loaded: there are 0"):
        wall.do(lambda: projector.show(index))
    wall.do(lambda: projector.load([noise(raster, 1)]))
    with pytest.raises(IndexError, match=f"pattern {index} was not loaded: there are 1"):
        wall.do(lambda: projector.show(index))


def test_pictures_of_another_size_are_refused_and_those_before_stay(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    wall.do(lambda: projector.load([noise(raster, 1)]))
    wrong = noise(Raster(raster.width - 1, raster.height), 2)
    with pytest.raises(ProjectorError, match=f"Pattern 1 has {raster.width - 1} x {raster.height} pixels and the proj"):
        wall.do(lambda: projector.load([noise(raster, 2), wrong]))
    with pytest.raises(ProjectorError, match="Pattern 0 has uint16 pixels"):
        wall.do(lambda: projector.load([noise(raster, 2).astype(np.uint16)]))
    wall.do(lambda: projector.show(0))
    assert wall.shows(noise(raster, 1))


def test_times_of_showing_rise_on_the_clock_of_frames(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    wall.do(lambda: projector.load([noise(raster, 1), noise(raster, 2)]))
    calls = (lambda: projector.show(0), projector.white, lambda: projector.show(1), projector.black)

    def timed(call: Callable[[], Showing]) -> tuple[float, Showing, float]:
        return time.monotonic(), call(), time.monotonic()

    found = [wall.do(lambda call=call: timed(call)) for call in calls]
    for asked_s, showing, returned_s in found:
        assert asked_s <= showing.drawn_s <= returned_s
        assert showing.certain_from_s >= showing.drawn_s
    for (_, before, _), (_, after, _) in pairwise(found):
        assert before.drawn_s < after.drawn_s


def test_after_stop_nothing_is_shown_and_that_is_said(wall: Wall) -> None:
    projector, raster = wall.projector, wall.projector.info.raster
    wall.do(lambda: projector.load([noise(raster, 1)]))
    wall.do(lambda: projector.show(0))
    wall.do(projector.stop)
    for call in (lambda: projector.show(0), projector.black, projector.white):
        with pytest.raises(ProjectorError, match=re.escape(projector.info.name)):
            wall.do(call)
    wall.do(projector.stop)


@pytest.mark.timeout(900)
def test_the_windows_projector_on_two_screens() -> None:
    said = two_screens.run_inside(HERE, "-k", "screen")
    found = re.search(r"(\d+) passed", said)
    assert found is not None, said
    assert int(found[1]) >= 9
