from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import ueye_stub
import viky
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.families import Found
from slopegate.drivers.devices.catalog import CAMERAS, OPEN, open_camera, try_camera
from slopegate.drivers.devices.survey import families, survey, try_device
from slopegate.drivers.files.rig_files import load_rig

RIG = load_rig(None)


def test_what_is_listed_can_be_opened_and_what_can_be_opened_is_listed() -> None:
    assert {family.key for family in CAMERAS} == set(OPEN)
    assert {family.key for family in families() if family.kind == "camera"} == {*OPEN, "virtual"}
    assert all(family.kind == "camera" and family.test is not None for family in CAMERAS)


@pytest.mark.parametrize("family", [family for family in OPEN if family != "aravis"])
def test_a_camera_that_is_not_there_is_told_in_a_sentence(family: str) -> None:
    with pytest.raises(CameraError) as told:
        open_camera(family, "no-such-camera-9", RIG)
    assert len(str(told.value)) > 20


def test_a_driver_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(CameraError, match="'firewire': there are ueye, gentl, aravis, video"):
        open_camera("firewire", "1", RIG)


def test_the_device_list_finds_and_tries_real_drivers(request: pytest.FixtureRequest) -> None:
    viky.install(request)
    ueye_stub.stub().fresh()
    seen = survey(CAMERAS, 30.0)
    found = {(device.family, device.where): device for device in seen.found}
    answer = try_device(found["ueye", ueye_stub.SERIAL], CAMERAS)
    assert answer.startswith("IDS UI-3250CP-C-HQ 4103123456 sent 1600 x 1200 bayer_gr12 after")
    answer = try_device(found["gentl", viky.RED], CAMERAS)
    assert "Viky 0 sent 800 x 800 mono8 after" in answer
    assert "no exposure time that can be set" in answer


def test_a_camera_that_sends_nothing_is_told_and_let_go() -> None:
    library = ueye_stub.stub()
    library.fresh(trigger_hz=0)
    device = Found("camera", "ueye", ueye_stub.SERIAL, "IDS")
    with pytest.raises(CameraError, match="sent no frame within 3 s"):
        try_camera(device)
    library.trigger(60)
    assert "sent" in try_camera(device)
    assert library.memories == 0


def test_a_film_opens_by_its_path(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.full((4, 6), 9, np.uint8))
    camera = open_camera("video", str(tmp_path), RIG)
    assert (camera.info.width, camera.info.height, camera.info.limits) == (6, 4, None)
    camera.close()
