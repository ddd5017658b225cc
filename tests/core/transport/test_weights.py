"""The fully lit image from slices, by every weighting, upright and sloped: the paper's figure 14."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from rigs import check_rig, shutter
from seen_slices import seen_slices
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import complement, upright_line_time
from slopegate.core.gating.slices import at_delays, occupied_times, tile_times
from slopegate.core.render.render import Buffers, render
from slopegate.core.rig.axis import infinity_us
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.settings import GateSettings, LineTimes, Steps
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.core.transport.sliced import SliceTransport
from slopegate.core.transport.weights import WEIGHTINGS, Weighting, agreement, floodlit, slice_weights
from slopegate.drivers.scenes.mesh_files import Placement, read_mesh

RIG = check_rig(96, exposure=Steps(1.0, 50000.0, 1.0))
GRID = BlockGrid(Raster(1280, 720), 4, 4)
CLOCKS = (78, 76, 80)


def line_time(clock_mhz: float) -> float:
    return RIG.camera.shutter.line.nearest(upright_line_time(RIG) * 78 / clock_mhz)


def wall_and_card() -> Buffers:
    card = plane("card", (0.05, 0.0, 0.8), (0.3, 0.3), turn(30.0, 20.0))
    return render(RIG, Scene("two", objects=(card, plane("wall", (0.0, 0.0, 1.3), (3.0, 3.0), turn()))))


@pytest.fixture(scope="module")
def seen() -> Buffers:
    return wall_and_card()


def tiling(buffers: Buffers, clock_mhz: float, count: int) -> tuple[GateSettings, ...]:
    """Slices that share edges and cover all that is lit."""
    first, last = occupied_times(RIG, line_time(clock_mhz), buffers.projector_row) or (0.0, 0.0)
    return tile_times(RIG, line_time(clock_mhz), first - 1, last + 1, count)


@pytest.mark.parametrize("clock_mhz", CLOCKS)
@pytest.mark.parametrize("weighting", ["tiling", "least-squares"])
def test_tiles_add_up_upright_and_sloped(seen: Buffers, clock_mhz: float, weighting: Weighting) -> None:
    gates = tiling(seen, clock_mhz, 7)
    slices = seen_slices(RIG, seen, gates, GRID)
    found = floodlit(slices, slice_weights(weighting, RIG, slices, gates))
    assert agreement(found, mono(seen.direct)).psnr_db > 120


def test_gates_that_overlap_are_weighted_by_least_squares(seen: Buffers) -> None:
    """Every place is in two or three of these gates: no weights of 1 will do, and some weights do exactly."""
    line = line_time(78)
    first, last = occupied_times(RIG, line, seen.projector_row) or (0.0, 0.0)
    width = 2 * math.ceil((last - first) / 8)
    delays = [first + width * (0.5 * k) for k in range(-1, 20)]
    gates = at_delays(RIG, line, width, delays)
    slices = seen_slices(RIG, seen, gates, GRID)
    white = mono(seen.direct)
    weights = slice_weights("least-squares", RIG, slices, gates)
    assert agreement(floodlit(slices, np.ones(len(gates))), white).psnr_db < 10
    assert agreement(floodlit(slices, weights), white).psnr_db > 100
    assert weights.min() >= 0


def test_equal_gates_share(seen: Buffers) -> None:
    gates = tiling(seen, 78, 3)
    twice = (*gates, *gates)
    weights = slice_weights("least-squares", RIG, seen_slices(RIG, seen, twice, GRID), twice)
    assert weights == pytest.approx(np.full(6, 0.5), abs=1e-6)


def test_no_weight_is_negative_where_one_would_fit_better(seen: Buffers) -> None:
    """Of a gate, a part of it and the rest of a period: the best without a bound takes the part twice."""
    tile = tiling(seen, 78, 3)
    gates = (tile[0], tile[1], complement(tile[2], RIG.projector.period_us))
    weights = slice_weights("least-squares", RIG, seen_slices(RIG, seen, gates, GRID), gates)
    assert weights.min() >= 0
    assert weights == pytest.approx([0, 0, 1], abs=1e-6)


def test_the_papers_weights_are_its_formula() -> None:
    """For the paper's own rig (v_c = v_p, f_c = f_p, c_c = c_p): b f / t_d^2, whatever the scale."""
    lens = replace(RIG.projector.lens, width=96, height=72, fx=100.0, fy=100.0, cx=48.0, cy=36.0)
    projector = replace(RIG.projector, lens=lens)
    camera = replace(RIG.camera, lens=lens, shutter=shutter(LineTimes(1 / projector.rows_per_us, 500.0, 1.0)))
    rig = replace(RIG, camera=camera, projector=projector)
    gates = at_delays(rig, 1 / projector.rows_per_us, 100.0, [400.0, 800.0, 1600.0])
    slices = [SliceTransport(np.ones((72, 96), np.float32), ()) for _ in gates]
    expected = np.array([1 / settings.delay_us**2 for settings in gates])
    found = slice_weights("paper", rig, slices, gates)
    assert found == pytest.approx(expected * 3 / expected.sum(), rel=1e-9)


def test_the_papers_weights_keep_the_light(seen: Buffers) -> None:
    gates = tiling(seen, 76, 9)
    slices = seen_slices(RIG, seen, gates, GRID)
    found = floodlit(slices, slice_weights("paper", RIG, slices, gates))
    assert found.sum(dtype=np.float64) == pytest.approx(mono(seen.direct).sum(dtype=np.float64), rel=1e-6)


def test_a_slice_beyond_infinity_has_no_weight_of_the_paper() -> None:
    gates = at_delays(RIG, line_time(78), 100.0, [float(infinity_us(RIG, line_time(78))) - 90])
    with pytest.raises(InputError, match="slice 0"):
        slice_weights("paper", RIG, [SliceTransport(np.ones((72, 96), np.float32), ())], gates)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_a_camera_without_a_gate_has_one_slice_of_weight_1(weighting: Weighting) -> None:
    slices = [SliceTransport(np.ones((72, 96), np.float32), ())]
    assert slice_weights(weighting, RIG, slices, [None]).tolist() == [1]


def test_slices_without_light_have_no_least_squares() -> None:
    gates = at_delays(RIG, line_time(78), 100.0, [2000.0])
    with pytest.raises(InputError, match="without light"):
        slice_weights("least-squares", RIG, [SliceTransport(np.zeros((72, 96), np.float32), ())], gates)


def test_an_unknown_weighting_is_refused() -> None:
    with pytest.raises(InputError, match="tiling, least-squares, paper"):
        slice_weights("best", RIG, [], [])  # type: ignore[arg-type]


FIGURES = [("bunny_6k.obj", "y"), ("lucy_winged_angel_30k.ply", "z")]


@pytest.mark.parametrize("clock_mhz", CLOCKS)
@pytest.mark.parametrize(("name", "up"), FIGURES)
def test_figure_14(
    shared: Callable[[str], Path],
    name: str,
    up: Literal["y", "z"],
    clock_mhz: float,
) -> None:
    """30 delays, 4 x 4 blocks: the plain sum reaches 60 dB and far more. The paper's weights are printed, no target:
    it states 32.4 dB, 0.981 (bunny) and 24.8 dB, 0.974 (a winged figure)."""
    figure, _ = read_mesh(shared(f"data/meshes/{name}"), Placement((0.0, 0.0, 1.0), up=up, fit_height_m=0.6))
    seen = render(RIG, Scene(name, objects=(*figure, plane("wall", (0.0, 0.0, 1.4), (3.0, 3.0), turn()))))
    gates = tiling(seen, clock_mhz, 30)
    slices = seen_slices(RIG, seen, gates, GRID)
    white = mono(seen.direct)
    found = {
        weighting: agreement(floodlit(slices, slice_weights(weighting, RIG, slices, gates)), white)
        for weighting in WEIGHTINGS
    }
    for weighting, value in found.items():
        print(f"{name} at {clock_mhz:g} MHz, {weighting}: {value.psnr_db:.1f} dB, SSIM {value.ssim:.3f}")
    assert found["tiling"].psnr_db >= 60
    assert found["least-squares"].psnr_db >= 60
    assert found["tiling"].ssim > 0.9999
