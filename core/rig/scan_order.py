"""Rasters that are scanned from the bottom to the top, as others turned upside down.

Everywhere else row coordinates rise with time: row r is drawn or read r rows after row 0. A raster that is scanned
upwards is one turned by half a turn about its optical axis, exactly, lens distortion and all: then its row 0 is the one
scanned first. The columns are turned with it, so that nothing is mirrored.
"""

from __future__ import annotations

from dataclasses import replace

from slopegate.core.rig.rig import Lens, Matrix3, Rig


def half_turned(lens: Lens) -> Lens:
    """The lens of the raster turned by half a turn: normalised (-x, -y) meet pixel (width - column, height - row).

    What is odd in x and y keeps its coefficients (radial distortion), what is even changes sign: tangential, thin prism
    and tilt.
    """
    flipped = tuple(-value if place in (2, 3) or place >= 8 else value for place, value in enumerate(lens.distortion))
    return replace(lens, cx=lens.width - lens.cx, cy=lens.height - lens.cy, distortion=flipped)


def in_scan_order(rig: Rig, camera_up: bool, projector_up: bool) -> Rig:
    """The rig with rows that rise with time, from one whose camera reads or whose projector draws upwards.

    Axes are the camera's, so they turn with it: what was above the camera is then below, and pictures are upside down.
    """
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
