"""The airlight that runs live: against the exact integral, with shadows, in motion, and on rigs of every kind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from patterned_fog import random_blocks
from rigs import bent, check_rig, turned
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import RowWindows, exact_upright_line_time, row_windows
from slopegate.core.light import airlight_kernels as kernels
from slopegate.core.light.airlight import Airlight, TableSize, make_bend, prepare_airlight
from slopegate.core.light.airlight_exact import exact_airlight, make_optics
from slopegate.core.light.airlight_table import exact_span
from slopegate.core.light.part import Filter
from slopegate.core.render.fog import medium_of
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import Buffers, Cancelled, Region, Renderer, make_tracer, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import KeyFrames, MeasuredScene, Mesh, Scene, Sphere

RIG = check_rig(200)
GENERAL = turned(RIG)
RIGS = {
    "ideal": RIG,
    "general": GENERAL,
    "bent": bent(GENERAL),
    "beside": replace(RIG, projector_offset_m=(-0.1, -1e-6, 0.0)),
}
FOGS = {
    "thin": Fog(0.5),
    "slab": Fog(0.55, 0.03, 0.0, (-1.5, -1.5, 0.3), (1.5, 1.5, 2.5)),
    "forward": Fog(2.0, 0.1, 0.8),
    "ground": Fog(1.0, 0.2, -0.7, (-math.inf, 0.05, 0.4), (math.inf, math.inf, 1.5)),
    "box": Fog(1.0, 0.2, -0.5, (-0.2, -0.15, 0.5), (0.25, 0.2, 1.4)),
}
# Half the pixels of the rig of the stated bounds, and half the step: the same rays.
SIZE = TableSize(2, 180)


def buffers_of(inverse_depth: NDArray[np.float32]) -> Buffers:
    height, width = inverse_depth.shape
    return replace(Buffers.empty(height, width), inverse_depth=inverse_depth)


def random_depths(rig: Rig, seed: int) -> NDArray[np.float32]:
    random, shape = np.random.default_rng(seed), (rig.camera.lens.height, rig.camera.lens.width)
    return np.where(random.random(shape) < 0.3, 0, random.uniform(0.2, 2.5, shape)).astype(np.float32)


def image(part: Airlight, windows: RowWindows, rig: Rig) -> NDArray[np.float32]:
    out = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    part.add(windows, out)
    return out


def random_windows(rig: Rig, random: np.random.Generator) -> RowWindows:
    line = exact_upright_line_time(rig.camera.lens, rig.projector) * 78 / random.choice([30, 50, 76, 78, 80, 108, 128])
    return row_windows(
        rig, gate(line, random.uniform(-8000, 12000), random.choice([200, 500, 2000, 8000, 16000, 20000]))
    )


def every_row(rig: Rig, inside: int = 1) -> RowWindows:
    height = rig.camera.lens.height
    return RowWindows(
        np.zeros(height), np.full(height, 1e4), np.full(height, inside, np.int32), np.zeros(height, np.int32)
    )


def misses(rig: Rig, fog: Fog, size: TableSize, gates: int = 8) -> tuple[float, float]:
    """Worst and root mean square difference from the exact light, as shares of the most that any ray gets ungated."""
    random = np.random.default_rng(5)
    inverse = random_depths(rig, 3)
    part = prepare_airlight(rig, Scene("fog", fog=fog), buffers_of(inverse), "mono", size=size)
    rows, columns = random.integers(0, inverse.shape[0], 200), random.integers(0, inverse.shape[1], 200)
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    with np.errstate(divide="ignore"):
        depths = 1 / inverse[rows, columns].astype(np.float64)
    most = exact_airlight(rig, fog, rays, np.full(200, np.inf), every_row(rig), rows).max()
    errors = []
    for _ in range(gates):
        windows = random_windows(rig, random)
        shown = image(part, windows, rig)
        assert (shown >= 0).all()
        errors.append(shown[rows, columns] - exact_airlight(rig, fog, rays, depths, windows, rows))
    return float(np.abs(errors).max() / most), float(np.sqrt(np.square(errors).mean()) / most)


@pytest.mark.parametrize("fog", FOGS)
@pytest.mark.parametrize("rig", RIGS)
def test_the_table_keeps_its_bound(rig: str, fog: str) -> None:
    worst, usual = misses(RIGS[rig], FOGS[fog], SIZE)
    # Where rays enter fog through a side that they nearly run along, the way through it changes fast from ray to ray.
    assert worst < (0.02 if fog == "ground" else 1e-3)
    assert usual < (5e-4 if fog == "ground" else 1e-4)


def test_a_finer_table_is_nearer() -> None:
    coarse, fine = (misses(RIG, FOGS["slab"], TableSize(2, nodes))[1] for nodes in (45, 360))
    assert fine < coarse / 8


def test_dense_fog_before_an_ideal_rig_keeps_the_bound() -> None:
    for density in (50.0, 1000.0):
        worst, usual = misses(RIG, Fog(density, 0.0, 0.5, (-2, -2, 0.5), (2, 2, 3)), SIZE, gates=4)
        assert worst < 1e-3
        assert usual < 2e-4


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.3), (0.1, 0.0, -0.2), (-0.1, 0.0, 0.0), (0.0, 0.1, 0.0)])
@pytest.mark.parametrize("fog", [Fog(1000.0, 0.0, 0.999), Fog(1e-6, 0.0, -0.999), Fog(0.0, 1.0), FOGS["box"]])
def test_no_bad_number_on_any_rig(offset: tuple[float, float, float], fog: Fog) -> None:
    rig = turned(check_rig(48), (0.0, 0.0, 0.0), offset)
    part = prepare_airlight(
        rig, Scene("fog", fog=fog), buffers_of(random_depths(rig, 1)), "mono", size=TableSize(4, 30)
    )
    random = np.random.default_rng(2)
    for _ in range(6):
        shown = image(part, random_windows(rig, random), rig)
        assert np.isfinite(shown).all()
        assert (shown >= 0).all()
        assert fog.scattering_per_m > 0 or not shown.any()


def test_light_counts_as_often_as_its_row_is_recorded() -> None:
    part = prepare_airlight(RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(random_depths(RIG, 1)), "mono", size=SIZE)
    windows = random_windows(RIG, np.random.default_rng(3))
    inside, outside = (replace(windows, inside=np.full_like(windows.inside, a), outside=np.full_like(windows.inside, b))
                       for a, b in ((1, 0), (0, 1)))  # fmt: skip
    both = replace(windows, inside=np.full_like(windows.inside, 3), outside=np.full_like(windows.inside, 2))
    expected = 3 * image(part, inside, RIG) + 2 * image(part, outside, RIG)
    np.testing.assert_allclose(image(part, both, RIG), expected, rtol=1e-5, atol=1e-6 * expected.max())
    np.testing.assert_allclose(
        image(part, inside, RIG) + image(part, outside, RIG), image(part, every_row(RIG), RIG), rtol=1e-5, atol=1e-6
    )
    nothing = replace(windows, inside=np.zeros_like(windows.inside), outside=np.zeros_like(windows.inside))
    assert not image(part, nothing, RIG).any()


@pytest.mark.parametrize("light_filter", ["mono", "bayer_rg", "rgb"])
def test_grey_light_is_added_alike_to_every_colour(light_filter: Filter) -> None:
    part = prepare_airlight(
        RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(random_depths(RIG, 1)), light_filter, size=SIZE
    )
    windows = random_windows(RIG, np.random.default_rng(3))
    shown = image(part, windows, RIG)
    colour = np.ones((*shown.shape, 3), np.float32)
    part.add(windows, colour)
    for k in range(3):
        np.testing.assert_array_equal(colour[..., k], 1 + shown)


def test_preparing_can_be_stopped_and_tells_how_far_it_is() -> None:
    shares: list[float] = []

    def stop_halfway(share: float) -> bool:
        shares.append(share)
        return share < 0.5

    with pytest.raises(Cancelled):
        prepare_airlight(
            RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(random_depths(RIG, 1)), "mono", progress=stop_halfway
        )
    assert shares == sorted(shares)
    assert 0.5 <= shares[-1] < 0.6


def test_without_fog_there_is_nothing_to_prepare() -> None:
    for fog in (None, Fog(0.0)):
        with pytest.raises(ValueError, match="without fog"):
            prepare_airlight(RIG, Scene("clear", fog=fog), buffers_of(random_depths(RIG, 1)), "mono")


# Scenes with surfaces, which cast shadows into the fog.


def card(depth: float, size: float, x: float = 0.0, y: float = 0.0, motion: KeyFrames | None = None) -> Mesh:
    corners = np.array(
        [
            [x - size, y - size, depth],
            [x + size, y - size, depth],
            [x + size, y + size, depth],
            [x - size, y + size, depth],
        ]
    )
    return Mesh("card", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), motion=motion)


def shaded_light(rig: Rig, scene: Scene, column: float, row: float, steps: int = 4000) -> tuple[float, float]:
    """All airlight of a ray by the midpoint rule, with a shadow ray at each place; and without shadows."""
    medium, optics, tracer = medium_of(scene.fog), make_optics(rig), make_tracer(rig, scene)
    assert medium is not None
    ray = rig.camera_rays(np.array([column]), np.array([row]))
    bodies = tracer.still()
    depth = tracer.trace(np.array([column]), np.array([row]), bodies).depth[0]
    along = (float(ray[0, 0]), float(ray[0, 1]), 1.0)
    first, last = (
        kernels.tau_of(w, optics.kappa) for w in exact_span(optics, medium, make_bend(rig.projector.lens), along)
    )
    first = max(first, 1 / (1 + optics.kappa * depth))
    places = first + (last - first) * (np.arange(steps) + 0.5) / steps
    made = kernels.make_ray(optics, medium, along)
    light = np.array([kernels.density(optics, medium, made, tau) for tau in places]) * (last - first) / steps
    shaded = tracer.shaded(np.repeat(ray, steps, axis=0), (1 - places) / (optics.kappa * places), bodies)
    return float(light[~shaded].sum()), float(light.sum())


@pytest.mark.parametrize("rig", ["ideal", "general", "bent", "beside"])
def test_what_casts_shadows_on_surfaces_casts_them_into_the_fog(rig: str) -> None:
    seen_by = RIGS[rig]
    balls = [Sphere("ball", (x, y, 0.9), 0.06) for x in (-0.3, -0.1, 0.1, 0.3) for y in (-0.2, 0.0, 0.2)]
    scene = Scene("balls", objects=(card(2.0, 3.0), *balls), fog=FOGS["slab"])
    part = prepare_airlight(seen_by, scene, render(seen_by, scene), "mono", size=SIZE)
    shown = image(part, every_row(seen_by), seen_by)
    random = np.random.default_rng(8)
    found, exact, shadow = [], [], 0
    for row, column in zip(random.integers(5, 145, 60), random.integers(5, 195, 60), strict=True):
        light, clear = shaded_light(seen_by, scene, column + 0.5, row + 0.5)
        found.append(shown[row, column])
        exact.append(light)
        shadow += light < 0.97 * clear
    difference = np.abs(np.array(found) - exact) / max(exact)
    assert shadow >= 3  # rays through a shadow among them
    assert difference.max() < 0.04  # at the border of a shadow, which the table blurs over two coarse rays
    assert np.median(difference) < 5e-4
    assert abs(np.mean(found) / np.mean(exact) - 1) < 3e-3


def moving_scene() -> Scene:
    path = KeyFrames(
        np.array([0.0, 1.0, 2.0]), np.array([[-0.4, 0, 0], [0.4, 0.1, 0.2], [0, 0, -0.5]]),
        np.stack([np.eye(3)] * 3), (0, 0, 1), False,
    )  # fmt: skip
    return Scene(
        "moving", objects=(card(1.8, 3.0), card(1.3, 0.1, 0.2), card(0.9, 0.12, motion=path)), fog=FOGS["slab"]
    )


@pytest.mark.parametrize("rig", ["ideal", "general", "bent", "beside"])
def test_what_moves_takes_its_airlight_and_shadows_along(rig: str) -> None:
    seen_by, scene = RIGS[rig], moving_scene()
    renderer = Renderer(seen_by, scene)
    part = prepare_airlight(seen_by, scene, renderer.at(0.0)[0], "mono", size=SIZE)
    windows = [every_row(seen_by), random_windows(seen_by, np.random.default_rng(4))]
    before = image(part, windows[0], seen_by)
    for time_s in (0.05, 0.5, 1.0, 1.8, 0.2):
        buffers, region = renderer.at(time_s)
        part.follow(buffers, region, time_s)
        anew = prepare_airlight(seen_by, scene, render(seen_by, scene, time_s), "mono", time_s, size=SIZE)
        for recorded in windows:
            np.testing.assert_array_equal(image(part, recorded, seen_by), image(anew, recorded, seen_by))
    assert np.abs(image(part, windows[0], seen_by) - before).max() > 0.05 * before.max()


def test_what_moves_takes_along_what_a_pattern_leaves_of_its_airlight() -> None:
    scene, pattern = moving_scene(), random_blocks(RIG, 16, 16)
    renderer = Renderer(RIG, scene)
    part = prepare_airlight(RIG, scene, renderer.at(0.0)[0], "mono", size=SIZE)
    part.light_with(pattern)
    before = image(part, every_row(RIG), RIG)
    for time_s in (0.5, 1.0):
        part.follow(*renderer.at(time_s), time_s)
        anew = prepare_airlight(RIG, scene, render(RIG, scene, time_s), "mono", time_s, size=SIZE)
        anew.light_with(pattern)
        np.testing.assert_array_equal(image(part, every_row(RIG), RIG), image(anew, every_row(RIG), RIG))
    assert np.abs(image(part, every_row(RIG), RIG) - before).max() > 0.02 * before.max()
    part.light_with(None)
    anew.light_with(None)
    np.testing.assert_array_equal(image(part, every_row(RIG), RIG), image(anew, every_row(RIG), RIG))


def test_rays_with_surfaces_of_their_own_follow_a_pattern() -> None:
    """White is as all on also where pixels look at several surfaces, and stripes and their inverse are white."""
    scene = Scene("card before a wall", objects=(card(1.8, 3.0), card(0.9, 0.12)), fog=FOGS["slab"])
    part = prepare_airlight(RIG, scene, render(RIG, scene), "mono", size=SIZE, samples=3)
    lit = image(part, every_row(RIG), RIG)
    stripes = random_blocks(RIG, 1, 32)
    shown = []
    for pattern in (np.ones_like(stripes), stripes, 1 - stripes):
        part.light_with(pattern)
        shown.append(image(part, every_row(RIG), RIG))
    np.testing.assert_allclose(shown[0], lit, atol=1e-4 * lit.max())
    np.testing.assert_allclose(shown[1] + shown[2], lit, atol=1e-4 * lit.max())
    assert np.abs(shown[1] - 0.5 * lit).max() > 0.1 * lit.max()


def test_at_rest_only_a_region_is_looked_at() -> None:
    inverse = random_depths(RIG, 1)
    part = prepare_airlight(RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(inverse), "mono", size=SIZE)
    nearer = inverse.copy()
    nearer[20:40, 50:90] = 2.0
    part.follow(buffers_of(nearer), Region(slice(20, 40), slice(50, 90)), 1.0)
    anew = prepare_airlight(RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(nearer), "mono", size=SIZE)
    windows = every_row(RIG)
    np.testing.assert_allclose(image(part, windows, RIG), image(anew, windows, RIG), rtol=1e-4, atol=1e-5)


def test_in_a_capture_unknown_depths_are_endless_and_the_known_cast_shadows() -> None:
    lens = RIG.camera.lens
    inverse = np.full((lens.height, lens.width), 0.6, np.float32)
    inverse[60:90, 90:120] = 1.2
    inverse[10:20, 10:20] = 0
    photo = np.ones((*inverse.shape, 3), np.float32)
    scene = Scene("capture", capture=MeasuredScene(lens, inverse, photo), fog=FOGS["slab"])
    part = prepare_airlight(RIG, scene, render(RIG, scene), "mono", size=SIZE)
    shown = image(part, every_row(RIG), RIG)
    alone = prepare_airlight(RIG, Scene("fog", fog=FOGS["slab"]), buffers_of(inverse), "mono", size=SIZE)
    lit = image(alone, every_row(RIG), RIG)
    assert shown[15, 15] > 1.03 * shown[15, 30]
    np.testing.assert_allclose(shown[15, 15], lit[15, 15], rtol=0.02)  # the light goes on behind the unknown
    assert (shown <= lit * (1 + 1e-3)).all()
    # The card hides its background from the projector above: under its lower edge the fog lies in its shadow.
    assert shown[95, 105] < 0.95 * lit[95, 105]
    np.testing.assert_allclose(shown[30:50, 20:60], lit[30:50, 20:60], rtol=1e-3)


def test_pixels_in_which_surfaces_end_are_means_over_their_rays() -> None:
    rig, size = check_rig(80), TableSize(1, 120)
    scene = Scene("edge", objects=(card(2.0, 3.0), card(0.7, 0.1, 0.0538, 0.003)), fog=FOGS["slab"])
    part = prepare_airlight(rig, scene, render(rig, scene), "mono", size=size, samples=2)
    single = prepare_airlight(rig, scene, render(rig, scene), "mono", size=size)
    offsets = [(0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)]
    many = [prepare_airlight(rig, scene, render(rig, scene, offset=offset), "mono", size=size) for offset in offsets]
    whole = every_row(rig)
    for recorded in (random_windows(rig, np.random.default_rng(11)), whole):
        mean = np.mean([image(one, recorded, rig) for one in many], axis=0)
        error, centres = (np.abs(image(of, recorded, rig) - mean).max() for of in (part, single))
        assert error < 0.05 * mean.max()
        assert error < 0.5 * centres or recorded is not whole


def test_beside_the_camera_epipolar_imaging_equals_regular_imaging() -> None:
    """All light that changes direction once stays in the plane of both centres: the row that the gate records."""
    rig = RIGS["beside"]
    scene = Scene("cards", objects=(card(2.0, 3.0), card(0.9, 0.15, 0.05, 0.1)), fog=FOGS["thin"])
    line = exact_upright_line_time(rig.camera.lens, rig.projector)
    # One camera row spans 4.8 projector rows; the window holds all of them.
    epipolar, regular = gate(line, 0.0, 200.0), gate(line, 0.0, rig.projector.period_us)
    complement = gate(line, rig.projector.period_us / 2, rig.projector.period_us - 200.0)
    for samples in (1, 3):
        buffers = render(rig, scene)
        part = prepare_airlight(rig, scene, buffers, "mono", size=SIZE, samples=samples)
        narrow, wide, rest = (
            image(part, row_windows(rig, settings), rig) for settings in (epipolar, regular, complement)
        )
        assert wide.max() > 0
        np.testing.assert_allclose(narrow, wide, rtol=1e-5, atol=1e-6 * wide.max())
        assert rest.max() <= 1e-6 * wide.max()
    direct = [integrate(rig, replace(scene, ambient=0.0), settings, 2) for settings in (epipolar, regular)]
    np.testing.assert_allclose(direct[0], direct[1], rtol=1e-6)
    flat = gated(
        buffers.projector_row, buffers.direct, np.zeros_like(buffers.direct), row_windows(rig, complement), 0.0
    )
    assert not flat.any()
