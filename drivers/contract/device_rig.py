"""Fits the rig file to an open camera, and says what the camera cannot do of a gate."""

from __future__ import annotations

from dataclasses import replace

from slopegate.core.rig.rig import Rig
from slopegate.core.rig.uncertainty import retold, still_known
from slopegate.drivers.contract.frame import CameraInfo


def device_rig(rig: Rig, info: CameraInfo) -> tuple[Rig, str]:
    """The rig with the camera's size and limits, to plan gates with, and a remark for the user (empty: none)."""
    seen, remark = seen_rig(rig, info)
    if info.limits is None:
        return seen, ""
    limited = replace(seen, camera=replace(seen.camera, shutter=info.limits))
    return still_known(seen, limited), remark


def seen_rig(rig: Rig, info: CameraInfo) -> tuple[Rig, str]:
    """The rig with the camera's size in pixels, and a remark for the user, empty when the rig file has that size.

    A rig file for another size is taken to describe the same lens before a sensor of the same width.
    """
    lens = rig.camera.lens
    if (lens.width, lens.height) == (info.width, info.height):
        return rig, ""
    remark = (
        f"{info.name} has {info.width} \u00d7 {info.height} pixels and the rig file describes "
        f"{lens.width} \u00d7 {lens.height}: tilts and distances are only rough until it describes this camera."
    )
    return retold(rig, lambda one: _resized(one, info.width, info.height)), remark


def _resized(rig: Rig, width: int, height: int) -> Rig:
    return replace(rig, camera=replace(rig.camera, lens=rig.camera.lens.resized(width, height)))


def no_timing(info: CameraInfo) -> str:
    """Why it is not known when the camera exposes its rows, in one sentence; empty when it is known."""
    if info.limits is None:
        return info.can.exposure.missing
    return "" if fixed_gate(info) else info.can.trigger.missing


def fixed_gate(info: CameraInfo) -> str:
    """Why the camera's gate is always the same, in one sentence; empty where it is not, or there is none."""
    return "" if info.limits is None else info.can.exposure.missing


def no_gate(info: CameraInfo) -> str:
    """Why the camera's gate cannot be set, in one sentence; empty when it can."""
    return no_timing(info) or fixed_gate(info) or info.can.delay.missing
