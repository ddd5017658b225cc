"""Rendering meshes and spheres, against a ray tracer slow and plain enough to be checked by reading."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render import kernels
from slopegate.core.render.integrate import integrate_parts, pixel_positions, pixel_shifts
from slopegate.core.render.render import Cancelled, Renderer, render
from slopegate.core.render.tracing import ProjectorFrame
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.rig.settings import PixelClocks, gate
from slopegate.core.scene.scene import Mesh, Scene, Sphere
from slow_rays import nearest

IDEAL = plain_rig(64, 48, 66.7, shutter(PixelClocks(1000.0, (78.0,))))


def turn(x_deg: float, y_deg: float, z_deg: float) -> Doubles:
    return np.asarray(cv2.Rodrigues(np.radians([x_deg, y_deg, z_deg]))[0], np.float64)


def quad(name: str, corner: list[float], across: list[float], down: list[float], **looks: object) -> Mesh:
    a, e, f = np.array(corner), np.array(across), np.array(down)
    corners = np.array([a, a + e, a + e + f, a + f])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return Mesh(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), uv=uv, **looks)  # type: ignore[arg-type]


def blob(seed: int, centre: tuple[float, float, float], count: int = 30) -> Mesh:
    rng = np.random.default_rng(seed)
    middles = rng.normal(size=(count, 1, 3)) * 0.12 + np.array(centre)
    corners = middles + rng.normal(size=(count, 3, 3)) * 0.05
    return Mesh(f"blob {seed}", corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


def still_life() -> Scene:
    texture = np.random.default_rng(5).uniform(0.1, 0.9, (7, 11, 3)).astype(np.float32)
    return Scene(
        "still life",
        objects=(
            quad("wall", [-1.2, -0.9, 2.0], [2.4, 0, 0.2], [0, 1.7, 0.1], texture=texture),
            blob(1, (-0.2, 0.0, 1.0)),
            blob(2, (0.3, 0.1, 1.3)),
            Sphere("ball", (0.05, -0.2, 1.2), 0.12, (0.9, 0.3, 0.1)),
            Sphere("bead", (0.3, -0.3, 0.9), 0.04, (0.2, 0.6, 0.9)),
        ),
        ambient=0.25,
    )


def slow_ray(rig: Rig, scene: Scene, column: float, row: float) -> tuple[float, float, Doubles, Doubles]:
    """Projector row, inverse depth, direct and ambient light of one camera ray."""
    dark = np.zeros(3)
    centre = np.array(rig.camera_centre_m)
    ray = rig.camera_rays(column, row)
    depth, normal, albedo, _ = nearest(scene, centre, ray)
    if math.isinf(depth):
        return -1.0, 0.0, dark, dark
    ambient = albedo * scene.ambient
    point = centre + depth * ray
    from_projector = point - rig.projector_centre_m
    p_column, p_row, p_depth = (float(value) for value in rig.to_projector(point))
    lens = rig.projector.lens
    if not (p_depth > 0 and 0 <= p_column < lens.width and 0 <= p_row < lens.height):
        return -1.0, 1 / depth, dark, ambient
    if nearest(scene, rig.projector_centre_m, from_projector)[0] < 1 - 1e-4:
        return -1.0, 1 / depth, dark, ambient
    length = float(np.linalg.norm(from_projector))
    cos_incidence = abs(normal @ from_projector) / length
    cos_axis = p_depth / length
    return p_row, 1 / depth, albedo * cos_incidence / (p_depth**2 * cos_axis), ambient


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (30, -50, 70)])
def test_hits_are_where_the_ray_meets_the_triangles_plane_or_beside_it_its_nearest_place(
    turn_deg: tuple[float, float, float],
) -> None:
    rng, rotation = np.random.default_rng(7), turn(*turn_deg)
    corner, edges, origin = rng.normal(size=3) + np.array([0, 0, 6]), rng.normal(size=(2, 3)), rng.normal(size=3)
    normal = np.cross(*edges)
    normal /= np.linalg.norm(normal)
    light, albedo = np.array([0.3, -2.0, 0.1]), np.array([[0.1, 0.2, 0.3]], np.float32)
    faces = kernels.Faces(corner[None], edges[:1], edges[1:], normal[None], albedo)
    inside = np.array([(0.2, 0.3), (0.9, 0.05), (0.01, 0.01)])
    beside = {(1.5, -0.4): (1.0, 0.0), (-0.3, 0.6): (0.0, 0.6), (-0.2, -0.2): (0.0, 0.0), (1.0, 1.0): (0.5, 0.5)}
    aimed, meant = np.vstack([inside, list(beside)]), np.vstack([inside, list(beside.values())])
    count = len(aimed)
    towards = corner + aimed @ edges - origin
    scale = rng.uniform(0.5, 2.0, count)[:, None]  # directions have any length
    prim, bary = np.zeros(count, np.int32), np.zeros((count, 2), np.float32)
    hits = kernels.Hits(np.full(count, np.inf), np.zeros(count), np.zeros((count, 3), np.float32))
    kernels.refine_triangles(prim, origin, (towards / scale) @ rotation.T, rotation, light, faces, hits, bary)
    np.testing.assert_allclose(bary, meant, atol=1e-6)
    place = corner + meant @ edges - origin
    depth = (place * towards).sum(axis=1) / (towards**2).sum(axis=1) * scale[:, 0]
    np.testing.assert_allclose(hits.depth, depth, rtol=1e-12)
    np.testing.assert_allclose(hits.facing, abs(normal @ (corner - light)), rtol=1e-12)
    np.testing.assert_array_equal(hits.colour, np.tile(albedo, (count, 1)))


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_the_kernels_know_the_same_place_of_a_point_as_the_rig(rig: Rig) -> None:
    """`to_projector_axes` and `ProjectorFrame.places` repeat the law of `Rig.to_projector`: to the last bit where no
    turn changes the order of sums, else to a float32 step."""
    rng = np.random.default_rng(5)
    rays = rig.camera_rays(rng.uniform(0, rig.camera.lens.width, 5000), rng.uniform(0, rig.camera.lens.height, 5000))
    depth, light = rng.uniform(0.3, 5.0, 5000), rig.projector_centre_m
    vectors, q = np.empty_like(rays), np.empty_like(rays)
    kernels.to_projector_axes(rig.camera_centre_m, rays, depth, light, rig.rotation, vectors, q)
    found = ProjectorFrame(rig.projector).places(q)
    column, row, _ = rig.to_projector(rig.camera_centre_m + depth[:, None] * rays)
    lens = rig.projector.lens
    inside = (column >= 0) & (column < lens.width) & (row >= 0) & (row < lens.height)
    expected = np.where(inside, (row, column), -1).astype(np.float32)
    assert 0.2 < inside.mean() < 1
    if rig is IDEAL:
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_every_ray_is_that_of_the_slow_ray_tracer(rig: Rig) -> None:
    scene = still_life()
    offset = (0.37, 0.61)
    buffers = render(rig, scene, offset=offset)
    kinds = set()
    for row in range(1, 48, 5):
        for column in range(2, 64, 6):
            slow = slow_ray(rig, scene, column + offset[0], row + offset[1])
            np.testing.assert_allclose(buffers.projector_row[row, column], slow[0], rtol=2e-7)
            np.testing.assert_allclose(buffers.inverse_depth[row, column], slow[1], rtol=2e-7)
            np.testing.assert_allclose(buffers.direct[row, column], slow[2], rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(buffers.ambient[row, column], slow[3], rtol=1e-6)
            kinds.add((slow[0] >= 0, slow[1] > 0))
    assert kinds == {(True, True), (False, True), (False, False)}


def test_a_frontal_plane_shows_albedo_over_depth_squared_and_the_ideal_row() -> None:
    depth = 1.25
    buffers = render(IDEAL, Scene("plane", objects=(quad("wall", [-3, -3, depth], [6, 0, 0], [0, 6, 0]),)))
    lit = buffers.projector_row >= 0
    rows = np.arange(48)[:, None] + 0.5
    expected = 1000 * ((rows - 24) / 66.7 + 0.1 / depth) + 360
    assert 0.5 < lit.mean() < 1
    np.testing.assert_allclose(buffers.direct[lit], 0.8 / depth**2, rtol=1e-6)
    np.testing.assert_allclose(buffers.inverse_depth, 1 / depth, rtol=1e-7)
    np.testing.assert_allclose(buffers.projector_row[lit], np.broadcast_to(expected, lit.shape)[lit], rtol=1e-7)
    columns = 1000 * (np.arange(64) + 0.5 - 32) / 66.7 + 640
    np.testing.assert_allclose(buffers.projector_column[lit], np.broadcast_to(columns, lit.shape)[lit], rtol=1e-6)
    np.testing.assert_array_equal(buffers.projector_column[~lit], -1)
    np.testing.assert_array_equal(lit, np.broadcast_to((expected >= 0) & (expected < 720), lit.shape))
    assert (buffers.direct[~lit] == 0).all()


def test_a_slanted_plane_does_not_shade_itself() -> None:
    rig = replace(IDEAL, camera=replace(IDEAL.camera, lens=Lens(640, 480, 667, 667, 320, 240)))
    for tilt in (0.0, 60.0, 85.0, 89.0):
        rotation = turn(tilt, 0, 0)
        corners = np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0.0]]) @ rotation.T + [0, 0, 1.1]
        # Many triangles: every inner edge is a chance of a false hit.
        steps = np.linspace(0, 1, 21)
        grid = corners[0] + np.array([[u * (corners[1] - corners[0]) + v * (corners[3] - corners[0])] for v in steps
                                      for u in steps]).reshape(-1, 3)  # fmt: skip
        at = np.arange(441).reshape(21, 21)
        a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
        buffers = render(rig, Scene("plane", objects=(Mesh("plane", grid, faces),)))
        seen = buffers.inverse_depth > 0
        rows = np.arange(480)[:, None] + 0.5
        row = 1000 * ((rows - 240) / 667 + 0.1 * buffers.inverse_depth.astype(np.float64)) + 360
        columns = 1000 * (np.arange(640) + 0.5 - 320) / 667 + 640
        lit = seen & (row >= 0) & (row < 719.999) & (columns >= 0) & (columns < 1280)
        assert lit.any()
        assert (buffers.projector_row[lit] >= 0).all(), tilt


def test_what_stands_a_millimetre_before_a_wall_shades_it() -> None:
    wall = quad("wall", [-3, -3, 1.0], [6, 0, 0], [0, 6, 0])
    # Edge-on to the camera and out of its sight; the projector, above, meets it first.
    shelf = quad("shelf", [-0.2, 0.05, 0.999], [0.4, 0, 0], [0, 0, 0.001])
    rig = replace(IDEAL, camera=replace(IDEAL.camera, lens=Lens(64, 480, 66.7, 66700.0, 32, 240)))
    buffers = render(rig, Scene("shelf", objects=(wall, shelf)))
    shadow_rows = np.flatnonzero((buffers.projector_row[:, 32] < 0) & (buffers.inverse_depth[:, 32] > 0))
    # The wall is 1 mm behind the front edge, which lies 0.1 m below the projector: a shadow of 0.1 mm, 6.7 rows. What
    # stands within 1e-4 of the way casts none, which takes the first 0.01 mm or 0.67 rows off again.
    np.testing.assert_array_equal(shadow_rows, np.arange(241, 247))


def test_a_sphere_is_exact_to_its_outline() -> None:
    rig = replace(IDEAL, camera=replace(IDEAL.camera, lens=Lens(400, 300, 417, 417, 200, 150)))
    centre, radius = np.array([0.1, 0.02, 1.2]), 0.25
    buffers = render(rig, Scene("ball", objects=(Sphere("ball", (0.1, 0.02, 1.2), radius),)))
    rays = rig.camera_rays(np.arange(400) + 0.5, np.arange(300)[:, None] + 0.5)
    offset = centre - rig.camera_centre_m
    distance = np.linalg.norm(np.cross(rays, offset), axis=2) / np.linalg.norm(rays, axis=2)
    np.testing.assert_array_equal(buffers.inverse_depth > 0, distance < radius)
    seen = buffers.inverse_depth > 0
    points = rays[seen] / buffers.inverse_depth[seen, None] - offset
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, rtol=1e-6)


def test_a_texel_is_looked_up_at_the_floor_of_its_coordinates() -> None:
    texture = np.arange(24, dtype=np.float32).reshape(2, 4, 3) / 24
    wall = quad("wall", [-0.4, -0.2, 1.0], [0.8, 0, 0], [0, 0.4, 0], texture=texture)
    wall = replace(wall, vertices=wall.vertices + IDEAL.camera_centre_m)
    buffers = render(IDEAL, Scene("card", objects=(wall,), ambient=1.0))
    seen = buffers.inverse_depth > 0
    rows, columns = np.nonzero(seen)
    rays = IDEAL.camera_rays(columns + 0.5, rows + 0.5)
    expected = texture[np.floor((rays[:, 1] + 0.2) / 0.2).astype(int), np.floor((rays[:, 0] + 0.4) / 0.2).astype(int)]
    assert len(np.unique(expected[:, 0])) == 8
    np.testing.assert_array_equal(buffers.ambient[seen], expected)


def test_texture_coordinates_outside_the_picture_take_its_border() -> None:
    texture = np.array([[[0.1] * 3, [0.7] * 3]], np.float32)
    wall = quad("wall", [-3, -3, 1.0], [6, 0, 0], [0, 6, 0], texture=texture)
    wall = replace(wall, uv=np.array([[-1e30, 0], [1e30, 0], [1e30, 5], [-1e30, 5]]))
    ambient = render(IDEAL, Scene("wall", objects=(wall,), ambient=1.0)).ambient[..., 0]
    np.testing.assert_array_equal(ambient[:, :32], np.float32(0.1))
    np.testing.assert_array_equal(ambient[:, 32:], np.float32(0.7))


@pytest.mark.parametrize(
    "objects",
    [
        (),
        (Sphere("behind", (0, 0, -1), 0.3),),
        (quad("behind", [-1, -1, -1], [2, 0, 0], [0, 2, 0]),),
        (Mesh("empty", np.zeros((0, 3)), np.zeros((0, 3), np.int32)),),
        (Mesh("points", np.ones((3, 3)), np.array([[0, 1, 2], [0, 0, 1]], np.int32)),),
    ],
)
def test_nothing_in_front_of_the_camera_is_a_dark_picture(objects: tuple[Mesh | Sphere, ...]) -> None:
    buffers = render(IDEAL, Scene("nothing", objects=objects, ambient=1.0))
    assert (buffers.projector_row == -1).all()
    assert not buffers.inverse_depth.any()
    assert not buffers.direct.any()
    assert not buffers.ambient.any()


def test_surfaces_at_the_very_centres_give_no_bad_numbers() -> None:
    edge_on = quad("edge-on", [0, -1, 0.5], [0, 2, 0], [0, 0, 3])
    through_camera = quad("through", [-1, 0.05, -1], [2, 0, 0], [0, 0, 3])
    through_projector = quad("through", [-1, -0.05, -1], [2, 0, 0], [0, 0, 3])
    inside = Sphere("round all", (0, 0, 0), 2.0)
    touching = Sphere("touching", (0, 0.05, 0.1), 0.1)
    for objects in ((edge_on,), (through_camera,), (through_projector, inside), (touching, inside), (inside,)):
        buffers = render(IDEAL, Scene("odd", objects=objects, ambient=0.1))
        for array in (buffers.projector_row, buffers.inverse_depth, buffers.direct, buffers.ambient):
            assert np.isfinite(array).all()
    np.testing.assert_allclose(1 / buffers.inverse_depth[24, 32], 2.0, rtol=0.01)


def test_a_distorted_projector_lights_nothing_beyond_its_frame() -> None:
    rig = replace(
        IDEAL,
        camera=replace(IDEAL.camera, lens=Lens(160, 120, 20.0, 20.0, 80, 60)),
        projector=replace(IDEAL.projector, lens=replace(IDEAL.projector.lens, distortion=(-0.3, 0.0, 0.0, 0.0))),
    )
    buffers = render(rig, Scene("wall", objects=(quad("wall", [-30, -30, 2.0], [60, 0, 0], [0, 60, 0]),)))
    x, y = rig.projector.lens.normalise([0, 1280], [0, 720])
    rays = rig.camera_rays(np.arange(160) + 0.5, np.arange(120)[:, None] + 0.5)
    far_off = (rays[..., 0] < 1.1 * x[0]) | (rays[..., 0] > 1.1 * x[1]) | (rays[..., 1] > 1.1 * y[1])
    folded = rig.to_projector(rays * 2.0 + rig.camera_centre_m)[1]
    assert ((folded[far_off] >= 0) & (folded[far_off] < 720)).any(), "the lens does fold"
    assert (buffers.projector_row[far_off] == -1).all()
    assert (buffers.projector_row >= 0).any()


def test_rendering_can_be_watched_and_stopped() -> None:
    rig = replace(IDEAL, camera=replace(IDEAL.camera, lens=Lens(640, 480, 667, 667, 320, 240)))
    told: list[float] = []

    def watch(done: float) -> bool:
        told.append(done)
        return len(told) < 3

    with pytest.raises(Cancelled):
        render(rig, still_life(), progress=watch)
    assert told == sorted(told)
    assert len(told) == 3
    renderer = Renderer(rig, still_life())
    told.clear()
    with pytest.raises(Cancelled):
        renderer.at(0.0, watch)
    buffers, region = renderer.at(0.0)
    assert (region.rows, region.columns) == (slice(0, 480), slice(0, 640))
    np.testing.assert_array_equal(buffers.direct, render(rig, still_life()).direct)


def test_without_embree_spheres_render_and_meshes_say_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex", None)
    render(IDEAL, Scene("ball", objects=(Sphere("ball", (0, 0, 1), 0.3),)))
    with pytest.raises(UserError, match="the package embreex, which is not installed"):
        render(IDEAL, Scene("card", objects=(quad("card", [0, 0, 1], [1, 0, 0], [0, 1, 0]),)))


def test_every_ray_of_an_integral_looks_up_its_own_projector_pixel() -> None:
    """A wall under a fine pattern, as the mean of pictures that are each looked up ray by ray."""
    scene = Scene("wall", objects=(quad("wall", [-3, -3, 1.25], [6, 0, 0], [0, 6, 0]),), ambient=0.2)
    picture = np.random.default_rng(8).random((720, 1280), np.float32)
    settings = gate(20.0, 0.0, 16666.7)
    found, room = integrate_parts(IDEAL, scene, settings, 3, pattern=picture)
    rows, columns = np.indices((48, 64)).reshape(2, -1)
    expected = np.zeros((48 * 64, 3))
    aside, down = pixel_shifts(3, columns, rows)
    for column, row in pixel_positions(3):
        at = columns + (column + aside) % 1, rows + (row + down) % 1
        points = IDEAL.camera_centre_m + 1.25 * IDEAL.camera_rays(*at)
        j, i, _ = IDEAL.to_projector(points)
        lit = (i >= 0) & (i < 720) & (j >= 0) & (j < 1280)
        expected[lit] += 0.8 / 1.25**2 * picture[i[lit].astype(int), j[lit].astype(int)][:, None] / 9
    differ = abs(found.reshape(-1, 3) - expected)[:, 0] > 1e-5
    assert differ.mean() < 2e-3, "but for rays that float32 moves over the edge of a pixel"
    np.testing.assert_array_equal(room, integrate_parts(IDEAL, scene, settings, 3)[1])
