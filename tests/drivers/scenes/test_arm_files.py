"""The shipped arm is what its script makes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / ".ci" / "arm"


def vertices(path: Path) -> np.ndarray:
    lines = path.read_text(encoding="utf-8").splitlines()
    return np.array([[float(value) for value in line.split()[1:]] for line in lines if line.startswith("v ")])


@pytest.mark.skipif(not SCRIPT.is_file(), reason="the script comes with a checkout only")
def test_the_script_makes_the_arm_that_is_shipped(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-P", str(SCRIPT), str(tmp_path)], check=True)
    shipped = ROOT / "resources" / "scenes"
    np.testing.assert_allclose(vertices(tmp_path / "arm.obj"), vertices(shipped / "arm.obj"), atol=2e-5)
    made, kept = (cv2.imread(str(folder / "arm_veins.png"), cv2.IMREAD_UNCHANGED) for folder in (tmp_path, shipped))
    assert made.shape == kept.shape == (720, 480)
    assert np.abs(made.astype(int) - kept).max() <= 2
