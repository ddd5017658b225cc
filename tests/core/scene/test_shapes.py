import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.scene.scene import Mesh
from slopegate.core.scene.shapes import Finish, NoAreaError, box, plane, quad, triangles, turn

ANGLE = st.floats(-180, 180)
PICTURE = Finish(texture=np.zeros((4, 4, 3), np.float32))


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_positive_tilt_leans_the_top_away_by_the_models_tangent() -> None:
    card = plane("card", (0, 0, 1.05), (0.2, 0.34), turn(tilt_deg=15))
    top, bottom = (card.vertices[np.argmin(sign * card.vertices[:, 1])] for sign in (1, -1))
    assert top[2] > bottom[2]
    assert -(top[2] - bottom[2]) / (top[1] - bottom[1]) == pytest.approx(math.tan(math.radians(15)))


def test_the_reference_scenes_tilted_target_comes_out() -> None:
    card = plane("p+15", (-0.25, 0, 0.9), (0.2, 0.34), turn(tilt_deg=15))
    corner = card.vertices[np.lexsort((card.vertices[:, 0], card.vertices[:, 1]))[0]]
    np.testing.assert_allclose(corner, [-0.35, -0.164207, 0.943999], atol=1e-6)


def test_positive_yaw_takes_the_right_side_away_and_roll_is_clockwise() -> None:
    assert (turn(yaw_deg=20) @ (1, 0, 0))[2] > 0
    assert (turn(roll_deg=20) @ (1, 0, 0))[1] > 0


@given(ANGLE, ANGLE, ANGLE)
def test_turns_are_rotations(tilt: float, yaw: float, roll: float) -> None:
    rotation = turn(tilt, yaw, roll)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_the_textures_top_left_is_the_planes_top_left() -> None:
    card = plane("card", (0, 0, 1), (0.4, 0.2), turn(), PICTURE)
    assert card.uv is not None
    corner = np.argmin(card.vertices[:, 0] + card.vertices[:, 1])
    np.testing.assert_allclose(card.vertices[corner], [-0.2, -0.1, 1])
    np.testing.assert_allclose(card.uv[corner], [0, 0])


@given(ANGLE, ANGLE, ANGLE)
def test_a_box_has_its_surface_and_stays_about_its_centre(tilt: float, yaw: float, roll: float) -> None:
    crate = box("crate", (1, 2, 3), (0.1, 0.2, 0.3), turn(tilt, yaw, roll))
    assert area(crate) == pytest.approx(2 * (0.02 + 0.06 + 0.03))
    np.testing.assert_allclose(np.unique(crate.vertices.round(9), axis=0).mean(axis=0), [1, 2, 3], atol=1e-6)


def edges(mesh: Mesh) -> Counter[frozenset[tuple[float, ...]]]:
    """In how many triangles each edge is, by the places of its ends."""
    places = [tuple(place) for place in mesh.vertices.round(9).tolist()]
    return Counter(frozenset((places[face[k]], places[face[k - 1]])) for face in mesh.faces for k in range(3))


def test_a_box_is_closed() -> None:
    found = edges(box("crate", (1, 2, 3), (0.1, 0.2, 0.3), turn(10, 20, 30)))
    assert len(found) == 12 + 6
    assert set(found.values()) == {2}


def test_a_quad_has_four_edges_and_one_diagonal_through_its_middle() -> None:
    found = edges(quad("card", (0, 0, 1), (0.4, 0.1, 0), (0, 0.2, 0.1)))
    assert sorted(found.values()) == [1, 1, 1, 1, 2]
    np.testing.assert_allclose(np.mean([*found.most_common(1)[0][0]], axis=0), [0.2, 0.15, 1.05], atol=1e-9)


def test_a_thin_triangle_is_kept_wherever_it_stands() -> None:
    thin = np.array([[0, 0, 0], [1e-3, 0, 0], [0, 1e-8, 0]])
    for corner in ((0, 0, 1), (300, 200, 1000)):
        assert len(triangles("sliver", thin + corner, [[0, 1, 2]]).faces) == 1


def test_a_boxs_front_shows_its_texture_upright() -> None:
    crate = box("crate", (0, 0, 1), (1, 1, 1), turn(), PICTURE)
    assert crate.uv is not None
    front = [
        (vertex, uv)
        for face in crate.faces
        if (crate.vertices[face, 2] == 0.5).all()
        for vertex, uv in zip(crate.vertices[face], crate.uv[face], strict=True)
    ]
    assert len(front) == 6
    for vertex, uv in front:
        np.testing.assert_allclose(vertex[:2] + 0.5, uv)


def test_equal_vertices_are_merged_and_flat_triangles_dropped() -> None:
    points = [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [2, 2, 2]]
    mesh = triangles("sheet", points, [[0, 1, 2], [3, 4, 5], [0, 1, 3]])
    assert len(mesh.vertices) == 4
    assert len(mesh.faces) == 2
    assert area(mesh) == pytest.approx(1)


def test_vertices_that_differ_in_the_texture_stay_apart() -> None:
    points, uv = [[0, 0, 1], [1, 0, 1], [0, 1, 1]] * 2, [[0, 0], [1, 0], [0, 1], [0.5, 0], [1, 0], [0, 1]]
    mesh = triangles("sheet", points, [[0, 1, 2], [3, 4, 5]], PICTURE, uv)
    assert len(mesh.vertices) == 4


@pytest.mark.parametrize(
    ("points", "faces", "words"),
    [
        ([[0, 0, 1], [1, 0, 1], [2, 0, 1]], [[0, 1, 2]], "no triangle with an area"),
        ([[0, 0, 1], [1, 0, 1], [0, 1, math.nan]], [[0, 1, 2]], "not finite"),
        ([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 3]], "face with vertex 3: it must be in 0..2"),
        ([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, -1]], "face with vertex -1"),
        (np.zeros((0, 3)), [[0, 1, 2]], "vertices of shape"),
        ([[0, 0, 1], [1, 0, 1], [0, 1, 1]], np.zeros((0, 3)), "faces of shape"),
    ],
)
def test_what_is_no_surface_is_refused(points: list[list[float]], faces: list[list[int]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        triangles("thing", points, faces)


def test_parallel_edges_span_nothing() -> None:
    with pytest.raises(NoAreaError, match="thing"):
        quad("thing", (0, 0, 1), (1, 0, 0), (-2, 0, 0))
