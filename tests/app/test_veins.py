"""The paper's figure 12 on the bench: veins of two arms at two tilts, each by its own pixel clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from arm_masks import ArmMasks, arm_masks, visibility, without_veins
from rigs import check_rig
from slopegate.app import api
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.measure.offset import offset_rows, place_in, with_offset
from slopegate.core.rig.settings import gate, quantise
from slopegate.core.scene.scene import Mesh
from slopegate.core.scene.shapes import turn


@dataclass(frozen=True, eq=False)
class Figure:
    """The shipped scene, the same arms without veins, and where these are."""

    arms: api.OpenScene
    bare: api.OpenScene
    masks: tuple[ArmMasks, ArmMasks]

    def seen(self, gate_: api.GateSettings, arm: int, colour: int = -1) -> float:
        return visibility(self.arms, self.bare, gate_, self.masks[arm], colour=colour)


@pytest.fixture(scope="module")
def figure() -> Figure:
    arms = api.open_scene("arms")
    return Figure(arms, without_veins(arms), (arm_masks(arms, 0), arm_masks(arms, 1)))


def test_each_clock_shows_the_veins_of_its_arm_and_full_light_hides_them(figure: Figure) -> None:
    upright, tilted, _ = figure.arms.gates.values()
    assert upright.line_time_us == pytest.approx(figure.arms.rig.camera.shutter.line.line_time_us(78.0))
    assert tilted.line_time_us == pytest.approx(figure.arms.rig.camera.shutter.line.line_time_us(74.0))
    lit = gate(upright.line_time_us, 0.0, figure.arms.period_us)
    for arm, own, other in ((0, upright, tilted), (1, tilted, upright)):
        shown, hidden, full = (figure.seen(g, arm) for g in (own, other, lit))
        assert shown > 0.15
        assert abs(shown / hidden) >= 1.3
        assert 0.0 < full < 0.02
        assert full < shown / 5


def test_in_red_alone_which_goes_deepest_the_gate_helps_too(figure: Figure) -> None:
    for arm, own in enumerate(list(figure.arms.gates.values())[:2]):
        lit = gate(own.line_time_us, 0.0, figure.arms.period_us)
        assert figure.seen(own, arm, colour=0) > 3 * figure.seen(lit, arm, colour=0)


def test_the_windows_stand_beside_the_row_that_lights_the_front_all_along_the_arm(figure: Figure) -> None:
    rig, rows = figure.arms.rig, figure.arms.buffers.projector_row
    for own, masks in zip(list(figure.arms.gates.values())[:2], figure.masks, strict=True):
        y, x = np.divmod(masks.front, rows.shape[1])
        for part in np.array_split(np.argsort(y), 6):
            box = (int(x[part].min()), int(y[part].min()), int(x[part].max()) + 1, int(y[part].min()) + 2)
            place = place_in(rig, rows, box)
            assert place is not None
            assert offset_rows(rig, own, place) == pytest.approx(8.0, abs=0.15)


def test_the_gate_is_bright_enough_to_be_told_from_the_noise(figure: Figure) -> None:
    for own, masks in zip(list(figure.arms.gates.values())[:2], figure.masks, strict=True):
        counts = figure.arms.frame(own, seed=3).ravel().astype(np.float64)
        bare = figure.bare.frame(own, seed=4).ravel().astype(np.float64)
        # The same pixels with and without veins: a hundred of them tell the two apart.
        apart = bare[masks.veins].mean() - counts[masks.veins].mean()
        assert apart > 5 * counts[masks.veins].std() / np.sqrt(100)


@pytest.mark.parametrize(("tilt_deg", "depth_m"), [(-14.0, 0.75), (25.0, 0.55)])
def test_another_arm_at_another_tilt_and_depth_shows_its_veins_by_the_gate_that_is_computed_for_it(
    tilt_deg: float, depth_m: float
) -> None:
    rig = check_rig(800)
    shipped = api.open_scene("arms").scene
    arm = shipped.objects[0]
    assert isinstance(arm, Mesh)
    place = np.array([0.03, 0.0, depth_m])
    turned = turn(tilt_deg=tilt_deg)
    moved = replace(arm, vertices=(arm.vertices - (-0.09, 0.0, 0.6)) @ turned.T + place)
    opened = api.OpenScene(rig, replace(shipped, objects=(moved,), gates=()))
    bare, masks = without_veins(opened), arm_masks(opened, 0)
    planned = plan_on_hardware(rig, tilt_deg, depth_m, 0.02).applied
    y, x = np.divmod(masks.front, rig.camera.lens.width)
    middle = int(np.median(y))
    lit_place = place_in(
        rig, opened.buffers.projector_row, (int(np.median(x)), middle, int(np.median(x)) + 2, middle + 2)
    )
    assert lit_place is not None

    def beside(line_time_us: float) -> api.GateSettings:
        asked = with_offset(rig, gate(line_time_us, 0.0, 213.0), lit_place, 8.0)
        return quantise(rig.camera.shutter, asked, rig.projector.period_us)

    upright = rig.camera.shutter.line.line_time_us(78.0)
    shown = visibility(opened, bare, beside(planned.line_time_us), masks)
    hidden = visibility(opened, bare, beside(upright), masks)
    full = visibility(opened, bare, gate(upright, 0.0, rig.projector.period_us), masks)
    assert shown > 0.12
    assert abs(shown / hidden) >= 1.3
    assert 0.0 < full < min(0.02, shown / 5)
