"""A virtual camera that is told gates by another rig than its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import check_rig
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.believed import BelievedCamera, any_gate
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import Camera

BELIEVED = check_rig(64)
SCENE = Scene("walls", objects=(plane("wall", (0.0, 0.0, 1.2), (6.0, 4.0), turn(30.0, 20.0)),), ambient=0.05)
SET = gate(78 * 66.0, 3000.0, 2500.0)


def true_rig(stretch: float, offset_us: float) -> Rig:
    shutter = BELIEVED.camera.shutter
    assert isinstance(shutter.line, PixelClocks)
    line = replace(shutter.line, clocks_per_line=stretch * shutter.line.clocks_per_line)
    limits = replace(shutter, line=line, delay_offset_us=offset_us)
    return replace(BELIEVED, camera=replace(BELIEVED.camera, shutter=limits))


def camera_of(rig: Rig) -> VirtualCamera:
    return VirtualCamera(any_gate(rig), SCENE, rate_hz=math.inf, noise=False)


def image_of(camera: Camera, settings: GateSettings) -> NDArray[np.uint16]:
    image = np.zeros((camera.info.height, camera.info.width), np.uint16)
    camera.configure(settings)
    camera.start()
    assert camera.read(image, 5.0) is not None
    return image


def test_real_gates_are_as_long_and_as_late_as_the_true_rigs_shutter_makes_them() -> None:
    """A true offset that is longer than the believed one lets the gate of a delay that is set open earlier."""
    true = true_rig(1.02, 400.25)
    believed = replace(
        BELIEVED, camera=replace(BELIEVED.camera, shutter=replace(BELIEVED.camera.shutter, delay_offset_us=150.0))
    )
    camera = BelievedCamera(camera_of(true), true.camera.shutter, believed)
    assert camera.info.limits == believed.camera.shutter
    got = image_of(camera, SET)
    applied = camera.configure(SET)
    real = gate(1.02 * applied.line_time_us, applied.delay_us + 150.0 - 400.25, applied.exposure_us)
    np.testing.assert_array_equal(got, image_of(camera_of(true), real))
    assert (got != image_of(camera_of(true), applied)).any()


def test_frames_tell_the_settings_that_were_believed() -> None:
    true = true_rig(1.02, 400.25)
    camera = BelievedCamera(camera_of(true), true.camera.shutter, BELIEVED)
    camera.start()
    buffer = np.zeros((camera.info.height, camera.info.width), np.uint16)
    applied = camera.configure(SET)
    settled = []
    for _ in range(2):
        stamp = camera.read(buffer, 5.0)
        assert stamp is not None
        assert (stamp.asked, stamp.applied) == (SET, applied)
        settled.append(stamp.settled)
    assert settled == [False, True]


def test_turned_pictures_stand_on_their_heads_and_so_do_rows_that_are_read() -> None:
    turned = BelievedCamera(camera_of(BELIEVED), BELIEVED.camera.shutter, BELIEVED, turned=True)
    plain = BelievedCamera(camera_of(BELIEVED), BELIEVED.camera.shutter, BELIEVED)
    upright = image_of(plain, SET)
    np.testing.assert_array_equal(image_of(turned, SET), upright[::-1, ::-1])
    height = plain.info.height
    assert turned.set_rows(8, 16) == (8, 16)
    buffer = np.zeros((height, plain.info.width), np.uint16)
    stamp = turned.read(buffer, 5.0)
    assert stamp is not None
    assert stamp.rows == (8, 16)
    np.testing.assert_array_equal(buffer[8:16], upright[::-1, ::-1][8:16])
    assert (np.delete(buffer, slice(8, 16), axis=0) == round(plain.info.black_count)).all()


def test_a_true_rig_with_other_pixels_is_refused() -> None:
    with pytest.raises(InputError, match=r"pixels of the camera is '64 x 48': it must be 80 x 60"):
        BelievedCamera(camera_of(check_rig(80)), BELIEVED.camera.shutter, BELIEVED)
