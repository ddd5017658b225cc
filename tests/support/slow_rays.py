"""Where rays meet surfaces, slowly and plainly enough to be checked by reading."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Doubles
from slopegate.core.scene.materials import Material
from slopegate.core.scene.scene import Mesh, Scene, Sphere


def texel(mesh: Mesh, face: NDArray[np.int32], s: float, t: float) -> Doubles:
    if mesh.texture is None or mesh.uv is None:
        return np.array(mesh.albedo)
    u, v = (1 - s - t) * mesh.uv[face[0]] + s * mesh.uv[face[1]] + t * mesh.uv[face[2]]
    height, width = mesh.texture.shape[:2]
    row = min(max(math.floor(v * height), 0), height - 1)
    return mesh.texture[row, min(max(math.floor(u * width), 0), width - 1)].astype(np.float64)


def nearest(scene: Scene, origin: Doubles, ray: Doubles) -> tuple[float, Doubles, Doubles, Material | None]:
    """Distance in lengths of the ray (infinite if none), unit normal, albedo and material of the first surface."""
    best: tuple[float, Doubles, Doubles, Material | None] = (math.inf, np.zeros(3), np.zeros(3), None)
    for item in scene.objects:
        if isinstance(item, Sphere):
            offset = origin - np.array(item.centre_m)
            a, b, c = ray @ ray, 2 * ray @ offset, offset @ offset - item.radius_m**2
            if b * b > 4 * a * c:
                for sign in (-1, 1):
                    t = (-b + sign * math.sqrt(b * b - 4 * a * c)) / (2 * a)
                    if 1e-6 < t < best[0]:
                        best = (t, (offset + t * ray) / item.radius_m, np.array(item.albedo), item.material)
            continue
        for face in item.faces:
            a, b, c = item.vertices[face]
            matrix = np.column_stack([b - a, c - a, -ray])
            if abs(np.linalg.det(matrix)) > 1e-15:
                s, u, t = np.linalg.solve(matrix, origin - a)
                if s >= 0 and u >= 0 and s + u <= 1 and 1e-6 < t < best[0]:
                    normal = np.cross(b - a, c - a)
                    best = (t, normal / np.linalg.norm(normal), texel(item, face, s, u), item.material)
    return best
