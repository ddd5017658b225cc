"""The bench of light transport, and noise by codes (the paper's figure 13). Run times are never looked at."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from slopegate.app.bench.transport_noise import GainRow, gains
from slopegate.app.bench.transport_truth import TransportCase, impulse_light, make_case
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.variants import binned_rig
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path


@cache
def case(name: str, binning: int = 25) -> TransportCase:
    rig, scene = open_scene(scene_path(name), binned_rig(load_rig(None), binning))
    return make_case(name, rig, scene, (8, 4), 2, 3)


@cache
def fog_gains() -> dict[tuple[str, str, str], GainRow]:
    """Figure 13: the Cornell box in fog, every code against impulses in as many frames."""
    found = case("cornell_fog")
    grid = BlockGrid(found.grid.raster, 8, 8)
    rows = gains(impulse_light(found, grid), grid, ("hadamard", "s"), 6, 4)
    return {(row.codes, row.regime, row.use): row for row in rows}


def test_codes_gain_in_noise_what_theory_says() -> None:
    rows = fog_gains()
    assert len(rows) == 12
    for row in rows.values():
        assert row.measured == pytest.approx(row.theory, rel=0.05), row
    assert rows["hadamard", "read", "column"].theory == pytest.approx(np.sqrt(64) / 2)
    assert rows["hadamard", "read", "floodlit"].theory == pytest.approx(np.sqrt(64))
    assert rows["hadamard", "shot", "floodlit"].theory == pytest.approx(1)


def test_impulses_gain_nothing_over_themselves() -> None:
    light = np.random.default_rng(3).uniform(0, 900, (16, 2000))
    found = gains(light, BlockGrid(case("three_targets").grid.raster, 4, 4), ("impulse",), 4, 1)
    for row in found:
        assert row.theory == 1
        assert row.measured == pytest.approx(1, rel=0.03)


def test_what_blocks_alone_bring_adds_up_to_all_of_them() -> None:
    found = case("three_targets")
    one, four = (impulse_light(found, BlockGrid(found.grid.raster, *size)) for size in ((1, 1), (4, 4)))
    # rounded to whole counts, once for every block and slice
    np.testing.assert_allclose(four.sum(axis=0), one.sum(axis=0), atol=2 * 34)
