"""The bench as a whole: its figures, its files, its guard. Run times are never looked at, errors are."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtGui import QImage

from slopegate.app.bench import check, noise, peer, session
from slopegate.app.bench.measure import TimedCall, peak_bytes, time_all
from slopegate.app.bench.picture import save_picture
from slopegate.app.bench.report import as_csv, as_markdown, as_text, number
from slopegate.app.bench.results import WaySummary, judge, pareto, summarise
from slopegate.app.bench.run import QUICK, RunSize, measure
from slopegate.app.bench.session import QUICK_SCENES, Bench
from slopegate.app.bench.subject import Subject, make_subject, scaled_rig
from slopegate.app.cli import main
from slopegate.core.exposure.sensor import SensorModel
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path, shipped_scenes

BASELINE = Path(__file__).resolve().parents[3] / "resources" / "bench" / "baseline.json"
Capture = pytest.CaptureFixture[str]
TINY = RunSize(
    width=96,
    pixels=400,
    samples=4,
    sub_rows=(2,),
    cast_rays=(2,),
    fast_repeats=1,
    slow_repeats=1,
    mpixels=(0.01, 0.04),
    objects=(1, 10),
    noise_frames=2,
    peer=(48, (1,), 1),
)


def quiet(_: str) -> None:
    pass


@cache
def tiny_bench() -> Bench:
    return session.run(["three_targets"], replace(TINY, peer=(0, (), 1)), quiet)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(peer, "why_not", lambda subject: "no peer: none wanted")
    monkeypatch.setattr(session, "_peer_rows", lambda *_: ([], ["no peer: none wanted"]))
    return tiny_bench()


def small_subject(width: int = 96) -> Subject:
    rig, scene = open_scene(scene_path("three_targets"), scaled_rig(load_rig(None), width))
    return make_subject("three_targets", rig, scene)


def summary(name: str, cost: float, gate: float | None, area: float | None, default: bool = False) -> WaySummary:
    return WaySummary("g", name, default, 1, cost, cost, cost, cost, gate, gate, gate, gate, area, area, area, 1.0)


@pytest.mark.parametrize("scenes", [QUICK_SCENES[:1], pytest.param(QUICK_SCENES, marks=pytest.mark.slow)])
def test_no_error_is_worse_than_the_committed_baseline(scenes: tuple[str, ...]) -> None:
    """The deterministic half of the regression guard: a quick run's errors, without its clocks; what other tests of
    this process leave in memory is not its business either."""
    found = session.errors_only(scenes, QUICK, quiet)
    figures = check.load_baseline(BASELINE)
    measured = {name: item for name, item in figures.items() if name.split(":")[0] in (*scenes, "noise")}
    before = {name: {k: v for k, v in item.items() if k != "memory_mb"} for name, item in measured.items()}
    compared = [name for name in check.baseline(found)["figures"] if name in before]
    assert len(compared) >= 15 * len(scenes)
    assert check.worse(found, before) == []


def test_the_committed_baseline_names_the_default_and_its_error() -> None:
    figures = check.load_baseline(BASELINE)["three_targets: cached float32 rows, hard edges"]
    assert figures["gate_edge_counts"] + figures["gate_level_counts"] < 0.5
    assert figures["ratio"] > 0


def test_an_error_that_grew_is_told(bench: Bench) -> None:
    before = check.baseline(bench)["figures"]
    assert check.worse(bench, before) == []
    name = "three_targets: trapezoid"
    smaller = before | {name: before[name] | {"area_rms_counts": before[name]["area_rms_counts"] / 2}}
    (said,) = check.worse(bench, smaller)
    assert said.startswith(f"{name}: area_rms_counts was ")
    faster = before | {name: before[name] | {"ratio": before[name]["ratio"] / 2}}
    assert [line.split(" was")[0] for line in check.worse(bench, faster)] == [f"{name}: ratio"]
    assert check.worse(bench, faster, bench) != []
    quiet_rows = [
        row if row.cost is None else replace(row, cost=replace(row.cost, quiet_ratio=0.0)) for row in bench.rows
    ]
    assert check.worse(bench, faster, replace(bench, rows=quiet_rows)) == [], "slow once is not slow"
    assert check.worse(bench, smaller, replace(bench, rows=quiet_rows)) == [said]
    (gone,) = check.worse(bench, before | {"door: something": {"ratio": 1.0}})
    assert gone == "door: something: no longer measured"


def test_a_baseline_without_clocks_says_nothing_of_time(bench: Bench) -> None:
    before = check.baseline(bench)["figures"]
    timeless = {name: {k: v for k, v in item.items() if k != "ratio"} for name, item in before.items()}
    assert check.worse(bench, timeless) == []


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"figures": 3}', '{"figures": {"a": 1}}'])
def test_a_file_that_is_no_baseline_is_refused(tmp_path: Path, text: str, capsys: Capture) -> None:
    path = tmp_path / "b.json"
    path.write_text(text)
    assert main(["bench", "--check", str(path)]) == 2
    assert "is no baseline of the bench" in capsys.readouterr().err


def test_rows_have_every_figure(bench: Bench) -> None:
    assert {row.group for row in bench.rows} >= {"default", "number type", "gate edges", "ray casting", "baseline"}
    for row in bench.rows:
        assert row.cost is not None, row.name
        assert 0 < row.cost.low_ms <= row.cost.core_ms <= row.cost.high_ms, row.name
        assert row.memory_mb > 0, row.name
        assert (row.gate is not None) or (row.area is not None), row.name
        assert row.area is not None
        assert 0 <= row.area.rms_counts <= row.area.max_counts
    slow = next(row for row in bench.rows if row.name == "row by row")
    default = next(row for row in bench.rows if row.default)
    assert slow.gate is not None
    assert default.gate is not None
    assert slow.gate.counts > 1000 * default.gate.counts


def test_one_row_is_measured_for_each_size(bench: Bench) -> None:
    assert [round(step.mpixels, 2) for step in bench.resolutions] == [0.01, 0.04]
    assert [step.size for step in bench.objects] == [1, 10]
    assert set(bench.exponents) == {"megapixels", "objects"}
    assert all(math.isfinite(power) for powers in bench.exponents.values() for power in powers.values())
    assert [pair.name for pair in bench.threads][:2] == ["frame, 1 thread", "frame, 2 threads"]
    assert len(bench.skipping) == 2 * 10 + 2 * 3
    assert bench.skipping[0].times == 1


def test_errors_are_the_same_on_every_run() -> None:
    subject = small_subject()
    once, again = (measure(subject, TINY, False, quiet) for _ in range(2))
    assert [(row.gate, row.area) for row in once] == [(row.gate, row.area) for row in again]
    assert all(row.cost is None for row in once)


def test_without_skipping_errors_are_the_same(bench: Bench) -> None:
    rows = measure(small_subject(), replace(TINY, skip=False), False, quiet)
    for row, other in zip(rows, bench.rows, strict=True):
        assert row.name == other.name
        assert row.gate == other.gate, row.name


def test_the_front_holds_what_nothing_beats() -> None:
    points = [(1.0, 9.0), (2.0, 3.0), (2.0, 4.0), (3.0, 3.0), (5.0, 1.0), (5.0, 1.0)]
    assert pareto(points) == [True, True, False, False, True, True]


def test_the_cheapest_good_one_is_chosen() -> None:
    found = judge(
        [
            summary("quick and wrong", 1, 30, 30),
            summary("right", 2, 0.3, 20, default=True),
            summary("exact", 3, 0.01, 20),
            summary("row by row", 4000, 900, 25),
        ]
    )
    assert (found.cheapest, found.default) == ("right", "right")
    assert found.on_gate_front
    assert found.on_area_front
    assert found.row_by_row_times == 2000
    worse = judge([summary("right", 2, 0.3, 20), summary("default", 3, 0.3, 20, default=True)])
    assert worse.cheapest == "right"
    assert not worse.on_gate_front
    assert not worse.on_area_front


def test_scenes_are_put_together(bench: Bench) -> None:
    rows = [replace(bench.rows[0], scene="a"), replace(bench.rows[0], scene="b", memory_mb=1e6)]
    (found,) = summarise(rows)
    cost = bench.rows[0].cost
    assert cost is not None
    assert found.scenes == 2
    assert found.core_ms_per_mpixel == pytest.approx(cost.core_ms_per_mpixel)
    assert found.memory_mb == 1e6


def test_text_names_every_way_and_the_machine(bench: Bench) -> None:
    text, markdown = as_text(bench), as_markdown(bench)
    for row in bench.rows:
        assert row.name in text
        assert row.name in markdown
    assert str(bench.machine["processor"]) in text
    assert "no peer: none wanted" in text
    for choice in ("Ramps cost", "One thread:", "Pooled noise:"):
        assert choice in text
        assert choice in markdown
    assert "times faster than the row-by-row simulation" in markdown
    lines = as_csv(bench.rows).splitlines()
    assert len(lines) == len(bench.rows) + 1
    assert "cost_core_ms" in lines[0]


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0"), (1234.5, "1,234"), (12.345, "12.3"), (0.0123, "0.0123"), (1.2e-5, "1.2e-05"), (3, "3")],
)
def test_numbers_are_readable(value: float | None, text: str) -> None:
    assert number(value) == text


def test_the_picture_shows_points_and_the_front(bench: Bench, tmp_path: Path, qapp: Any) -> None:
    path = tmp_path / "p.png"
    save_picture(path, bench.summaries, "this machine")
    image = QImage(str(path))
    assert image.width() >= 1000
    colours = [image.pixelColor(x, y).name() for x in range(image.width()) for y in range(60, 560)]
    for colour in ("#c2410c", "#1d4ed8", "#047857", "#4b5563"):
        assert colours.count(colour) > 30, colour
    save_picture(path, [item for item in bench.summaries if item.group != "gate edges"], "")
    image = QImage(str(path))
    left = [image.pixelColor(x, y).name() for x in range(image.width()) for y in range(60, 560)]
    assert left.count("#047857") == 0
    with pytest.raises(StorageError, match=r"p\.png cannot be written"):
        save_picture(tmp_path / "none" / "p.png", bench.summaries, "")


def test_time_and_memory_are_those_of_the_call() -> None:
    calls: list[str] = []
    timings = time_all([TimedCall(lambda: calls.append("a"), 0.5, 3), TimedCall(lambda: calls.append("b"), 1, 1)])
    assert calls == ["a", "b", "a", "b", "a", "a"]
    assert [timing.repeats for timing in timings] == [3, 1]
    assert peak_bytes(lambda: np.ones(1_000_000)) == pytest.approx(8e6, rel=0.01)


def test_noise_is_judged_by_the_exact_distribution() -> None:
    sensor = SensorModel()
    for level in noise.LEVELS:
        reach = round(12 * math.sqrt(level / 2 + 16))
        span = np.arange(round(level + sensor.black_count) - reach, round(level + sensor.black_count) + reach)
        below = noise.cumulative(span, level, sensor)
        chance = np.diff(below, prepend=0)
        mean = float((chance * span).sum())
        spread = math.sqrt(float((chance * (span - mean) ** 2).sum()))
        assert below[-1] == pytest.approx(1)
        assert mean == pytest.approx(level + sensor.black_count, abs=1e-3)
        assert spread == pytest.approx(math.sqrt(level / 2 + 16 + 1 / 12), rel=1e-3)


def test_every_noise_is_near_and_a_wrong_one_is_not() -> None:
    subject = small_subject()
    for name, make in noise.makers(320).items():
        found = noise.measure(make, subject, 8)
        assert found.mean_counts < 0.3, name
        assert found.deviation_percent < 1, name
        assert found.probability < 0.012, name
        assert found.correlation < 0.02, name

    def too_loud(path: Any, index: int, number: int) -> None:
        noise.makers(320)["fresh normals, numpy"](path, index, number)
        path.out[:, 1::2] = path.out[:, ::2]

    assert noise.measure(too_loud, subject, 4).correlation > 0.3


def test_the_command_leaves_its_files(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Capture
) -> None:
    monkeypatch.setattr("slopegate.app.bench.session.run", lambda names, extent, say: bench)
    folder = tmp_path / "a" / "b"
    assert main(["bench", "--quick", "--out", str(folder), "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["verdict"]["default"] == "cached float32 rows, hard edges"
    assert {p.name for p in folder.iterdir()} == {"bench.json", "bench.csv", "bench.md", "bench.png", "baseline.json"}
    assert json.loads((folder / "bench.json").read_text()) == values
    assert main(["bench", "--check", str(folder / "baseline.json")]) == 0
    assert capsys.readouterr().out.startswith("nothing got worse: ")
    stored = json.loads((folder / "baseline.json").read_text())
    stored["figures"]["three_targets: trapezoid"]["ratio"] /= 10
    (folder / "baseline.json").write_text(json.dumps(stored))
    assert main(["bench", "--check", str(folder / "baseline.json")]) == 1
    assert "three_targets: trapezoid: ratio was" in capsys.readouterr().out


def test_scenes_are_chosen(bench: Bench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Capture) -> None:
    seen: list[tuple[list[str], RunSize]] = []

    def fake(names: list[str], extent: RunSize, say: Any) -> Bench:
        seen.append((names, extent))
        return bench

    monkeypatch.setattr("slopegate.app.bench.session.run", fake)
    out = ["--out", str(tmp_path)]
    assert main(["bench", "--quick", *out]) == 0
    assert main(["bench", "--scene", "spot", "shipped", "--no-skip", *out]) == 0
    assert [names[:2] for names, _ in seen] == [list(QUICK_SCENES), ["spot", shipped_scenes()[0].key]]
    assert seen[0][1] == QUICK
    assert not seen[1][1].skip
    capsys.readouterr()
    assert main(["bench", "--scene", "nowhere", *out]) == 2
    assert "nowhere is no file" in capsys.readouterr().err


def test_without_mitsuba_the_peer_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer, "find_spec", lambda name: None)
    said = peer.why_not(small_subject())
    assert said is not None
    assert said.startswith("no peer: Mitsuba 3 is not installed")
    assert "\n" not in said


def test_a_peer_that_fails_says_why(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "mitsuba.py").write_text("raise ImportError('broken for a test')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(peer, "find_spec", lambda name: object())
    if "mitsuba" in sys.modules:
        pytest.skip("Mitsuba is loaded")
    said = peer.render_gates(small_subject(32), (1,), 1)
    assert said == "no peer: Mitsuba 3 failed (ImportError: broken for a test)"


def test_captures_and_motion_have_no_peer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer, "find_spec", lambda name: object())
    rig = load_rig(None)
    for name in ("aloe", "door"):
        own, scene = open_scene(scene_path(name), rig)
        said = peer.why_not(make_subject(name, own if name == "aloe" else scaled_rig(own, 96), scene))
        assert said is not None
        assert said.startswith("no peer for this scene")
    assert peer.why_not(small_subject()) is None


@pytest.mark.slow
def test_the_peer_agrees_to_its_noise() -> None:
    """Where Mitsuba 3 is installed: its error falls with its samples, and its mean is ours."""
    pytest.importorskip("mitsuba", reason="the extra 'peer' is not installed")
    subject = small_subject(160)
    area = subject.area_counts(subject.lattice(5000), 12)
    images = peer.render_gates(subject, (1, 16), 1)
    assert not isinstance(images, str), images
    rms = []
    for image in images:
        seen = image.counts.reshape(len(subject.gates), -1)[:, area.pixels]
        rms.append(peer.as_row(subject, area, image, 1.0).area.rms_counts)  # type: ignore[union-attr]
    # Few rays saturate pixels by chance, which takes light away; with 16 the mean is right.
    assert seen.mean() == pytest.approx(np.mean(area.counts), rel=0.02)
    assert rms[1] < 0.5 * rms[0]
