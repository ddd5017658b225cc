"""Damaged files of every kind: each is read or refused in one sentence, in bounded memory and seconds."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import fuzzed
from fuzzed import KINDS, damaged, told_well

SEED = int(os.environ.get("SLOPEGATE_FUZZ_SEED", "1"))
COUNT = int(os.environ.get("SLOPEGATE_FUZZ_COUNT", "400"))
GATE = ("--clock-mhz", "78", "--delay-us", "2028", "--exposure-us", "400")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the limit on memory is Linux's")


def tried(kind: str, count: int, folder: Path) -> tuple[list[dict[str, Any]], Counter[str]]:
    """What a process of its own finds, and how many inputs it read, refused and complained of."""
    folder.mkdir(exist_ok=True)
    command = [sys.executable, fuzzed.__file__, kind, str(SEED), str(count), str(folder)]
    done = subprocess.run(command, check=False, capture_output=True, timeout=1500)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith(b"{")]
    assert done.returncode == 0, f"after {lines[-1:]} it ended with {done.returncode}: {done.stderr.decode()[-2000:]}"
    print(f"{kind}: {lines[-1]}")
    return [line for line in lines if "what" in line], Counter(lines[-1]["told"])


@pytest.mark.parametrize("kind", ["scene toml", "exr", "session", "window.json"])
def test_a_few_damaged_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    findings, told = tried(kind, 30, tmp_path / "found")
    assert findings == []
    assert told.total() == 30


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    findings, told = tried(kind, COUNT, tmp_path / "found")
    assert findings == [], f"{len(findings)} of {COUNT} inputs"
    assert told["refused"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["scene toml", "obj", "glb", "scene.json", "exr depth"])
def test_the_command_line_speaks_json_or_one_sentence(kind: str, tmp_path: Path) -> None:
    good = (KINDS.get(kind) or EXR_DEPTH).make(tmp_path)
    scene = good.parent if kind in ("scene.json", "exr depth") else good
    # a whole bake of every scene that is still good would take most of the time, and minutes on a busy machine
    whole = good.read_bytes().replace(b"indirect = true", b"indirect = false")
    rng, codes = random.Random(f"{kind} {SEED}"), Counter[int]()
    environment = {**os.environ, "PYTHONWARNINGS": "default"}
    for number in range(COUNT // 40):
        good.write_bytes(damaged(whole, rng))
        command = [sys.executable, "-m", "slopegate.app", "render", str(scene), *GATE, "--json", "--out", "x.png"]
        done = subprocess.run(command, check=False, capture_output=True, cwd=tmp_path, env=environment, timeout=300)
        out, err = done.stdout.decode(), done.stderr.decode()
        codes[done.returncode] += 1
        assert done.returncode in (0, 2), f"{kind} {number}: {err}"
        if done.returncode:
            assert out == "", f"{kind} {number}"
            assert err.startswith("slopegate: ")
            assert err.endswith("\n")
            assert told_well(err.rstrip("\n").removeprefix("slopegate: ")) == "", f"{kind} {number}: {err}"
        else:
            json.loads(out)
    print(f"{kind}: {dict(codes)}")


def _exr_depth(folder: Path) -> Path:
    """A folder whose depth is an OpenEXR file: its library writes to standard output, past Python."""
    from slopegate.drivers.files.images import write_image

    photo = KINDS["photo png"].make(folder)
    (folder / "depth_mm.png").unlink()
    path = photo.with_name("depth_m.exr")
    write_image(path, ".exr", fuzzed.LIGHT.repeat(4, 0).repeat(4, 1) / 48 + 1)
    return path


EXR_DEPTH = fuzzed.Kind(_exr_depth, lambda path: None)


def test_a_library_that_speaks_is_not_heard_beside_json(tmp_path: Path) -> None:
    path = _exr_depth(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[:-40] + bytes(40))
    command = [sys.executable, "-m", "slopegate.app", "render", str(tmp_path), *GATE, "--json", "--out", "x.png"]
    done = subprocess.run(command, check=False, capture_output=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, b"")
    assert told_well(done.stderr.decode().removesuffix("\n").removeprefix("slopegate: ")) == ""
