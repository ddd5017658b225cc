"""`slopegate capture --camera` on aravis' fake GigE Vision camera, in a network namespace: run, killed, resumed."""

from __future__ import annotations

import json
import math
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import tifffile

import fake_gige
from fake_gige import FakeCamera, rolling_shutter
from slopegate.app.cli import main
from slopegate.drivers.captures.film import open_film
from slopegate.drivers.captures.storage import CaptureFolder, open_capture
from slopegate.drivers.files.rig_files import rig_to_toml
from small_window import small_rig

HERE = Path(__file__)
PATIENCE_S = 60.0
Process = subprocess.Popen[str]


@pytest.mark.timeout(900)
def test_captures_from_a_gige_camera_inside_a_namespace() -> None:
    said = fake_gige.run_inside(str(HERE), "--timeout=200")
    passed = re.search(r"(\d+) passed", said)
    assert passed, said
    assert int(passed[1]) == 4, said


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., FakeCamera]]:
    yield from fake_gige.serving(tmp_path)


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Starts `slopegate` with these words, to be told apart from this process by what is done to it."""
    begun: list[Process] = []

    def start(*words: str) -> Process:
        command = [sys.executable, "-m", "slopegate.app", *words]
        begun.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return begun[-1]

    yield start
    for process in begun:
        process.kill()
        process.communicate()


def capture(server: FakeCamera, folder: Path, *more: str) -> list[str]:
    (folder / "rig.toml").write_text(rig_to_toml(small_rig()), "utf-8")
    # the fake camera leaves the format black that would be chosen
    camera = ["--camera", f"aravis:{server.where}", "--pixel-format", "Mono16", "--rig", str(folder / "rig.toml")]
    return ["capture", *camera, "--out", str(folder / "c"), "--json", *more]


def ended(process: Process) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


def until(condition: Callable[[], object], process: Process) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s, "it did not happen in time"
        time.sleep(0.005)


def brightest(exposure_us: float) -> float:
    """What the fake camera's 16-bit ramp reaches at this exposure."""
    return min(65535.0, max(0.0, 65289 * (1 + math.log10(exposure_us / 10000))))


def check_brightness(folder: CaptureFolder) -> None:
    """Every slice was exposed as its record says, which only frames made with that very gate can show."""
    for index, record in folder.records().items():
        # the ramp moves on by a pixel a frame, and its mean stays where it is
        expected = brightest(record.applied.exposure_us) / 2
        assert folder.mean(index).mean() == pytest.approx(expected, rel=0.03), record
        assert record.frames == folder.manifest.frames


def test_a_capture_is_read_back_and_exported(
    serve: Callable[..., FakeCamera], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    server = serve(rolling_shutter())
    plan = ("--near-m", "0.1", "--far-m", "0.4", "--count", "3", "--spacing", "depth")
    assert main(capture(server, tmp_path, *plan)) == 0
    out, err = capsys.readouterr()
    assert err == ""
    told = json.loads(out)
    assert (told["scene"], told["planned"], told["taken"], told["missing"]) == ("Aravis Fake GV01", 3, 3, [])
    assert told["frames_used"] == 3
    assert told["share_edges"]
    exposures_us = [item["applied"]["exposure_us"] for item in told["slices"]]
    assert exposures_us == sorted(exposures_us, reverse=True)
    assert brightest(exposures_us[2]) > 1000
    folder = open_capture(tmp_path / "c")
    assert folder.manifest.camera.pixel_format == "mono16"
    assert folder.shape == (240, 320)
    check_brightness(folder)
    stack = tmp_path / "slices.ome.tif"
    assert main(["export", str(tmp_path / "c"), "--format", "ome-tiff", "--out", str(stack)]) == 0
    for index, plane in enumerate(tifffile.imread(stack)):
        np.testing.assert_array_equal(plane, folder.total(index))


def test_depth_is_swept_on_a_camera(
    serve: Callable[..., FakeCamera], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Its ramp grows with the exposure and knows no delay, so most answers contradict each other."""
    server = serve(rolling_shutter())
    asked = ["depth", *capture(server, tmp_path)[1:-3], "--nearest-m", "0.6", "--finest-rows", "8", "--json"]
    assert main(asked) == 0
    out, err = capsys.readouterr()
    assert err == ""
    told = json.loads(out)
    assert (told["scene"], told["error"]) == ("Aravis Fake GV01", None)
    assert 2 < told["frames"] <= told["plain_frames"]
    assert told["known_share"] < 0.5
    assert main([*asked, "--no-noise"]) == 2
    assert "are for a SCENE" in capsys.readouterr().err


def test_a_capture_goes_on_after_control_c_and_after_its_camera_has_vanished(
    serve: Callable[..., FakeCamera], begin: Callable[..., Process], tmp_path: Path
) -> None:
    server = serve(rolling_shutter())
    plan = ("--delays-us", "3000,2600,2200,1800,1400,1000", "--exposure-us", "4000", "--frames", "12")
    folder = tmp_path / "c"
    process = begin(*capture(server, tmp_path, *plan))
    until((folder / "slice_0000.tif").exists, process)
    process.send_signal(signal.SIGINT)
    code, out, err = ended(process)
    kept = taken(folder)
    assert (code, out) == (130, "")
    assert err.startswith(
        f"slopegate: interrupted: {len(kept)} of 6 slices are kept in {folder}; go on with: slopegate "
    )
    assert err.endswith(" --resume\n")
    assert 1 <= len(kept) < 5
    process = begin(*capture(server, tmp_path, "--resume", "--wait-s", "2"))
    until(lambda: len(taken(folder)) > len(kept), process)
    server.kill()
    code, out, err = ended(process)
    assert (code, out) == (2, "")
    said = r"slopegate: Aravis Fake GV01 has sent no frame for 2 s: .+; [2-5] of 6 slices are kept\n"
    assert re.fullmatch(said, err), err
    assert kept.items() < taken(folder).items()
    kept = taken(folder)
    server.start()
    code, out, err = ended(begin(*capture(server, tmp_path, "--resume")))
    assert (code, err) == (0, "")
    assert json.loads(out)["frames_used"] == 12 * (6 - len(kept))
    assert kept.items() < taken(folder).items()
    assert open_capture(folder).missing() == []
    check_brightness(open_capture(folder))


def taken(folder: Path) -> dict[str, bytes]:
    """What is on the disk so far."""
    return {path.name: path.read_bytes() for path in folder.glob("slice_*.tif")}


def test_a_recording_is_of_that_camera_and_ends_when_it_vanishes(
    serve: Callable[..., FakeCamera],
    begin: Callable[..., Process],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    server = serve(rolling_shutter())
    gate = ("--clock-mhz", "78", "--delay-us", "3000", "--exposure-us", "4000")
    words = ["record", *capture(server, tmp_path)[1:-3], "--json", *gate]
    assert main([*words, "--out", str(tmp_path / "r"), "--frames", "20"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert (err, told["frames"], told["scene"]) == ("", 20, "Aravis Fake GV01")
    film = open_film(tmp_path / "r")
    numbers = [film.record(number).sequence for number in range(20)]
    assert numbers[-1] - numbers[0] == 19 + told["lost_by_camera"] + told["lost_by_disk"]
    exposure_us = told["gate"]["exposure_us"]
    for number in range(20):
        assert film.frame(number).mean() == pytest.approx(brightest(exposure_us) / 2, rel=0.03)
    process = begin(*words, "--out", str(tmp_path / "s"), "--wait-s", "2")
    until(lambda: (tmp_path / "s" / "frames_0000.tif").exists() and len(open_film(tmp_path / "s")) > 3, process)
    server.kill()
    code, out, err = ended(process)
    assert (code, out) == (2, "")
    kept = len(open_film(tmp_path / "s"))
    assert re.fullmatch(rf"slopegate: Aravis .+ for 2 s: .+; {kept} frames are kept in {tmp_path / 's'}\n", err), err
