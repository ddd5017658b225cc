"""The bench of light transport, and noise by codes (the paper's figure 13). Run times are never looked at."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cli_calls import report
from slopegate.app.bench import transport
from slopegate.app.bench.transport import TransportBench, TransportSize, as_text, run_transport
from slopegate.app.bench.transport_noise import GainRow, gains
from slopegate.app.bench.transport_truth import TransportCase, impulse_light, make_case, shown
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.variants import binned_rig
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

TINY = TransportSize(25, (8, 8), 2, 3, 2)


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


@cache
def tiny() -> TransportBench:
    """Of the three targets."""
    rig, scene = open_scene(scene_path("three_targets"), load_rig(None))
    return run_transport([("three_targets", rig, scene)], TINY, lambda sentence: None)


def test_every_way_has_its_figures_and_codes_are_as_good_as_impulses() -> None:
    rows = {row.codes: row for row in tiny().rows}
    assert set(rows) == {"impulse", "hadamard", "s", "gray", "adaptive"}
    for row in rows.values():
        assert (row.scene, row.grid, row.width, row.height, row.slices) == ("three_targets", "8x8", 64, 48, 2)
        assert row.worst_db > 60
        assert row.noisy_db < row.relit_db
        assert row.kept_mb > 0
        assert row.peak_mb > row.kept_mb
    assert rows["gray"].frames < rows["hadamard"].frames < rows["s"].frames + 64
    assert rows["hadamard"].noisy_db > rows["impulse"].noisy_db + 3


def test_light_under_no_pattern_is_left_in_a_scene_that_was_shown_patterns() -> None:
    """Parts of the light are shared by the cameras of a case: each begins with everything lit."""
    found = case("foggy_room")
    again = [shown(found, found.pictures) for _ in range(2)]
    np.testing.assert_array_equal(again[0].lit, again[1].lit)
    np.testing.assert_array_equal(again[0].pictures, again[1].pictures)


def test_people_are_told_what_ways_there_are() -> None:
    text = as_text(tiny())
    for row in tiny().rows:
        assert f"\n{row.codes} " in text
    for row in tiny().gains[0].rows:
        assert f"\n{row.codes}, {row.regime} " in text


def test_the_command_leaves_and_prints_its_figures(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport, "QUICK", TINY)
    found = report(capsys, "bench", "--transport", "--quick", "--out", str(tmp_path / "out"))
    assert set(found) == {"machine", "rows", "gains"}
    assert {row["scene"] for row in found["rows"]} == {"three_targets"}
    assert json.loads((tmp_path / "out" / "transport.json").read_text("utf-8")) == found
