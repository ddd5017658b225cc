"""Scenes as plain data: objects, their motion, a measured depth map and named gates, in world coordinates (metres).

x right, y down, z forward (model section 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopegate.core.rig.arrays import Doubles, Ints, Singles
from slopegate.core.rig.rig import Lens, Vector3
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.materials import Material
from slopegate.core.scene.media import Fog


@dataclass(frozen=True, eq=False)
class KeyFrames:
    """A rigid motion: a point p of the resting object is at pivot + R (p - pivot) + position.

    times_s (K,) rising from 0; positions_m (K, 3) offsets added to the object; rotations (K, 3, 3) about `pivot_m`, in
    world axes. Between key frames positions go linearly, rotations by the shortest turn (slerp). Beyond the last key
    frame the motion starts again when `loop`, else it rests; before time 0 it rests at the first.
    """

    times_s: Doubles
    positions_m: Doubles
    rotations: Doubles
    pivot_m: Vector3
    loop: bool = True

    def pose(self, time_s: float) -> tuple[Doubles, Doubles]:
        """R (3, 3) and t (3,), float64, with moved point = R p + t at this time."""
        end = float(self.times_s[-1])
        at = time_s % end if self.loop and end > 0 and time_s > 0 else min(max(time_s, 0.0), end)
        after = min(int(np.searchsorted(self.times_s, at, side="right")), len(self.times_s) - 1)
        before = max(after - 1, 0)
        span = float(self.times_s[after] - self.times_s[before])
        share = (at - float(self.times_s[before])) / span if span > 0 else 0.0
        first = self.rotations[before]
        turn = cv2.Rodrigues(np.ascontiguousarray(self.rotations[after] @ first.T))[0]
        rotation = np.asarray(cv2.Rodrigues(turn * share)[0], np.float64) @ first
        position = (1 - share) * self.positions_m[before] + share * self.positions_m[after]
        pivot = np.array(self.pivot_m)
        return rotation, pivot - rotation @ pivot + position


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one two-sided material, Lambertian where `material` is None.

    vertices (V, 3) float64, faces (F, 3) int32, uv (V, 2) float64 or None with u to the right and v down in the
    texture, texture (h, w, 3) float32 linear albedo looked up at [floor(v h), floor(u w)] (nearest), albedo the linear
    colour where there is no texture. Pieces that share edges but not colours repeat their vertices or are other meshes.
    """

    name: str
    vertices: Doubles
    faces: Ints
    albedo: Vector3 = (0.8, 0.8, 0.8)
    uv: Doubles | None = None
    texture: Singles | None = None
    motion: KeyFrames | None = None
    material: Material | None = None


@dataclass(frozen=True, eq=False)
class Sphere:
    """An exact sphere with a constant albedo."""

    name: str
    centre_m: Vector3
    radius_m: float
    albedo: Vector3 = (0.8, 0.8, 0.8)
    motion: KeyFrames | None = None
    material: Material | None = None


@dataclass(frozen=True, eq=False)
class MeasuredScene:
    """A measured scene as its own camera saw it.

    lens: that camera. inverse_depth (H, W) float32 in 1/m, 0 where nothing was measured. photo (H, W, 3) float32,
    linear, 0..1: albedo times the shading that it was taken with, so no cosine is applied a second time.
    """

    lens: Lens
    inverse_depth: Singles
    photo: Singles


@dataclass(frozen=True)
class Preset:
    """A named gate that suits a scene; with `complement` everything but this gate is wanted."""

    name: str
    settings: GateSettings
    complement: bool = False
    asked_slab: tuple[float, float, float] | None = None
    """The tilt in degrees, distance and thickness in metres that `settings` were rounded from, where known."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Objects or a capture, under uniform ambient light.

    `ambient` is the radiance that a white surface returns from the room's light in one projector period, in the unit
    of the projector's own (a white frontal plane at 1 m returns 1).
    """

    name: str
    description: str = ""
    objects: tuple[Mesh | Sphere, ...] = ()
    capture: MeasuredScene | None = None
    ambient: float = 0.0
    gates: tuple[Preset, ...] = ()
    fog: Fog | None = None
    indirect: bool = False
    """Whether interreflection is asked for; fog brings its own."""
    remarks: tuple[str, ...] = ()
    """What of the scene's file was left out or made otherwise for this rig, a clause each."""

    @property
    def moving(self) -> bool:
        """Whether anything moves."""
        return any(item.motion is not None for item in self.objects)
