"""Subsurface light against plain sums, integrals and the laws that every gate keeps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.gating.gate import row_windows
from slopegate.core.light.kernels_subsurface import half_erf
from slopegate.core.light.subsurface import prepare_subsurface
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.materials import Skin, SkinLobe
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import Finish, plane, turn

RIG = check_rig(160)
T = RIG.projector.period_us
LOBES = (SkinLobe(0.8, (0.3, 0.2, 0.1)), SkinLobe(3.0, (0.4, 0.1, 0.05)))


def flat_scene(tilt_deg: float, size_m: float = 0.3, depth_m: float = 0.7) -> Scene:
    card = plane("card", (0.0, 0.0, depth_m), (size_m, size_m), turn(tilt_deg), Finish(material=Skin(LOBES)))
    return Scene("card", objects=(card,))


def at(rig: Rig, clock_mhz: float, delay_us: float, exposure_us: float) -> GateSettings:
    return gate(rig.camera.shutter.line.line_time_us(clock_mhz), delay_us, exposure_us)  # type: ignore[union-attr]


def image(part, rig: Rig, settings: GateSettings) -> Singles:
    lens = rig.camera.lens
    out = np.zeros((lens.height, lens.width, 3), np.float32)
    part.add(row_windows(rig, settings), out)
    return out


def test_half_erf_keeps_its_bound_rises_and_is_odd() -> None:
    x = np.linspace(-6, 6, 200_001).astype(np.float32)
    values = np.array([half_erf(value) for value in x])
    exact = np.array([0.5 * math.erf(float(value)) for value in x])
    assert np.abs(values - exact).max() < 4e-7
    assert (np.diff(values) >= 0).all()
    assert (values == -values[::-1]).all()


@pytest.mark.parametrize("clock", [70.0, 78.0, 90.0])
def test_gates_that_tile_a_period_add_up_to_the_fully_lit_light(clock: float) -> None:
    part = prepare_subsurface(RIG, flat_scene(25.0), "rgb")
    full = image(part, RIG, at(RIG, clock, 0.0, T))
    slices = [image(part, RIG, at(RIG, clock, (n + 0.5) * T / 23, T / 23)) for n in range(23)]
    assert full.max() > 0.5
    assert np.abs(np.sum(slices, axis=0) - full).max() < 1e-6 * 23
    assert np.abs(image(part, RIG, at(RIG, clock, 0.0, 2 * T)) - 2 * full).max() < 1e-6
    assert min(part.min() for part in slices) >= 0.0
