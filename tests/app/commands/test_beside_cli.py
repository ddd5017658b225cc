"""Commands with the projector beside the camera: only what needs a slab is refused, in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from beside import write_beside
from cli_calls import refusal
from slopegate.app import api
from slopegate.app.cli import main

Capture = pytest.CaptureFixture[str]
WHY = "This rig's gates are no slabs: the projector stands along its own rows"
GATE = ("--clock-mhz", "78", "--delay-us", "0", "--exposure-us", "100")


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """A rig file and a scene file."""
    rig, scene = write_beside(tmp_path)
    return str(rig), str(scene)


def told(capsys: Capture, *command: str) -> tuple[dict[str, object], str]:
    """What a command tells with --json, and its warnings."""
    assert main([*command, "--json"]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_render_keeps_all_direct_light_and_its_complement_none(
    capsys: Capture, files: tuple[str, str], tmp_path: Path
) -> None:
    rig, scene = files
    out = [str(tmp_path / name) for name in ("kept.npy", "rest.npy", "all.npy")]
    kept, warned = told(capsys, "render", scene, "--rig", rig, *GATE, "--out", out[0])
    assert kept["slab"] is None
    assert str(kept["no_slab"]).startswith(WHY)
    assert kept["lit_fraction"] == pytest.approx(1.0, abs=0.1)  # all but the card's shadow
    assert warned.count("warning") == 1
    assert "gates that are given as slabs ('The card') are left out: This rig's gates are no slabs" in warned
    rest, _ = told(capsys, "render", scene, "--rig", rig, *GATE, "--complement", "--out", out[1])
    assert rest["lit_fraction"] == 0.0
    whole = ("--clock-mhz", "78", "--delay-us", "8333.3", "--exposure-us", repr(1e6 / 60))
    told(capsys, "render", scene, "--rig", rig, *whole, "--out", out[2])
    images = [np.load(path) for path in out]
    # what the two share is ambient light, of which each gets its exposure's part
    np.testing.assert_allclose(images[0] + images[1], images[2], rtol=1e-5, atol=1e-7)


def test_render_says_in_words_what_is_kept(capsys: Capture, files: tuple[str, str], tmp_path: Path) -> None:
    rig, scene = files
    assert main(["render", scene, "--rig", rig, *GATE, "--out", str(tmp_path / "kept.png")]) == 0
    out, _ = capsys.readouterr()
    assert "keeps: Epipolar: all direct light, and indirect that moved up to 2.3 rows" in out


@pytest.mark.parametrize(
    "command",
    [
        ("slab", *GATE),
        ("plan", "--tilt-deg", "0", "--distance-m", "1", "--thickness-m", "0.1"),
        ("plan", "--plane=0,-0.5,1,-1", "--thickness-m", "0.1"),
    ],
)
def test_slab_and_plan_are_refused(capsys: Capture, files: tuple[str, str], command: tuple[str, ...]) -> None:
    assert refusal(capsys, *command, "--rig", files[0]).startswith(f"slopegate: {WHY}")


@pytest.mark.parametrize(
    "command",
    [
        ("depth",),
        ("search",),
        ("capture", "--near-m", "0.5", "--far-m", "2", "--out", "nowhere"),
    ],
)
def test_what_tells_distances_is_refused(capsys: Capture, files: tuple[str, str], command: tuple[str, ...]) -> None:
    rig, scene = files
    assert main([command[0], scene, *command[1:], "--rig", rig]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1].startswith(f"slopegate: {WHY}")
    assert not Path("nowhere").exists()


def test_slices_by_delay_are_recorded_and_exported(capsys: Capture, files: tuple[str, str], tmp_path: Path) -> None:
    rig, scene = files
    folder = tmp_path / "slices"
    delays = ("--delays-us=-200,0,200", "--exposure-us", "100")
    found, _ = told(capsys, "capture", scene, "--rig", rig, *delays, "--no-noise", "--out", str(folder))
    slices = found["slices"]
    assert isinstance(slices, list)
    assert [record["slab"] for record in slices] == [None, None, None]
    opened = api.open_capture(folder)
    direct = [float(opened.light(place).mean()) for place in range(3)]
    assert direct[1] > 20 * max(direct[0], direct[2])
    assert np.isnan(opened.depth_m).all()
    for form, target in (("ome-tiff", "all.ome.tiff"), ("png", "pictures"), ("json", "all.json")):
        told(capsys, "export", str(folder), "--format", form, "--out", str(tmp_path / target))


def test_a_band_of_rows_can_be_masked_whatever_its_distance(capsys: Capture, files: tuple[str, str]) -> None:
    rig, scene = files
    found, _ = told(capsys, "mask", scene, "--rig", rig, "--region", "0", "20", "160", "70")
    assert found["slab"] is None
    assert found["good"]
    assert float(str(found["iou"])) > 0.95


def test_light_that_fog_scatters_once_stays_in_its_row(files: tuple[str, str], tmp_path: Path) -> None:
    """So an epipolar gate keeps all of it, and can do nothing against it (the paper's figure 8b)."""
    foggy = tmp_path / "foggy.toml"
    foggy.write_text(Path(files[1]).read_text("utf-8") + "[fog]\nvisibility_m = 5.0\n", "utf-8")
    scene = api.open_scene(foggy, files[0])
    gate = scene.epipolar
    assert gate is not None
    found = [scene.light(one, parts=("airlight",), max_order=1) for one in (gate, scene.everything_lit)]
    assert found[1].min() > 0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4)


def test_rigs_that_ship_have_keys(capsys: Capture, tmp_path: Path) -> None:
    assert api.open_rig("beside").epipolar == api.open_rig("beside").gate(clock_mhz=78, delay_us=0, exposure_us=100)
    assert api.open_rig("check").rig == api.open_rig().rig
    assert api.open_rig().epipolar is None
    assert "none of the shipped rigs (beside, binned, check)" in refusal(capsys, "slab", *GATE, "--rig", "besides")
