"""Commands killed at any moment: nothing that was kept is lost, and what is resumed is what it would have been."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile

from slopegate.drivers.captures.storage import is_capture, open_capture
from slopegate.drivers.files.rig_files import rig_to_toml
from small_window import small_rig

SEED = int(os.environ.get("SLOPEGATE_KILL_SEED", "1"))
KILLS = int(os.environ.get("SLOPEGATE_CLI_KILLS", "12"))
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SCENE = """
[[objects]]
type = "plane"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 4.0
[[objects]]
type = "plane"
centre_m = [0.0, 0.0, 1.0]
width_m = 0.4
height_m = 0.3
"""

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="there are no such signals there")]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "rig.toml").write_text(rig_to_toml(small_rig()), "utf-8")
    (tmp_path / "s.toml").write_text(SCENE, "utf-8")
    return tmp_path


def start(home: Path, *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "slopegate.app", *words]
    return subprocess.Popen(command, cwd=home, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finish(home: Path, *words: str) -> None:
    with start(home, *words) as process:
        _, err = process.communicate(timeout=300)
    assert process.returncode == 0, err.decode()


def kill(home: Path, number: int, within_s: tuple[float, float], *words: str) -> bool:
    """Start a command and kill it at a moment drawn by chance; whether it was killed before its end."""
    rng = random.Random(f"{SEED} {number} {words}")
    with start(home, *words) as process:
        time.sleep(rng.uniform(*within_s))
        process.send_signal(SIGNALS[number % len(SIGNALS)])
        _, err = process.communicate(timeout=120)
    assert b"Traceback" not in err, err.decode()
    assert process.returncode in (0, 130, *(-number for number in SIGNALS)), err.decode()
    return process.returncode != 0


def slices(folder: Path) -> dict[str, bytes]:
    """The pixels of each file of a capture."""
    return {path.name: tifffile.imread(path).tobytes() for path in sorted(folder.glob("*.tif"))}


def seconds(home: Path, *words: str) -> tuple[float, float]:
    """From when on and until when a command works: the first and the last moment at which killing it tells anything."""
    begun = time.monotonic()
    finish(home, *words)
    whole_s = time.monotonic() - begun
    return 0.3 * whole_s, 1.1 * whole_s


@pytest.mark.timeout(1500)
def test_a_killed_capture_goes_on_and_is_the_same(home: Path) -> None:
    plan = ("--near-m", "0.8", "--far-m", "2.5", "--count", "12", "--frames", "8", "--dark", "--seed", "5")
    within_s = seconds(home, "capture", "s.toml", "--rig", "rig.toml", *plan, "--out", "whole")
    whole, landed, kept = slices(home / "whole"), 0, {}
    for number in range(KILLS):
        begun = is_capture(home / "c")
        more = ("--resume",) if begun else plan
        landed += kill(home, number, within_s, "capture", "s.toml", "--rig", "rig.toml", *more, "--out", "c")
        now = slices(home / "c")
        assert kept.items() <= now.items(), "a slice that was kept is lost or another"
        kept = now
    more = ("--resume",) if is_capture(home / "c") else plan
    finish(home, "capture", "s.toml", "--rig", "rig.toml", *more, "--out", "c")
    assert open_capture(home / "c").missing() == []
    assert slices(home / "c") == whole
    assert not list((home / "c").glob("*.part"))
    print(f"{KILLS} kills, {landed} before the end")


@pytest.mark.timeout(1500)
@pytest.mark.parametrize(("kind", "out"), [("ome-tiff", "e.ome.tif"), ("png", "e")])
def test_a_killed_export_leaves_nothing_or_all_of_it(home: Path, kind: str, out: str) -> None:
    plan = ("--near-m", "0.8", "--far-m", "2.5", "--count", "12")
    finish(home, "capture", "s.toml", "--rig", "rig.toml", *plan, "--out", "c")
    words = ("export", "c", "--format", kind, "--out", out)
    within_s = seconds(home, *words[:-1], f"whole-{out}")
    landed = 0
    for number in range(KILLS):
        if (home / out).exists():  # the last one came too late
            (home / out).rename(home / f"late-{number}-{out}")
        landed += kill(home, number, within_s, *words)
    if not (home / out).exists():
        finish(home, *words)
    else:
        finish(home, *words, "--overwrite")
    assert not [path.name for path in home.iterdir() if path.name.endswith(".part")]
    pictures = [path for path in (home / out).iterdir()] if (home / out).is_dir() else [home / out]
    wholes = home / f"whole-{out}"
    if wholes.is_dir():
        assert {path.name for path in pictures} == {path.name for path in wholes.iterdir()}
    for path in pictures:
        other = wholes / path.name if wholes.is_dir() else wholes
        if path.suffix == ".tif":
            np.testing.assert_array_equal(tifffile.imread(path), tifffile.imread(other))
        else:
            assert path.stat().st_size == other.stat().st_size
    print(f"{kind}: {KILLS} kills, {landed} before the end")


@pytest.mark.timeout(1500)
def test_killed_light_transport_goes_on(home: Path) -> None:
    plan = ("--near-m", "0.8", "--far-m", "2.5", "--count", "3", "--grid", "8x8")
    words = ("transport", "acquire", "s.toml", "--rig", "rig.toml")
    within_s = seconds(home, *words, *plan, "--out", "whole")
    landed, kept = 0, {}
    for number in range(KILLS):
        if len(kept) == len(arrays(home / "whole")):  # the last one came too late
            (home / "t").rename(home / f"late-{number}")
            kept = {}
        more = ("--resume",) if (home / "t" / "transport.json").exists() else plan
        landed += kill(home, number, within_s, *words, *more, "--out", "t")
        now = arrays(home / "t")
        assert kept.items() <= now.items(), "a slice that was kept is lost or another"
        kept = now
    more = ("--resume",) if (home / "t" / "transport.json").exists() else plan
    finish(home, *words, *more, "--out", "t")
    assert arrays(home / "t") == arrays(home / "whole")
    print(f"{KILLS} kills, {landed} before the end")


def arrays(folder: Path) -> dict[str, bytes]:
    """The numbers of each file of light transport."""
    found = {}
    for path in sorted(folder.glob("slice_*.npz")):
        with np.load(path) as data:
            found[path.name] = b"".join(data[name].tobytes() for name in sorted(data.files))
    return found
