"""Rasters scanned upwards, against a slow reference that goes through the projector's rows one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inverse_depth_bounds import inverse_depth_bounds
from slopegate.core.gating.gate import discrete_weights, row_windows, slab, weights
from slopegate.core.gating.plan import plan
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, half_turned
from slopegate.core.rig.settings import GateSettings, LineTimes, ShutterLimits, Steps, gate
from slopegate.core.rig.variants import in_scan_order
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn

LIMITS = ShutterLimits(LineTimes(1.0, 2000.0, 0.1), Steps(-16667, 33334, 1), Steps(100, 50000, 1))
BENT = (-0.12, 0.05, 0.002, -0.003, 0.01)
WAYS = [(camera, projector) for camera in (False, True) for projector in (False, True)]


def as_described(distortion: tuple[float, ...] = BENT, turned: float = 0.03) -> Rig:
    """A rig as a file describes it, seen upright: the projector is above, slightly turned."""
    camera = Lens(40, 30, 41.0, 42.0, 19.0, 16.0, distortion)
    projector = Lens(64, 36, 50.0, 51.0, 30.0, 20.0, distortion)
    rotation = cv2.Rodrigues(np.array([turned, -turned / 2, turned / 3]))[0]
    matrix = tuple(tuple(float(value) for value in row) for row in rotation)
    return Rig(RigCamera(camera, LIMITS), RigProjector(projector, 16_000.0, 0.9), (0.004, -0.1, 0.003), matrix)  # type: ignore[arg-type]


class Slow:
    """What the described rig records, from its picture's own rows and a loop over those of the projector."""

    def __init__(self, rig: Rig, camera_up: bool, projector_up: bool) -> None:
        self.rig, self.camera_up, self.projector_up = rig, camera_up, projector_up

    def exposed_us(self, made: GateSettings, row: int) -> tuple[float, float]:
        """When the picture's row is exposed: reading begins at the bottom or at the top."""
        place = self.rig.camera.lens.height - row - 0.5 if self.camera_up else row + 0.5
        centre = made.delay_us + place * made.line_time_us
        return centre - made.exposure_us / 2, centre + made.exposure_us / 2

    def row_weights(self, made: GateSettings, row: int) -> Doubles:
        """Weight of each of the projector's rows, whose light comes while the row is drawn, in every period."""
        projector = self.rig.projector
        start, end = self.exposed_us(made, row)
        found = np.zeros(projector.lens.height)
        for drawn in range(projector.lens.height):
            place = projector.lens.height - 1 - drawn if self.projector_up else drawn
            for period in range(-6, 7):
                on = place / projector.rows_per_us + period * projector.period_us
                off = (place + 1) / projector.rows_per_us + period * projector.period_us
                found[drawn] += max(0.0, min(end, off) - max(start, on)) * projector.rows_per_us
        return found

    def times_recorded(self, made: GateSettings, row: int, projector_row: float) -> int:
        """How often a point that this row coordinate lights is recorded: it shines at an instant of every period."""
        projector = self.rig.projector
        place = projector.lens.height - projector_row if self.projector_up else projector_row
        start, end = self.exposed_us(made, row)
        instants = place / projector.rows_per_us + np.arange(-6, 7) * projector.period_us
        return int(((instants >= start) & (instants < end)).sum())


def picture(array: Doubles, camera_up: bool) -> Doubles:
    """From the order of reading to the described picture."""
    return array[::-1, ::-1] if camera_up else array


some_gates = st.builds(gate, st.floats(50.0, 900.0), st.floats(-8_000.0, 16_000.0), st.floats(100.0, 30_000.0))


@settings(max_examples=25)
@given(made=some_gates, way=st.sampled_from(WAYS))
def test_whole_rows_weigh_what_the_loop_over_the_projectors_rows_says(
    made: GateSettings, way: tuple[bool, bool]
) -> None:
    described = as_described()
    slow, rig = Slow(described, *way), in_scan_order(described, *way)
    height_c, height_p = described.camera.lens.height, described.projector.lens.height
    for row in range(0, height_c, 7):
        read = height_c - 1 - row if way[0] else row
        drawn = np.arange(height_p)
        place = height_p - 1 - drawn if way[1] else drawn
        np.testing.assert_allclose(discrete_weights(rig, made, read, place), slow.row_weights(made, row), atol=1e-9)


SCENE = Scene(
    "corner",
    objects=(
        plane("wall", (0.0, 0.0, 1.6), (3.0, 3.0), turn(10.0, 15.0)),
        plane("card", (-0.15, 0.1, 1.0), (0.3, 0.3), turn(-20.0)),
        Sphere("ball", (0.15, -0.05, 0.9), 0.12),
    ),
)


def turned_scene(scene: Scene) -> Scene:
    """The same things in axes turned by half a turn about z."""
    turned = []
    for thing in scene.objects:
        if isinstance(thing, Sphere):
            x, y, z = thing.centre_m
            turned.append(replace(thing, centre_m=(-x, -y, z)))
        else:
            turned.append(replace(thing, vertices=thing.vertices * (-1.0, -1.0, 1.0)))
    return replace(scene, objects=tuple(turned))


@pytest.mark.parametrize("way", WAYS)
def test_rendered_light_and_gated_pictures_are_those_of_the_loop(way: tuple[bool, bool]) -> None:
    """The projector's row of every pixel, its light, and how often a gate records it."""
    described = as_described()
    slow, rig = Slow(described, *way), in_scan_order(described, *way)
    upright = render(described, SCENE)
    buffers = render(rig, turned_scene(SCENE) if way[0] else SCENE)
    height = described.projector.lens.height
    rows = picture(buffers.projector_row.astype(np.float64), way[0])
    lit, expected = rows >= 0, upright.projector_row >= 0
    assert (lit != expected).sum() <= 3, "but for rounding at the edges of shadows"
    both = lit & expected
    assert both.mean() > 0.4
    drawn = height - rows if way[1] else rows
    np.testing.assert_allclose(drawn[both], upright.projector_row[both], atol=2e-3)
    direct = picture(buffers.direct[..., 0], way[0])
    np.testing.assert_allclose(direct[both], upright.direct[..., 0][both], rtol=1e-3)
    made = gate(420.0, 500.0, 1800.0)
    recorded = picture(weights(row_windows(rig, made), buffers.projector_row), way[0])
    looped = np.array(
        [
            [slow.times_recorded(made, row, value) if value >= 0 else 0 for value in line]
            for row, line in enumerate(upright.projector_row.astype(np.float64))
        ]
    )
    assert (recorded != looped).mean() < 0.01, "but for rounding at the gate's edges"
    assert 0.05 < (looped > 0).mean() < 0.95


@pytest.mark.parametrize("way", WAYS)
def test_bounds_and_row_windows_agree(way: tuple[bool, bool]) -> None:
    rig = in_scan_order(as_described(()), *way)
    made = gate(400.0, 800.0, 900.0)
    low, high = inverse_depth_bounds(rig, made)
    columns, rows = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    rays = rig.camera_rays(columns, rows)
    for w in np.linspace(0.3, 2.5, 23):
        _, projector_row, _ = rig.to_projector(rig.camera_centre_m + rays / w)
        projector_row = np.where(np.abs(projector_row - 18) <= 18, projector_row, -1.0)
        counts = weights(row_windows(rig, made), projector_row)
        near_edge = np.minimum(np.abs(low - w), np.abs(high - w)) < 1e-9
        np.testing.assert_array_equal(((low <= w) & (w < high))[~near_edge], (counts > 0)[~near_edge])


def test_half_a_turn_of_a_lens_with_every_distortion() -> None:
    whole = (-0.1, 0.05, 0.002, -0.003, 0.01, 0.02, -0.01, 0.003, 0.004, -0.001, 0.002, 0.003, 0.02, -0.03)
    for count in (0, 4, 5, 8, 12, 14):
        lens = Lens(640, 480, 500.0, 510.0, 300.0, 250.0, whole[:count])
        x, y = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 7))
        column, row = lens.project(x, y)
        turned_column, turned_row = half_turned(lens).project(-x, -y)
        np.testing.assert_allclose(turned_column, lens.width - column, atol=1e-9)
        np.testing.assert_allclose(turned_row, lens.height - row, atol=1e-9)
        assert half_turned(half_turned(lens)) == lens


@given(tilt=st.floats(-60, 60), distance=st.floats(0.5, 4), thickness=st.floats(0.02, 0.2))
def test_a_rig_that_hangs_upside_down_makes_the_same_slabs(tilt: float, distance: float, thickness: float) -> None:
    """Both scan upwards: tilts are turned with the axes, distances and delays stay."""
    upright = as_described((), 0.0)
    upright = replace(upright, projector_offset_m=(0.0, -0.1, 0.0))
    hanging = in_scan_order(upright, True, True)
    assert not hanging.is_opposed
    assert hanging.projector_offset_m == (0.0, 0.1, 0.0)
    made = plan(upright, tilt, distance, thickness)
    other = plan(hanging, -tilt, distance, thickness)
    shift_us = upright.projector.lens.height / upright.projector.rows_per_us
    shift_us -= upright.camera.lens.height * made.line_time_us
    assert other.line_time_us == pytest.approx(made.line_time_us, rel=1e-9)
    assert other.exposure_us == pytest.approx(made.exposure_us, rel=1e-9)
    # what was read first is read last: the whole pass, seen from its other end
    assert float(other.delay_us) == pytest.approx(shift_us - float(made.delay_us), abs=1e-6)
    found = slab(hanging, other)
    assert found.tilt_deg == pytest.approx(-tilt, abs=1e-7)
    assert found.distance_m == pytest.approx(distance, rel=1e-9)
    assert found.thickness_m == pytest.approx(thickness, rel=1e-9)
    assert math.copysign(1, found.centre.normal[2]) == math.copysign(1, found.centre.A)


def test_opposed_rasters_are_told_and_their_upright_slabs_refused() -> None:
    for way in ((True, False), (False, True)):
        opposed = in_scan_order(as_described((), 0.0), *way)
        assert opposed.is_opposed
        assert any("the other way" in warning for warning in slab(opposed, gate(300.0, 900.0, 400.0)).warnings)
        with pytest.raises(
            ValueError, match="the projector draws its rows the other way than the camera reads its own"
        ):
            plan(opposed, 10.0, 1.0, 0.1)
    assert not any("the other way" in warning for warning in slab(as_described(), gate(300.0, 900.0, 400.0)).warnings)
