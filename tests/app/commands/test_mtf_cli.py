"""The contract of `mtf`: every kind of file, published figures, refusals in a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.special import erf

from cli_calls import refusal, report
from slopegate.app.cli import main
from slopegate.drivers.files.images import save_image

Capture = pytest.CaptureFixture[str]


def edge(sigma_px: float = 1.5) -> np.ndarray:
    """An edge 5 degrees off vertical in a picture of 120 x 100 pixels, 0.1 to 0.7."""
    y, x = np.mgrid[:100, :120] + 0.5
    across = (x - 60) * np.cos(np.radians(5)) + (y - 50) * np.sin(np.radians(5))
    return (0.4 + 0.3 * erf(across / (sigma_px * np.sqrt(2)))).astype(np.float32)


@pytest.mark.parametrize("suffix", [".npy", ".exr", ".tif", ".png"])
@pytest.mark.parametrize("colour", [False, True])
def test_every_file_that_the_program_writes_is_measured_alike(
    capsys: Capture, tmp_path: Path, suffix: str, colour: bool
) -> None:
    path = tmp_path / f"edge{suffix}"
    image = edge() if suffix in {".npy", ".exr"} else (edge() * 4095).round().astype(np.uint16)
    save_image(path, np.repeat(image[:, :, None], 3, axis=2) if colour else image)
    found = report(capsys, "mtf", str(path), "--region", "10", "5", "110", "95")
    assert found["mtf50_cy_per_px"] == pytest.approx(0.18739 / 1.5, rel=0.01)
    assert found["edge_angle_deg"] == pytest.approx(5, abs=0.02)
    assert found["edge"] == "vertical"
    assert "ISO 12233" in found["method"]
    curve = found["curve"]
    assert len(curve["frequency_cy_per_px"]) == len(curve["mtf"]) > 50
    assert curve["mtf"][0] == 1
    assert found["warnings"] == []


def test_colours_count_by_their_luminance(capsys: Capture, tmp_path: Path) -> None:
    """Green is sharp, red and blue are not: each alone, then as the eye weighs them."""
    planes = [edge(3.0), edge(1.0), edge(3.0)]
    save_image(tmp_path / "colour.exr", np.stack(planes, axis=2))
    save_image(tmp_path / "grey.npy", 0.2848 * planes[0] + 0.7152 * planes[1])
    found = [
        report(capsys, "mtf", str(tmp_path / name), "--region", "10", "5", "110", "95")["mtf50_cy_per_px"]
        for name in ("colour.exr", "grey.npy")
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-4)


def test_published_figures_are_met(capsys: Capture, shared: Callable[[str], Path]) -> None:
    folder = shared("data/mtf")
    found = report(capsys, "mtf", str(folder / "h_edge.tif"), "--region", "0", "0", "300", "125")
    assert found["mtf50_cy_per_px"] == pytest.approx(0.1980, rel=0.01)
    assert found["edge"] == "horizontal"
    words = ["mtf", str(folder / "slant_uonder.png"), "--region", "0", "0", "141", "225"]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "0.474" in out
    assert "of the region's pixels are 255" in err


def test_saturation_is_warned_of_or_refused(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "edge.png"
    save_image(path, np.minimum(edge() * 8000, 4095).astype(np.uint16))
    words = ["mtf", str(path), "--region", "10", "5", "110", "95"]
    (warning,) = report(capsys, *words)["warnings"]
    assert "pixels are 4095" in warning
    assert "region is 'saturated in" in refusal(capsys, *words, "--full-scale", "4095")
    assert report(capsys, *words, "--full-scale", "8191")["warnings"] == []


@pytest.mark.parametrize(
    ("name", "region", "said"),
    [
        ("edge.npy", "10 5 121 95", "region is (10, 5, 121, 95): it must be x0, y0, x1, y1"),
        ("edge.npy", "10 5 10 95", "inside the image of 120 x 100 pixels"),
        ("edge.npy", "0 0 40 100", "no single straight edge"),
        ("edge.npy", "10 5 110 15", "at least 16 x 16 pixels"),
        ("none.png", "0 0 40 100", "none.png is missing"),
        ("edge.doc", "0 0 40 100", "edge.doc is no picture that can be read"),
        ("broken.exr", "0 0 40 100", "broken.exr cannot be decoded"),
        ("cube.npy", "0 0 40 100", "cube.npy has shape (4, 5, 6)"),
    ],
)
def test_mtf_refuses_in_a_sentence(capsys: Capture, tmp_path: Path, name: str, region: str, said: str) -> None:
    save_image(tmp_path / "edge.npy", edge())
    (tmp_path / "edge.doc").write_text("a")
    (tmp_path / "broken.exr").write_text("a")
    np.save(tmp_path / "cube.npy", np.zeros((4, 5, 6)))
    assert said in refusal(capsys, "mtf", str(tmp_path / name), "--region", *region.split())
