"""Makes gates that follow the planes listed in a capture's scene.json."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slopegate.core.gating.plan import gate_around, plan_plane
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import quantise
from slopegate.core.scene.scene import MeasuredScene, Preset
from slopegate.drivers.scenes.scene_values import NotNegative, Number

_NEAR_M = 0.01
_NEAR_RMS = 3.0
_STRIDE = 3
"""Pixels between those looked at: a plane covers thousands."""


class PlaneFacts(BaseModel):
    """A fitted plane in camera coordinates: normal . X + distance_m = 0."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    normal: tuple[Number, Number, Number]
    distance_m: Number
    inlier_fraction: NotNegative = 0.0
    rms_mm: NotNegative = 0.0
    name: str = Field(default="", max_length=80)


def plane_gates(planes: Any, rig: Rig, capture: MeasuredScene) -> tuple[Preset, ...]:
    """A gate and its complement for each plane in the list. Entries that no gate can follow are skipped.

    The plane gives the tilt. Delay and exposure are chosen so that the slab holds the measured points on the plane:
    those within three times the fit's rms, at least 1 cm. A gate cannot lean sideways; for a plane that does, the slab
    gets thick enough to hold it all the same.
    """
    presets = []
    points, rows, lit_rows = _points(rig, capture)
    for index, entry in enumerate(planes if isinstance(planes, list) else [], start=1):
        try:
            facts = PlaneFacts.model_validate(entry)
            offset = float(np.dot(facts.normal, rig.camera_centre_m)) - facts.distance_m
            exact = plan_plane(rig, facts.normal, offset, _NEAR_M)
            away = np.abs(points @ np.array(facts.normal) - offset)
            on = away < max(_NEAR_M, _NEAR_RMS * facts.rms_mm / 1000)
            line_time_us = rig.camera.shutter.line.nearest(exact.line_time_us)
            around = gate_around(rig, rows[on], lit_rows[on], line_time_us)
        except (ValidationError, InputError):
            continue
        applied = quantise(rig.camera.shutter, around, rig.projector.period_us)
        share = f" ({facts.inlier_fraction:.0%} of the depth)" if facts.inlier_fraction else ""
        name = (facts.name or f"plane {index}") + share
        presets += [Preset(f"Only {name}", applied, False), Preset(f"All but {name}", applied, True)]
    return tuple(presets)


def _points(rig: Rig, capture: MeasuredScene) -> tuple[Doubles, Doubles, Doubles]:
    """World points (n, 3) that the projector lights, and for each the camera row and the projector row."""
    rows, columns = np.nonzero(capture.inverse_depth[::_STRIDE, ::_STRIDE])
    rows, columns = rows * _STRIDE, columns * _STRIDE
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    points = rays / capture.inverse_depth[rows, columns][:, None] + rig.camera_centre_m
    _, lit_rows, depth = rig.to_projector(points)
    lit = (depth > 0) & (lit_rows >= 0) & (lit_rows < rig.projector.lens.height)
    return points[lit], rows[lit].astype(np.float64), lit_rows[lit]
