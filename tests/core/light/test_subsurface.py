"""Subsurface light against plain sums over lit skin, integrals in 30 digits, and the laws that every gate keeps."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from patterned_fog import random_blocks
from rigs import bent, check_rig, turned
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows, complement, recorded_times, row_windows
from slopegate.core.light.kernels_subsurface import SkinColumns, half_erf
from slopegate.core.light.part import Filter
from slopegate.core.light.skin_points import SkinBody, in_front, views
from slopegate.core.light.skin_tiles import SkinWays, in_tiles
from slopegate.core.light.subsurface import SkinPart, Subsurface, prepare_subsurface, reached
from slopegate.core.render.render import Cancelled, render
from slopegate.core.render.tracing import Tracer
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.materials import Skin, SkinLobe
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.core.scene.shapes import Finish, plane, quad, turn

RIG = check_rig(160)
T = RIG.projector.period_us
LOBES = (SkinLobe(0.8, (0.3, 0.2, 0.1)), SkinLobe(3.0, (0.4, 0.1, 0.05)))
WHITE = (1.0, 1.0, 1.0)


def card(tilt_deg: float, yaw_deg: float = 0.0, size_m: float = 0.09, depth_m: float = 0.7) -> Scene:
    tile = plane(
        "card", (0, 0, depth_m), (size_m, size_m), turn(tilt_deg, yaw_deg), Finish(WHITE, material=Skin(LOBES))
    )
    return Scene("card", objects=(tile,))


def ball(radius_m: float = 0.04) -> Scene:
    return Scene("ball", objects=(Sphere("ball", (0.01, 0.0, 0.55), radius_m, WHITE, material=Skin(LOBES)),))


def at(rig: Rig, clock_mhz: float, delay_us: float, exposure_us: float) -> GateSettings:
    return gate(rig.camera.shutter.line.line_time_us(clock_mhz), delay_us, exposure_us)  # type: ignore[union-attr]


def image(part: Subsurface, rig: Rig, windows: RowWindows, channels: int = 3) -> Singles:
    lens = rig.camera.lens
    out = np.zeros((lens.height, lens.width, channels) if channels > 1 else (lens.height, lens.width), np.float32)
    part.add(windows, out)
    return out


def over(rig: Rig, row: float, low: float, high: float) -> RowWindows:
    """The same window for every camera row: projector rows from row + low to row + high."""
    ones = np.ones(rig.camera.lens.height)
    return RowWindows((row + low) * ones, (row + high) * ones, ones.astype(np.int32), 0 * ones.astype(np.int32))


# The plain sum: every lit point of the skin, one by one.


class LitSkin:
    """Points of skin with the light that falls on them: points (N, 3), projector rows (N,), flux (N,)."""

    def __init__(self, rig: Rig, points: Doubles, normals: Doubles, areas: Doubles, lit: Doubles) -> None:
        away = points - rig.projector_centre_m
        column, row, depth = rig.to_projector(points)
        lens = rig.projector.lens
        lit = lit & (column >= 0) & (column < lens.width) & (row >= 0) & (row < lens.height)
        self.points, self.rows, self.columns = points[lit], row[lit], column[lit]
        self.flux = (np.abs((away * normals).sum(axis=1)) / depth**3 * areas)[lit]

    def under(self, pattern: Singles) -> LitSkin:
        """The same under a pattern of the projector."""
        shown = copy(self)
        shown.flux = self.flux * pattern[self.rows.astype(int), self.columns.astype(int)]
        return shown

    def seen(self, point: Doubles, windows: RowWindows, camera_row: int, channel: int = 0) -> float:
        square = ((self.points - point) ** 2).sum(axis=1)
        near = np.flatnonzero(square < 0.016**2)
        times = recorded_times(windows, np.full(len(near), camera_row), self.rows[near])
        light = 0.0
        for lobe in LOBES:
            sigma = 1e-3 * lobe.sigma_mm
            gauss = np.exp(-square[near] / (2 * sigma**2)) / (2 * math.pi * sigma**2)
            light += lobe.weight[channel] * float((times * self.flux[near] * gauss).sum())
        return light


def lit_ball(rig: Rig, scene: Scene, steps: int = 400) -> LitSkin:
    item = scene.objects[0]
    assert isinstance(item, Sphere)
    theta = (np.arange(steps) + 0.5) / steps * math.pi
    phi = (np.arange(2 * steps) + 0.5) / steps * math.pi
    t, p = np.meshgrid(theta, phi, indexing="ij")
    # Sheared, so that an edge of a window does not meet a whole line of points at once.
    t = (t + SHEAR * math.pi / steps * np.arange(2 * steps)).ravel() % math.pi
    p = p.ravel()
    normals = np.stack([np.sin(t) * np.cos(p), np.cos(t), np.sin(t) * np.sin(p)], axis=1)
    points = np.array(item.centre_m) + item.radius_m * normals
    areas = np.sin(t) * (math.pi / steps * item.radius_m) ** 2
    lit = ((points - rig.projector_centre_m) * normals).sum(axis=1) < 0
    return LitSkin(rig, points, normals, areas, lit)


def lit_card(rig: Rig, scene: Scene, steps: int = 300) -> LitSkin:
    item = scene.objects[0]
    assert isinstance(item, Mesh)
    # Three corners; the first lies across from the one that both triangles leave out.
    a, b, c = item.vertices[item.faces[0]]
    d = item.vertices.sum(axis=0) - a - b - c
    corner = min((a, b, c), key=lambda point: -float(np.linalg.norm(point - d)))
    others = [point for point in (a, b, c) if point is not corner]
    right, down = others[0] - corner, others[1] - corner
    along = (np.arange(steps) + 0.5) / steps
    u, v = np.meshgrid(along, along)
    v = (v + SHEAR / steps * np.arange(steps)) % 1.0
    u, v = u.ravel()[:, None], v.ravel()[:, None]
    points = corner + u * right + v * down
    normal = np.cross(right, down)
    areas = np.full(len(points), np.linalg.norm(normal) / steps**2)
    normals = np.tile(normal / np.linalg.norm(normal), (len(points), 1))
    tracer = Tracer(rig, scene)
    rays = points - rig.camera_centre_m
    shaded = tracer.shaded(rays / rays[:, 2:], rays[:, 2], tracer.still())
    return LitSkin(rig, points, normals, areas, ~shaded)


def seen_points(rig: Rig, scene: Scene) -> tuple[Indices, Doubles]:
    item = scene.objects[0]
    assert isinstance(item.material, Skin)
    tracer = Tracer(rig, scene)
    patch = SkinBody(item, item.material, 0.0).seen(views(rig)[0], tracer.still(), rig.projector_centre_m)
    patch = in_front(rig, patch)
    return patch.pixels, patch.points


def compare(
    rig: Rig, scene: Scene, lit: LitSkin, windows: RowWindows, among: tuple[Indices, Doubles]
) -> tuple[Doubles, Doubles]:
    """Red light by the part and by the plain sum, of pixels of the first skin and their points, (P,)."""
    pixels, points = among
    ours = image(prepare_subsurface(rig, scene, "rgb"), rig, windows)[..., 0].ravel()[pixels].astype(np.float64)
    rows = pixels // rig.camera.lens.width
    return ours, np.array([lit.seen(p, windows, int(k)) for p, k in zip(points, rows, strict=True)])


def errors(ours: Doubles, plain: Doubles) -> tuple[float, float]:
    """Root of the mean square and the largest difference, both in parts of the mean."""
    off = np.abs(ours - plain) / plain.mean()
    return float(np.sqrt((off**2).mean())), float(off.max())


def anywhere(count: int) -> SkinColumns:
    """Columns of skin for what does not ask for them."""
    return SkinColumns(*np.zeros((3, count), np.float32))


ALL = (-1e6, 1e6)
BRIGHT = at(RIG, 78.0, 452.0 / RIG.projector.rows_per_us - 43.7 * RIG.camera.shutter.line.line_time_us(78.0), 170.0)  # type: ignore[union-attr]
"""A gate of the ball's front."""
SHEAR = 0.6180339887


def test_on_a_ball_of_40_mm_it_is_the_sum_over_all_lit_points() -> None:
    """The bound that the docstring of `subsurface` speaks of: curved skin, its outline and the edge of its own shade,
    for a lobe of 3 mm, against the sum with straight distances through the skin."""
    scene = ball()
    lit = lit_ball(RIG, scene)
    pixels, points = seen_points(RIG, scene)
    among = pixels[::2], points[::2]
    for low, high, mean_square, most in (
        (*ALL, 0.02, 0.12),
        (-3.0, 3.0, 0.03, 0.25),
        (4.0, 12.0, 0.04, 0.2),
        (-12.0, -4.0, 0.04, 0.2),
    ):
        ours, plain = compare(RIG, scene, lit, over(RIG, 452.0, low, high), among)
        off, worst = errors(ours, plain)
        print(f"ball, rows {low:g}..{high:g}: {off:.4f} {worst:.4f}")
        assert plain.max() > 0.3
        assert off < mean_square
        assert worst < most


@pytest.mark.parametrize(("name", "rig"), [("ball", turned(RIG)), ("card", RIG)], ids=["ball", "card"])
def test_under_a_pattern_it_is_the_sum_over_all_points_that_it_lights(name: str, rig: Rig) -> None:
    """Blocks from far wider than a lobe to as narrow as one: a lobe of 3 mm is 4 rows deep here."""
    scene = ball() if name == "ball" else card(35.0, 30.0)
    lit = lit_ball(rig, scene) if name == "ball" else lit_card(rig, scene)
    pixels, points = seen_points(rig, scene)
    among = slice(None, None, len(pixels) // 300)
    pixels, points = pixels[among], points[among]
    part, row = prepare_subsurface(rig, scene, "rgb"), float(np.median(lit.rows))
    mean = image(part, rig, over(rig, 0.0, *ALL))[..., 0].ravel()[pixels].mean()
    for size, bound in ((32, 0.03), (512, 0.03)):
        pattern = random_blocks(rig, size, size)
        part.light_with(pattern)
        shown = lit.under(pattern)
        for low, high in (ALL, (4.0, 12.0)):
            windows = over(rig, row, low, high)
            ours = image(part, rig, windows)[..., 0].ravel()[pixels]
            rows = pixels // rig.camera.lens.width
            plain = np.array([shown.seen(p, windows, int(k)) for p, k in zip(points, rows, strict=True)])
            off = float(np.sqrt(((ours - plain) ** 2).mean())) / mean
            print(f"{name}, blocks {size}, rows {low:g}..{high:g}: {off:.4f}")
            assert plain.max() > 0.1 * mean
            assert off < bound


@pytest.mark.parametrize(("tilt", "yaw"), [(-50.0, 0.0), (0.0, 0.0), (35.0, 30.0)])
def test_on_a_flat_card_it_is_the_sum_over_all_lit_points(tilt: float, yaw: float) -> None:
    hold_on_card(RIG, card(tilt, yaw))


def test_on_a_frontal_card_it_is_the_error_function() -> None:
    scene = card(0.0)
    pixels, points = seen_points(RIG, scene)
    middle = np.abs(points[:, :2]).max(axis=1) < 0.02
    row = RIG.to_projector(points[middle])[1]
    part = prepare_subsurface(RIG, scene, "rgb")
    for low, high in ((-2.0, 1.5), (4.0, 12.0), (-9.0, -3.0)):
        ours = image(part, RIG, over(RIG, 435.0, low, high))[..., 0].ravel()[pixels[middle]]
        expected = np.zeros(len(row))
        for lobe in LOBES:
            s = lobe.sigma_mm * math.sqrt(2) / 0.7
            expected += (
                lobe.weight[0]
                / 0.98
                * np.array([math.erf((435 + high - r) / s) - math.erf((435 + low - r) / s) for r in row])
            )
        assert expected.max() > 0.2
        assert np.abs(ours - expected).max() < 1e-5 * expected.max()


BESIDE = replace(RIG, projector_offset_m=(-0.1, -1e-6, 0.0))


@pytest.mark.parametrize(
    "rig", [turned(RIG), bent(RIG), bent(turned(RIG)), BESIDE], ids=["turned", "bent", "both", "beside"]
)
def test_any_rig_has_it(rig: Rig) -> None:
    hold_on_card(rig, card(20.0, 15.0))


def hold_on_card(rig: Rig, scene: Scene) -> None:
    """Off the card's edges, of which a test of its own has the bound."""
    pixels, points = seen_points(rig, scene)
    middle = np.abs(points[:, :2]).max(axis=1) < 0.02
    among = pixels[middle], points[middle]
    assert len(among[0]) > 40
    lit = lit_card(rig, scene)
    row = float(np.median(rig.to_projector(among[1])[1]))
    for low, high in (ALL, (-2.0, 1.5), (4.0, 12.0)):
        ours, plain = compare(rig, scene, lit, over(rig, row, low, high), among)
        print(f"card, rows {low:g}..{high:g}: {np.abs(ours - plain).max() / plain.max():.4f}")
        assert plain.max() > 0.1
        # The plain sum itself is off by 0.011 at the edges of a window.
        assert np.abs(ours - plain).max() < 0.02 * plain.max()


def test_a_shadow_and_the_edges_of_skin_glow_as_far_as_its_light_reaches() -> None:
    """A bar shades the card: light goes under it from both sides. The bound where neighbours are dark."""
    # Aslant: edges along the projector's rows would all be off by the same part of its pixel.
    bar = quad("bar", (-0.2, -0.09, 0.6), (0.4, 0.1, 0.0), (0.0, 0.008, 0.0))
    scene, rig = replace(card(0.0), objects=(*card(0.0).objects, bar)), check_rig(1600)
    lit = lit_card(rig, scene)
    pixels, points = seen_points(rig, scene)
    spread = slice(None, None, 173)
    among = pixels[spread], points[spread]
    ours, plain = compare(rig, scene, lit, over(rig, 435.0, *ALL), among)
    dark = render(rig, scene).projector_row.ravel()[among[0]] < 0
    print(f"shadow: {ours[dark].mean():.4f} {plain[dark].mean():.4f}", errors(ours, plain))
    assert 10 < dark.sum() < 0.5 * len(dark)
    assert plain[dark].mean() > 0.03
    assert ours[dark].mean() == pytest.approx(plain[dark].mean(), rel=0.03)
    off, worst = errors(ours, plain)
    assert off < 0.03
    assert worst < 0.12


def test_light_that_would_come_in_beyond_the_raster_does_not_exist() -> None:
    scene = card(0.0, size_m=1.4, depth_m=0.7)
    rig = check_rig(400)
    pixels, points = seen_points(rig, scene)
    column, row, _ = rig.to_projector(points)
    chosen = np.flatnonzero((np.abs(row) < 6) | (np.abs(row - 720) < 6) | (np.abs(column) < 6))[::37]
    assert len(chosen) > 20
    light = image(prepare_subsurface(rig, scene, "rgb"), rig, over(rig, 0.0, *ALL))[..., 0].ravel()[pixels[chosen]]
    strength = np.abs(points[chosen] - rig.projector_centre_m)[:, 2] ** -2.0
    for light_, row_, column_, bright in zip(light, row[chosen], column[chosen], strength, strict=True):
        expected = 0.0
        for lobe in LOBES:
            s = lobe.sigma_mm * math.sqrt(2) * 1000 / 700
            shares = [0.5 * (math.erf((n - x) / s) + math.erf(x / s)) for x, n in ((row_, 720), (column_, 1280))]
            expected += lobe.weight[0] * shares[0] * shares[1] * bright
        # Columns are told apart by whole pixels of the projector where the light is gathered.
        assert light_ == pytest.approx(expected, abs=0.05 * bright)


# The closed form itself.


def test_half_erf_keeps_its_bound_rises_and_is_odd() -> None:
    x = np.concatenate([np.linspace(-6, 6, 100_001), np.geomspace(1e-9, 1e9, 1000)]).astype(np.float32)
    values = np.array([half_erf(value) for value in x])
    exact = np.array([0.5 * math.erf(float(value)) for value in x])
    assert np.abs(values - exact).max() < 9e-7
    assert (np.diff(values[:100_001]) >= 0).all()
    assert (values[:100_001] == -values[:100_001][::-1]).all()


@given(
    row=st.floats(-30, 750),
    sharpness=st.floats(0.01, 5.0),
    curvature=st.floats(-0.02, 0.02),
    drift=st.floats(-1.5, 1.5),
    edges=st.tuples(st.floats(-100, 800), st.floats(0, 400)),
    counts=st.tuples(st.integers(0, 3), st.integers(0, 3)),
)
def test_a_pixel_is_its_integral_to_thirty_digits(
    row: float,
    sharpness: float,
    curvature: float,
    drift: float,
    edges: tuple[float, float],
    counts: tuple[int, int],
) -> None:
    low, high = edges[0], edges[0] + edges[1]
    ways = SkinWays(np.array([row]), np.array([sharpness]), np.array([curvature]), np.array([1.3]), np.array([[drift]]))
    pixels = in_tiles(np.array([0]), np.array([2]), 1, ways, np.array([[[2.0]]], np.float32), 720.0)
    one = np.ones(1)
    inside, outside = (np.full(1, count, np.int32) for count in counts)
    out = np.zeros((1, 4), np.float32)
    Subsurface(720, [SkinPart(pixels, anywhere(1))]).add(RowWindows(low * one, high * one, inside, outside), out)

    def share(at_row: float) -> mpmath.mpf:
        with mpmath.workdps(30):
            x = mpmath.mpf(at_row) - mpmath.mpf(row)
            bend = min(max(curvature * x, mpmath.mpf(-0.25)), mpmath.mpf(0.25))
            return mpmath.erf(x * (1 - bend) * sharpness / mpmath.mpf(1.3) - drift) / 2

    bottom, top = min(max(low, 0.0), 720.0), min(max(high, 0.0), 720.0)
    within, all_ = share(top) - share(bottom), share(720.0) - share(0.0)
    expected = 2 * (counts[1] * all_ + (counts[0] - counts[1]) * within)
    # 9e-7 a value of half_erf, and float32 in its argument.
    assert float(abs(out[0, 2] - expected)) < 2e-5
    assert out[0, 2] >= 0
    assert not out[0, [0, 1, 3]].any()


@pytest.mark.parametrize("clock", [70.0, 78.0, 90.0])
def test_gates_that_tile_a_period_add_up_to_the_fully_lit_light(clock: float) -> None:
    part = prepare_subsurface(RIG, ball(), "rgb")
    full = image(part, RIG, row_windows(RIG, at(RIG, clock, 0.0, T)))
    assert full.max() > 0.5
    slices = [image(part, RIG, row_windows(RIG, at(RIG, clock, (n + 0.5) * T / 23, T / 23))) for n in range(23)]
    assert np.abs(np.sum(slices, axis=0) - full).max() < 1e-5
    assert min(one.min() for one in slices) >= 0.0
    brightest = int(np.argmax([one.sum() for one in slices]))
    one = at(RIG, clock, (brightest + 0.5) * T / 23, 170.0)
    both = [image(part, RIG, row_windows(RIG, settings)) for settings in (one, complement(one, T))]
    assert both[0].max() > 0.1
    assert min(half.min() for half in both) >= 0.0
    assert np.abs(both[0] + both[1] - full).max() < 1e-5
    assert np.abs(image(part, RIG, row_windows(RIG, at(RIG, clock, 0.0, 2 * T))) - 2 * full).max() < 1e-5


def test_leaving_tiles_out_changes_nothing() -> None:
    part = prepare_subsurface(RIG, ball(), "rgb")
    everywhere = [
        pixels._replace(low=np.full_like(pixels.low, -np.inf), high=np.full_like(pixels.high, np.inf))
        for pixels, _ in part._skins
    ]
    for delay in np.linspace(3200.0, 4000.0, 9):
        windows = row_windows(RIG, at(RIG, 78.0, float(delay), 120.0))
        plain = image(Subsurface(720, [SkinPart(each, anywhere(part.count)) for each in everywhere]), RIG, windows)
        assert np.abs(image(part, RIG, windows) - plain).max() < 3e-8


# Colours, fog, motion, and what has no skin.


def test_filters_are_those_of_the_colour_picture() -> None:
    windows = row_windows(RIG, BRIGHT)
    colour = image(prepare_subsurface(RIG, ball(), "rgb"), RIG, windows)
    assert (colour.max(axis=(0, 1)) > 0.02).all()
    filters: tuple[tuple[Filter, Singles], ...] = (("mono", mono(colour)), ("bayer_rg", bayer_rg(colour)))
    for name, expected in filters:
        np.testing.assert_allclose(image(prepare_subsurface(RIG, ball(), name), RIG, windows, 1), expected, atol=1e-6)


def test_it_adds_to_what_is_there() -> None:
    part = prepare_subsurface(RIG, ball(), "mono")
    windows = row_windows(RIG, BRIGHT)
    out = np.ones((RIG.camera.lens.height, RIG.camera.lens.width), np.float32)
    part.add(windows, out)
    np.testing.assert_allclose(out, 1 + image(part, RIG, windows, 1), atol=1e-6)


def test_fog_takes_from_it_what_it_takes_from_direct_light() -> None:
    fog = Fog(0.8, 0.3, lo_m=(-0.5, -0.5, 0.2), hi_m=(0.03, 0.5, 0.9))
    clear, foggy = ball(), replace(ball(), fog=fog)
    windows = over(RIG, 0.0, *ALL)
    ratio = [image(prepare_subsurface(RIG, scene, "rgb"), RIG, windows)[..., 0] for scene in (foggy, clear)]
    direct = [render(RIG, scene).direct[..., 0] for scene in (foggy, clear)]
    lit = (direct[1] > 0) & (ratio[1] > 0.1)
    kept = direct[0][lit] / direct[1][lit]
    assert 0.3 < kept.min() < kept.max() < 0.75
    np.testing.assert_allclose(ratio[0][lit] / ratio[1][lit], kept, rtol=1e-5)


def test_with_the_direct_light_it_is_what_a_matt_card_shows() -> None:
    """Nothing is lost where all of the card is lit: what is not thrown back where it fell comes out beside."""
    skin = card(30.0, 20.0)
    matt = replace(skin, objects=tuple(replace(item, material=None) for item in skin.objects))
    pixels, points = seen_points(RIG, skin)
    middle = pixels[np.abs(points[:, :2]).max(axis=1) < 0.02]
    part = prepare_subsurface(RIG, skin, "rgb")
    assert part.count == len(pixels)
    below = image(part, RIG, over(RIG, 0.0, *ALL)).reshape(-1, 3)[middle]
    shown = render(RIG, skin).direct.reshape(-1, 3)[middle] + below
    assert below.min() > 0.1
    np.testing.assert_allclose(shown, render(RIG, matt).direct.reshape(-1, 3)[middle], rtol=1e-3)


def test_skin_that_moves_is_prepared_where_it_is() -> None:
    there = np.array([0.02, 0.01, 0.03])
    tilted, motion = (
        turn(20.0),
        KeyFrames(np.array([0.0, 1.0]), np.array([0 * there, there]), np.empty(0), (0, 0, 0.55)),
    )
    motion = replace(motion, rotations=np.stack([np.eye(3), tilted]), loop=False)
    still = card(0.0, depth_m=0.55)
    item = still.objects[0]
    turned_item = replace(item, vertices=(item.vertices - (0, 0, 0.55)) @ tilted.T + (0, 0, 0.55) + there)
    windows = over(RIG, 452.0, -4.0, 6.0)
    moving = prepare_subsurface(RIG, replace(still, objects=(replace(item, motion=motion),)), "rgb", time_s=1.0)
    placed = prepare_subsurface(RIG, replace(still, objects=(turned_item,)), "rgb")
    expected = image(placed, RIG, windows)
    assert expected.max() > 0.1
    np.testing.assert_allclose(image(moving, RIG, windows), expected, atol=1e-4)


def test_what_stands_before_skin_hides_it() -> None:
    screen = quad("screen", (-0.5, -0.5, 0.3), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert prepare_subsurface(RIG, replace(ball(), objects=(*ball().objects, screen)), "mono").count == 0


def test_scenes_without_skin_or_with_skin_that_is_all_surface_have_none() -> None:
    matt = replace(ball(), objects=(Sphere("ball", (0.0, 0.0, 0.55), 0.04),))
    surface = replace(ball(), objects=(Sphere("ball", (0.0, 0.0, 0.55), 0.04, material=Skin(())),))
    behind = replace(ball(), objects=(Sphere("ball", (0.0, 0.0, -0.55), 0.04, material=Skin(LOBES)),))
    for scene in (matt, surface, behind):
        part = prepare_subsurface(RIG, scene, "rgb")
        assert part.count == 0
        assert not image(part, RIG, over(RIG, 0.0, *ALL)).any()


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.0, -0.05, 0.02), (0.0, 0.05, 0.03), (0.3, -0.4, 0.1)])
def test_skin_about_the_rig_itself_gives_no_nonsense(centre: tuple[float, float, float]) -> None:
    scene = replace(ball(), objects=(Sphere("ball", centre, 0.06, material=Skin(LOBES)),))
    part = prepare_subsurface(RIG, scene, "rgb")
    for low, high in (ALL, (100.0, 110.0)):
        light = image(part, RIG, over(RIG, 0.0, low, high))
        assert np.isfinite(light).all()
        assert light.min() >= 0.0


def test_preparing_can_be_stopped() -> None:
    with pytest.raises(Cancelled):
        prepare_subsurface(RIG, ball(), "rgb", progress=lambda share: False)


# Veins.


def test_how_much_light_goes_deep_agrees_with_the_series_that_is_good_for_small_depths() -> None:
    def other(x: float) -> float:
        k2 = np.arange(1, 40) ** 2
        return 1 - float(math.sqrt(2) * math.pi**2.5 / x**3 * np.sum(k2 * np.exp(-(math.pi**2) * k2 / (2 * x * x))))

    for depth in np.linspace(0.3, 6.0, 30):
        assert reached(depth, 2.0) == pytest.approx(other(depth / 2.0), abs=1e-12)
    values = [reached(depth, 1.0) for depth in np.linspace(0.01, 8, 400)]
    assert values[0] == 1.0
    assert (np.diff(values) <= 1e-15).all()


def test_random_walks_that_come_back_go_that_deep() -> None:
    """A Brownian excursion as the three-dimensional Bessel bridge, 4000 of them."""
    rng, steps = np.random.default_rng(5), 600
    walk = np.cumsum(rng.normal(size=(6000, steps, 3)).astype(np.float32), axis=1) / math.sqrt(steps)
    share = (np.arange(1, steps + 1) / steps).astype(np.float32)[None, :, None]
    deepest = np.sqrt(((walk - share * walk[:, -1:]) ** 2).sum(axis=2)).max(axis=1)
    # What a walk in steps misses of its greatest depth (Broadie, Glasserman and Kou 1997).
    deepest += 0.5826 / math.sqrt(steps)
    for depth in (0.8, 1.2, 1.7):
        assert reached(depth, 1.0) == pytest.approx(float((deepest > depth).mean()), abs=0.02)


def test_a_vein_takes_its_share_of_what_goes_deep_and_looks_blurred() -> None:
    veins = np.zeros((200, 200), np.float32)
    veins[:, 90:110] = 1.0
    skin = Skin(LOBES, veins, depth_mm=2.0, absorbed=(0.9, 0.5, 0.0))
    rig = check_rig(400)
    tiles = [plane("card", (0, 0, 0.5), (0.1, 0.1), turn(), Finish(WHITE, material=one)) for one in (skin, Skin(LOBES))]
    scenes = [Scene("card", objects=(tile,)) for tile in tiles]
    veined, bare = (image(prepare_subsurface(rig, one, "rgb"), rig, over(rig, 0.0, *ALL)) for one in scenes)
    pixels, points = seen_points(rig, scenes[0])
    x_mm, y = 1e3 * points[:, 0], points[:, 1]
    inside = np.abs(y) < 0.03
    lost = 1 - veined.reshape(-1, 3)[pixels] / bare.reshape(-1, 3)[pixels]
    # 20 of 200 texels on 100 mm: a band of 10 mm, seen through a Gaussian of each lobe's sigma over the root of 2.
    for channel, absorbed in enumerate(skin.absorbed):
        deep = np.zeros(len(pixels))
        for lobe in LOBES:
            blur = [0.5 * np.array([math.erf((e - x) / lobe.sigma_mm) for x in x_mm]) for e in (-5.0, 5.0)]
            deep += lobe.weight[channel] * reached(2.0, lobe.sigma_mm) * (blur[1] - blur[0])
        expected = absorbed * deep / sum(lobe.weight[channel] for lobe in LOBES)
        assert np.abs(lost[:, channel] - expected)[inside].max() < 0.01


def test_a_texture_gives_skin_its_colour() -> None:
    texture = np.zeros((1, 2, 3), np.float32)
    texture[0, 0], texture[0, 1] = (1.0, 0.5, 0.25), (0.2, 0.4, 0.6)
    tile = plane("card", (0, 0, 0.5), (0.1, 0.1), turn(), Finish(WHITE, texture, Skin((SkinLobe(1.0, WHITE),))))
    scene = Scene("card", objects=(tile,))
    light = image(prepare_subsurface(RIG, scene, "rgb"), RIG, over(RIG, 0.0, *ALL)).reshape(-1, 3)
    pixels, points = seen_points(RIG, scene)
    for side, colour in ((-1, texture[0, 0]), (1, texture[0, 1])):
        x, y = side * points[:, 0], np.abs(points[:, 1])
        here = light[pixels[(x > 0.01) & (x < 0.03) & (y < 0.03)]]
        np.testing.assert_allclose(here / here[:, :1], np.tile(colour / colour[0], (len(here), 1)), rtol=1e-4)


def test_a_spheres_veins_go_once_round_it_with_the_middle_towards_the_rig() -> None:
    veins = np.zeros((180, 360), np.float32)
    veins[60:120, 200:240] = 1.0  # to the right of the middle, from 20 to 60 degrees
    skins = [Skin((SkinLobe(1.0, WHITE),), one, depth_mm=0.1, absorbed=WHITE) for one in (veins, None)]
    rig = check_rig(400)
    scenes = [replace(ball(), objects=(Sphere("ball", (0.0, 0.0, 0.5), 0.06, WHITE, material=s),)) for s in skins]
    veined, bare = (image(prepare_subsurface(rig, one, "rgb"), rig, over(rig, 0.0, *ALL)) for one in scenes)
    pixels, points = seen_points(rig, scenes[0])
    out = (points - (0.0, 0.0, 0.5)) / 0.06
    east, south = np.degrees(np.arctan2(out[:, 0], -out[:, 2])), np.degrees(np.arcsin(out[:, 1]))
    left = veined[..., 0].ravel()[pixels] / np.maximum(bare[..., 0].ravel()[pixels], 1e-6)
    lit = bare[..., 0].ravel()[pixels] > 0.1
    within = (np.abs(east - 40) < 17) & (np.abs(south) < 27)
    without = (np.abs(east - 40) > 23) | (np.abs(south) > 33)
    assert (within & lit).sum() > 100
    assert left[within & lit].max() < 0.02
    assert left[without & lit].min() > 0.98


def test_veins_without_texture_coordinates_are_refused_by_name() -> None:
    tile = replace(plane("card", (0, 0, 0.5), (0.1, 0.1), turn()), material=Skin(LOBES, np.ones((2, 2), np.float32)))
    with pytest.raises(InputError, match="card has veins and no texture coordinates"):
        prepare_subsurface(RIG, Scene("card", objects=(tile,)), "mono")
