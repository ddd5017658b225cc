"""What leaving work out saves, kind by kind, before a sparse and a crowded scene: the same work with and without.

Each function returns two variants, the program's own way first; both make the same frames or buffers, to the last bit,
which the tests of skipping prove.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import Final

import numpy as np

from slopegate.app.bench.scaling import clutter, sparse
from slopegate.app.bench.subject import scaled_rig
from slopegate.app.bench.variant import Variant
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.sensor import Plates, SensorModel, auto_gain, expose_fast, mono, noise_pool
from slopegate.core.gating.gate import lit_rows, row_windows, seen_reach, upright_line_time
from slopegate.core.gating.plan import plan
from slopegate.core.gating.slices import occupied_times, tile_times
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera

Group = tuple[tuple[int, int], list[Variant]]
"""Rows and columns of the frame, and ways to make it, to be compared with the first."""

Frame = Callable[[int], object]

CROWD: Final = 100
TILT_DEG, DISTANCE_M, THICKNESS_M = 60.0, 1.05, 0.05
SWEEP_FRAMES: Final = 24


def ways_to_skip(rig: Rig, moving: tuple[Rig, Scene], width: int) -> Iterator[Group]:
    """All kinds of skipping with a camera of this many columns; `moving`: a crowded scene in which something moves."""
    small = scaled_rig(rig, width)
    lens = small.camera.lens
    shape = lens.height, lens.width
    for scene in (sparse(), clutter(CROWD)):
        view = SkipView(small, scene)
        yield shape, view.tiles()
        yield shape, view.rows()
        yield shape, view.unchanged()
        yield shape, view.sweep()
        yield shape, rays(small, scene)
    yield shape, moved(small, passing_ball())
    yield shape, moved(scaled_rig(moving[0], width), moving[1])


def rays(rig: Rig, scene: Scene) -> list[Variant]:
    """Rays cast only where it is not known beforehand what they meet."""
    return [
        _slow(f"{scene.name}: cast what is not known", lambda index: render(rig, scene)),
        _slow(f"{scene.name}: cast every ray", lambda index: render(rig, scene, skip=False)),
    ]


def moved(rig: Rig, scene: Scene) -> list[Variant]:
    """Only what moved rendered anew, twentieths of a second apart; and nothing, while nothing does."""
    walking, standing = Renderer(rig, scene), Renderer(rig, scene)
    times_s = (index / 20 for index in count(1))
    return [
        _slow(f"{scene.name}: render what moved", lambda index: walking.at(next(times_s))),
        _slow(f"{scene.name}: render everything", lambda index: render(rig, scene, next(times_s))),
        _slow(f"{scene.name}: nothing moved", lambda index: standing.at(0.0)),
    ]


class SkipView:
    """A scene, a leaning gate through its middle, and what makes frames of it."""

    def __init__(self, rig: Rig, scene: Scene) -> None:
        self._rig, self._scene = rig, scene
        self._buffers: Buffers = render(rig, scene)
        self._gate = plan(rig, TILT_DEG, DISTANCE_M, THICKNESS_M)
        direct, ambient = mono(self._buffers.direct), mono(self._buffers.ambient)
        self._sensor = auto_gain(direct + ambient, SensorModel())
        self._plates, self._every = (
            Plates(self._buffers.projector_row, direct, ambient, self._sensor, skip) for skip in (True, False)
        )
        self._out = np.empty(direct.shape, np.uint16)
        self._pool = noise_pool(np.random.default_rng(0), direct.shape[1])

    def tiles(self) -> list[Variant]:
        """Tiles that the gate cannot light are not looked at."""
        return [
            self._quick("tiles left out", self._frame(self._plates)),
            self._quick("every pixel", self._frame(self._every)),
        ]

    def rows(self) -> list[Variant]:
        """Rows that the gate cannot light are not read."""
        lit = lit_rows(row_windows(self._rig, self._gate), seen_reach(self._buffers.projector_row))
        return [
            self._quick("lit rows read", self._frame(self._plates, lit)),
            self._quick("all rows read", self._frame(self._plates)),
        ]

    def unchanged(self) -> list[Variant]:
        """A frame that cannot differ from the last one is not made again: without noise, while nothing changes."""
        camera = VirtualCamera(self._rig, self._scene, self._sensor, rate_hz=math.inf, noise=False)
        camera.configure(self._gate)
        camera.start()
        return [
            self._quick("unchanged frame kept", lambda index: camera.read(self._out, 1.0)),
            self._quick("frame made again", self._frame(self._plates)),
        ]

    def sweep(self) -> list[Variant]:
        """A sweep of the delay begins where light begins and ends where none is left, not after a whole period."""
        step_us = self._rig.projector.period_us / SWEEP_FRAMES
        line_us = upright_line_time(self._rig)
        every = [gate(line_us, index * step_us, step_us) for index in range(SWEEP_FRAMES)]
        lit = occupied_times(self._rig, line_us, self._buffers.projector_row)
        assert lit is not None
        some = tile_times(self._rig, line_us, *lit, max(1, math.ceil((lit[1] - lit[0]) / step_us)))
        return [
            _slow(
                f"{self._scene.name}: {len(items)} slices of {which}",
                _one_after_the_other([self._frame(self._plates, None, item) for item in items]),
            )
            for items, which in ((some, "what is lit"), (every, "a period"))
        ]

    def _frame(
        self, plates: Plates, rows: tuple[int, int] | None = None, settings: GateSettings | None = None
    ) -> Frame:
        held = settings or self._gate
        windows = kernel_windows(row_windows(self._rig, held))
        periods = held.exposure_us / self._rig.projector.period_us
        return lambda index: expose_fast(plates, windows, periods, self._pool.frame(0, index), self._out, rows)

    def _quick(self, name: str, run: Frame) -> Variant:
        return Variant("", f"{self._scene.name}: {name}", run)


def passing_ball() -> Scene:
    """A ball that crosses the view before a wall: the sparsest scene in which something moves."""
    times = np.array([0.0, 4.0, 8.0])
    offsets = np.array([[-0.4, 0, 0], [0.4, 0, 0], [-0.4, 0, 0]])
    motion = KeyFrames(times, offsets, np.stack([np.eye(3)] * 3), (0.0, 0.0, 0.0))
    wall = plane("wall", (0.0, 0.0, 1.6), (2.4, 2.0), turn(), Finish((0.5, 0.5, 0.5)))
    return Scene("a passing ball", objects=(wall, Sphere("ball", (0.0, 0.0, 1.05), 0.08, motion=motion)))


def _one_after_the_other(frames: list[Frame]) -> Frame:
    return lambda index: [frame(index) for frame in frames]


def _slow(name: str, run: Frame) -> Variant:
    return Variant("", name, run, gates=1, slow=True)
