"""The proximity alarm in fog: the sheet glows, and still nothing but what crosses it sets the alarm off."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigs import LADDER, check_rig
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.light.lights import asked_parts
from slopegate.core.measure.alarm import Alarm, AlarmZone, quiet_level
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

FOG = Fog(scattering_per_m=1.0, absorption_per_m=0.1, g=0.7)
"""The stated density: a visibility of 3.6 m."""
FRAMES, LEAST_SHARE = 10_000, 0.0005


def foggy(rig: Rig) -> Scene:
    scene = open_scene(Path(scene_path("alarm")), rig)[1]
    return replace(scene, fog=FOG)


def nobody(scene: Scene) -> Scene:
    return replace(scene, objects=tuple(item for item in scene.objects if item.motion is None))


def watched(rig: Rig, scene: Scene, rate_hz: float = math.inf) -> VirtualCamera:
    """A camera before the sheet, with everything that fog does; light between surfaces is not needed for it."""
    camera = VirtualCamera(rig, scene, rate_hz=rate_hz, seed=5, sleep=lambda seconds: None)
    assert asked_parts(scene) >= {"airlight", "scatter"}
    camera.configure(scene.gates[0].settings)
    camera.start()
    return camera


def armed(camera: VirtualCamera) -> tuple[Alarm, Counts]:
    """Set as the panel's Learn does, from one frame."""
    info = camera.info
    image = np.zeros((info.height, info.width), np.uint16)
    camera.read(image, 5.0)
    level = quiet_level(image, (0, 0, info.width, info.height))
    assert image.mean() > SensorModel().black_count + 2, "the sheet must glow, or this says nothing of fog"
    return Alarm(AlarmZone(0, 0, info.width, info.height, level, LEAST_SHARE)), image


def frames_without_alarm(rig: Rig) -> int:
    camera = watched(rig, nobody(foggy(rig)))
    alarm, image = armed(camera)
    for number in range(FRAMES):
        assert camera.read(image, 5.0) is not None
        alarm = alarm.after(image, number, 0.0)
        if alarm.trip is not None:
            break
    return alarm.frames


def test_nobody_crosses_and_ten_thousand_foggy_frames_stay_quiet() -> None:
    assert frames_without_alarm(check_rig(200, ladder=LADDER)) == FRAMES


@pytest.mark.slow
def test_ten_thousand_foggy_frames_at_full_resolution_stay_quiet() -> None:
    assert frames_without_alarm(check_rig(1600, ladder=LADDER)) == FRAMES


def test_a_hand_that_crosses_the_sheet_in_fog_sets_the_alarm_off() -> None:
    rig = check_rig(200, ladder=LADDER)
    camera = watched(rig, foggy(rig), rate_hz=20.0)
    alarm, image = armed(camera)
    tripped = None
    for number in range(1, 180):
        assert camera.read(image, 5.0) is not None
        alarm = alarm.after(image, number, number / 20.0)
        tripped = alarm.trip
        if tripped is not None:
            break
    assert tripped is not None
    assert 3.0 < tripped.time_s < 6.0
