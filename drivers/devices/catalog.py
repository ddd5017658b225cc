"""Every family of cameras: what it finds and how one is opened. A new family is one line in `CAMERAS`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.aravis import find_aravis, missing_aravis, open_aravis
from slopegate.drivers.cameras.device_camera import FREE_RUNNING
from slopegate.drivers.cameras.gentl import find_gentl, missing_gentl, open_gentl
from slopegate.drivers.cameras.ueye import find_ueye, missing_ueye, open_ueye
from slopegate.drivers.cameras.video import NO_GATE, list_videos, open_video
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.families import Address, Family, Found
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.files.rig_files import load_rig

Open = Callable[[str, Rig, OpenOptions], Camera]

TEST_S: Final = 3.0
"""How long a test waits for a first frame."""


@dataclass(frozen=True, kw_only=True)
class CameraFamily(Family):
    """A family of cameras."""

    open: Open
    """Open the camera that is at a `Found.where`. Raises CameraError."""
    no_gate: str = ""
    """Why none of its cameras can make a gate, in one sentence; empty when some can."""


def open_camera(family: str, where: str, rig: Rig, options: OpenOptions | None = None) -> Camera:
    """Open the camera that a device list shows as `family` and `where`. Blocks for seconds; raises CameraError.

    Its `info.limits` are what the rig file and the camera both allow: plan gates with those instead of the rig file's.
    Video sources that no list shows have a `where` too: a file, a folder of pictures, an address.
    """
    if family not in OPEN:
        raise CameraError(f"There is no camera driver {family!r}: there are {', '.join(OPEN)}")
    return OPEN[family](where, rig, options or OpenOptions())


def try_camera(device: Found) -> str:
    """Open it running by itself, wait for a frame, let it go: one sentence on what came. Raises CameraError."""
    camera = open_camera(device.family, device.where, load_rig(None), OpenOptions(triggered=False))
    try:
        info = camera.info
        image = np.zeros((info.height, info.width), np.uint16)
        started_s = time.monotonic()
        camera.start()
        while camera.read(image, TEST_S) is None:
            if time.monotonic() - started_s > TEST_S:
                raise CameraError(f"{info.name} answers, but sent no frame within {TEST_S:g} s")
        after_s = time.monotonic() - started_s
        can = info.can
        missing = {ability.missing for ability in (can.line_time, can.delay, can.exposure, can.trigger, can.rows)}
        missing -= {"", FREE_RUNNING}  # whether it can be triggered is not known of one that was not asked to
        limits = f" It cannot do everything: {' '.join(sorted(missing))}" if missing else ""
        return f"{info.name} sent {info.width} x {info.height} {info.pixel_format} after {after_s:.1f} s.{limits}"
    finally:
        camera.close()


def no_gate_at(address: Address) -> str:
    """Why no camera of this family makes a gate, in one sentence; empty where one may, or for an unknown family."""
    return next((family.no_gate for family in CAMERAS if family.key == address.family), "")


def _find_videos() -> list[Found]:
    return [Found("camera", "video", where, name, where) for where, name in list_videos()]


VIRTUAL: Final = Family(
    "virtual",
    "camera",
    "Virtual camera",
    lambda: "",
    lambda: [Found("camera", "virtual", "virtual", "Virtual camera", "looks at the scene that is open")],
)
"""Nobody opens it here: it is made with the scene that it looks at."""

CAMERAS: Final = (
    CameraFamily("ueye", "camera", "IDS uEye", missing_ueye, find_ueye, try_camera, open=open_ueye),
    CameraFamily(
        "gentl", "camera", "GenICam by a vendor's producer", missing_gentl, find_gentl, try_camera, open=open_gentl
    ),
    CameraFamily("aravis", "camera", "GenICam by aravis", missing_aravis, find_aravis, try_camera, open=open_aravis),
    CameraFamily(
        "video", "camera", "Webcams", lambda: "", _find_videos, try_camera, open=open_video, no_gate=NO_GATE.missing
    ),
)

OPEN: Final[dict[str, Open]] = {family.key: family.open for family in CAMERAS}
