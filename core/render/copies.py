"""Which meshes of a scene are copies of each other, turned and moved: rays are cast at one of them, at several places.

Who builds scenes lets copies share their arrays of faces, so that is where to look.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.scene.scene import Mesh, Scene, Sphere

MIN_TRIANGLES: Final = 20_000
"""Smaller meshes are not worth it: every body costs every ray, a copy of its triangles only memory."""
_SAME: Final = 1e-9
"""Greatest distance of two copies' vertices, in sizes of the mesh and its distance from the origin."""


@dataclass(frozen=True, eq=False)
class CopiedMesh:
    """A mesh, and the places of its copies, itself among them: rotation (3, 3), perhaps mirrored, and position (3,)."""

    mesh: Mesh
    poses: tuple[tuple[Doubles, Doubles], ...]


def find_copies(scene: Scene) -> tuple[list[Mesh | Sphere], list[CopiedMesh]]:
    """What stands still and is to be one body, and large meshes that occur more than once.

    Where anything moves nothing is taken out: each body would cost every ray of every frame.
    """
    still = [item for item in scene.objects if item.motion is None]
    groups: dict[tuple[object, ...], list[Mesh]] = {}
    for item in still:
        if isinstance(item, Mesh) and len(item.faces) >= MIN_TRIANGLES and not scene.moving:
            look = item.albedo, id(item.uv), id(item.texture), id(item.material)
            groups.setdefault((id(item.faces), *look), []).append(item)
    found: list[CopiedMesh] = []
    taken: set[int] = set()
    for group in groups.values():
        if len(group) > 1:
            alike = [(item, pose) for item in group if (pose := rigid_motion(group[0].vertices, item.vertices))]
            if len(alike) > 1:
                found.append(CopiedMesh(group[0], tuple(pose for _, pose in alike)))
                taken.update(id(item) for item, _ in alike)
    return [item for item in still if id(item) not in taken], found


def rigid_motion(first: Doubles, other: Doubles) -> tuple[Doubles, Doubles] | None:
    """Rotation, perhaps mirrored, and position that take vertices (V, 3) to others; None where none does (Kabsch)."""
    if first is other:
        return np.eye(3), np.zeros(3)
    if first.shape != other.shape:
        return None
    middle, there = first.mean(axis=0), other.mean(axis=0)
    left, _, right = np.linalg.svd((other - there).T @ (first - middle))
    rotation = left @ right
    position = there - rotation @ middle
    off = float(np.abs(first @ rotation.T + position - other).max())
    return (rotation, position) if off <= _SAME * float(np.abs(first).max() + np.abs(other).max()) else None
