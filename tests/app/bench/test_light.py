"""The bench of light beyond the direct path: its figures, its command, its peer. Run times are never looked at."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cli_calls import report
from slopegate.app.bench import light, light_peer, peer
from slopegate.app.bench.light import LightBench, LightSize, as_text, blocks, misses, run_light
from slopegate.app.bench.subject import Subject, make_subject, scaled_rig
from slopegate.core.scene.materials import Gloss
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

Capture = pytest.CaptureFixture[str]
TINY = LightSize(48, (2, 8), 32, 2, 32, 1, (1,), 4)


@cache
def box(width: int = 32, name: str = "cornell") -> Subject:
    rig, scene = open_scene(scene_path(name), scaled_rig(load_rig(None), width))
    return make_subject(name, rig, scene)


@cache
def tiny() -> LightBench:
    """Of the Cornell box, without the peer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(peer, "find_spec", lambda name: None)
        subject = box()
        return run_light([("cornell", subject.rig, subject.scene)], TINY, lambda sentence: None)


def test_every_way_has_its_figures_and_more_paths_are_better() -> None:
    rows = {row.name: row for row in tiny().rows if row.part == "indirect"}
    assert [name for name, row in rows.items() if row.default] == ["8 paths a cell"]
    assert sum("bands, not" in name for name in rows) == 3
    assert sum("pixels, not" in name for name in rows) == 2
    assert sum("smoothed over" in name for name in rows) == 3
    for row in tiny().rows:
        assert (row.scene, row.height * 4) == ("cornell", row.width * 3)
        for figure in (row.prepare_ms, row.gate_ms, row.error_percent):
            assert figure >= 0
        assert math.isfinite(row.bias_percent)
    assert rows["8 paths a cell"].error_percent < rows["2 paths a cell"].error_percent
    kept = [rows[f"{bands} bands, not 72"].memory_mb or 0 for bands in (36, 144, 288)]
    assert kept == sorted(kept)
    assert kept[0] > 0


def test_whole_images_are_made_and_a_missing_peer_is_said() -> None:
    whole = [row for row in tiny().rows if row.part == "all"]
    assert [row.name for row in whole] == [f"this program, {paths} paths a cell" for paths in TINY.paths]
    (remark,) = tiny().remarks
    assert remark.startswith("no peer: Mitsuba 3 is not installed")


def test_errors_are_without_the_noise_of_the_truth() -> None:
    rng = np.random.default_rng(0)
    exact = np.ones((3, 40, 80))
    exact[-1] = 2
    noisy = exact + rng.normal(0, 0.4, exact.shape)
    noise = ((blocks(noisy - exact)) ** 2).mean(axis=(1, 2))
    np.testing.assert_allclose(noise, 0.4**2 / 16, rtol=0.2)
    error, bias = misses(exact, noisy, noise)
    assert error == pytest.approx(0, abs=1e-6)
    assert misses(exact, noisy, 0 * noise)[0] == pytest.approx(100 * 0.1 / 2, rel=0.1)
    error, bias = misses(exact + 0.06, exact, 0 * noise)
    assert (error, bias) == (pytest.approx(3), pytest.approx(3))


def test_fog_has_its_parts_measured() -> None:
    """Finer tables of airlight are nearer to the finest; pairs of pixels are what the halo is measured against."""
    subject = box(name="cornell_fog")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(peer, "find_spec", lambda name: None)
        found = run_light([("fog", subject.rig, subject.scene)], TINY, lambda sentence: None)
    rows = {(row.part, row.name): row for row in found.rows}
    assert {row.part for row in found.rows} == {"airlight", "scatter", "indirect", "all"}
    assert rows["airlight", "2 pixels apart, not 4"].error_percent < 0.5
    assert (
        rows["airlight", "2 pixels apart, not 4"].error_percent
        < rows["airlight", "8 pixels apart, not 4"].error_percent
    )
    assert rows["scatter", "all pairs of pixels"].error_percent == 0
    assert [row.part for row in found.rows if row.default] == ["airlight", "scatter", "indirect"]


def test_people_are_told_what_programs_are() -> None:
    text = as_text(tiny())
    for row in tiny().rows:
        assert row.name in text
    assert "no peer: Mitsuba 3 is not installed" in text


def test_the_command_leaves_and_prints_its_figures(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peer, "find_spec", lambda name: None)
    monkeypatch.setattr(light, "QUICK", TINY)
    words = ["bench", "--light", "--quick", "--scene", "cornell", "--out", str(tmp_path / "out")]
    found = report(capsys, *words)
    assert set(found) == {"machine", "rows", "remarks"}
    assert {row["scene"] for row in found["rows"]} == {"cornell"}
    assert json.loads((tmp_path / "out" / "light.json").read_text("utf-8")) == found


def test_what_the_peer_cannot_show_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer, "find_spec", lambda name: object())
    assert light_peer.why_not(box()) is None
    subject = box(name="cornell_fog")
    assert light_peer.why_not(subject) is None
    scene, fog = subject.scene, subject.scene.fog
    assert fog is not None
    glossy = replace(scene.objects[0], material=Gloss(0.2))
    for changed, said in (
        (replace(scene, objects=(glossy, *scene.objects[1:])), "only matt surfaces"),
        (replace(scene, fog=replace(fog, hi_m=(1.0, 1.0, math.inf))), "its fog has no end"),
        (replace(scene, fog=replace(fog, lo_m=(-1.5, -1.5, -1.0))), "the rig stands in its fog"),
    ):
        assert said in str(light_peer.why_not(replace(subject, scene=changed)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell", "cornell_fog"])
def test_the_peer_agrees_to_its_noise(name: str) -> None:
    pytest.importorskip("mitsuba", reason="the extra 'peer' is not installed")
    subject = box(name=name)
    found = run_light([(name, subject.rig, subject.scene)], replace(TINY, peer_paths=(16,)), lambda sentence: None)
    (row,) = (row for row in found.rows if row.name.startswith("Mitsuba"))
    assert abs(row.bias_percent) < 2
    assert row.error_percent < 12
