"""The paper's figure 9 on the road in fog: what of its arrow and its stop sign stands above all noise in a gate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

import draw_scenes
from rigs import check_rig
from slopegate.app import api
from slopegate.core.gating.gate import phase_us, upright_line_time
from slopegate.core.rig.arrays import Bools
from slopegate.core.rig.settings import GateSettings

UPHILL, UP, MIDDLE = np.array([0.0, -0.6, 0.8]), np.array([0.0, -0.8, -0.6]), np.array([0.0, 0.0, 0.8])
FAR_END_M = 0.595
"""The far end of the road, from MIDDLE."""
SIGN_M = MIDDLE + 0.19 * np.array([1.0, 0, 0]) - 0.025 * UPHILL + 0.14 * UP


@dataclass(frozen=True)
class Road:
    """The scene, its light prepared, and which of its pixels show what."""

    scene: api.OpenScene
    arrow: Bools
    sign: Bools
    road: Bools

    def seen(self, gate: GateSettings, where: Bools) -> float:
        """Share of the pixels whose direct light is at least 3 standard deviations of all noise there."""
        parts, sensor = self.scene.light_by_part(gate), self.scene.sensor()
        electrons = {
            name: light[where] * sensor.counts_per_unit * sensor.electrons_per_count for name, light in parts.items()
        }
        noise = np.sqrt(np.sum(list(electrons.values()), axis=0) + sensor.read_noise_e**2)
        assert min(light.min() for light in electrons.values()) > -1e-3  # sums of float32 end in rounding
        assert min(electrons["airlight"].max(), electrons["indirect"].max()) > 1
        return float((electrons["direct"] >= 3 * noise).mean())

    def best_upright(self, exposure_us: float, where: Bools) -> GateSettings:
        """The upright gate of this exposure that lights the most of these pixels, of all delays there are."""
        rig, line_time_us = self.scene.rig, upright_line_time(self.scene.rig)
        rows = np.nonzero(where)[0]
        at = np.sort(phase_us(rig, line_time_us, rows + 0.5, self.scene.buffers.projector_row[where].astype(float)))
        count = np.searchsorted(at, at + exposure_us) - np.arange(len(at))
        delay_us = at[int(count.argmax())] + exposure_us / 2 - 1e-6
        return self.scene.gate(line_time_us=line_time_us, delay_us=float(delay_us), exposure_us=exposure_us)


def opened(width: int, paths: int) -> Road:
    scene = api.open_scene("fog_road", rig=api.OpenRig(check_rig(width)))
    scene.bake(paths=paths)
    depth, (height, width) = scene.depth_m, scene.shape
    rows, columns = np.mgrid[:height, :width]
    eye = scene.rig.camera_centre_m
    points = eye + scene.rig.camera_rays(columns + 0.5, rows + 0.5) * depth[..., None]
    right, uphill, up = points[..., 0], (points - MIDDLE) @ UPHILL, (points - MIDDLE) @ UP
    on_road = (np.abs(up) < 1e-4) & (np.abs(right) < draw_scenes.ROAD_MM[0] / 2000)
    width_mm, length_mm = draw_scenes.ROAD_MM
    paint = np.zeros((length_mm, width_mm), np.uint8)
    cv2.fillPoly(paint, [np.array(draw_scenes.ARROW, np.int32) + draw_scenes.ARROW_AT], 1)
    x = np.clip(right * 1000 + width_mm / 2, 0, width_mm - 1).astype(int)
    y = np.clip((FAR_END_M - uphill) * 1000, 0, length_mm - 1).astype(int)
    flat = points - SIGN_M
    sign = (np.abs(flat @ UPHILL) < 1e-4) & (np.linalg.norm(flat, axis=-1) < 0.065)
    return Road(scene, on_road & (paint[y, x] == 1), sign, on_road)


def assert_figure_9(road: Road) -> None:
    gates = road.scene.gates
    for name, where in (("The arrow on the road", road.arrow), ("The stop sign", road.sign)):
        sloped = gates[name]
        upright = road.best_upright(sloped.exposure_us, where)
        assert road.seen(sloped, where) >= 0.98
        assert 0.2 < road.seen(upright, where) <= 0.7
    longer = gates["The stop sign, longer exposure: more of the road"]
    assert road.seen(longer, road.sign) >= 0.98
    assert road.seen(longer, road.road) > 3 * road.seen(gates["The stop sign"], road.road)


def test_a_sloped_gate_shows_arrow_and_sign_whole_and_no_upright_one_does() -> None:
    road = opened(320, 8)
    assert road.arrow.sum() > 500
    assert road.sign.sum() > 1500
    assert_figure_9(road)


@pytest.mark.slow
def test_figure_9_holds_at_the_cameras_full_resolution() -> None:
    assert_figure_9(opened(1600, 16))
