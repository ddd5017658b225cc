"""Where camera and projector look, as corner points for drawing."""

from __future__ import annotations

import numpy as np
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Lens, Rig


def camera_view(rig: Rig, depth_m: float) -> Doubles:
    """The camera's centre and the corners of its view at a depth, clockwise from top left, (5, 3) metres."""
    return _view(rig.camera.lens, rig.camera_centre_m, np.eye(3), depth_m)


def projector_view(rig: Rig, depth_m: float) -> Doubles:
    """The projector's centre and the corners of its view at a depth along its own axis, (5, 3) metres."""
    return _view(rig.projector.lens, rig.projector_centre_m, rig.rotation, depth_m)


def _view(lens: Lens, centre: Doubles, rotation: Doubles, depth_m: float) -> Doubles:
    x, y = lens.normalise([0, lens.width, lens.width, 0], [0, 0, lens.height, lens.height])
    corners = np.stack([x, y, np.ones_like(x)], axis=-1) * depth_m
    return np.concatenate([centre[None], centre + corners @ rotation])
