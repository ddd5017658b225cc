"""The contract of `chart`: true to scale, found again in what it draws, refused where it does not fit."""

from __future__ import annotations

import re
import shutil
import subprocess
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from cli_calls import refusal, report
from slopegate.core.calibration.chart import Chart, chart_from, dark_parts, find_corners, picture

Capture = pytest.CaptureFixture[str]


def checked(chart: Chart, image: np.ndarray, dpi: float, within_px: float) -> None:
    """All corners are there, a square's side apart."""
    corners = find_corners(chart, image)
    assert corners is not None
    assert len(corners.index) == chart.count
    wanted = chart.points_m[corners.index, :2] * 1000 * dpi / 25.4
    # a checkerboard may be seen upside down; on the page it is neither turned nor scaled
    got = corners.points - corners.points.mean(axis=0)
    wanted = wanted - wanted.mean(axis=0)
    assert min(np.abs(got - wanted).max(), np.abs(got + wanted).max()) < within_px


@pytest.mark.parametrize(("text", "paper"), [("9x7:22", "a4"), ("charuco:7x5:25", "letter"), ("8x8:10", "a4")])
def test_a_picture_holds_its_chart_true_to_scale(capsys: Capture, tmp_path: Path, text: str, paper: str) -> None:
    path = tmp_path / "chart.png"
    told = report(capsys, "chart", text, "--out", str(path), "--paper", paper, "--dpi", "150")
    chart = chart_from(text)
    assert told["chart"] == str(chart)
    assert told["square_mm"] == pytest.approx(1000 * chart.square_m)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == tuple(round(side / 25.4 * 150) for side in reversed(told["paper_mm"]))
    checked(chart, np.asarray(image, np.uint8), 150, 0.25)
    data = path.read_bytes()
    dots = data.index(b"pHYs")
    assert int.from_bytes(data[dots + 4 : dots + 8], "big") == round(150 / 0.0254)
    # ink at the foot: the ruler, from the left margin on; the text stands to its right
    foot = np.flatnonzero(image[-round(8.15 / 25.4 * 150), : round(110 / 25.4 * 150)] < 128)
    assert (foot[-1] - foot[0] + 1) * 25.4 / 150 == pytest.approx(90 if text == "8x8:10" else 100, abs=0.4)


def test_a_pdf_has_the_paper_s_size_and_the_chart_s_squares(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "chart.pdf"
    assert report(capsys, "chart", "--out", str(path))["chart"] == "9x7:22"
    data = path.read_bytes()
    box = re.search(rb"/MediaBox \[\s*0 0 ([\d.]+) ([\d.]+)", data)
    assert box is not None
    assert [float(side) / 72 * 25.4 for side in box.groups()] == pytest.approx([297, 210], abs=0.3)
    drawn = b"".join(
        zlib.decompressobj().decompress(part)
        for part in re.findall(rb"stream\r?\n(.*?)endstream", data, re.S)
        if part[:1] == b"x"
    )
    squares = [tuple(map(float, one)) for one in re.findall(rb"([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re", drawn)]
    sides = [size[2] for size in squares if size[2] == pytest.approx(size[3])]
    assert len(sides) == 40


@pytest.mark.skipif(shutil.which("gs") is None, reason="ghostscript is not here to draw the PDF")
@pytest.mark.parametrize("text", ["9x7:22", "charuco:7x5:25"])
def test_a_pdf_that_another_program_draws_holds_its_chart(capsys: Capture, tmp_path: Path, text: str) -> None:
    path, drawn = tmp_path / "chart.pdf", tmp_path / "drawn.png"
    report(capsys, "chart", text, "--out", str(path))
    words = ["gs", "-q", "-dNOPAUSE", "-dBATCH", "-sDEVICE=pnggray", "-r150", f"-sOutputFile={drawn}", str(path)]
    subprocess.run(words, check=True, timeout=60)
    checked(chart_from(text), np.asarray(cv2.imread(str(drawn), cv2.IMREAD_GRAYSCALE), np.uint8), 150, 0.7)


@pytest.mark.parametrize("text", ["6x5:30", "charuco:6x5:30:20:5x5_50"])
def test_rectangles_and_pixels_draw_the_same_chart(text: str) -> None:
    chart = chart_from(text)
    pixels = 210
    drawn = np.full((pixels * (chart.rows + 1), pixels * (chart.columns + 1)), 255, np.uint8)
    for left, top, width, height in dark_parts(chart) / chart.square_m * pixels:
        drawn[round(top) : round(top + height), round(left) : round(left + width)] = 0
    assert (drawn != picture(chart, pixels)).mean() < 2e-3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["9x7:75"], "chart 9x7:75 is 750 x 600 mm and does not fit a4 (210 x 297 mm) with its border: 9x7:22 would"),
        (["9x7:75"], ", and paper a0 would"),
        (["9x7:22", "--paper", "a5"], "9x7:15 would, and paper a4 would"),
        (["9x7:22", "--paper", "60x60"], "does not fit 60x60 (60 x 60 mm) with its border: 9x7:4 would"),
        (["charuco:9x7:40"], "charuco:9x7:22:15.4:4x4_50 would"),
        (["90x70:75"], "paper of 6841x5353 would"),
        (["--paper", "foolscap"], "paper is 'foolscap': it must be one of a4, a3"),
        (["--paper", "0x100"], "paper is '0x100': it must be one of"),
        (["2x7:22"], "chart columns is 2: it must be from 3 to 100 inner corners"),
        (["9 by 7"], "chart is '9 by 7': it must be COLUMNSxROWS:SQUARE_MM"),
        (["9x7:0"], "chart square_m is 0.0: it must be a finite number above 0"),
        (["charuco:9x7:20:21"], "chart marker_m is 0.021: it must be above 0 and below the square's 0.02 m"),
        (["charuco:30x30:5:3:4x4_50"], "chart dictionary is '4x4_50': it must be one of at least 480 markers"),
        (["--dpi", "3000"], "3000 must be a number from 50 to 2400"),
        (["9x7:100", "--paper", "a0", "--dpi", "2400"], "dpi is 2400.0: it must be at most 641 for this paper"),
    ],
)
def test_what_cannot_be_drawn_is_refused(capsys: Capture, tmp_path: Path, words: list[str], said: str) -> None:
    path = tmp_path / "chart.png"
    assert said in refusal(capsys, "chart", *words, "--out", str(path))
    assert not path.exists()


def test_a_chart_needs_a_file_that_is_not_there_yet(capsys: Capture, tmp_path: Path) -> None:
    assert "has the suffix '.jpg': it must be one of .pdf, .png" in refusal(
        capsys, "chart", "--out", str(tmp_path / "chart.jpg")
    )
    (tmp_path / "chart.pdf").write_text("mine")
    assert "exists already" in refusal(capsys, "chart", "--out", str(tmp_path / "chart.pdf"))
    assert report(capsys, "chart", "--out", str(tmp_path / "chart.pdf"), "--overwrite")["dpi"] is None
    assert (tmp_path / "chart.pdf").read_bytes().startswith(b"%PDF")
