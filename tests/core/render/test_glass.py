"""Sight through glass: Fresnel and Snell, and whole pictures against rays that are followed one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import bent, plain_rig, shutter, turned
from slopegate.core.render.glass import MAX_SURFACES, fresnel
from slopegate.core.render.render import Buffers, Renderer, render
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.materials import Glass, Gloss
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.core.scene.shapes import Finish, box, plane, turn
from slow_rays import nearest

IDEAL = plain_rig(120, 90, 125.0, shutter(PixelClocks(1000.0, (78.0,))))
FIELDS = ("projector_row", "projector_column", "inverse_depth", "direct", "ambient")
CLEAR = Finish((1.0, 1.0, 1.0), material=Glass(1.5))


def wall(depth_m: float = 1.4) -> Mesh:
    texture = np.random.default_rng(5).uniform(0.1, 0.9, (9, 13, 3)).astype(np.float32)
    return plane("wall", (0.0, 0.0, depth_m), (2.6, 2.2), turn(8, 12), Finish(texture=texture))


def behind_glass() -> Scene:
    """A crooked block, a full ball and a hollow one of tinted glass, a matt ball behind them and a glossy wall."""
    tint = Finish((0.9, 1.0, 0.8), material=Glass(1.45))
    return Scene(
        "behind glass",
        objects=(
            replace(wall(), material=Gloss(0.3, 30.0)),
            box("block", (-0.12, 0.09, 0.62), (0.1, 0.12, 0.08), turn(15, 35, 20), tint),
            Sphere("lens", (0.09, 0.1, 0.6), 0.05, (1.0, 0.9, 0.9), material=Glass(1.6)),
            Sphere("bubble", (0.09, -0.02, 0.7), 0.05, (0.95, 0.95, 1.0), material=Glass(1.5)),
            Sphere("its inside", (0.09, -0.02, 0.7), 0.042, (0.95, 0.95, 1.0), material=Glass(1.5)),
            Sphere("ball", (-0.1, 0.2, 1.1), 0.12, (0.7, 0.2, 0.1)),
        ),
        ambient=0.3,
    )


def followed(scene: Scene, origin: Doubles, ray: Doubles) -> tuple[Doubles, Doubles, Doubles, Doubles] | None:
    """The point seen, the direction in which sight arrives, the colour with that of the glass, the colour alone."""
    direction, weight, within = ray / np.linalg.norm(ray), np.ones(3), False
    for _ in range(MAX_SURFACES + 1):
        distance, normal, albedo, material = nearest(scene, origin, direction)
        if math.isinf(distance):
            return None
        point = origin + distance * direction
        if not isinstance(material, Glass):
            return point, direction, weight * albedo, weight
        normal = -normal if normal @ direction > 0 else normal
        before, after = (material.index, 1.0) if within else (1.0, material.index)
        tangent = direction - (direction @ normal) * normal
        sine = np.linalg.norm(tangent)
        across = float(sine * before / after)
        if across >= 1:
            direction, origin = direction - 2 * (direction @ normal) * normal, point + 1e-5 * normal
            continue
        falls, leaves = math.cos(math.asin(min(sine, 1.0))), math.cos(math.asin(across))
        s = (before * falls - after * leaves) / (before * falls + after * leaves)
        p = (before * leaves - after * falls) / (before * leaves + after * falls)
        weight = weight * albedo * (1 - (s * s + p * p) / 2)
        direction = (tangent * before / after) - leaves * normal
        origin, within = point - 1e-5 * normal, not within
    return None


@given(cosine=st.floats(0, 1), index=st.floats(1, 4))
def test_what_is_mirrored_is_a_share_and_the_same_from_both_sides(cosine: float, index: float) -> None:
    mirrored = fresnel(cosine, 1 / index)
    assert 0 <= mirrored <= 1
    behind = math.sqrt(1 - (1 - cosine * cosine) / index**2)
    assert fresnel(behind, index) == pytest.approx(mirrored, abs=1e-6)


def test_fresnels_equations_have_their_known_values() -> None:
    assert fresnel(1.0, 1 / 1.5) == pytest.approx(0.04)
    assert fresnel(1.0, 1.5) == pytest.approx(0.04)
    assert fresnel(0.0, 1 / 1.5) == pytest.approx(1.0)
    # At Brewster's angle only light across the plane of incidence is mirrored.
    angle = math.atan(1.5)
    assert fresnel(math.cos(angle), 1 / 1.5) == pytest.approx(math.cos(2 * angle) ** 2 / 2)
    assert fresnel(math.cos(math.asin(1 / 1.5)) - 1e-3, 1.5) == 1.0


@pytest.mark.parametrize("rig", [IDEAL, bent(turned(IDEAL))], ids=["ideal", "general"])
def test_pictures_through_glass_are_those_of_rays_followed_one_by_one(rig: Rig) -> None:
    scene = behind_glass()
    ours, eye = render(rig, scene), rig.camera_centre_m
    rows, columns = np.indices(ours.projector_row.shape).reshape(2, -1)
    first = [nearest(scene, eye, ray) for ray in rig.camera_rays(columns[::7] + 0.5, rows[::7] + 0.5)]
    glass = np.array([index for index, met in enumerate(first) if isinstance(met[3], Glass)]) * 7
    good, lit = 0, 0
    for pixel in glass:
        row, column = rows[pixel], columns[pixel]
        expected = followed(scene, eye, rig.camera_rays(column + 0.5, row + 0.5))
        if expected is None:
            good += ours.inverse_depth[row, column] == 0
            continue
        point, direction, colour, weight = expected
        depth = point[2] - eye[2]
        # Texels have edges, and glass enlarges what float32 does to a ray: few pixels may differ.
        if not np.isclose(ours.inverse_depth[row, column], 1 / depth, rtol=1e-4) or not np.allclose(
            ours.ambient[row, column], 0.3 * colour, rtol=1e-3, atol=1e-5
        ):
            continue
        good += 1
        if ours.projector_row[row, column] < 0:
            continue
        lit += 1
        p_column, p_row, z = rig.to_projector(point)
        np.testing.assert_allclose(ours.projector_row[row, column], p_row, atol=2e-2)
        np.testing.assert_allclose(ours.projector_column[row, column], p_column, atol=2e-2)
        beam = point - rig.projector_centre_m
        distance, normal, _, material = nearest(scene, point - 1e-3 * direction, 1e-3 * direction)
        assert distance == pytest.approx(1, rel=1e-4)
        white = abs(normal @ beam) / z**3
        back = -beam / np.linalg.norm(beam)
        cosine = max(float((2 * (normal @ back) * normal - back) @ -direction), 0.0)
        lobe = 0.3 * 32 / 2 * cosine**30 if isinstance(material, Gloss) else 0.0
        np.testing.assert_allclose(ours.direct[row, column], (colour + lobe * weight) * white, rtol=3e-3, atol=1e-5)
    assert good > 0.97 * len(glass) > 150
    assert lit > 60


def test_glass_of_index_1_only_casts_its_shadow() -> None:
    clear = replace(behind_glass(), objects=tuple(
        replace(item, albedo=(1.0, 1.0, 1.0), material=Glass(1.0)) if isinstance(item.material, Glass) else item
        for item in behind_glass().objects
    ))  # fmt: skip
    bare = replace(clear, objects=tuple(item for item in clear.objects if not isinstance(item.material, Glass)))
    ours, without = render(IDEAL, clear), render(IDEAL, bare)
    same = np.isclose(ours.inverse_depth, without.inverse_depth, rtol=1e-4)
    assert same.mean() > 0.999
    shaded = same & (ours.projector_row < 0) & (without.projector_row >= 0)
    assert 0.005 < shaded.mean() < 0.2
    lit = same & (ours.projector_row >= 0)
    np.testing.assert_allclose(ours.projector_row[lit], without.projector_row[lit], atol=5e-2)
    close = np.isclose(ours.direct[lit], without.direct[lit], rtol=1e-3, atol=1e-5).all(axis=1)
    assert close.mean() > 0.999


def test_a_line_of_sight_ends_after_its_last_surface_of_glass() -> None:
    for count, seen in ((MAX_SURFACES // 2, True), (MAX_SURFACES // 2 + 1, False)):
        panes = [box(f"pane {k}", (0, 0, 0.4 + 0.02 * k), (0.6, 0.6, 0.01), turn(), CLEAR) for k in range(count)]
        ours = render(IDEAL, Scene("panes", objects=(*panes, wall()), ambient=1.0))
        assert (ours.inverse_depth[45, 60] > 0) == seen
        assert (ours.ambient[45, 60] > 0).all() == seen


def test_what_lies_behind_glass_may_be_nothing_or_the_dark() -> None:
    ours = render(IDEAL, Scene("glass alone", objects=(behind_glass().objects[1], behind_glass().objects[2])))
    for name, nothing in (("projector_row", -1), ("inverse_depth", 0), ("direct", 0), ("ambient", 0)):
        assert (getattr(ours, name) == nothing).all()


def test_fog_dims_what_is_seen_through_glass_along_the_straight_line() -> None:
    scene = replace(behind_glass(), ambient=0.0)
    fog = Fog(0.4, 0.1, lo_m=(-3, -3, 0.3), hi_m=(3, 3, 3))
    clear, dim = render(IDEAL, scene), render(IDEAL, replace(scene, fog=fog))
    eye, rows, columns = IDEAL.camera_centre_m, *np.nonzero(clear.projector_row >= 0)
    rays = IDEAL.camera_rays(columns + 0.5, rows + 0.5)
    points = eye + rays / clear.inverse_depth[rows, columns][:, None]
    bare = tuple(item for item in scene.objects if not isinstance(item.material, Glass))
    alone = render(IDEAL, replace(scene, objects=bare))
    straight = clear.inverse_depth[rows, columns] == alone.inverse_depth[rows, columns]
    kept = dim.direct[rows, columns][:, 0] / clear.direct[rows, columns][:, 0]
    legs = [
        np.linalg.norm(points - start, axis=1) * (1 - 0.3 / points[:, 2]) for start in (eye, IDEAL.projector_centre_m)
    ]
    np.testing.assert_allclose(kept[straight], np.exp(-0.5 * sum(legs))[straight], rtol=1e-4)
    assert (kept[~straight] < 1).all()
    assert (~straight).any()


def assert_same(ours: Buffers, other: Buffers) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(ours, name), getattr(other, name), err_msg=name)


def test_what_moves_is_seen_through_glass_that_moves_or_rests() -> None:
    motion = KeyFrames(
        np.array([0.0, 1.0]), np.array([[0, 0, 0], [0.05, -0.1, 0.1]]), np.stack([turn(), turn(5, 40)]), (0.0, 0.0, 0.8)
    )
    objects = list(behind_glass().objects)
    objects[1], objects[5] = replace(objects[1], motion=motion), replace(objects[5], motion=motion)
    scene = replace(behind_glass(), objects=tuple(objects))
    renderer = Renderer(IDEAL, scene)
    seen = []
    for time_s in (0.0, 0.5, 1.0):
        ours, _ = renderer.at(time_s)
        assert_same(ours, render(IDEAL, scene, time_s))
        assert_same(ours, render(IDEAL, scene, time_s, skip=False))
        seen.append(ours.ambient.copy())
    assert (seen[0] != seen[1]).any()
