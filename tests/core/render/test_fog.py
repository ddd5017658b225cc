"""Fog in the tracers: lengths inside its box, what it takes from light and what of the ambient light it scatters."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render.fog import length_within, medium_of, span
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks, gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import KeyFrames, MeasuredScene, Mesh, Scene, Sphere

IDEAL = plain_rig(80, 60, 83.0, shutter(PixelClocks(1000.0, (78.0,))))
GENERAL = bent(turned(IDEAL))
FIELDS = ("projector_row", "projector_column", "inverse_depth", "direct", "ambient")
BANK = Fog(0.8, 0.3, 0.4, (-0.3, -0.35, 0.6), (0.4, 0.5, 1.3))
EVERYWHERE = Fog(0.5, 0.0)
Vector = tuple[float, float, float]

side = st.one_of(st.sampled_from([-math.inf, -1.0, 0.0, 1.0, math.inf]), st.floats(-3, 3))
place = st.one_of(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-3, 3))
step = st.one_of(st.just(0.0), st.floats(-3, 3).filter(lambda v: v == 0 or abs(v) > 1e-9))
vector = st.tuples(step, step, step)
points = st.tuples(place, place, place)


def pieces_within(lo: Vector, hi: Vector, start: Vector, along: Vector, end: float) -> float:
    """The same length piece by piece: cut at every plane of a side, ask each piece's middle whether it is inside."""
    cuts = {0.0, end}
    for k in range(3):
        for border in (lo[k], hi[k]):
            if along[k] != 0 and math.isfinite(border):
                cuts.add(min(max((border - start[k]) / along[k], 0.0), end))
    total, ordered = 0.0, sorted(cuts)
    for first, last in pairwise(ordered):
        middle = [start[k] + 0.5 * (first + last) * along[k] for k in range(3)]
        if all(lo[k] <= middle[k] <= hi[k] for k in range(3)):
            total += last - first
    return total * math.hypot(*along)


@given(st.tuples(side, side, side), st.tuples(side, side, side), points, vector, st.floats(0, 5))
def test_the_length_is_that_of_the_pieces_inside(
    a: Vector, b: Vector, start: Vector, along: Vector, end: float
) -> None:
    low, high = (tuple(f(x, y) for x, y in zip(a, b, strict=True)) for f in (min, max))
    ours = length_within(low, high, start, along, end)
    assert ours == pytest.approx(pieces_within(low, high, start, along, end), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("start", "along", "end", "expected"),
    [
        ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), 5.0, 1.0),  # right through
        ((0.5, 0.5, 0.5), (0.0, 0.0, 1.0), math.inf, 0.5),  # from within, without an end
        ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), 1.5, 0.5),  # ends within
        ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 5.0, 0.0),  # from the border outwards
        ((0.0, 0.0, 0.0), (0.0, 3.0, 4.0), 0.1, 0.5),  # along a face, from a corner
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 5.0, 1.0),  # along an edge
        ((1.1, 0.0, 0.0), (0.0, 1.0, 0.0), 5.0, 0.0),  # beside it
        ((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), 5.0, 0.0),  # no way at all
        ((2.0, 2.0, 2.0), (1.0, 1.0, 1.0), 5.0, 0.0),  # away from it
    ],
)
def test_lengths_in_a_unit_box(start: Vector, along: Vector, end: float, expected: float) -> None:
    assert length_within((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), start, along, end) == pytest.approx(expected, abs=1e-15)


def test_infinite_fog_has_infinite_length_and_no_nan() -> None:
    endless = (-math.inf,) * 3, (math.inf,) * 3
    assert span(*endless, (0.0, 0.0, 0.0), (0.0, 1.0, 1.0)) == (0.0, math.inf)
    assert length_within(*endless, (0.0, 0.0, 0.0), (0.0, 1.0, 1.0), math.inf) == math.inf
    assert length_within(*endless, (0.0, 0.0, 0.0), (1e-320, 0.0, 1.0), 2.0) == 2.0
    half = (-math.inf, -math.inf, 0.0), (math.inf,) * 3
    assert length_within(*half, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0) == 2.0
    assert length_within(*half, (0.0, 0.0, -1.0), (0.0, 0.0, -1e-310), math.inf) == 0.0


def wall(depth: float = 1.6, size: float = 0.6) -> Mesh:
    corners = np.array([[-size, -size, depth], [size, -size, depth], [size, size, depth], [-size, size, depth]])
    return Mesh("wall", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (0.7, 0.5, 0.3))


def scene_with(fog: Fog | None, *objects: Mesh | Sphere) -> Scene:
    return Scene("foggy", objects=objects or (wall(), Sphere("ball", (0.1, 0.1, 1.0), 0.15)), ambient=0.25, fog=fog)


def lengths(rig: Rig, fog: Fog, buffers: Buffers, row: int, column: int) -> tuple[float, float]:
    """Way of camera's and projector's light to a pixel's surface inside the fog."""
    eye, light = rig.camera_centre_m, rig.projector_centre_m
    ray = rig.camera_rays(column + 0.5, row + 0.5)
    w = float(buffers.inverse_depth[row, column])
    end = 1 / w if w else 1e12
    there = eye + ray * end - light
    box = fog.lo_m, fog.hi_m
    return pieces_within(*box, tuple(eye), tuple(ray), end), pieces_within(*box, tuple(light), tuple(there), 1.0)


@pytest.mark.parametrize("fog", [BANK, EVERYWHERE, Fog(0.0, 0.7), Fog(1000.0, 0.0, 0.99), Fog(1e-6)])
@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_light_is_dimmed_by_the_fog_on_both_ways(rig: Rig, fog: Fog) -> None:
    clear, foggy = render(rig, scene_with(None)), render(rig, scene_with(fog))
    np.testing.assert_array_equal(foggy.projector_row, clear.projector_row)
    np.testing.assert_array_equal(foggy.inverse_depth, clear.inverse_depth)
    share = fog.scattering_per_m / fog.extinction_per_m
    assert (clear.inverse_depth == 0).any()  # rays without a surface among them
    for row in range(1, 60, 7):
        for column in range(0, 80, 5):
            seen, lit = (fog.extinction_per_m * x for x in lengths(rig, fog, clear, row, column))
            dimmed = clear.direct[row, column] * math.exp(-seen - lit)
            np.testing.assert_allclose(foggy.direct[row, column], dimmed, rtol=1e-5, atol=1e-35)
            room = clear.ambient[row, column] * math.exp(-seen) - 0.25 * share * math.expm1(-seen)
            np.testing.assert_allclose(foggy.ambient[row, column], room, rtol=1e-5, atol=1e-35)


def test_far_in_dense_fog_only_its_own_ambient_light_is_seen() -> None:
    foggy = render(IDEAL, scene_with(Fog(3.0, 1.0), wall(30.0, 60.0)))
    np.testing.assert_allclose(foggy.ambient, 0.25 * 3 / 4, rtol=1e-6)
    assert foggy.direct.max() < 1e-30


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_fog_of_no_density_changes_nothing(rig: Rig) -> None:
    nothing = Fog(0.0, 0.0, 0.5)
    assert medium_of(nothing) is None
    assert medium_of(None) is None
    clear, foggy = render(rig, scene_with(None)), render(rig, scene_with(nothing))
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(foggy, field), getattr(clear, field))


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
@pytest.mark.parametrize("fog", [BANK, EVERYWHERE], ids=["bank", "everywhere"])
def test_moving_objects_in_fog_make_the_full_picture(rig: Rig, fog: Fog) -> None:
    path = KeyFrames(
        np.array([0.0, 1.0, 2.0]),
        np.array([[-0.6, 0, 0], [0.6, 0.1, 0.3], [0, 0, -0.8]]),
        np.stack([np.eye(3)] * 3),
        (0, 0, 1),
        False,
    )
    # A wall that leaves rays without a surface, so that the ball also covers and uncovers bare fog.
    scene = scene_with(fog, wall(1.6, 0.5), Sphere("ball", (0.0, 0.1, 1.0), 0.15, motion=path))
    renderer = Renderer(rig, scene)
    covered = []
    for time_s in (0.0, 0.3, 0.5, 1.0, 1.7, 2.0, 0.4):
        ours, full = renderer.at(time_s)[0], render(rig, scene, time_s)
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(ours, field), getattr(full, field), err_msg=field)
        covered.append(full.inverse_depth.copy())
        np.testing.assert_array_equal(full.ambient, render(rig, scene, time_s, skip=False).ambient)
    assert all((covered[0] != later).any() for later in covered[1:])


def capture_scene(fog: Fog | None) -> Scene:
    lens = IDEAL.camera.lens
    random = np.random.default_rng(4)
    shape = lens.height, lens.width
    inverse: NDArray[np.float32] = np.where(random.random(shape) < 0.1, 0, 0.8).astype(np.float32)
    photo = random.uniform(0.2, 1, (*shape, 3)).astype(np.float32)
    return Scene("capture", capture=MeasuredScene(lens, inverse, photo), ambient=0.25, fog=fog)


@pytest.mark.parametrize("fog", [BANK, EVERYWHERE], ids=["bank", "everywhere"])
def test_captures_are_dimmed_alike(fog: Fog) -> None:
    clear, foggy = render(IDEAL, capture_scene(None)), render(IDEAL, capture_scene(fog))
    share = fog.scattering_per_m / fog.extinction_per_m
    for row in range(0, 60, 6):
        for column in range(0, 80, 7):
            seen, lit = (fog.extinction_per_m * x for x in lengths(IDEAL, fog, clear, row, column))
            dimmed = clear.direct[row, column] * math.exp(-seen - lit)
            np.testing.assert_allclose(foggy.direct[row, column], dimmed, rtol=1e-5, atol=1e-35)
            room = clear.ambient[row, column] * math.exp(-seen) - 0.25 * share * math.expm1(-seen)
            np.testing.assert_allclose(foggy.ambient[row, column], room, rtol=1e-5, atol=1e-35)
    nothing = render(IDEAL, capture_scene(Fog(0.0)))
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(nothing, field), getattr(clear, field))


def test_an_image_of_many_rays_is_dimmed_too() -> None:
    whole = gate(10.0, 0.0, IDEAL.projector.period_us)
    scene = scene_with(Fog(0.5, 0.2), wall(1.6, 3.0))
    centre = render(IDEAL, scene)
    image = integrate(IDEAL, scene, whole, 2)
    middle = np.s_[20:40, 20:60]
    np.testing.assert_allclose(image[middle], (centre.direct + centre.ambient)[middle], rtol=2e-3)
    assert image.mean() < 0.9 * integrate(IDEAL, replace(scene, fog=None), whole, 2).mean()
