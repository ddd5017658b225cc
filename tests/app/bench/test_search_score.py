"""Scores: what counts as found, isolated and findable, on cases whose answer is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from search_card import search_card
from slopegate.app.bench.search_cases import Case, binned, make_cases, material
from slopegate.app.bench.search_score import best_gate, overlap, run, score, summary
from slopegate.core.gating.plan import plan
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig


@pytest.fixture(scope="module")
def case() -> Case:
    card = search_card(30.0, 0.8)
    nothing = np.zeros_like(card.truth)
    return Case(0, "posed", "card", card.rig, card.buffers, card.target, card.truth, nothing, 30.0, 0.8, 1)


def test_both_methods_are_scored(case: Case) -> None:
    fast, paper = score(case)
    assert (fast.method, paper.method) == ("fast", "paper")
    assert fast.findable
    assert fast.right
    assert fast.covers
    assert not fast.wrong
    assert fast.iou > 0.9
    assert fast.frames < paper.frames
    assert fast.best_iou == paper.best_iou > 0.9


def test_overlap_of_everything_and_of_nothing(case: Case) -> None:
    period = case.rig.projector.period_us
    line = case.rig.camera.shutter.line.nearest(32.0)
    whole, inside, covered = overlap(case, gate(line, 0.0, period))
    lit = case.lit
    assert covered == 1.0
    assert whole == pytest.approx((case.truth & lit).sum() / lit.sum())
    assert whole < inside < 1.0
    far = plan(case.rig, 0.0, 40.0, 1.0)
    assert overlap(case, far) == (0.0, 0.0, 0.0)


def test_no_gate_does_better_than_the_best(case: Case) -> None:
    best = best_gate(case)
    assert best > 0.95
    for tilt_deg, thickness_m in ((30.0, 0.1), (30.0, 2.0), (0.0, 0.1), (-20.0, 0.4)):
        assert overlap(case, plan(case.rig, tilt_deg, 0.8, thickness_m))[0] <= best


def test_ignored_pixels_count_neither_way(case: Case) -> None:
    wide = gate(case.rig.camera.shutter.line.nearest(32.0), 0.0, case.rig.projector.period_us)
    free = replace(case, ignored=case.lit & ~case.truth)
    assert overlap(free, wide) == (1.0, 1.0, 1.0)


def test_a_target_in_the_dark_is_not_findable(case: Case) -> None:
    row = case.buffers.projector_row.copy()
    direct = case.buffers.direct.copy()
    row[case.truth], direct[case.truth] = -1, 0
    hidden = replace(case, buffers=replace(case.buffers, projector_row=row, direct=direct))
    for result in score(hidden):
        assert not result.findable
        assert result.why_not == "out of the projector's light"
        assert not result.right


def test_seeded_cases_repeat_and_grow() -> None:
    one, two = list(make_cases(1, 3)), list(make_cases(2, 3))
    assert one[0].name == two[0].name
    assert np.array_equal(one[0].truth, two[0].truth)
    assert two[0].name != two[1].name
    assert one[0].truth.any()
    x0, y0, x1, y1 = one[0].target
    assert not np.delete(one[0].truth, np.s_[y0:y1], axis=0).any()
    assert not np.delete(one[0].truth, np.s_[x0:x1], axis=1).any()
    assert material().pictures


def test_the_report_is_written_and_says_how_it_was_made(tmp_path: Path) -> None:
    out = tmp_path / "search.json"
    said: list[str] = []
    report = run(1, 3, out, said.append)
    assert json.loads(out.read_text(encoding="utf-8")) == report
    assert said == ["1 of 1"]
    assert (report["cases"], report["seed"], len(report["results"])) == (1, 3, 2)
    assert report["summary"]["fast"]["cases"] == 1


def test_a_summary_of_nothing_has_no_medians() -> None:
    table = summary([])
    assert table["fast"]["median_frames"] is None
    assert table["both_cover"] == 0


def test_binning_keeps_the_geometry() -> None:
    rig = load_rig(None)
    small = binned(rig, 2)
    point = np.array([[0.1, 0.2, 1.3]])
    full, half = rig.to_camera(point), small.to_camera(point)
    assert half[1] == pytest.approx(full[1] / 2)
    line, small_line = rig.camera.shutter.line, small.camera.shutter.line
    assert small_line.line_time_us(60.0) == pytest.approx(2 * line.line_time_us(60.0))  # type: ignore[union-attr]
