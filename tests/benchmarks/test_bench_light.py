"""A frame with all parts of the light against one of the clear scene: the gate at rest, and another gate every time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

SCENES = ("cornell_fog", "fog_road", "arms")


def ready(rig: Rig, scene: Scene) -> VirtualCamera:
    """A camera whose parts are all there: indirect light after its first pass, which costs a frame what any does."""
    camera = VirtualCamera(rig, scene, rate_hz=math.inf, bake=True)
    camera.prepare(lambda share: True)
    camera.start()
    if camera.baking is not None:
        camera.baking.close()
    return camera


def clear(scene: Scene) -> Scene:
    """The same without fog, skin and interreflection."""
    objects = tuple(replace(item, material=None) for item in scene.objects)
    return replace(scene, objects=objects, fog=None, indirect=False)


@pytest.fixture(scope="module", params=SCENES)
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[str, VirtualCamera, VirtualCamera]]:
    """The name of a scene, and the cameras before it and before the same without light beyond the direct path."""
    rig = load_rig(None)
    _, scene = open_scene(scene_path(request.param), rig)
    cameras = ready(rig, scene), ready(rig, clear(scene))
    yield request.param, *cameras
    for camera in cameras:
        camera.close()


@pytest.mark.parametrize("moving", [False, True], ids=["rest", "moving"])
def test_next_frame(pair: tuple[str, VirtualCamera, VirtualCamera], compare: Callable[..., None], moving: bool) -> None:
    name, foggy, plain = pair
    image = np.empty((foggy.info.height, foggy.info.width), np.uint16)

    def frame_of(camera: VirtualCamera) -> Callable[[], object]:
        turns = count()

        def take() -> None:
            if moving:
                camera.configure(gate(12.777803, 1800.0 + 3 * (next(turns) % 100), 1000.0))
            assert camera.read(image, 5.0) is not None

        return take

    what = f"{name}: all parts / clear, gate {'moving' if moving else 'at rest'}"
    compare(what, frame_of(foggy), frame_of(plain), "6x" if moving else "1.2x", rounds=60)
