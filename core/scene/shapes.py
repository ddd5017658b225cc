"""Planes, boxes and triangle soups as meshes in world coordinates (x right, y down, z forward, metres)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Vector3
from slopegate.core.scene.materials import Material, Skin
from slopegate.core.scene.scene import Mesh


@dataclass(frozen=True, eq=False)
class Finish:
    """A surface: a linear albedo, or a texture (h, w, 3) float32 of it, and what it is made of."""

    albedo: Vector3 = (0.8, 0.8, 0.8)
    texture: Singles | None = None
    material: Material | None = None

    @property
    def patterned(self) -> bool:
        """Whether it needs texture coordinates, for its texture or its veins."""
        return self.texture is not None or (isinstance(self.material, Skin) and self.material.veins is not None)


class NoAreaError(InputError):
    """A shape without a single triangle that has an area."""


GREY = Finish()
UNIT_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
# Outward normal, the texture's right and the texture's down for each side of a box, in the box's axes.
BOX_SIDES = (
    ((0, 0, -1), (1, 0, 0), (0, 1, 0)),
    ((0, 0, 1), (-1, 0, 0), (0, 1, 0)),
    ((-1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
)


def turn(tilt_deg: float = 0.0, yaw_deg: float = 0.0, roll_deg: float = 0.0) -> Doubles:
    """Rotation (3, 3) float64: first roll, then tilt, then yaw, each about the object's centre in world axes.

    Positive roll turns clockwise as the camera sees it, positive tilt leans the top away from the rig, positive yaw
    takes the right side away from the rig.
    """
    (ct, st), (cy, sy), (cr, sr) = (
        (math.cos(math.radians(angle)), math.sin(math.radians(angle))) for angle in (tilt_deg, yaw_deg, roll_deg)
    )
    roll = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, ct, st], [0.0, -st, ct]])
    yaw = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    return np.asarray(yaw @ tilt @ roll, np.float64)


def quad(
    name: str,
    corner_m: ArrayLike,
    edge_u_m: ArrayLike,
    edge_v_m: ArrayLike,
    finish: Finish = GREY,
) -> Mesh:
    """The parallelogram corner + u edge_u + v edge_v, u and v from 0 to 1; the texture's top left is at the corner.

    Raises NoAreaError where the edges span no area.
    """
    corner, right, down = (np.asarray(item, np.float64) for item in (corner_m, edge_u_m, edge_v_m))
    vertices = corner + UNIT_UV[:, :1] * right + UNIT_UV[:, 1:] * down
    return triangles(name, vertices, np.array([[0, 1, 2], [0, 2, 3]]), finish, UNIT_UV)


def plane(
    name: str,
    centre_m: ArrayLike,
    size_m: tuple[float, float],
    rotation: Doubles,
    finish: Finish = GREY,
) -> Mesh:
    """A rectangle of width and height about its centre, upright and facing the rig before `rotation`."""
    right, down = rotation @ (size_m[0], 0.0, 0.0), rotation @ (0.0, size_m[1], 0.0)
    corner = np.asarray(centre_m, np.float64) - (right + down) / 2
    return quad(name, corner, right, down, finish)


def box(
    name: str,
    centre_m: ArrayLike,
    size_m: ArrayLike,
    rotation: Doubles,
    finish: Finish = GREY,
) -> Mesh:
    """A box of size (x, y, z) before `rotation`; each side bears the whole texture, upright on the four walls."""
    half = np.asarray(size_m, np.float64) / 2
    corners = [
        [half * (np.array(out) + (2 * u - 1) * np.array(right) + (2 * v - 1) * np.array(down)) for u, v in UNIT_UV]
        for out, right, down in BOX_SIDES
    ]
    vertices = np.asarray(centre_m, np.float64) + np.array(corners).reshape(-1, 3) @ rotation.T
    faces = np.concatenate([[[k, k + 1, k + 2], [k, k + 2, k + 3]] for k in range(0, 24, 4)])
    return triangles(name, vertices, faces, finish, np.tile(UNIT_UV, (6, 1)))


def triangles(
    name: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    finish: Finish = GREY,
    uv: ArrayLike | None = None,
) -> Mesh:
    """A mesh from vertices (V, 3), faces (F, 3) and uv (V, 2), without areas of 0 and unused or equal vertices.

    Raises InputError with one sentence for wrong shapes, numbers that are not finite, indices out of range, and
    NoAreaError where no triangle with an area is left. uv is kept only beside a texture or veins.
    """
    points, corners = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    places = np.asarray(uv, np.float64) if uv is not None and finish.patterned else None
    _check_arrays(name, points, corners, places)
    corners = corners[_has_area(points, corners)]
    if not len(corners):
        raise NoAreaError(f"{name} has no triangle with an area: at least one is needed")
    rows = points if places is None else np.hstack([points, places])
    # Equal bytes, not equal numbers: -0.0 and 0.0 stay apart, which costs a vertex and changes nothing.
    keys = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * 8))).ravel()
    _, first, same = np.unique(keys[corners.ravel()], return_index=True, return_inverse=True)
    kept = rows[corners.ravel()[first]]
    return Mesh(
        name=name,
        vertices=np.ascontiguousarray(kept[:, :3]),
        faces=np.ascontiguousarray(same.reshape(-1, 3), dtype=np.int32),
        albedo=finish.albedo,
        uv=None if places is None else np.ascontiguousarray(kept[:, 3:]),
        texture=finish.texture,
        material=finish.material,
    )


def _check_arrays(name: str, points: Doubles, corners: Indices, places: Doubles | None) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{name} has vertices of shape {points.shape}: they must be (V, 3) with V at least 1")
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners):
        raise InputError(f"{name} has faces of shape {corners.shape}: they must be (F, 3) with F at least 1")
    if corners.min() < 0 or corners.max() >= len(points):
        worst = int(corners.max() if corners.max() >= len(points) else corners.min())
        raise InputError(f"{name} has a face with vertex {worst}: it must be in 0..{len(points) - 1}")
    if not np.isfinite(points[corners]).all():
        raise InputError(f"{name} has a vertex that is not finite: every coordinate must be a finite number")
    if places is not None and places.shape != (len(points), 2):
        raise InputError(f"{name} has uv of shape {places.shape}: it must be ({len(points)}, 2)")
    if places is not None and not np.isfinite(places[corners]).all():
        raise InputError(f"{name} has a texture coordinate that is not finite: every one must be a finite number")


def _has_area(points: Doubles, corners: Indices) -> Bools:
    """Whether each triangle is more than a point or a line, to float64 rounding at its own scale."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
    rounding = 1e-12 * (longest + np.abs(points[corners]).max(axis=(1, 2)))
    return np.asarray(area > longest * rounding, np.bool_)
