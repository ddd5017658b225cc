"""The examples that ship run as they are, and leave what they say."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np

import notebook

EXAMPLES = Path(str(files("slopegate.resources"))) / "examples"
SCRIPTS = {
    "first_gate.py": "gated.png rest.png lit.png",
    "mask_an_object.py": "before.png after.png",
    "sweep_to_depth.py": "depth.npy depth.png",
    "record_slices.py": "capture slices.png",
    "own_camera.py": "stripes.png",
}


def test_every_example_is_tried_and_listed() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == {*SCRIPTS, "__init__.py"}
    listed = (EXAMPLES / "README.md").read_text("utf-8")
    assert all(f"[{name}]({name})" in listed for name in (*SCRIPTS, notebook.NOTEBOOK.name))
    assert list(EXAMPLES.glob("*.ipynb")) == [notebook.NOTEBOOK]


def run(name: str, folder: Path) -> str:
    """What the script says; a warning of Python's is an error."""
    words = [sys.executable, "-W", "error", str(EXAMPLES / name), str(folder)]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=280)
    assert (done.returncode, done.stderr) == (0, "")
    assert {path.name for path in folder.iterdir()} == set(SCRIPTS[name].split())
    return done.stdout


def picture(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image.astype(np.float64)


def test_the_first_gate_and_the_rest_make_the_lit_image(tmp_path: Path) -> None:
    folder = tmp_path / "made" / "by it"
    assert "got 15.26, at 1.050 m" in run("first_gate.py", folder)
    gated, rest, lit = (picture(folder / f"{name}.png") for name in ("gated", "rest", "lit"))
    assert np.abs(gated + rest - 16 * 40 - lit).mean() < 16 * 40  # in counts: the noise of three frames
    assert 0.02 < ((gated > 16 * 400) & (lit > 16 * 400)).mean() < 0.5


def test_the_masked_object_is_gone(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    assert "overlap with the region" in run("mask_an_object.py", folder)
    before, after = (picture(folder / f"{name}.png")[300:700, 680:920] for name in ("before", "after"))
    assert after.mean() < 0.2 * before.mean()


def test_the_sweep_measures_depth(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    assert "settings of the gate; equal steps would take" in run("sweep_to_depth.py", folder)
    depth_m = np.load(folder / "depth.npy")
    assert depth_m.dtype == np.float32
    assert 0.5 < np.nanmin(depth_m) < 1.1 < np.nanmax(depth_m) < 3
    assert picture(folder / "depth.png").shape == (*depth_m.shape, 3)


def test_slices_are_recorded_and_read(tmp_path: Path) -> None:
    said = run("record_slices.py", tmp_path)
    assert said.count("slice at ") == 12
    assert (tmp_path / "capture" / "capture.json").is_file()
    assert picture(tmp_path / "slices.png").max() > 200


def test_the_notebook_runs_and_holds_what_it_shows(tmp_path: Path) -> None:
    results = notebook.run(notebook.NOTEBOOK, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"targets", "layers.exr"}
    printed = "".join(text for text, _ in results)
    frames = {name: int(count) for name, count in re.findall(r"(\w+): (\d+) frames at most", printed)}
    assert frames["adaptive"] < frames["hadamard"] / 5
    assert "5 slices exported" in printed
    cells = [cell for cell in json.loads(notebook.NOTEBOOK.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    kept = [[output["output_type"] for output in cell["outputs"]] for cell in cells]
    assert kept == [[output["output_type"] for output in notebook.outputs(*result)] for result in results]
    pictures = [cv2.imdecode(np.frombuffer(data, np.uint8), -1) for _, shown in results for data in shown]
    assert len(pictures) == 5
    assert all(picture is not None and np.ptp(picture) > 100 for picture in pictures)


def test_a_camera_of_ones_own_runs(tmp_path: Path) -> None:
    """That it keeps the contract is tried with the other cameras, in tests/drivers/contract."""
    assert "was made with GateSettings" in run("own_camera.py", tmp_path)
    assert picture(tmp_path / "stripes.png").std() > 1000


def test_a_camera_of_ones_own_takes_sixty_lines() -> None:
    code = (EXAMPLES / "own_camera.py").read_text("utf-8").split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= 60
