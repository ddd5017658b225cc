"""The near halo against paths through the true geometry, and against its integral taken in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from halo_reference import SlantedEdge, halo_by_paths, slanted_edge
from rigs import check_rig
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows, complement, row_windows
from slopegate.core.light.halo import HALO_RADIUS, halo_share
from slopegate.core.light.scatter import ScatterSums, make_turns, spread_of_pixels
from slopegate.core.light.scatter_kernels import halo
from slopegate.core.render.render import Buffers, Cancelled, render
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh, Scene, Sphere

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


def sums(rig: Rig, scene: Scene, windows: RowWindows, buffers: Buffers | None = None) -> Singles:
    out = np.zeros((rig.camera.lens.height, rig.camera.lens.width), np.float32)
    ScatterSums(rig, scene, buffers or render(rig, scene), "mono").add(windows, out)
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


@pytest.mark.parametrize("case", CASES)
def test_sums_agree_with_paths(case: str) -> None:
    """Within 1.5 % and the paths' own error (5 of it) where no edge runs through the pixels next to it."""
    tilt, on_side, fog = CASES[case]
    rig, edge = small_rig(), slanted_edge(tilt, 5.0, 1.5, on_side)
    scene = edge_in_fog(edge, fog)
    buffers = render(rig, scene)
    for settings, slack in ((open_gate(rig), 0.015), (thin_gate(rig, buffers), 0.03)):
        windows = row_windows(rig, settings)
        found = sums(rig, scene, windows, buffers)
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
