"""Casting only the rays whose answer is not known beforehand must change nothing, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.render.tracing import Body
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks, gate
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere

IDEAL = plain_rig(200, 150, 208.0, shutter(PixelClocks(1000.0, (78.0,))))
FIELDS = ("projector_row", "projector_column", "inverse_depth", "direct", "ambient")
RIGS = [pytest.param(IDEAL, id="ideal"), pytest.param(bent(turned(IDEAL)), id="general")]


def soup(triangles: NDArray[np.float64], motion: KeyFrames | None = None, name: str = "soup") -> Mesh:
    count = len(triangles)
    return Mesh(name, triangles.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3), motion=motion)


def quad(corner: list[float], across: list[float], down: list[float], motion: KeyFrames | None = None) -> Mesh:
    a, e, f = np.array(corner), np.array(across), np.array(down)
    return Mesh(
        "quad", np.array([a, a + e, a + e + f, a + f]), np.array([[0, 1, 2], [0, 2, 3]], np.int32), motion=motion
    )


def room() -> Scene:
    """A room that the rig stands in: floor, ceiling and walls reach behind it; a table before the wall."""
    return Scene(
        "room",
        objects=(
            quad([-2, 1, -3], [4, 0, 0], [0, 0, 6]),
            quad([-2, -1, -3], [4, 0, 0], [0, 0, 6]),
            quad([-2, -1, -3], [0, 2, 0], [0, 0, 6]),
            quad([2, -1, -3], [0, 2, 0], [0, 0, 6]),
            quad([-2, -1, 3], [4, 0, 0], [0, 2, 0]),
            quad([-0.5, 0.3, 1.2], [1, 0, 0], [0, 0, 0.8]),
            Sphere("globe", (0.1, 0.1, 1.5), 0.2),
            Sphere("behind", (0.0, 0.0, -1.0), 0.3),
        ),
        ambient=0.1,
    )


def confetti(seed: int, size: float, count: int) -> Scene:
    """Triangles of any attitude, some through each other, some twice, some behind or beside the rig."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform([-1, -0.8, -0.3], [1, 0.8, 3], (count, 1, 3))
    triangles = middles + rng.normal(size=(count, 3, 3)) * size
    return Scene(
        "confetti", objects=(soup(np.concatenate([triangles, triangles[:5]])), quad([-2, -2, 3], [4, 0, 0], [0, 4, 0]))
    )


def edge_on() -> Scene:
    """Cards seen from the side, one of them exactly so, and stairs a hair's breadth apart."""
    cards = [quad([x, -0.3, 1], [0, 0.6, 0], [0.001 * k, 0, 0.7]) for k, x in enumerate(np.linspace(-0.4, 0.4, 9))]
    stairs = [
        quad([-0.5, -0.5 + 0.1 * k, 2 + s], [1, 0, 0], [0, 0.12, 0]) for k, s in enumerate(10.0 ** -np.arange(1, 9))
    ]
    return Scene("edge-on", objects=(quad([0, -0.4, 0.8], [0, 0.8, 0], [0, 0, 1]), *cards, *stairs))


def enclosed() -> Scene:
    """Inside a ball, with a card that all but touches the camera."""
    return Scene(
        "enclosed",
        objects=(Sphere("shell", (0, 0, 0.5), 4.0), quad([-0.001, 0.05, 0.0005], [0.002, 0, 0], [0, 0.001, 0])),
    )


def corridor() -> Scene:
    """Walls and a floor that reach ten kilometres away, with cards all along, their edges nearly in line."""
    sides = [quad([side, -1, 0.5], [0, 2, 0], [0, 0, 1e4]) for side in (-0.7, 0.7)]
    floor = quad([-1, 0.9, 0.5], [2, 0, 0], [0, 0, 1e4])
    cards = [quad([-0.6 + 0.01 * k, 0.2, z], [0.3, 0, 0], [0, 0.7, 0]) for k, z in enumerate(np.geomspace(1, 3e3, 12))]
    return Scene("corridor", objects=(*sides, floor, *cards), ambient=0.1)


SCENES = [
    pytest.param(corridor(), id="corridor"),
    pytest.param(room(), id="room"),
    pytest.param(confetti(1, 0.3, 60), id="large triangles"),
    pytest.param(confetti(2, 0.02, 800), id="small triangles"),
    pytest.param(edge_on(), id="edge-on"),
    pytest.param(enclosed(), id="enclosed"),
    pytest.param(Scene("empty"), id="empty"),
]


def assert_identical(ours: Buffers, other: Buffers) -> None:
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(ours, field), getattr(other, field), err_msg=field)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("scene", SCENES)
def test_the_same_picture_with_every_ray_cast(rig: Rig, scene: Scene) -> None:
    for offset in ((0.5, 0.5), (0.01, 0.93)):
        assert_identical(render(rig, scene, offset=offset), render(rig, scene, offset=offset, skip=False))


def test_the_same_mean_over_pixels() -> None:
    settings = gate(21.3, 1500.0, 900.0)
    ours = integrate(IDEAL, room(), settings, 2)
    assert (ours > 0).any()
    np.testing.assert_array_equal(ours, integrate(IDEAL, room(), settings, 2, skip=False))


@pytest.fixture
def cast(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """How many rays embree is asked for, call by call."""
    counts: list[int] = []
    ask = Body._ask

    def counting(body: Body, origin: object, directions: object, pose: object, prim: NDArray[np.int32]) -> None:
        counts.append(int((prim == -2).sum()))
        ask(body, origin, directions, pose, prim)  # type: ignore[arg-type]

    monkeypatch.setattr(Body, "_ask", counting)
    return counts


def test_few_rays_are_cast_in_a_simple_scene(cast: list[int]) -> None:
    size = 200 * 150
    render(IDEAL, room())
    assert 0 < sum(cast) < 0.12 * size
    cast.clear()
    render(IDEAL, room(), skip=False)
    assert sum(cast) == size


def still() -> KeyFrames:
    return KeyFrames(np.array([0.0, 1.0]), np.zeros((2, 3)), np.stack([np.eye(3)] * 2), (0, 0, 0))


def passing(direction: list[float], spin_deg: list[float], start: list[float]) -> KeyFrames:
    turn = np.asarray(cv2.Rodrigues(np.radians(spin_deg))[0], np.float64)
    positions = np.array([start, np.array(start) + direction])
    return KeyFrames(np.array([0.0, 1.0]), positions, np.stack([np.eye(3), turn]), (0.0, 0.0, 1.2), loop=False)


def parade() -> Scene:
    """Bodies that pass through each other, come nearer than the rig, leave the view, and one that does not move."""
    rng = np.random.default_rng(9)
    triangles = rng.normal(size=(25, 1, 3)) * 0.1 + rng.normal(size=(25, 3, 3)) * 0.12 + [0, 0, 1.2]
    return Scene(
        "parade",
        objects=(
            *room().objects,
            soup(triangles, passing([0.9, 0.1, 0.2], [0, 90, 20], [-0.4, 0, 0])),
            quad([-0.2, -0.2, 1.1], [0.4, 0, 0], [0, 0.4, 0.1], passing([-1.5, 0, 0], [40, 0, 0], [0.5, 0, 0])),
            Sphere("coming", (0.05, 0.0, 1.3), 0.12, motion=passing([0, 0, -2.0], [0, 0, 0], [0, 0, 0])),
            Sphere("resting", (-0.3, -0.2, 1.0), 0.08, motion=still()),
        ),
        ambient=0.2,
    )


@pytest.mark.parametrize("rig", RIGS)
def test_moving_bodies_look_as_if_everything_were_cast_anew(rig: Rig) -> None:
    renderer, anew = Renderer(rig, parade()), Renderer(rig, parade(), skip=False)
    before: Buffers | None = None
    cast: list[int] = []
    for time_s in (0.0, 0.2, 0.45, 0.5, 0.6, 0.62, 0.7, 0.9, 1.0, 0.1):
        buffers, region = renderer.at(time_s)
        full, whole = anew.at(time_s)
        assert_identical(buffers, full)
        assert (whole.rows, whole.columns, anew.recast_pixels) == (slice(0, 150), slice(0, 200), 30000)
        if before is not None:
            changed = (buffers.projector_row != before.projector_row) | (buffers.ambient != before.ambient).any(axis=2)
            changed[region.rows, region.columns] = False
            assert not changed.any(), "a change outside the region"
            cast.append(renderer.recast_pixels)
        before = buffers.copy()
    assert min(cast) < 15000


def test_without_skipping_even_what_rests_is_cast() -> None:
    renderer = Renderer(IDEAL, room(), skip=False)
    first = renderer.at(0.0)[0]
    again = renderer.at(1.0)[0]
    assert again is not first
    assert renderer.recast_pixels == 200 * 150
    assert_identical(first, again)
