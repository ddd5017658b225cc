"""`slopegate capture` and `slopegate export`: what they write, and every refusal."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import OpenEXR
import pytest
import tifffile

from capture_schema import json_schema
from cli_calls import refusal, report
from scene_texts import CARD_AND_WALL, card_home
from slopegate.app.cli import main
from slopegate.core.rig.settings import gate
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.storage import open_capture
from small_window import small_rig, small_scene

Capture = pytest.CaptureFixture[str]

GATE = ("--clock-mhz", "78", "--delay-us", "2028", "--exposure-us", "400", "--out", "x.png")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return card_home(tmp_path)


def words(home: Path, *more: str, out: str = "c") -> list[str]:
    return ["capture", str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--out", str(home / out), *more]


def test_exported_slices_add_up_to_the_floodlit_capture(capsys: Capture, home: Path) -> None:
    told = report(capsys, *words(home, "--no-noise", "--frames", "4", "--dark"))
    assert told["planned"] == told["taken"] == len(told["slices"])
    assert told["share_edges"]
    assert told["missing"] == []
    assert told["frames_used"] == 4 * (told["planned"] + 1)
    assert told["dark"]["frames"] == 4
    told = report(capsys, "export", str(home / "c"), "--format", "ome-tiff", "--out", str(home / "c.ome.tif"))
    assert told["steps_per_count"] == 4
    planes = tifffile.imread(home / "c.ome.tif").astype(np.int64)
    camera = VirtualCamera(small_rig(), small_scene(small_rig()), noise=False, rate_hz=math.inf)
    flood, image = gate(50.0, 0.0, 16667.0), np.zeros((240, 320), np.uint16)
    camera.start()
    camera.configure(flood)
    assert camera.read(image, 1.0) is not None
    black = int(camera.info.black_count)
    np.testing.assert_array_equal((planes - 4 * black).sum(axis=0), 4 * (image.astype(np.int64) - black))
    assert image.max() > 1000


def test_formats_from_the_command_line(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "--count", "5", "--skip-empty"))
    folder = open_capture(home / "c")
    outs = {"ome-tiff": "o.ome.tif", "exr": "exr", "png": "png", "json": "o.json"}
    for kind, out in outs.items():
        told = report(capsys, "export", str(home / "c"), "--format", kind, "--out", str(home / out))
        assert (told["format"], told["slices"]) == (kind, 5)
    lit = next(index for index, record in folder.records().items() if not record.empty)
    np.testing.assert_array_equal(tifffile.imread(home / "o.ome.tif")[lit], folder.total(lit))
    with OpenEXR.File(str(home / "exr" / f"slice_{lit:04d}.exr")) as image:
        np.testing.assert_array_equal(image.channels()["Y"].pixels, folder.mean(lit))
    jsonschema.Draft202012Validator(json_schema()).validate(json.loads((home / "o.json").read_text("utf-8")))
    assert (home / "png" / "contact.png").stat().st_size > 1000


def test_zarr_from_the_command_line(capsys: Capture, home: Path) -> None:
    """In a process of its own, as the library's threads never end."""
    report(capsys, *words(home, "--count", "2"))
    export = ["export", str(home / "c"), "--format", "zarr", "--out", str(home / "o.ome.zarr"), "--json"]
    made = subprocess.run([sys.executable, "-m", "slopegate.app", *export], capture_output=True, text=True, check=True)
    assert made.stderr == ""
    assert json.loads(made.stdout)["slices"] == 2
    read = f"import sys, zarr; sys.stdout.buffer.write(zarr.open_group({str(home / 'o.ome.zarr')!r}, mode='r')['0'][1])"
    data = subprocess.run([sys.executable, "-c", read], capture_output=True, check=True).stdout
    assert data == open_capture(home / "c").total(1).tobytes()


def test_a_range_in_equal_depth(capsys: Capture, home: Path) -> None:
    plan = ("--near-m", "0.9", "--far-m", "2.1", "--count", "4", "--spacing", "depth", "--line-time-us", "63")
    told = report(capsys, *words(home, *plan))
    exposures = [item["applied"]["exposure_us"] for item in told["slices"]]
    assert exposures == sorted(exposures, reverse=True)
    assert told["share_edges"]
    told = report(capsys, *words(home, "--near-m", "0.9", "--far-m", "inf", "--clock-mhz", "76", out="d"))
    assert told["planned"] > 4
    assert told["slices"][-1]["slab"]["far_m"] is None


def test_a_list_of_delays(capsys: Capture, home: Path) -> None:
    told = report(capsys, *words(home, "--delays-us", "-100,2028.4", "--exposure-us", "400"))
    assert [item["applied"]["delay_us"] for item in told["slices"]] == [-100.0, 2028.0]
    assert not told["share_edges"]


def test_the_same_seed_the_same_capture(capsys: Capture, home: Path) -> None:
    for out, seed in (("a", "7"), ("b", "7"), ("c", "8")):
        report(capsys, *words(home, "--count", "3", "--frames", "2", "--seed", seed, out=out))
    a, b, c = (open_capture(home / name) for name in "abc")
    for index in range(3):
        np.testing.assert_array_equal(a.total(index), b.total(index))
        assert (a.total(index) != c.total(index)).any()


def test_resume_takes_what_is_missing(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "--count", "4", "--frames", "2", "--no-noise"))
    folder = open_capture(home / "c")
    before = [folder.total(index).copy() for index in range(4)]
    for index in (1, 3):
        (home / "c" / f"slice_{index:04d}.tif").unlink()
    assert main(["export", str(home / "c"), "--format", "png", "--out", str(home / "some")]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("2 slices of Card and wall are in ")
    assert err == "warning: c is unfinished: 2 of 4 slices are missing\n"
    told = report(capsys, *words(home, "--resume", "--no-noise"))
    assert told["frames_used"] == 4
    for index in range(4):
        np.testing.assert_array_equal(folder.total(index), before[index])


def test_without_json_it_says_what_was_done(capsys: Capture, home: Path) -> None:
    assert main(words(home, "--count", "3", "--dark")) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "3 of 3 slices of Card and wall and a dark frame are in" in out
    assert " discarded: the first ones after a change of settings, which may still show those before\n" in out
    assert main(["export", str(home / "c"), "--format", "json", "--out", str(home / "c.json")]) == 0
    assert capsys.readouterr().out.startswith("3 slices of Card and wall are in")


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--near-m", "1"), "--near-m and --far-m belong together"),
        (("--delays-us", "1"), "--delays-us and --exposure-us belong together"),
        (("--delays-us", "1,x", "--exposure-us", "9"), "'x' must be a number from -1000000"),
        (("--delays-us", "nan", "--exposure-us", "9"), "'nan' must be a number"),
        (("--delays-us", "1," * 10_000 + "1", "--exposure-us", "9"), "10001 delays are too many"),
        (("--delays-us", "1", "--exposure-us", "400", "--count", "3"), "stands in place of"),
        (("--spacing", "depth"), "--spacing depth needs --near-m and --far-m"),
        (("--near-m", "2", "--far-m", "1"), "--far-m is 1: it must be above --near-m (2)"),
        (("--near-m", "1", "--far-m", "2", "--count", "90"), "count is 90: it must be at most"),
        (("--frames", "0"), "0 must be a whole number from 1 to 10000"),
        (("--clock-mhz", "70", "--line-time-us", "9"), "not allowed with"),
        (("--resume",), "is missing"),
        (("--resume", "--count", "3"), "give no other plan beside it"),
    ],
)
def test_refusals(capsys: Capture, home: Path, more: tuple[str, ...], sentence: str) -> None:
    assert sentence in refusal(capsys, *words(home, *more))
    assert not (home / "c").exists()


def test_a_folder_with_something_in_it_is_refused_before_any_work(
    capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(camera: VirtualCamera, progress: Callable[[float], bool]) -> None:
        raise AssertionError("rendered for nothing")

    monkeypatch.setattr(VirtualCamera, "prepare", never)
    assert "is not empty" in refusal(capsys, "capture", str(home / "card.toml"), "--out", str(home))
    assert "is a file" in refusal(capsys, *words(home, out="rig.toml"))


def test_resume_takes_damaged_slices_again(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "--count", "3", "--no-noise"))
    folder = open_capture(home / "c")
    broken, before = folder.path / "slice_0001.tif", folder.total(1).copy()
    whole = broken.read_bytes()
    broken.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert report(capsys, *words(home, "--resume", "--no-noise"))["frames_used"] == 1
    np.testing.assert_array_equal(folder.total(1), before)
    assert broken.with_suffix(".damaged").exists()


@pytest.mark.parametrize("more", [("--dark",), ("--skip-empty",)])
def test_what_is_taken_again_is_the_same_to_the_last_bit(capsys: Capture, home: Path, more: tuple[str, ...]) -> None:
    report(capsys, *words(home, "--count", "4", "--frames", "2", "--seed", "7", *more))
    folder = open_capture(home / "c")
    kept = {path.name: tifffile.imread(path) for path in folder.path.glob("*.tif")}
    assert {"dark.tif", "slice_0000.tif", "slice_0003.tif"} <= kept.keys()
    (folder.path / "slice_0003.tif").unlink()
    for name in ("dark.tif", "slice_0000.tif"):
        data = bytearray((folder.path / name).read_bytes())
        data[-3] ^= 1
        (folder.path / name).write_bytes(data)
    told = report(capsys, *words(home, "--resume"))
    assert (told["taken"], told["frames_lost"]) == (4, 0)
    assert told["dark"]["frames"] == 2
    assert {path.name for path in folder.path.glob("*.tif")} == kept.keys()
    for name, before in kept.items():
        np.testing.assert_array_equal(tifffile.imread(folder.path / name), before, name)


def test_another_noise_cannot_resume(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "--count", "2", "--seed", "7"))
    sentence = refusal(capsys, *words(home, "--resume", "--seed", "8"))
    assert "was begun with the seed 7: it cannot be resumed with 8" in sentence
    assert "was begun with noise" in refusal(capsys, *words(home, "--resume", "--no-noise"))
    assert report(capsys, *words(home, "--resume", "--seed", "7"))["frames_used"] == 0


def test_a_title_with_a_control_character_is_exported_as_valid_xml(capsys: Capture, home: Path) -> None:
    scene = (home / "card.toml").read_text("utf-8").replace("Card and wall", "Pasted\\u000btitle")
    (home / "card.toml").write_text(scene, "utf-8")
    assert report(capsys, *words(home, "--count", "2"))["scene"] == "Pasted title"
    report(capsys, "export", str(home / "c"), "--format", "ome-tiff", "--out", str(home / "c.ome.tif"))
    with tifffile.TiffFile(home / "c.ome.tif") as image:
        image_tag = ElementTree.fromstring(image.ome_metadata or "").find("{*}Image")
        assert image.series[0].axes == "ZYX"
    assert image_tag is not None
    assert image_tag.get("Name") == "Pasted title"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere every file name is text")
def test_a_file_name_that_is_not_utf8_is_replaced(capsys: Capture, home: Path) -> None:
    name = os.fsdecode(b"M\xf6bel.toml")
    (home / name).write_text(CARD_AND_WALL.replace('title = "Card and wall"', ""), "utf-8")
    command = [
        "capture",
        str(home / name),
        "--rig",
        str(home / "rig.toml"),
        "--count",
        "2",
        "--out",
        str(home / name)[:-5],
    ]
    assert report(capsys, *command)["scene"] == r"M\xf6bel"
    folder = open_capture(Path(command[-1]))
    assert folder.manifest.scene == folder.manifest.camera.name == r"M\xf6bel"
    assert report(capsys, *command[:4], "--out", command[-1], "--resume")["missing"] == []
    assert r"M\xf6bel.png" in refusal(capsys, "render", str(home / name[:-5]) + ".png", *GATE)


def test_another_rig_cannot_resume(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "--count", "2"))
    sentence = refusal(capsys, "capture", str(home / "card.toml"), "--out", str(home / "c"), "--resume")
    assert "was begun with another scene, camera or rig" in sentence


@pytest.mark.parametrize(
    ("kind", "out", "sentence"),
    [
        ("png", "rig.toml", "exists already: take another name, or allow to overwrite it"),
        ("json", "c.txt", "it must be one of .json"),
        ("zarr", "no/where.ome.zarr", "there is no folder"),
        ("zarr", "slices", "must end in .ome.zarr"),
        ("tiff", "c.tif", "invalid choice: 'tiff'"),
    ],
)
def test_export_refusals(capsys: Capture, home: Path, kind: str, out: str, sentence: str) -> None:
    report(capsys, *words(home, "--count", "2"))
    assert sentence in refusal(capsys, "export", str(home / "c"), "--format", kind, "--out", str(home / out))
    assert "is no capture" in refusal(capsys, "export", str(home), "--format", "json", "--out", str(home / "o.json"))
