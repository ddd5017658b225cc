"""The gate that shows an object whole before its wall, against what the renderer sees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import bent, check_rig, turned
from slopegate.core.gating.gate import recorded_times, row_windows
from slopegate.core.gating.plan import every_line_time, gate_before_wall
from slopegate.core.render.render import render
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import LineTimes
from slopegate.core.scene.scene import Mesh, Scene
from slopegate.core.scene.shapes import Finish, plane, turn

WALL_Z_M = 1.6
IDEAL = check_rig(160)
RIGS = {
    "ideal": IDEAL,
    "free line time": check_rig(160, LineTimes(60.0, 900.0, 0.5)),
    "turned": turned(IDEAL, (2.0, -2.0, 1.5)),
    "distorted": bent(IDEAL),
}


def before_wall(corners: NDArray[np.float64]) -> Scene:
    """Triangles (N, 3, 3) before the wall."""
    faces = np.arange(len(corners) * 3, dtype=np.int32).reshape(-1, 3)
    wall = plane("wall", (0.0, 0.0, WALL_Z_M), (2.4, 2.0), turn(), Finish((0.5, 0.5, 0.5)))
    return Scene("object", objects=(Mesh("object", corners.reshape(-1, 3), faces), wall))


def seen_shares(name: str, corners: NDArray[np.float64]) -> tuple[float, float]:
    """Which shares of the lit pixels of the object and of the wall the gate records, over all of a pixel's area."""
    rig = RIGS[name]
    windows = row_windows(rig, gate_before_wall(rig, corners.reshape(-1, 3), WALL_Z_M))
    seen, counted = np.zeros(2), np.zeros(2)
    for offset in ((0.5, 0.5), (0.02, 0.02), (0.98, 0.98)):
        buffers = render(rig, before_wall(corners), offset=offset)
        rows = np.broadcast_to(np.arange(rig.camera.lens.height)[:, None], buffers.projector_row.shape)
        lit = buffers.projector_row >= 0
        recorded = recorded_times(windows, rows, buffers.projector_row) > 0
        nearer = buffers.inverse_depth > 1.001 / WALL_Z_M
        for index, kind in enumerate((nearer, ~nearer)):
            seen[index] += np.count_nonzero(recorded & lit & kind)
            counted[index] += np.count_nonzero(lit & kind)
    assert counted[0] > 20
    shares = seen / counted
    return float(shares[0]), float(shares[1])


def some_triangles(seed: int, size_m: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    middle = np.array([0.0, 0.0, 1.05]) + rng.uniform(-0.1, 0.1, (6, 1, 3))
    corners: NDArray[np.float64] = middle + rng.uniform(-size_m, size_m, (6, 3, 3))
    return corners


@given(st.integers(0, 10_000), st.floats(0.02, 0.2))
@example(0, 0.2)
@settings(max_examples=25)
def test_an_ideal_rig_shows_all_of_it_and_no_wall(seed: int, size_m: float) -> None:
    assert seen_shares("ideal", some_triangles(seed, size_m)) == (1.0, 0.0)


@pytest.mark.parametrize("name", list(RIGS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_rig_shows_all_of_it(name: str, seed: int) -> None:
    shown, wall = seen_shares(name, some_triangles(seed, 0.2))
    assert shown == 1.0
    assert wall < 0.05


def test_a_tilted_card_gets_the_thinnest_gate_of_all_clocks() -> None:
    """No other line time shows it whole with a shorter exposure, by brute force over what is rendered."""
    corners = np.array([[[-0.1, -0.15, 1.04], [0.1, -0.15, 1.04], [0.1, 0.15, 0.96]]])
    found = gate_before_wall(IDEAL, corners.reshape(-1, 3), WALL_Z_M)
    buffers = render(IDEAL, before_wall(corners))
    rows, _ = np.nonzero(object_pixels := (buffers.inverse_depth > 1.001 / WALL_Z_M) & (buffers.projector_row >= 0))
    lit_us = buffers.projector_row[object_pixels] / IDEAL.projector.rows_per_us
    # half a camera row and a projector row beyond the pixels' centres, at either edge
    margin_us = 2 / IDEAL.projector.rows_per_us
    whole = {line: float(np.ptp(lit_us - (rows + 0.5) * line)) + line + margin_us for line in every_line_time(IDEAL)}
    assert found.exposure_us == pytest.approx(min(whole.values()), abs=20)


def test_what_is_not_in_front_of_the_rig_is_refused() -> None:
    with pytest.raises(InputError, match="at least one point in front of the rig"):
        gate_before_wall(IDEAL, np.array([[0.0, 0.0, -1.0]]), WALL_Z_M)
