"""Whether a scene can be what its author meant: scenes in millimetres, or beside the rig, open as black pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from slopegate.core.rig.rig import Rig
from slopegate.core.scene.distances import in_view, nearest_m
from slopegate.core.scene.scene import Mesh, Sphere
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.scene_values import MAX_METRES, MIN_METRES

FAR_METRES: Final = 100.0
"""From here on less than one ten-thousandth of the light at 1 m comes back."""


def check_distances(path: Path, objects: Sequence[Mesh | Sphere], rig: Rig) -> tuple[str, ...]:
    """Remarks about a scene that hardly shows anything. Raises SceneError where nothing can be seen at all."""
    centres = {"camera": rig.camera_centre_m, "projector": rig.projector_centre_m}
    nearest = {name: nearest_m(objects, centre, MIN_METRES, FAR_METRES) for name, centre in centres.items()}
    for name, distance in nearest.items():
        if distance < MIN_METRES:
            raise SceneError(
                f"{path}: a surface is {1000 * distance:.3g} mm from the {name}: it must be at least "
                f"{1000 * MIN_METRES:g} mm away (lengths are in metres)"
            )
    distance = nearest["camera"]
    if distance > MAX_METRES:
        raise SceneError(
            f"{path}: the nearest surface is at {distance:.6g} m: it must be within {MAX_METRES:g} m (lengths are in "
            "metres)"
        )
    if distance > FAR_METRES:
        return (
            f"{path}: the nearest surface is at {distance:.6g} m, where hardly any light comes back from: lengths are "
            "in metres, and those of a scene in millimetres must be a thousandth",
        )
    if not in_view(objects, rig.camera.lens):
        return (f"{path}: no object is in the camera's view: it looks along z, and y points down",)
    return ()
