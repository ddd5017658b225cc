"""The near halo against paths through the true geometry, and against its integral taken in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from halo_reference import SlantedEdge, halo_by_paths, slanted_edge
from rigs import bent, check_rig, plain_rig, turned
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows, complement, row_windows
from slopegate.core.light.halo import HALO_RADIUS, halo_share
from slopegate.core.light.scatter import Scatter, ScatterSums, cell_size, make_turns, spread_of_pixels
from slopegate.core.light.scatter_kernels import halo
from slopegate.core.render.render import Buffers, Cancelled, render
from slopegate.core.rig.arrays import Doubles, Ints, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import MeasuredScene, Mesh, Scene, Sphere

HAZE = Fog(0.4, 0.02, 0.85)


def small_rig() -> Rig:
    return check_rig(200)


def open_gate(rig: Rig) -> GateSettings:
    return gate(1.0, 0.0, rig.projector.period_us)


def thin_gate(rig: Rig, buffers: Buffers, exposure_us: float = 400.0) -> GateSettings:
    """Upright, through what the middle of the picture shows."""
    line_us = 1e6 / 60 * 0.92 / 720 * 1000 / rig.camera.lens.fy
    k, j = rig.camera.lens.height // 2, rig.camera.lens.width // 2
    delay_us = float(buffers.projector_row[k, j]) / rig.projector.rows_per_us - (k + 0.5) * line_us
    return gate(line_us, delay_us, exposure_us)


def edge_in_fog(edge: SlantedEdge, fog: Fog | None = HAZE) -> Scene:
    return Scene("edge", objects=(edge.mesh(),), fog=fog)


def sums(
    rig: Rig, scene: Scene, windows: RowWindows, buffers: Buffers | None = None, max_order: int | None = None
) -> Singles:
    out = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    ScatterSums(rig, scene, buffers or render(rig, scene), "mono", None, max_order).add(windows, out)
    return out


@pytest.mark.parametrize("g", [-0.9, 0.0, 0.85, 0.999])
def test_one_pair_is_the_integral_along_the_ray(g: float) -> None:
    """s from the camera to the plane of the element or to what ends the ray, D^2 cos(beta) / rho^2 and all."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        extinction, distance, alpha = 10 ** rng.uniform(-2, 0.7), rng.uniform(0.3, 3), 10 ** rng.uniform(-3.7, -1.4)
        tilt, first = np.tan(rng.uniform(-1.4, 1.4)), rng.choice([0.0, 0.6]) * distance
        last = rng.choice([distance * 0.95, distance * 1.3, np.inf])
        element, along = np.array([distance, 0.0]), np.array([np.cos(alpha), np.sin(alpha)])
        off = distance * np.sin(alpha)
        ends = [(s - distance * np.cos(alpha)) / off for s in (first, min(last, 30 * distance))]
        u = np.linspace(np.arcsinh(ends[0]), np.arcsinh(ends[1]), 40001)
        s = distance * np.cos(alpha) + off * np.sinh(u)
        to = s[:, None] * along - element
        rho = np.linalg.norm(to, axis=1)
        facing = np.maximum(to @ np.array([-1.0, tilt]), 0) / rho
        phase = (1 - g * g) / (4 * np.pi * (1 + g * g + 2 * g * (to @ along) / rho) ** 1.5)
        left = np.exp(-extinction * (s + rho - distance))
        value = distance**2 * phase * facing / rho**2 * left * off * np.cosh(u)
        expected = integrate.simpson(value, x=u)
        turns = make_turns(g, extinction * distance * HALO_RADIUS)
        found = halo(turns, extinction, distance, np.sin(alpha), np.cos(alpha), tilt, first, last)
        assert found == pytest.approx(expected, rel=1e-3, abs=1e-6)


def test_a_pixels_area_makes_of_one_over_r_what_it_should() -> None:
    spread = spread_of_pixels(small_rig().camera.lens)
    middle = len(spread) // 2
    # The mean of 1 / r over two points of one unit square.
    assert 1 / spread[middle, middle] == pytest.approx(4 * np.log(1 + np.sqrt(2)) - 4 / 3 * (np.sqrt(2) - 1), rel=1e-4)
    # Far off the tent's variance of 1/6 an axis is left, at half the Laplacian of 1/r.
    assert spread[middle, 2 * middle] - 1 == pytest.approx(1 / (12 * middle**2), rel=0.1)


CASES = {
    "frontal": (0.0, False, HAZE),
    "road": (30.0, False, HAZE),
    "level edge": (20.0, True, HAZE),
    "fog begins before the rig": (0.0, False, Fog(0.8, 0.1, 0.9, (-2, -2, 0.6), (2, 2, 3))),
    "scattered evenly": (20.0, False, Fog(0.8, 0.1, 0.0)),
}


QUICK = ("road", "fog begins before the rig")


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=() if case in QUICK else pytest.mark.slow) for case in CASES]
)
def test_sums_agree_with_paths(case: str) -> None:
    """One turn: within 1.5 % and the paths' own error (5 of it) where no edge runs through the pixels next to it."""
    tilt, on_side, fog = CASES[case]
    rig, edge = small_rig(), slanted_edge(tilt, 5.0, 1.5, on_side)
    scene = edge_in_fog(edge, fog)
    buffers = render(rig, scene)
    for settings, slack in ((open_gate(rig), 0.015), (thin_gate(rig, buffers), 0.03)):
        windows = row_windows(rig, settings)
        found = sums(rig, scene, windows, buffers, 2)
        pixels = [(75, 90), (75, 110), (65, 104), (84, 95)] if not on_side else [(64, 100), (80, 100), (88, 95)]
        for pixel in pixels:
            expected, error = halo_by_paths(rig, edge, fog, windows, pixel, 200_000, 1)
            assert abs(found[pixel] - expected) < slack * expected + 5 * error, (pixel, found[pixel], expected, error)


def test_a_gate_cuts_the_halo_across_rows_alone() -> None:
    """A lit line of one column keeps its halo along the row; one of one row loses it beyond the window."""
    rig, scene = small_rig(), edge_in_fog(slanted_edge(0.0, 5.0, 1.5))
    buffers = render(rig, scene)
    windows = row_windows(rig, thin_gate(rig, buffers, 300.0))
    for point in (0, 1):
        direct = np.zeros_like(buffers.direct)
        direct[75, 100] = 1.0
        lit = replace(buffers, direct=direct)
        gated, whole = sums(rig, scene, windows, lit), sums(rig, scene, row_windows(rig, open_gate(rig)), lit)
        assert gated[75, 100 + 5 * point] == pytest.approx(whole[75, 100 + 5 * point], rel=1e-5)
        assert whole[80, 100] > 0.5 * whole[75, 105] > 0
        assert gated[80, 100] == 0


def test_gate_and_complement_add_up() -> None:
    rig, scene = small_rig(), edge_in_fog(slanted_edge(20.0, 5.0, 1.5))
    buffers = render(rig, scene)
    settings = thin_gate(rig, buffers)
    both = [settings, complement(settings, rig.projector.period_us)]
    parts = [sums(rig, scene, row_windows(rig, each), buffers) for each in both]
    whole = sums(rig, scene, row_windows(rig, open_gate(rig)), buffers)
    np.testing.assert_allclose(parts[0] + parts[1], whole, rtol=1e-5, atol=1e-8)


def test_every_filter_shows_the_same_light() -> None:
    rig = check_rig(120)
    coloured = Mesh(
        "wall",
        np.array([[-2, -2, 1.5], [2, -2, 1.5], [2, 2, 1.5], [-2, 2, 1.5]], float),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        albedo=(0.8, 0.4, 0.1),
    )
    scene = Scene("wall", objects=(coloured, Sphere("ball", (0, 0, 1.2), 0.1, (0.1, 0.2, 0.9))), fog=HAZE)
    buffers, windows = render(rig, scene), row_windows(rig, open_gate(rig))
    shape = rig.camera.lens.height, rig.camera.lens.width
    rgb, grey, mosaic = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    ScatterSums(rig, scene, buffers, "rgb").add(windows, rgb)
    ScatterSums(rig, scene, buffers, "mono").add(windows, grey)
    ScatterSums(rig, scene, buffers, "bayer_rg").add(windows, mosaic)
    np.testing.assert_allclose(grey, mono(rgb), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(mosaic, bayer_rg(rgb), rtol=1e-6)
    assert rgb[45, 20, 0] > 3 * rgb[45, 20, 2] > 0


def test_clear_air_adds_nothing() -> None:
    rig = check_rig(40)
    for fog in (None, Fog(0.0), Fog(0.0, 0.5)):
        scene = edge_in_fog(slanted_edge(0.0, 5.0, 1.5), fog)
        assert not sums(rig, scene, row_windows(rig, open_gate(rig))).any()


def test_thick_fog_grazing_planes_and_empty_views_give_finite_light() -> None:
    rig = check_rig(60)
    scenes = [
        edge_in_fog(slanted_edge(tilt, 5.0, 1.5), Fog(density, 0.0, g))
        for tilt in (0.0, 88.0)
        for density in (1e-6, 1000.0)
        for g in (-0.999, 0.999)
    ]
    for scene in (*scenes, Scene("nothing", fog=HAZE), Scene("ball", objects=(Sphere("b", (0, 0, 1), 0.2),), fog=HAZE)):
        found = sums(rig, scene, row_windows(rig, open_gate(rig)))
        assert np.isfinite(found).all()
        assert (found >= 0).all()


def test_it_can_be_stopped() -> None:
    rig, scene = check_rig(40), edge_in_fog(slanted_edge(0.0, 5.0, 1.5))
    out = np.zeros((30, 40), np.float32)
    part = ScatterSums(rig, scene, render(rig, scene), "mono", lambda share: share < 0.4)
    with pytest.raises(Cancelled):
        part.add(row_windows(rig, open_gate(rig)), out)
    assert not out.any()


def test_the_halo_ends_at_its_radius() -> None:
    rig, scene = small_rig(), edge_in_fog(slanted_edge(0.0, 5.0, 1.5))
    buffers = render(rig, scene)
    direct = np.zeros_like(buffers.direct)
    direct[75, 100] = 1.0
    found = sums(rig, scene, row_windows(rig, open_gate(rig)), replace(buffers, direct=direct))
    reach = HALO_RADIUS * rig.camera.lens.fx
    assert found[75, 100 + int(reach)] > 0
    assert found[75, 100 + int(reach) + 2 :].max() == 0
    assert halo_share(HALO_RADIUS) == 0


# The live way.


def live(rig: Rig, scene: Scene, windows: RowWindows, buffers: Buffers) -> Singles:
    out = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    Scatter(rig, scene, buffers, "mono").add(windows, out)
    return out


def assert_close(rig: Rig, scene: Scene, settings: GateSettings, buffers: Buffers, rms: float) -> None:
    windows = row_windows(rig, settings)
    expected, found = sums(rig, scene, windows, buffers), live(rig, scene, windows, buffers)
    brightest = expected.max()
    assert brightest > 0
    assert abs(found.mean() - expected.mean()) < (0.01 if rms <= 0.01 else 0.03) * expected.mean()
    assert np.sqrt(((found - expected) ** 2).mean()) < rms * brightest
    assert np.abs(found - expected).max() < 0.15 * brightest


@pytest.mark.parametrize(("tilt", "g"), [(0.0, 0.85), (20.0, 0.0), (70.0, 0.85), (-40.0, 0.5)])
def test_the_live_way_agrees_with_the_sums(tilt: float, g: float) -> None:
    rig = check_rig(160)
    scene = edge_in_fog(slanted_edge(tilt, 5.0, 1.5), Fog(0.5, 0.02, g))
    buffers = render(rig, scene)
    assert_close(rig, scene, open_gate(rig), buffers, 0.01)
    assert_close(rig, scene, thin_gate(rig, buffers), buffers, 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_live_way_agrees_with_the_sums_in_every_case(case: str) -> None:
    tilt, on_side, fog = CASES[case]
    rig, scene = small_rig(), edge_in_fog(slanted_edge(tilt, 5.0, 1.5, on_side), fog)
    buffers = render(rig, scene)
    for exposure_us, rms in ((open_gate(rig).exposure_us, 0.01), (2000.0, 0.02), (300.0, 0.025)):
        assert_close(rig, scene, thin_gate(rig, buffers, exposure_us), buffers, rms)


@pytest.mark.slow
def test_the_live_way_agrees_with_the_sums_in_cells_of_many_pixels() -> None:
    """A long lens, of which only a part of the picture is small enough to sum up."""
    rig = plain_rig(90, 72, 1600.0, check_rig(40).camera.shutter)
    assert cell_size(rig.camera.lens) == 3
    scene = edge_in_fog(slanted_edge(20.0, 5.0, 1.5))
    buffers = render(rig, scene)
    assert_close(rig, scene, open_gate(rig), buffers, 0.015)
    assert_close(rig, scene, thin_gate(rig, buffers, 300.0), buffers, 0.03)


def test_lens_blur_spreads_the_live_halo_as_the_sums() -> None:
    """A narrow band of light, so that blur shows; the sums lose a little beyond the halo's end (`spread_of_pixels`)."""
    rig = check_rig(160)
    blurry = replace(rig, camera=replace(rig.camera, blur_px=0.8), projector=replace(rig.projector, blur_px=4.0))
    scene = edge_in_fog(slanted_edge(0.0, 5.0, 1.5))
    buffers = render(rig, scene)
    line = np.zeros_like(buffers.direct)
    line[:, 78:82] = 1.0
    lit = replace(buffers, direct=line)
    for settings in (open_gate(rig), thin_gate(rig, buffers, 300.0)):
        windows = row_windows(rig, settings)
        expected, found = sums(blurry, scene, windows, lit)[60], live(blurry, scene, windows, lit)[60]
        sharp = live(rig, scene, windows, lit)[60]
        np.testing.assert_allclose(found[76:84], expected[76:84], rtol=0.1)
        assert found[80] < 0.97 * sharp[80]


def test_live_filters_gates_and_complements_agree() -> None:
    rig = check_rig(120)
    ball = Sphere("ball", (0, 0, 1.2), 0.1, (0.1, 0.2, 0.9))
    scene = replace(edge_in_fog(slanted_edge(20.0, 5.0, 1.5)), objects=(slanted_edge(20.0, 5.0, 1.5).mesh(), ball))
    buffers = render(rig, scene)
    shape = rig.camera.lens.height, rig.camera.lens.width
    settings = thin_gate(rig, buffers)
    whole = live(rig, scene, row_windows(rig, open_gate(rig)), buffers)
    total = np.zeros(shape, np.float32)
    for each in (settings, complement(settings, rig.projector.period_us)):
        windows = row_windows(rig, each)
        rgb, mosaic, grey = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        Scatter(rig, scene, buffers, "rgb").add(windows, rgb)
        Scatter(rig, scene, buffers, "bayer_rg").add(windows, mosaic)
        Scatter(rig, scene, buffers, "mono").add(windows, grey)
        np.testing.assert_allclose(mosaic, bayer_rg(rgb), rtol=1e-5, atol=1e-6 * whole.max())
        np.testing.assert_allclose(grey, mono(rgb), atol=2e-3 * whole.max())
        assert (rgb >= 0).all()
        total += grey
    np.testing.assert_allclose(total, whole, atol=2e-3 * whole.max())


def test_the_live_way_is_finite_and_never_negative() -> None:
    rig = turned(bent(check_rig(60)))
    plane = slanted_edge(88.0, 5.0, 1.5).mesh()
    fogs = [Fog(density, 0.0, g) for density in (1e-6, 1.0, 1000.0) for g in (-0.999, 0.999)]
    for fog in (*fogs, Fog(0.5, 0.0, 0.8, (-1, -1, 0.2), (1, 1, 0.9))):
        scene = Scene("s", objects=(plane, Sphere("b", (0, 0, 1), 0.2)), fog=fog)
        found = live(rig, scene, row_windows(rig, gate(20.0, 3000.0, 20000.0)), render(rig, scene))
        assert np.isfinite(found).all()
        assert (found >= 0).all()
    for scene in (Scene("nothing", fog=HAZE), Scene("clear", objects=(plane,)), Scene("dark", fog=Fog(0, 1))):
        assert not live(rig, scene, row_windows(rig, open_gate(rig)), render(rig, scene)).any()


def test_a_photo_with_depth_gets_its_halo() -> None:
    rig = check_rig(80)
    shape = rig.camera.lens.height, rig.camera.lens.width
    photo = np.full((*shape, 3), 0.5, np.float32)
    photo[:, :40] = 0.05
    capture = MeasuredScene(rig.camera.lens, np.full(shape, 1 / 1.5, np.float32), photo)
    plane = Mesh("wall", *box_wall(), albedo=(0.5, 0.5, 0.5))
    fog, windows = Fog(0.4, 0.0, 0.85), row_windows(rig, open_gate(rig))
    flat = Scene("capture", capture=capture, fog=fog)
    found, wall = (live(rig, s, windows, render(rig, s)) for s in (flat, Scene("wall", objects=(plane,), fog=fog)))
    assert found[30, 60] == pytest.approx(wall[30, 60], rel=0.02)
    assert found[30, 20] < 0.2 * found[30, 60]
    assert found[30, 20] < found[30, 38] < found[30, 42]


def box_wall() -> tuple[Doubles, Ints]:
    corners = np.array([[-3, -3, 1.5], [3, -3, 1.5], [3, 3, 1.5], [-3, 3, 1.5]], float)
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)
