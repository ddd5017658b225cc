"""Every part of the light under a projector's pattern: against the sums that it stands for, and what it must keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from patterned_fog import patterned_airlight, random_blocks
from rigs import bent, check_rig, turned
from slopegate.core.exposure.patterned import patterned
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.airlight import TableSize, prepare_airlight
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.indirect import Indirect, everything_once
from slopegate.core.light.lights import Lights
from slopegate.core.light.part import LightPart, PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.light.scatter import Scatter, ScatterSums
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Skin, SkinLobe
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import Finish, box, plane, turn

RIG = check_rig(80)
RAYS = check_rig(200)
RASTER = RIG.projector.lens.height, RIG.projector.lens.width
SKIN = Finish((0.8, 0.7, 0.6), material=Skin((SkinLobe(2.0, (0.4, 0.3, 0.2)),)))
ROOM = Scene(
    "foggy room",
    objects=(
        box("room", (0.0, 0.0, 0.8), (1.6, 1.2, 2.0), turn(0, 0)),
        plane("card", (0.1, 0.0, 0.9), (0.2, 0.2), turn(0, 0), SKIN),
        Sphere("ball", (-0.2, 0.05, 1.0), 0.1, (0.7, 0.7, 0.7)),
    ),
    fog=Fog(0.4, 0.05, 0.5),
)


def parts_of(rig: Rig = RIG, scene: Scene = ROOM) -> list[LightPart]:
    view = SeenScene(rig, scene, render(rig, scene), "mono")
    bake = Bake(rig, scene, BakeSettings(pitch_px=8, bands=36, columns=32))
    bake.trace(0, 8)
    bake.trace(1, 8)
    indirect = Indirect(rig, bake.picture, "mono")
    indirect.show(bake.snapshot())
    return [indirect, *prepare_parts(view, ("airlight", "scatter", "subsurface"))]


def image(part: LightPart, windows: RowWindows, pattern: Singles | None, rig: Rig = RIG) -> Singles:
    out = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    part.light_with(pattern)
    part.add(windows, out)
    return out


@pytest.fixture(scope="module")
def parts() -> dict[PartName, LightPart]:
    return {part.name: part for part in parts_of()}


@pytest.fixture(params=["indirect", "airlight", "scatter", "subsurface"])
def part(request: pytest.FixtureRequest, parts: dict[PartName, LightPart]) -> LightPart:
    return parts[request.param]


def slab(rig: Rig, nearest_m: float, farthest_m: float) -> RowWindows:
    """Windows that hold what lies between two depths."""
    lens, projector = rig.camera.lens, rig.projector.lens
    slopes = (np.arange(lens.height) + 0.5 - lens.cy) / lens.fy
    low, high = (projector.cy + projector.fy * (slopes + rig.baseline_m / depth) for depth in (farthest_m, nearest_m))
    once = np.ones(lens.height, np.int32)
    return RowWindows(low, high, once, 0 * once)


def windows() -> list[RowWindows]:
    return [everything_once(RIG), slab(RIG, 0.7, 1.1)]


def test_white_is_as_none_and_black_is_black(part: LightPart) -> None:
    for each in windows():
        lit = image(part, each, None)
        assert lit.max() > 0
        np.testing.assert_allclose(
            image(part, each, np.ones(RASTER, np.float32)), lit, rtol=1e-4, atol=1e-5 * lit.max()
        )
        assert not image(part, each, np.zeros(RASTER, np.float32)).any()
        np.testing.assert_array_equal(image(part, each, None), lit)


def test_light_is_linear_in_the_pattern(part: LightPart) -> None:
    pattern = np.random.default_rng(3).random(RASTER).astype(np.float32)
    for each in windows():
        lit = image(part, each, None)
        both = image(part, each, pattern) + image(part, each, 1 - pattern)
        np.testing.assert_allclose(both, lit, rtol=1e-3, atol=1e-4 * lit.max())
        half = image(part, each, np.float32(0.5) * pattern)
        np.testing.assert_allclose(2 * half, image(part, each, pattern), rtol=1e-3, atol=1e-4 * lit.max())


def test_parts_that_come_later_are_lit_as_the_others(parts: dict[PartName, LightPart]) -> None:
    lights = Lights()
    lights.light_with(np.zeros(RASTER, np.float32))
    out = np.zeros((RIG.camera.lens.height, RIG.camera.lens.width), np.float32)
    for part in parts.values():
        lights.put(part)
    lights.add(everything_once(RIG), lights.names, out)
    assert not out.any()
    lights.light_with(None)
    lights.add(everything_once(RIG), lights.names, out)
    assert out.any()


@pytest.mark.parametrize("kind", ["ideal", "general", "bent"])
def test_airlight_takes_the_pattern_where_its_light_is(kind: str) -> None:
    """Blocks of 40 x 22 pixels, where coarse rays are 10 columns apart: half of a block's edge is between them."""
    rig = {"ideal": RAYS, "general": turned(RAYS), "bent": bent(turned(RAYS))}[kind]
    scene = Scene("fog", objects=(ROOM.objects[0],), fog=Fog(0.8, 0.05, 0.5))
    buffers = render(rig, scene)
    part = prepare_airlight(rig, scene, buffers, "mono", size=TableSize(2, 180))
    random = np.random.default_rng(1)
    rows, columns = (random.integers(0, size, 150) for size in buffers.inverse_depth.shape)
    depths = 1 / buffers.inverse_depth[rows, columns].astype(np.float64)
    for pattern, bound in ((random_blocks(rig, 1, 32), 0.006), (random_blocks(rig, 8, 8), 0.03)):
        for each in (everything_once(rig), slab(rig, 0.5, 1.2)):
            true = patterned_airlight(rig, scene.fog, (rows, columns), depths, pattern, each)
            error = image(part, each, pattern, rig)[rows, columns] - true
            lit = image(part, everything_once(rig), None, rig).mean()
            assert np.sqrt((error**2).mean()) < bound * lit
            assert true.std() > 2 * bound * lit


@pytest.mark.parametrize("kind", ["ideal", "general"])
def test_the_halo_is_that_of_the_direct_light_under_the_pattern(kind: str) -> None:
    rig = RIG if kind == "ideal" else turned(RIG)
    buffers = render(rig, ROOM)
    part = Scatter(rig, ROOM, buffers, "mono")
    lit = image(part, everything_once(rig), None, rig)
    for seed, blocks in enumerate(((4, 4), (16, 16), (1, 64), (128, 72))):
        pattern = random_blocks(rig, *blocks, seed)
        seen = patterned(buffers.direct, buffers.projector_row, buffers.projector_column, pattern)
        for each in (everything_once(rig), slab(rig, 0.7, 1.1)):
            true = np.zeros(buffers.inverse_depth.shape, np.float32)
            ScatterSums(rig, ROOM, replace(buffers, direct=seen), "mono").add(each, true)
            error = image(part, each, pattern, rig) - true
            # As of any light: what the Gaussians err by (`scatter`).
            assert np.sqrt((error**2).mean()) < 0.025 * lit.max()
            assert abs(error.mean()) < 0.03 * lit.mean()
