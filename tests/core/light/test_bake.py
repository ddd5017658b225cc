"""Indirect light: what paths bring, against an independent renderer and against what must hold of itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from references import block_reference, direct_images
from rigs import check_rig
from slopegate.core.gating.gate import row_windows
from slopegate.core.light.bake import Bake, bake_until
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.indirect import Indirect, everything_once
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.light.scatter import ScatterSums
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.render.render import Cancelled, render
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.materials import Glass, Gloss
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import MeasuredScene, Mesh, Scene, Sphere
from slopegate.core.scene.shapes import Finish, box

RIG = check_rig(80)
CORNER = np.array([[-1, -1, 1.5], [1, -1, 1.5], [1, 1, 1.5], [-1, 1, 1.5], [-1, 0.2, 0.5], [1, 0.2, 0.5]])
ROOM = Scene(
    "wall and floor",
    objects=(
        Mesh("wall", CORNER, np.array([[0, 1, 2], [0, 2, 3]], np.int32)),
        Mesh("floor", CORNER, np.array([[3, 2, 5], [3, 5, 4]], np.int32), (0.5, 0.5, 0.5)),
        Sphere("ball", (0.0, -0.05, 1.2), 0.1, (0.7, 0.7, 0.7)),
    ),
)


@pytest.mark.parametrize("name", ["cornell_global", "three_planes_global"])
def test_agrees_with_the_independent_renderer(name: str) -> None:
    reference = block_reference(name)
    bake = Bake(reference.rig, reference.scene, BakeSettings(max_order=reference.max_order))
    for half in (0, 1):
        bake.trace(half, 64)
    part = Indirect(reference.rig, bake.picture, "mono")
    part.show(bake.snapshot())
    ours = direct_images(reference, 2).astype(np.float32)
    for image, windows in zip(ours, reference.windows, strict=True):
        part.add(windows, image)
    mean, error = reference.misses(ours.astype(np.float64)).T
    assert np.abs(mean).max() < 0.01
    # Rays for the direct part are few here: they are most of the error of thin gates.
    assert error.max() < 0.03
    assert error[-1] < 0.02


def test_fog_agrees_with_the_independent_renderer() -> None:
    reference = block_reference("cornell_fog_slab_fog_full")
    rig, scene = reference.rig, reference.scene
    bake = Bake(rig, scene, BakeSettings(max_order=reference.max_order))
    for half in (0, 1):
        bake.trace(half, 32)
    part = Indirect(rig, bake.picture, "mono")
    part.show(bake.snapshot())
    view = SeenScene(rig, scene, render(rig, scene), "mono", max_order=reference.max_order)
    parts = [part, *prepare_parts(view, ("airlight", "scatter"))]
    ours = direct_images(reference, 2).astype(np.float32)
    for image, windows in zip(ours, reference.windows, strict=True):
        for part_of_it in parts:
            part_of_it.add(windows, image)
    mean, error = reference.misses(ours.astype(np.float64)).T
    assert np.abs(mean).max() < 0.01
    assert error.max() < 0.02


@pytest.mark.parametrize("density", [0.3, 3.0])
def test_what_scatter_draws_is_left_out_of_the_bake(density: float) -> None:
    foggy = replace(ROOM, fog=Fog(density, 0.0, 0.6))
    sums = {}
    for with_halo in (False, True):
        bake = Bake(RIG, foggy, BakeSettings(with_halo=with_halo))
        bake.trace(0, 64)
        sums[with_halo] = bake.snapshot().plain[0]
    assert (sums[True] >= sums[False] * (1 - 1e-6)).all()
    assert sums[False].sum() < sums[True].sum()
    assert np.isfinite(sums[True]).all()


@pytest.mark.parametrize(("density", "g", "max_order"), [(0.55, 0.0, None), (1.0, 0.85, None), (1.0, 0.85, 2)])
def test_scatter_draws_as_much_as_the_bake_leaves_to_it(density: float, g: float, max_order: int | None) -> None:
    """The same paths with and without it, at a wall and a floor: all indirect light to 0.3 %, and the halo to 2 %.

    Where fog scatters evenly paths know the small halo to 10 %.
    """
    rig = check_rig(160)
    foggy = replace(ROOM, objects=ROOM.objects[:2], fog=Fog(density, 0.03, g))
    means = {}
    for with_halo in (False, True):
        settings = BakeSettings(with_halo=with_halo, max_order=max_order)
        means[with_halo] = float(baked_image(foggy, 64, settings, rig).mean())
    halo = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    ScatterSums(rig, foggy, render(rig, foggy), "mono", None, max_order).add(everything_once(rig), halo)
    assert halo.mean() == pytest.approx(means[True] - means[False], rel=0.02 if g else 0.1)
    assert means[False] + halo.mean() == pytest.approx(means[True], rel=3e-3)


def test_equal_seeds_give_equal_tables_and_others_do_not() -> None:
    tables = []
    for seed in (1, 1, 2):
        bake = Bake(RIG, ROOM, BakeSettings(seed=seed))
        bake.trace(0, 4)
        tables.append(bake.snapshot().matt)
    assert np.array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


def test_a_stopped_pass_leaves_the_bake_as_it_was() -> None:
    bake = Bake(RIG, ROOM)
    bake.trace(0, 4)
    before = bake.snapshot()
    shares: list[float] = []
    with pytest.raises(Cancelled):
        bake.trace(0, 256, lambda share: (shares.append(share), share < 0.5)[1])
    assert max(shares) >= 0.5
    after = bake.snapshot()
    assert np.array_equal(before.matt, after.matt)
    assert np.array_equal(before.paths, after.paths)
    whole = Bake(RIG, ROOM)
    whole.trace(0, 4)
    whole.trace(0, 256)
    bake.trace(0, 256)
    assert np.array_equal(bake.snapshot().matt, whole.snapshot().matt)


def test_light_that_turns_once_is_not_in_it() -> None:
    bake = Bake(RIG, ROOM, BakeSettings(max_order=1))
    bake.trace(0, 4)
    assert not bake.snapshot().matt.any()


def test_a_lone_convex_object_has_no_indirect_light() -> None:
    bake = Bake(RIG, Scene("ball", objects=(Sphere("ball", (0.0, 0.0, 1.0), 0.2),)))
    bake.trace(0, 16)
    assert bake.snapshot().paths.sum() > 0
    assert not bake.snapshot().matt.any()


def test_a_gate_and_its_complement_add_up() -> None:
    bake = Bake(RIG, ROOM)
    bake.trace(0, 16)
    part = Indirect(RIG, bake.picture, "mono")
    part.show(bake.snapshot())
    line = RIG.camera.shutter.line.nearest(50.0)
    period = RIG.projector.period_us
    thin, rest, whole = (
        row_windows(RIG, gate(line, delay, exposure))
        for delay, exposure in ((2000.0, 3000.0), (2000.0 + period / 2, period - 3000.0), (0.0, period))
    )
    shape = RIG.camera.lens.height, RIG.camera.lens.width
    images = [np.zeros(shape, np.float32) for _ in range(2)]
    part.add(thin, images[0])
    assert images[0].sum() > 0
    part.add(rest, images[0])
    part.add(whole, images[1])
    np.testing.assert_allclose(images[0], images[1], rtol=2e-5, atol=1e-6)


def baked_image(
    scene: Scene, each: int = 64, settings: BakeSettings | None = None, rig: Rig = RIG
) -> NDArray[np.float32]:
    """The indirect part of everything lit once, without smoothing."""
    bake = Bake(rig, scene, settings)
    bake.trace(0, each)
    part = Indirect(rig, bake.picture, "mono", 0)
    part.show(bake.snapshot())
    image = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    part.add(everything_once(rig), image)
    return image


@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_an_integrating_sphere_is_as_bright_as_theory_says(albedo: float) -> None:
    # After one reflection light is spread evenly over a sphere: a closed form, with all orders in it.
    radius, lens = 1.0, RIG.projector.lens
    image = baked_image(Scene("sphere", objects=(Sphere("sphere", (0.0, 0.1, 0.2), radius, (albedo,) * 3),)), 4096)
    flux = np.pi * lens.width * lens.height / (lens.fx * lens.fy)
    expected = albedo / np.pi * flux * albedo / (1 - albedo) / (4 * np.pi * radius**2)
    assert image.mean() == pytest.approx(expected, rel=5e-3)
    assert image.std() < 0.1 * expected


def test_order_cuts_the_series_of_the_sphere() -> None:
    albedo, lens = 0.7, RIG.projector.lens
    scene = Scene("sphere", objects=(Sphere("sphere", (0.0, 0.1, 0.2), 1.0, (albedo,) * 3),))
    flux = np.pi * lens.width * lens.height / (lens.fx * lens.fy)
    once = albedo / np.pi * flux / (4 * np.pi)
    for order in (2, 3, 6):
        image = baked_image(scene, 2048, BakeSettings(max_order=order))
        assert image.mean() == pytest.approx(once * sum(albedo**n for n in range(1, order)), rel=8e-3)


def test_gloss_throws_light_as_its_formula_says() -> None:
    share, exponent = 0.6, 8.0
    gloss = Gloss(share, exponent)
    wall = Mesh("wall", CORNER, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (0.0, 0.0, 0.0), material=gloss)
    corners = np.array([[-1, 0.4, 1.5], [1, 0.4, 1.5], [1, 0.4, 0.5], [-1, 0.4, 0.5]])
    floor = Mesh("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (0.5, 0.5, 0.5))
    bake = Bake(RIG, Scene("corner", objects=(wall, floor)), BakeSettings(pitch_px=4, max_order=2))
    bake.trace(0, 8192)
    held = bake.snapshot()
    shining, lit = (table[0].sum((1, 2, 3)) / held.paths[0] for table in (held.plain, held.matt))
    # Both ways: the wall shines with the floor's light, and lights the floor. The corner is too sharp for the sums.
    places = 4 * np.arange(20) + 2.0
    for row in (10,):
        assert shining[row].mean() == pytest.approx(cell_mean(gloss_by_sum, row, places, share, exponent), rel=0.03)
    for row in (13, 14):
        assert 0.5 * lit[row].mean() == pytest.approx(cell_mean(gloss_by_sum, row, places, share, exponent), rel=0.03)


def cell_mean(
    light: Callable[..., float], row: int, columns: NDArray[np.float64], share: float, exponent: float
) -> float:
    """Mean over a row of cells, by four places down each."""
    rows = 4 * row + np.array([0.5, 1.5, 2.5, 3.5])
    return float(np.mean([light(share, exponent, 0.5, x, y) for x in columns[::3] for y in rows]))


def gloss_by_sum(share: float, exponent: float, albedo: float, x: float, y: float) -> float:
    """What a glossy black wall (z = 1.5) and a matt floor (y = 0.4) send each other of direct light, by plain sums.

    Seen at camera column x and row y.
    """
    light = RIG.projector_centre_m
    fine = 150
    across, down = np.meshgrid((np.arange(fine) + 0.5) / fine * 2 - 1, (np.arange(fine) + 0.5) / fine, indexing="ij")
    floor = np.stack([across, np.full_like(across, 0.4), 0.5 + down], axis=-1).reshape(-1, 3)
    wall = np.stack([across, 0.4 - 1.4 * down, np.full_like(across, 1.5)], axis=-1).reshape(-1, 3)
    up, front = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, -1.0])

    def lit(points: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
        column, row, depth = RIG.to_projector(points)
        raster = RIG.projector.lens
        inside = (column >= 0) & (column < raster.width) & (row >= 0) & (row < raster.height)
        return np.where(inside, -((points - light) @ normal) / depth**3, 0)

    def lobe(
        arrive: NDArray[np.float64], leave: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        mirrored = arrive - 2 * (arrive @ normal)[..., None] * normal
        cosine = np.maximum((mirrored * leave).sum(-1), 0)
        return share * (exponent + 2) / (2 * np.pi) * cosine**exponent

    ray = RIG.camera_rays(x, y)
    point = RIG.camera_centre_m + ray * (1.5 - RIG.camera_centre_m[2])
    on_floor = bool(point[1] > 0.4)
    if on_floor:
        point = RIG.camera_centre_m + ray * (0.4 - RIG.camera_centre_m[1]) / ray[1]
    others, far_normal, normal = (wall, front, up) if on_floor else (floor, up, front)
    way = point - others
    distance = np.sqrt((way**2).sum(-1))
    way /= distance[:, None]
    form = np.maximum(way @ far_normal, 0) * np.maximum(-way @ normal, 0) / distance**2
    if on_floor:
        beam = (others - light) / np.sqrt(((others - light) ** 2).sum(-1, keepdims=True))
        sent = lit(others, front) * lobe(beam, way, front)
        return float(albedo * (sent * form).sum() * (2 * 1.4 / fine**2))
    sent = albedo * lit(others, up) * lobe(way, -ray / np.linalg.norm(ray), front)
    return float((sent * form).sum() * (2 * 1.0 / fine**2))


def test_glass_of_index_1_changes_nothing() -> None:
    # Only the glass's shadow and what particles bring through it are at stake: it stands above what the camera sees.
    wall = Mesh("wall", CORNER, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    block = box("block", (0.0, -0.115, 0.3), (0.3, 0.07, 0.1), np.eye(3), Finish((1.0, 1.0, 1.0), material=Glass(1.0)))
    clear = render(RIG, Scene("wall", objects=(wall,))).direct[:, :, 1]
    glazed = Scene("wall behind glass", objects=(wall, block))
    buffers = render(RIG, glazed)
    direct = buffers.direct[:, :, 1]
    shadow = (clear > 0) & (direct == 0)
    assert 0.1 < shadow.mean() < 0.9
    light = baked_image(glazed, 256)
    assert (direct + light).mean() == pytest.approx(clear.mean(), rel=0.01)
    assert np.median(np.abs(light[shadow] / clear[shadow] - 1)) < 0.01


def test_textures_stay_sharp() -> None:
    checks = np.indices((64, 64)).sum(axis=0) % 2
    texture = np.repeat(np.where(checks, 0.9, 0.1).astype(np.float32)[:, :, None], 3, axis=2)
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.5], [1.0, 0.5]])
    wall = Mesh("wall", CORNER, np.array([[0, 1, 2], [0, 2, 3]], np.int32), uv=uv, texture=texture)
    scene = Scene("checked wall and floor", objects=(wall, *ROOM.objects[1:]))
    light = baked_image(scene, 16)
    albedo = Surfaces(scene).guides(RIG).albedo[:, :, 1]
    smooth = light[albedo > 0] / albedo[albedo > 0]
    plain = baked_image(ROOM, 16)
    # What is divided by the colour is as smooth as a wall of one colour, whose light it differs from otherwise.
    assert (albedo == np.float32(0.1)).mean() > 0.2
    assert (albedo == np.float32(0.9)).mean() > 0.2
    assert smooth.std() / smooth.mean() < 1.5 * plain[plain > 0].std() / plain[plain > 0].mean()


def test_a_snapshot_is_taken_up_where_it_was_left() -> None:
    whole = Bake(RIG, ROOM)
    for each in (4, 8):
        whole.trace(0, each)
        whole.trace(1, each)
    first = Bake(RIG, ROOM)
    first.trace(0, 4)
    first.trace(1, 4)
    second = Bake(RIG, ROOM, begun=first.snapshot())
    second.trace(0, 8)
    second.trace(1, 8)
    assert np.array_equal(second.snapshot().matt, whole.snapshot().matt)
    assert second.error_percent() == whole.error_percent()
    assert second.paths == 24


def test_more_paths_are_less_noise_and_the_figure_knows() -> None:
    bake = Bake(RIG, ROOM)
    assert bake.error_percent() == np.inf
    assert bake_until(bake, None, 1.0) <= 1.0
    figure, image = bake.error_percent(), images_of(bake)
    truth = Bake(RIG, ROOM, BakeSettings(seed=5))
    bake_until(truth, 4096, 1.0)
    best = images_of(truth)
    height, width = (n // 4 * 4 for n in best.shape)
    apart = (image - best)[:height, :width].reshape(height // 4, 4, width // 4, 4).mean((1, 3))
    found = 200 * float(np.sqrt((apart**2).mean())) / float(best.mean() + render(RIG, ROOM).direct[:, :, 1].mean())
    assert 0.5 * figure < found < 1.6 * figure


def images_of(bake: Bake) -> NDArray[np.float32]:
    part = Indirect(RIG, bake.picture, "mono")
    part.show(bake.snapshot())
    image = np.zeros((RIG.camera.lens.height, RIG.camera.lens.width), np.float32)
    part.add(everything_once(RIG), image)
    return image


def test_a_photo_with_depth_is_refused() -> None:
    lens = RIG.camera.lens
    shape = lens.height, lens.width
    photo = MeasuredScene(lens, np.ones(shape, np.float32), np.ones((*shape, 3), np.float32))
    with pytest.raises(UserError, match="desk is a photo with depth"):
        Bake(RIG, Scene("desk", capture=photo))


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="pitch_px is 0"):
        BakeSettings(pitch_px=0)
    with pytest.raises(InputError, match="max_order is 0"):
        BakeSettings(max_order=0)
    with pytest.raises(InputError, match="each is 3"):
        Bake(RIG, ROOM).trace(0, 3)


def test_without_smoothing_the_same_light_is_there_and_more_noise() -> None:
    """Smoothing moves no light over the picture: the mean stays, what differs from cell to cell falls."""
    bake = Bake(RIG, ROOM, BakeSettings(bands=8))
    bake.trace(0, 4)
    bake.trace(1, 4)
    lit = row_windows(RIG, gate(10.0, 0.0, RIG.projector.period_us))
    images = []
    for radius in (0, 2):
        part = Indirect(RIG, bake.picture, "mono", radius)
        part.show(bake.snapshot())
        out = np.zeros((RIG.camera.lens.height, RIG.camera.lens.width), np.float32)
        part.add(lit, out)
        images.append(out)
    raw, smoothed = images
    assert smoothed.mean() == pytest.approx(raw.mean(), rel=0.02)
    assert np.abs(np.diff(smoothed, axis=1)).mean() < 0.7 * np.abs(np.diff(raw, axis=1)).mean()
