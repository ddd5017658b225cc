"""Rigs made from another one: with larger pixels, in scan order, and with the projector beside the camera."""

from __future__ import annotations

from dataclasses import replace

from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Lens, Matrix3, Rig, half_turned
from slopegate.core.rig.settings import GateSettings, LineTimes, PixelClocks
from slopegate.core.rig.uncertainty import retold


def binned_rig(rig: Rig, by: int) -> Rig:
    """The rig with camera pixels `by` times as wide and high; what does not fill a whole pixel is cut off.

    A row lasts as long as those that it is made of, so its gate is that of `binned_gate`.
    """
    require(1 <= by <= min(rig.camera.lens.width, rig.camera.lens.height), "by", by, "from 1 to the image's size")
    return retold(rig, lambda one: _binned(one, by))


def _binned(rig: Rig, by: int) -> Rig:
    line = rig.camera.shutter.line
    longer = (
        PixelClocks(line.clocks_per_line * by, line.ladder_mhz)
        if isinstance(line, PixelClocks)
        else LineTimes(line.min_us * by, line.max_us * by, line.step_us * by)
    )
    shutter = replace(rig.camera.shutter, line=longer)
    return replace(rig, camera=replace(rig.camera, lens=binned_lens(rig.camera.lens, by), shutter=shutter))


def binned_lens(lens: Lens, by: int) -> Lens:
    """The lens over pixels `by` times as wide and high."""
    scaled = {name: getattr(lens, name) / by for name in ("fx", "fy", "cx", "cy")}
    return replace(lens, width=lens.width // by, height=lens.height // by, **scaled)


def binned_gate(settings: GateSettings, by: int) -> GateSettings:
    """The gate of `binned_rig` that records the same slab: a row is exposed as those are on average that it is of."""
    return replace(settings, line_time_us=settings.line_time_us * by)


def beside_rig(rig: Rig) -> Rig:
    """The rig with the projector at the same distance to the camera's left, looking where the camera looks."""
    return replace(
        rig,
        projector_offset_m=(-rig.baseline_m, 0.0, 0.0),
        projector_rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        name=f"{rig.name}, projector beside",
        calibration=None,
    )


def in_scan_order(rig: Rig, camera_up: bool, projector_up: bool) -> Rig:
    """The rig with rows that rise with time, from one whose camera reads or whose projector draws upwards.

    Axes are the camera's, so they turn with it: what was above the camera is then below, and pictures are upside down.
    Its calibration turns with it.
    """
    return retold(rig, lambda one: _half_turned(one, camera_up, projector_up)) if camera_up or projector_up else rig


def _half_turned(rig: Rig, camera_up: bool, projector_up: bool) -> Rig:
    if camera_up:
        x, y, z = rig.projector_offset_m
        camera = replace(rig.camera, lens=half_turned(rig.camera.lens))
        turned = _signed(rig.projector_rotation, columns=True)
        rig = replace(rig, camera=camera, projector_offset_m=(-x, -y, z), projector_rotation=turned)
    if projector_up:
        projector = replace(rig.projector, lens=half_turned(rig.projector.lens))
        rig = replace(rig, projector=projector, projector_rotation=_signed(rig.projector_rotation, columns=False))
    return rig


def _signed(rotation: Matrix3, columns: bool) -> Matrix3:
    """Half a turn about z after the rotation, or before it: the first two rows, or columns, change sign."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    if columns:
        return ((-a, -b, c), (-d, -e, f), (-g, -h, i))
    return ((-a, -b, -c), (-d, -e, -f), (g, h, i))
