"""What a rig file becomes with an open camera before its lens, and what that camera cannot do of a gate."""

from __future__ import annotations

from dataclasses import replace

from slopegate.core.rig.rig import Rig, RigCamera
from slopegate.drivers.contract.frame import CameraInfo


def device_rig(rig: Rig, info: CameraInfo) -> tuple[Rig, str]:
    """The rig with the camera's pixels and limits to plan gates with, and what is to be said of it; empty: nothing."""
    seen, remark = seen_rig(rig, info)
    if info.limits is None:
        return seen, ""
    return replace(seen, camera=replace(seen.camera, shutter=info.limits)), remark


def seen_rig(rig: Rig, info: CameraInfo) -> tuple[Rig, str]:
    """The rig with a camera that has as many pixels as its frames, and what is to be said of that.

    A rig file for another size is taken for the same lens before a sensor of the same width.
    """
    lens = rig.camera.lens
    if (lens.width, lens.height) == (info.width, info.height):
        return rig, ""
    remark = (
        f"{info.name} has {info.width} \u00d7 {info.height} pixels and the rig file describes "
        f"{lens.width} \u00d7 {lens.height}: tilts and distances are only rough until it describes this camera."
    )
    return replace(rig, camera=RigCamera(lens.resized(info.width, info.height), rig.camera.shutter)), remark


def no_slab(info: CameraInfo) -> str:
    """Why it is not known where the camera's slab lies, if there is one, in one sentence; empty when it is."""
    return info.can.exposure.missing if info.limits is None else info.can.trigger.missing


def no_gate(info: CameraInfo) -> str:
    """Why the camera cannot be told where its slab is to lie, in one sentence; empty when it can."""
    return no_slab(info) or info.can.delay.missing
