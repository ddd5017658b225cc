"""Scenes that light transport is measured on, and what the camera sees of them under any picture, without noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import Slices, occupied_times, tile_times
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import for_patterns
from slopegate.core.light.indirect import Indirect
from slopegate.core.light.lights import PLAIN, asked_parts, holds
from slopegate.core.light.part import LightPart
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.render import Buffers, Renderer
from slopegate.core.rig.arrays import Bytes, Doubles, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import LIT
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.capture_run import SceneClock


@dataclass(frozen=True, eq=False)
class TransportCase:
    """A scene before a rig, its slices and blocks, and random patterns of blocks (count, rows, columns) 0 or 1."""

    name: str
    rig: Rig
    scene: Scene
    renderer: Renderer
    parts: tuple[LightPart, ...]
    grid: BlockGrid
    slices: Slices
    patterns: Bytes

    @property
    def pictures(self) -> list[Bytes]:
        """The random patterns as the projector shows them."""
        return [self.grid.spread(pattern * np.uint8(LIT)) for pattern in self.patterns]


@dataclass(frozen=True, eq=False)
class Shown:
    """What the camera sees of pictures, without noise: counts above black (slices, pictures, H, W), and with all on."""

    lit: Singles
    pictures: Singles
    electrons_per_count: float


PATHS: Final = 64
"""Of indirect light, a cell."""


def make_case(name: str, rig: Rig, scene: Scene, blocks: tuple[int, int], count: int, patterns: int) -> TransportCase:
    """`count` slices over all that is lit, and so many random patterns. Raises InputError where nothing is lit."""
    renderer = Renderer(rig, scene)
    line, seen = upright_line_time(rig), renderer.at(0.0)[0]
    lit = occupied_times(rig, line, seen.projector_row)
    if lit is None:
        raise InputError(f"the projector lights nothing of {name} that the camera sees")
    grid = BlockGrid(rig.projector.raster, *blocks)
    random = np.random.default_rng(7).integers(0, 2, (patterns, grid.rows, grid.columns), dtype=np.uint8)
    slices = tile_times(rig, line, *lit, count)
    return TransportCase(name, rig, scene, renderer, _smooth_parts(rig, scene, seen), grid, slices, random)


def _smooth_parts(rig: Rig, scene: Scene, seen: Buffers) -> tuple[LightPart, ...]:
    """All that the scene asks for beside direct and ambient light, ready for patterns."""
    asked = asked_parts(scene) - PLAIN
    parts = list(prepare_parts(SeenScene(rig, scene, seen, "mono"), asked))
    if "indirect" in asked and holds(scene, "indirect"):
        bake = Bake(rig, scene, for_patterns())
        for half in (0, 1):
            bake.trace(half, PATHS // 2)
        indirect = Indirect(rig, bake.picture, "mono")
        indirect.show(bake.snapshot())
        parts.append(indirect)
    return tuple(parts)


def shown(case: TransportCase, pictures: Sequence[Bytes]) -> Shown:
    """Frames of these pictures, shown by the virtual projector."""
    with case_camera(case, False, 0) as (camera, projector):
        shape = camera.info.height, camera.info.width
        projector.load(pictures)
        buffer = np.zeros(shape, np.uint16)

        def frame() -> Singles:
            camera.read(buffer, 1.0)
            return buffer.astype(np.float32)

        lit = np.empty((len(case.slices), *shape), np.float32)
        found = np.empty((len(case.slices), len(pictures), *shape), np.float32)
        for gate, whole, images in zip(case.slices, lit, found, strict=True):
            camera.configure(gate)
            projector.black()
            black = frame()
            projector.white()
            whole[:] = frame() - black
            for index in range(len(pictures)):
                projector.show(index)
                images[index] = frame() - black
        assert camera.sensor is not None
        return Shown(lit, found, camera.sensor.electrons_per_count)


def impulse_light(case: TransportCase, grid: BlockGrid) -> Doubles:
    """Electrons (blocks, P) that each block of a grid alone brings to the pixels that all blocks together light."""
    ones = np.eye(grid.count, dtype=np.uint8).reshape(grid.count, grid.rows, grid.columns)
    seen = shown(case, [grid.spread(one * np.uint8(LIT)) for one in ones])
    light = np.maximum(seen.pictures.sum(axis=0), 0.0).astype(np.float64).reshape(grid.count, -1)
    total = light.sum(axis=0)
    return np.asarray(light[:, total > 0.2 * total.max()] * seen.electrons_per_count)


@contextmanager
def case_camera(case: TransportCase, noise: bool, seed: int) -> Iterator[tuple[VirtualCamera, VirtualProjector]]:
    """A started camera and its projector, whose time passes as fast as frames are made."""
    for part in case.parts:
        part.light_with(None)
    clock = SceneClock()
    camera = VirtualCamera(
        case.rig,
        case.scene,
        seed=seed,
        clock=clock.now,
        sleep=clock.sleep,
        noise=noise,
        renderer=case.renderer,
        parts=case.parts,
    )
    camera.prepare(lambda share: True)
    camera.start()
    try:
        yield camera, VirtualProjector(camera, clock.now)
    finally:
        camera.close()
