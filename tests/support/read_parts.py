"""What tests of mesh files ask of what was read."""

from pathlib import Path

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.scene.scene import Mesh
from slopegate.drivers.scenes.mesh_files import Placement, read_mesh

AS_FILED = Placement((0.0, 0.0, 0.0), up="z", anchor="origin")


def read(path: Path) -> tuple[list[Mesh], tuple[str, ...]]:
    """The meshes of a file in its own size, z up, and the remarks without the file's name."""
    meshes, remarks = read_mesh(path, AS_FILED)
    assert all(remark.startswith(f"{path}: ") and "\n" not in remark for remark in remarks)
    return meshes, tuple(remark.removeprefix(f"{path}: ") for remark in remarks)


def read_whole(path: Path) -> list[Mesh]:
    """The meshes of a file of which nothing is left out."""
    meshes, remarks = read(path)
    assert remarks == ()
    return meshes


def corners(mesh: Mesh) -> Doubles:
    """Corners (F, 3, 3) in the file's axes."""
    x, y, z = (mesh.vertices[mesh.faces][..., k] for k in range(3))
    return np.stack([x, z, -y], axis=-1)


def area(*meshes: Mesh) -> float:
    """Of all triangles together."""
    shapes = [corners(mesh) for mesh in meshes]
    crossed = [np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0]) for shape in shapes]
    return float(sum(np.linalg.norm(each, axis=1).sum() / 2 for each in crossed))


def colour_at(meshes: list[Mesh], place: tuple[float, float, float]) -> list[float]:
    """The albedo that the renderer finds where a triangle of the meshes holds `place`, in the file's axes."""
    for mesh in meshes:
        for number, (a, b, c) in enumerate(corners(mesh)):
            shares, *_ = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), np.array(place) - a, rcond=None)
            here = a + shares @ np.stack([b - a, c - a])
            if shares.min() < -1e-9 or shares.sum() > 1 + 1e-9 or np.abs(here - place).max() > 1e-9:
                continue
            if mesh.texture is None or mesh.uv is None:
                return list(mesh.albedo)
            u, v = np.array([1 - shares.sum(), *shares]) @ mesh.uv[mesh.faces[number]]
            height, width = mesh.texture.shape[:2]
            texel = mesh.texture[min(max(int(v * height), 0), height - 1), min(max(int(u * width), 0), width - 1)]
            return [float(value) for value in texel]
    raise AssertionError(f"nothing is at {place}")
