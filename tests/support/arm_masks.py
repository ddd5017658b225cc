"""Where an arm's veins and the skin beside them are in the picture, and how well veins are seen there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from slopegate.app.api import GateSettings, OpenScene
from slopegate.core.light.skin_points import SkinBody, views
from slopegate.core.render.tracing import Tracer
from slopegate.core.rig.arrays import Indices
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Mesh, Scene

AROUND_MM, LENGTH_MM = 198.0, 330.0
"""The size of the vein map on the arm."""


@dataclass(frozen=True, eq=False)
class ArmMasks:
    """Pixels, by number, of one arm's front: on veins, on skin 5 to 9 mm beside them, and along its front line."""

    veins: Indices
    skin: Indices
    front: Indices


def arm_masks(opened: OpenScene, number: int) -> ArmMasks:
    """Of the arm that is the scene's object `number`: 22 mm to either side of its front line, without its ends."""
    rig, scene = opened.rig, opened.scene
    item = scene.objects[number]
    assert isinstance(item, Mesh)
    assert isinstance(item.material, Skin)
    assert item.material.veins is not None
    patch = SkinBody(item, item.material, 0.0).seen(views(rig)[0], Tracer(rig, scene).still(), rig.projector_centre_m)
    map_ = item.material.veins
    away_mm = cv2.distanceTransform((map_ < 0.5).astype(np.uint8), cv2.DIST_L2, 5) * AROUND_MM / map_.shape[1]
    place = (patch.uv * (map_.shape[1], map_.shape[0])).astype(int)
    place = np.clip(place, 0, (map_.shape[1] - 1, map_.shape[0] - 1))
    x, y = (patch.uv[:, 0] - 0.5) * AROUND_MM, (patch.uv[:, 1] - 0.5) * LENGTH_MM
    near = (np.abs(x) < 22) & (np.abs(y) < 120)
    vein, away = map_[place[:, 1], place[:, 0]] > 0.99, away_mm[place[:, 1], place[:, 0]]
    return ArmMasks(
        patch.pixels[near & vein], patch.pixels[near & (away > 5) & (away < 9)], patch.pixels[near & (np.abs(x) < 3)]
    )


def without_veins(opened: OpenScene) -> OpenScene:
    """The same scene with skin that hides none."""
    objects = [
        replace(item, material=replace(item.material, veins=None)) if isinstance(item.material, Skin) else item
        for item in opened.scene.objects
    ]
    scene: Scene = replace(opened.scene, objects=tuple(objects))
    return OpenScene(opened.rig, scene)


def visibility(opened: OpenScene, bare: OpenScene, gate: GateSettings, masks: ArmMasks, *, colour: int = -1) -> float:
    """By what share veins are darker than the skin beside them; shading is divided out by the arm without veins.

    colour: 0..2 of a colour picture, -1 for luminance.
    """
    ratios = []
    for one in (opened, bare):
        light = one.light(gate) if colour < 0 else one.light(gate, colour=True)[..., colour]
        ratios.append(float(light.ravel()[masks.veins].mean() / light.ravel()[masks.skin].mean()))
    return 1 - ratios[0] / ratios[1]
