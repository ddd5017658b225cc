"""Every part of the light under a projector's pattern: against the sums that it stands for, and what it must keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from patterned_bake import PatternedBake
from patterned_fog import patterned_airlight, random_blocks
from rigs import bent, check_rig, turned
from slopegate.core.exposure.patterned import patterned
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light import bake as bake_module
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
from slopegate.core.scene.materials import Glass, Skin, SkinLobe
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


@pytest.mark.parametrize("scene", [ROOM, replace(ROOM, fog=None)], ids=["fog", "clear"])
def test_blocks_that_the_bake_tells_apart_are_as_if_each_path_asked_the_pattern(scene: Scene) -> None:
    settings = BakeSettings(pitch_px=4, bands=32, columns=32)
    bake = traced(Bake(RIG, scene, settings))
    part = Indirect(RIG, bake.picture, "mono")
    part.show(bake.snapshot())
    lit = image(part, everything_once(RIG), None).mean()
    for pattern in (random_blocks(RIG, 32, 32), random_blocks(RIG, 8, 4)):
        asked = traced(PatternedBake(RIG, scene, replace(settings, columns=1), pattern))
        true = Indirect(RIG, asked.picture, "mono")
        true.show(asked.snapshot())
        for each in windows():
            expected = image(true, each, None)
            assert expected.max() > 0.1 * lit
            error = image(part, each, pattern) - expected
            assert np.sqrt((error**2).mean()) < 1e-5 * lit


@pytest.mark.parametrize("blocks", [(16, 9), (128, 128), (512, 512)])
def test_other_blocks_are_missed_by_little(blocks: tuple[int, int]) -> None:
    """Paths are the same in both: what is left of their noise is a part of the bound."""
    clear, pattern = replace(ROOM, fog=None), random_blocks(RIG, *blocks)
    bake = traced(Bake(RIG, clear, BakeSettings(pitch_px=4, bands=32, columns=32)), 64)
    asked = traced(PatternedBake(RIG, clear, BakeSettings(pitch_px=4, bands=32), pattern), 64)
    images = []
    for each in (bake, asked):
        part = Indirect(RIG, each.picture, "mono")
        part.show(each.snapshot())
        images.append(image(part, everything_once(RIG), pattern if each is bake else None))
    assert np.sqrt(((images[0] - images[1]) ** 2).mean()) < 0.06 * images[1].mean()


def traced(bake: Bake, each: int = 16) -> Bake:
    for half in (0, 1):
        bake.trace(half, each)
    return bake


def test_a_bake_without_columns_has_a_patterns_means_over_rows() -> None:
    bake = traced(Bake(RIG, ROOM, BakeSettings(pitch_px=4, bands=36)))
    part = Indirect(RIG, bake.picture, "mono")
    part.show(bake.snapshot())
    rows = np.linspace(0, 1, RASTER[0], dtype=np.float32)[:, None]
    columns = np.arange(RASTER[1], dtype=np.float32)[None] % 2
    even, striped = image(part, windows()[1], rows * np.ones_like(columns)), image(part, windows()[1], rows * columns)
    assert even.max() > 0
    np.testing.assert_allclose(striped, 0.5 * even, rtol=1e-4)


GLASS = Scene(
    "glass ball before a wall",
    objects=(
        plane("wall", (0.0, 0.0, 1.5), (2.0, 2.0), turn(0, 0), Finish((0.6, 0.6, 0.6))),
        Sphere("ball", (0.0, 0.0, 1.0), 0.12, (1.0, 1.0, 1.0), material=Glass(1.5)),
    ),
)


def test_caustics_have_the_patterns_own_pixels() -> None:
    bake = traced(Bake(RIG, GLASS, BakeSettings(pitch_px=8, bands=8, columns=4)), 64)
    baked = bake.snapshot()
    assert len(baked.caustic_light) > 5_000
    part = Indirect(RIG, bake.picture, "mono")
    part.show(baked)
    fine = np.random.default_rng(4).integers(0, 2, RASTER).astype(np.float32)
    everything, wall = everything_once(RIG), replace(baked, caustic_light=baked.caustic_light[:0])
    caustic = []
    for pattern in (None, fine, 1 - fine):
        lit = image(part, everything, pattern)
        without = Indirect(RIG, bake.picture, "mono")
        without.show(wall)
        caustic.append(lit - image(without, everything, pattern))
    shares = fine[baked.caustic_places[:, 1], baked.caustic_places[:, 2]]
    held = float((shares * baked.caustic_light[:, 0]).sum() / baked.caustic_light[:, 0].sum())
    assert caustic[1].sum() / caustic[0].sum() == pytest.approx(held, rel=0.02)
    np.testing.assert_allclose(caustic[1] + caustic[2], caustic[0], atol=1e-4 * caustic[0].max())


def test_listed_caustics_are_those_of_the_table() -> None:
    images = []
    for columns in (1, 4):
        bake = traced(Bake(RIG, GLASS, BakeSettings(pitch_px=3, bands=8, columns=columns)), 128)
        part = Indirect(RIG, bake.picture, "mono", 0)
        part.show(bake.snapshot())
        images.append(image(part, everything_once(RIG), None))
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=0.01)
    assert np.sqrt(((images[1] - images[0]) ** 2).mean()) < 0.05 * images[0].max()


def test_more_particles_than_a_list_takes_are_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bake_module, "MOST_CAUSTICS", 2000)
    bake = Bake(RIG, GLASS, BakeSettings(pitch_px=8, bands=8, columns=4))
    for _ in range(3):
        traced(bake, 16)
    baked = bake.snapshot()
    sent, paths = baked.caustic_count.tolist(), baked.paths.sum()
    again = traced(Bake(RIG, GLASS, bake.settings, baked), 16).snapshot()
    assert len(again.caustic_light) == len(baked.caustic_light)
    assert again.caustic_count.tolist() == sent
    assert again.paths.sum() > paths
