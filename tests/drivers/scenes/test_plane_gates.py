import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.gating.plan import gate_around
from slopegate.core.render.render import render
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.plane_gates import plane_gates
from slopegate.drivers.scenes.scene_files import open_scene

RIG = load_rig(None)


def test_a_gate_around_points_keeps_the_share_asked_for() -> None:
    rng = np.random.default_rng(3)
    rows = rng.integers(0, 1200, 20_000).astype(float)
    lit_rows = (rows + 0.5) * 0.55 + 40 + rng.normal(0, 3, rows.size)
    settings = gate_around(RIG, rows, lit_rows, 0.55 / RIG.projector.rows_per_us, keep=0.9)
    windows = row_windows(RIG, settings)
    counted = np.where((lit_rows >= windows.low[rows.astype(int)]) & (lit_rows < windows.high[rows.astype(int)]), 1, 0)
    assert 0.9 <= counted.mean() < 0.95
    with pytest.raises(ValueError, match="camera_rows is 0"):
        gate_around(RIG, rows[:0], lit_rows[:0], 13.0)


# Planes that lie across the scene, and how near they must be to count as standing on it.
@pytest.mark.parametrize(
    "name", ["floor_3bottles", "floor_bottles_chair", "five_people", "motorcycle", "osd_table_2cans", "redwood_chair"]
)
def test_the_main_plane_of_a_capture_is_offered_as_a_gate(name: str, shared: Callable[[str], Path]) -> None:
    folder = shared(f"data/scenes/{name}")
    rig, scene = open_scene(folder, RIG)
    only, rest = scene.gates[:2]
    assert only.name.startswith("Only plane 1")
    assert (only.complement, rest.complement) == (False, True)
    buffers = render(rig, scene)
    facts = json.loads((folder / "scene.json").read_text())["planes"][0]
    rows, columns = np.nonzero(buffers.projector_row >= 0)
    points = rig.camera_rays(columns + 0.5, rows + 0.5) / buffers.inverse_depth[rows, columns][:, None]
    away = np.abs(points @ np.array(facts["normal"]) + facts["distance_m"])
    recorded = weights(row_windows(rig, only.settings), buffers.projector_row)[rows, columns]
    assert recorded[away < 0.01].mean() > 0.97
    assert recorded[away > 0.15].mean() < 0.03


def test_planes_that_say_nothing_are_passed_over(shared: Callable[[str], Path]) -> None:
    rig, scene = open_scene(shared("data/scenes/floor_3bottles"), RIG)
    assert scene.capture is not None
    odd = [{}, 3, {"normal": [1, 0, 0], "distance_m": 1}, {"normal": [0, 0, 1], "distance_m": "near"}]
    assert plane_gates(odd, rig, scene.capture) == ()
    assert plane_gates("all of them", rig, scene.capture) == ()
