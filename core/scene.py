"""What stands in front of the rig, as plain data in world coordinates (x right, y down, z forward, metres)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig import Lens, Vector3

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class KeyFrames:
    """A rigid motion about the object's own origin, linear (slerp for rotations) between key frames.

    times_s (K,) rising from 0; positions_m (K, 3) offsets added to the object; rotations (K, 3, 3) object -> world,
    about `pivot_m`. Beyond the last key frame the motion starts again when `loop`, else it rests.
    """

    times_s: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    rotations: NDArray[np.float64]
    pivot_m: Vector3
    loop: bool = True


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one Lambertian, two-sided material.

    vertices (V, 3) float64, faces (F, 3) int32, uv (V, 2) float64 or None with u to the right and v down in the
    texture, texture (h, w, 3) float32 linear albedo looked up at [floor(v h), floor(u w)] (nearest), albedo the linear
    colour where there is no texture. Pieces that share edges but not colours repeat their vertices or are other meshes.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    albedo: Vector3 = (0.8, 0.8, 0.8)
    uv: NDArray[np.float64] | None = None
    texture: Image | None = None
    motion: KeyFrames | None = None


@dataclass(frozen=True, eq=False)
class Sphere:
    """An exact sphere with a constant albedo."""

    name: str
    centre_m: Vector3
    radius_m: float
    albedo: Vector3 = (0.8, 0.8, 0.8)
    motion: KeyFrames | None = None


@dataclass(frozen=True, eq=False)
class Capture:
    """A measured scene as its own camera saw it.

    lens: that camera. inverse_depth (H, W) float32 in 1/m, 0 where nothing was measured. photo (H, W, 3) float32,
    linear, 0..1: albedo times the shading that it was taken with, so no cosine is applied a second time.
    """

    lens: Lens
    inverse_depth: Image
    photo: Image


@dataclass(frozen=True, eq=False)
class Scene:
    """Objects or a capture, under uniform ambient light.

    `ambient` is the radiance that a white surface returns from the room's light in one projector period, in the unit
    of the projector's own (a white frontal plane at 1 m returns 1).
    """

    name: str
    description: str = ""
    objects: tuple[Mesh | Sphere, ...] = ()
    capture: Capture | None = None
    ambient: float = 0.0

    @property
    def moving(self) -> bool:
        """Whether anything moves."""
        return any(item.motion is not None for item in self.objects)
