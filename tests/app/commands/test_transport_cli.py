"""`slopegate transport`, `relight`, `composite` and the export of it: what they tell, and every refusal."""

from __future__ import annotations

from pathlib import Path

import OpenEXR
import pytest

from cli_calls import refusal, report
from made_transports import made_transport

Capture = pytest.CaptureFixture[str]


def test_light_transport_is_exported(capsys: Capture, tmp_path: Path) -> None:
    made_transport(tmp_path / "t", taken=2)
    export = ["export", str(tmp_path / "t"), "--format", "exr", "--out", str(tmp_path / "t.exr")]
    told = report(capsys, *export)
    assert (told["slices"], told["missing"], told["format"]) == (2, [2], "exr")
    with OpenEXR.File(str(tmp_path / "t.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {"Y", "white.Y", "slice_0000.Y", "slice_0001.Y"}
    assert "one of zarr, exr, png for light transport" in refusal(capsys, *export[:3], "ome-tiff", *export[4:])
    assert "no dark left to subtract" in refusal(capsys, *export, "--subtract-dark")
