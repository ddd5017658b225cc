"""Every format of light transport is read back with what other programs would read it with."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import zarr

from made_transports import SHAPE, half_lit, made_transport
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.checks import InputError
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.transports.export import TRANSPORT_FORMATS, export_transport

OUT = {"exr": "t.exr", "zarr": "t.ome.zarr", "png": "t-png"}


@pytest.mark.parametrize("kind", TRANSPORT_FORMATS)
def test_an_export_appears_whole_or_not_at_all(tmp_path: Path, kind: str) -> None:
    folder, out, told = made_transport(tmp_path / "t"), tmp_path / OUT[kind], []

    def stop_late(share: float) -> bool:
        told.append(share)
        return len(told) < 3

    with pytest.raises(Cancelled):
        export_transport(folder, kind, out, stop_late)
    assert [path.name for path in tmp_path.iterdir()] == ["t"]
    assert export_transport(folder, kind, out) == 3
    assert {path.name for path in tmp_path.iterdir()} == {"t", OUT[kind]}


def test_openexr_has_a_layer_a_slice_and_their_sum(tmp_path: Path) -> None:
    folder, out = made_transport(tmp_path / "t"), tmp_path / "t.exr"
    export_transport(folder, "exr", out)
    with OpenEXR.File(str(out), separate_channels=True) as file:
        planes = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
        facts = json.loads(file.header()["slopegate"])
    assert set(planes) == {"Y", "white.Y", "slice_0000.Y", "slice_0001.Y", "slice_0002.Y"}
    assert np.array_equal(planes["slice_0000.Y"], half_lit(True).total)
    assert not planes["slice_0001.Y"].any()
    assert np.array_equal(planes["Y"], planes["white.Y"])
    assert facts["transport"]["grid"] == [4, 2]
    assert [item["empty"] for item in facts["slices"]] == [False, True, False]


def test_zarr_holds_the_transport_itself(tmp_path: Path) -> None:
    folder, out = made_transport(tmp_path / "t"), tmp_path / "z.ome.zarr"
    export_transport(folder, "zarr", out)
    group = zarr.open_group(str(out), mode="r")
    scales = group.attrs["ome"]["multiscales"][0]
    assert scales["datasets"][0]["path"] == "0"
    assert [axis["unit"] for axis in scales["axes"]][1:] == ["meter", "meter"]
    assert group.attrs["slopegate"]["transport"]["scene"] == "Two halves"
    assert np.array_equal(group["0"][:], [half_lit(True).total, np.zeros(SHAPE), half_lit(False).total])
    entries, wanted = group["transport/2/0"], half_lit(False).layers[0]
    assert dict(entries.attrs) == {"columns": 4, "rows": 2}
    for name in ("starts", "block", "value"):
        assert np.array_equal(entries[name][:], getattr(wanted, name))
    assert "transport/1" not in group


def test_previews_share_their_levels(tmp_path: Path) -> None:
    folder, out = made_transport(tmp_path / "t"), tmp_path / "p"
    export_transport(folder, "png", out)
    seen = [cv2.imread(str(out / f"slice_{index:04d}.png"), cv2.IMREAD_UNCHANGED) for index in range(3)]
    assert [picture.shape for picture in seen if picture is not None] == [SHAPE] * 3
    assert [picture.max() for picture in seen if picture is not None] == [255, 0, 188]  # the last: half of the light
    assert (out / "contact.png").is_file()


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    folder = made_transport(tmp_path / "t", taken=0)
    with pytest.raises(StorageError, match="no slice yet"):
        export_transport(folder, "exr", tmp_path / "t.exr")
    with pytest.raises(InputError, match="one of zarr, exr, png for light transport"):
        export_transport(folder, "ome-tiff", tmp_path / "t.tif")
    full = made_transport(tmp_path / "f")
    with pytest.raises(StorageError, match=r"must be one of \.exr"):
        export_transport(full, "exr", tmp_path / "t.tif")
    with pytest.raises(StorageError, match="exists already"):
        export_transport(full, "png", tmp_path / "f")
    with pytest.raises(StorageError, match="was not made by an export"):
        export_transport(full, "png", tmp_path / "f", overwrite=True)
