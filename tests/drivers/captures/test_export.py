"""Every format read back with the program that others use for it, bit for bit."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import cv2
import jsonschema
import numpy as np
import OpenEXR
import pytest
import tifffile
import zarr

from capture_schema import json_schema
from settings_inside import read_settings
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.settings import gate
from slopegate.drivers.captures.export import FORMATS, export_capture
from slopegate.drivers.captures.storage import CaptureFolder, create_capture
from slopegate.drivers.files.durable import StorageError
from small_capture import COUNT, SENSOR, camera, frame_of, lit_slices, record

from .test_storage import manifest, pixels
from .test_storage import record as record_of

OME = {"ome": "http://www.openmicroscopy.org/Schemas/OME/2016-06"}
OUT = {"ome-tiff": "slices.ome.tif", "zarr": "slices.ome.zarr", "exr": "exr", "png": "png", "json": "slices.json"}


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> CaptureFolder:
    """Four noisy frames a slice and a dark frame; slices without light left out."""
    return record(tmp_path_factory.mktemp("export") / "c", noise=True, frames=4, dark=True, skip_empty=True)[0]


def empty(capture: CaptureFolder) -> list[int]:
    return [index for index, item in capture.records().items() if item.empty]


def test_there_are_slices_of_both_kinds(capture: CaptureFolder) -> None:
    assert 0 < len(empty(capture)) < COUNT


def test_ome_tiff(capture: CaptureFolder, tmp_path: Path) -> None:
    out = tmp_path / "slices.ome.tif"
    assert export_capture(capture, "ome-tiff", out) == COUNT
    with tifffile.TiffFile(out) as image:
        assert image.is_ome
        series = image.series[0]
        assert [one.shape for one in image.series[1:]] == [(60, 80)], "the dark frame, as an image of its own"
        assert (series.axes, series.shape, series.dtype) == ("ZYX", (COUNT, 60, 80), np.dtype("uint16"))
        assert len(image.pages) == COUNT + 1, "one plane a slice"
        planes, xml = series.asarray(), image.ome_metadata
        np.testing.assert_array_equal(image.series[1].asarray(), capture.dark_total())
    for index in range(COUNT):
        if index in empty(capture):
            np.testing.assert_array_equal(planes[index], capture.dark_mean() * 4)
        else:
            np.testing.assert_array_equal(planes[index], capture.total(index))
    assert xml is not None
    root = ElementTree.fromstring(xml)
    described = root.find("ome:Image/ome:Pixels", OME)
    assert described is not None
    assert {key: described.get(key) for key in ("Type", "SizeX", "SizeY", "SizeZ", "SizeC", "SizeT")} == {
        "Type": "uint16", "SizeX": "80", "SizeY": "60", "SizeZ": str(COUNT), "SizeC": "1", "SizeT": "1",
    }  # fmt: skip
    of_planes = described.findall("ome:Plane", OME)
    records = capture.records()
    assert [int(plane.get("TheZ", "")) for plane in of_planes] == list(range(COUNT))
    assert [float(plane.get("ExposureTime", "")) for plane in of_planes] == [
        item.applied.exposure_us for item in records.values()
    ]
    assert {plane.get("ExposureTimeUnit") for plane in of_planes} == {"\u00b5s"}
    assert [float(plane.get("PositionZ", "")) for plane in of_planes] == pytest.approx(
        [item.slab.distance_m for item in records.values()]
    )
    assert {plane.get("PositionZUnit") for plane in of_planes} == {"m"}
    description = root.find("ome:Image/ome:Description", OME)
    assert description is not None
    facts = json.loads(description.text or "")
    assert facts.pop("steps_per_count") == 4
    at_m = facts.pop("pixel_size_at_m")
    distances = [item.slab.distance_m for item in records.values()]
    assert at_m == pytest.approx(np.median(distances))
    sizes = {axis: (described.get(f"PhysicalSize{axis}"), described.get(f"PhysicalSize{axis}Unit")) for axis in "XYZ"}
    assert {unit for _, unit in sizes.values()} == {"m"}
    lens = capture.rig.camera.lens
    assert float(sizes["X"][0] or "") == pytest.approx(at_m / lens.fx)
    assert float(sizes["Y"][0] or "") == pytest.approx(at_m / lens.fy)
    assert float(sizes["Z"][0] or "") == pytest.approx(abs(distances[-1] - distances[0]) / (COUNT - 1))
    assert facts == capture.sidecar.model_dump(mode="json")


def test_ome_tiff_of_many_frames_is_rounded_to_the_nearest_step(tmp_path: Path) -> None:
    folder = create_capture(tmp_path / "c", manifest(frames=100))
    total = pixels(3, 100 * 4095)
    total[0, 0], total[0, 1] = 100 * 4095, 0
    folder.write(record_of(0, 100), total)
    export_capture(folder, "ome-tiff", tmp_path / "o.tif")
    plane = tifffile.imread(tmp_path / "o.tif").reshape(60, 80)
    assert (plane[0, 0], plane[0, 1]) == (16 * 4095, 0)
    assert np.abs(plane - 16 * total / 100).max() <= 0.5 + 1e-2


def test_zarr(capture: CaptureFolder, tmp_path: Path) -> None:
    out = tmp_path / "slices.ome.zarr"
    assert export_capture(capture, "zarr", out) == COUNT
    group = zarr.open_group(str(out), mode="r")
    assert group.metadata.zarr_format == 3
    slices = group["0"]
    assert isinstance(slices, zarr.Array)
    assert (slices.shape, slices.chunks, slices.dtype) == ((COUNT, 60, 80), (1, 60, 80), np.dtype("uint16"))
    for index in set(range(COUNT)) - set(empty(capture)):
        np.testing.assert_array_equal(slices[index], capture.total(index))
    dark = group["dark"]
    assert isinstance(dark, zarr.Array)
    np.testing.assert_array_equal(dark[:], capture.dark_total())
    assert (slices.attrs["frames"], dark.attrs["frames"]) == (4, 4)
    attributes = json.loads((out / "zarr.json").read_text("utf-8"))["attributes"]
    scales = attributes["ome"]["multiscales"][0]
    assert scales["axes"] == [{"name": name, "type": "space", "unit": "meter"} for name in "zyx"]
    assert scales["datasets"][0]["path"] == "0"
    scale, moved = scales["datasets"][0]["coordinateTransformations"]
    distances = [item.slab.distance_m for item in capture.records().values()]
    assert scales["metadata"]["places"] == pytest.approx(distances)
    assert scale["scale"][0] * (COUNT - 1) + moved["translation"][0] == pytest.approx(distances[-1])
    assert scale["scale"][1:] == pytest.approx([np.median(distances) / capture.rig.camera.lens.fx] * 2)
    jsonschema.Draft202012Validator(json_schema()).validate(attributes["slopegate"])


def test_exr(capture: CaptureFolder, tmp_path: Path) -> None:
    assert export_capture(capture, "exr", tmp_path / "exr") == COUNT
    names = [f"slice_{index:04d}.exr" for index in range(COUNT)]
    assert sorted(path.name for path in (tmp_path / "exr").iterdir()) == ["dark.exr", *names]
    for index, name in enumerate(names):
        with OpenEXR.File(str(tmp_path / "exr" / name)) as image:
            found = image.channels()["Y"].pixels
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, capture.mean(index))
        facts = read_settings(tmp_path / "exr" / name)
        assert facts["record"] == capture.records()[index].model_dump(mode="json")
        assert facts["capture"]["rig_toml"] == capture.manifest.rig_toml
    with OpenEXR.File(str(tmp_path / "exr" / "dark.exr")) as image:
        np.testing.assert_array_equal(image.channels()["Y"].pixels, capture.dark_mean())


def test_exr_less_the_dark_frame_adds_up_to_the_floodlit_capture(tmp_path: Path) -> None:
    """The float path without noise: exact."""
    folder, _ = record(tmp_path / "c", frames=3, dark=True)
    export_capture(folder, "exr", tmp_path / "exr", subtract_dark=True)
    total = np.zeros((60, 80), np.float32)
    for index in range(COUNT):
        with OpenEXR.File(str(tmp_path / "exr" / f"slice_{index:04d}.exr")) as image:
            total += image.channels()["Y"].pixels
    source = camera()
    flood = frame_of(source, gate(lit_slices(source)[0].line_time_us, 0.0, 16667.0))
    np.testing.assert_array_equal(total, flood - np.float32(SENSOR.black_count))


def test_png(capture: CaptureFolder, tmp_path: Path) -> None:
    assert export_capture(capture, "png", tmp_path / "png") == COUNT
    names = [f"slice_{index:04d}.png" for index in range(COUNT)]
    assert sorted(path.name for path in (tmp_path / "png").iterdir()) == ["contact.png", *names]
    previews = [cv2.imread(str(tmp_path / "png" / name), cv2.IMREAD_UNCHANGED) for name in names]
    assert all(item.shape == (60, 80) and item.dtype == np.uint8 for item in previews)
    for index in empty(capture):
        assert previews[index].max() < 60
    lit = [index for index in range(COUNT) if index not in empty(capture)]
    assert max(previews[index].max() for index in lit) == 255
    light = np.concatenate([capture.mean(index).ravel() for index in lit])
    grey = np.concatenate([previews[index].ravel() for index in lit])
    order = np.argsort(light)
    assert (np.diff(grey[order].astype(int)) >= 0).all(), "one curve for all slices"
    sheet = cv2.imread(str(tmp_path / "png" / "contact.png"))
    assert sheet.shape[1] == 3 * 320
    assert sheet.shape[0] == 3 * (240 + 22)
    assert read_settings(tmp_path / "png" / names[0])["index"] == 0


def test_json_keeps_the_published_schema(capture: CaptureFolder, tmp_path: Path) -> None:
    export_capture(capture, "json", tmp_path / "slices.json")
    found = json.loads((tmp_path / "slices.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(json_schema()).validate(found)
    assert len(found["slices"]) == COUNT
    assert found["slices"][0]["applied"] == found["capture"]["slices"][0]


@pytest.mark.parametrize(
    ("kind", "first"), [("bayer_rg12", (0, 0)), ("bayer_gr8", (0, 1)), ("bayer_gb12", (1, 0)), ("bayer_bg16", (1, 1))]
)
def test_a_mosaic_has_coloured_previews(tmp_path: Path, kind: str, first: tuple[int, int]) -> None:
    """`first`: row and column of the first red pixel."""
    made = manifest()
    mosaic = made.model_copy(update={"camera": made.camera.model_copy(update={"pixel_format": kind})})
    folder = create_capture(tmp_path / "c", mosaic)
    red = np.full((60, 80), 40, np.uint32)
    red[first[0] :: 2, first[1] :: 2] = 3000
    folder.write(record_of(0), red)
    export_capture(folder, "png", tmp_path / "png")
    preview = cv2.imread(str(tmp_path / "png" / "slice_0000.png"), cv2.IMREAD_UNCHANGED)
    assert preview.shape == (60, 80, 3)
    assert preview[30, 40, 2] > 200
    assert preview[30, 40, 0] < 10


@pytest.mark.parametrize("kind", FORMATS)
def test_what_is_stopped_or_fails_leaves_nothing(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    if FORMATS[kind].needs_slices:
        with pytest.raises(Cancelled):
            export_capture(capture, kind, tmp_path / OUT[kind], progress=lambda share: share < 0.5)
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="there is no folder"):
        export_capture(capture, kind, tmp_path / "file" / OUT[kind])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("kind", FORMATS)
def test_nothing_is_overwritten_unless_so_told(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    out = tmp_path / OUT[kind]
    export_capture(capture, kind, out)
    before = {path: path.stat().st_ino for path in (out, *out.rglob("*"))}
    with pytest.raises(StorageError, match="exists already: take another name, or allow to overwrite it"):
        export_capture(capture, kind, out)
    assert {path: path.stat().st_ino for path in (out, *out.rglob("*"))} == before
    export_capture(capture, kind, out, overwrite=True)
    assert not set(before.values()) & {path.stat().st_ino for path in (out, *out.rglob("*"))}
    assert [path.name for path in tmp_path.iterdir()] == [OUT[kind]]


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind not in {"ome-tiff", "json"}])
def test_a_folder_that_no_export_made_is_never_overwritten(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    out = tmp_path / OUT[kind]
    out.mkdir()
    (out / "thesis.txt").write_text("years of work", "utf-8")
    with pytest.raises(StorageError, match="was not made by an export"):
        export_capture(capture, kind, out, overwrite=True)
    assert (out / "thesis.txt").exists()


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("ome-tiff", "slices.png", "slices.png has the suffix '.png': it must be one of .tif, .tiff"),
        ("json", "slices", "slices has the suffix '': it must be one of .json"),
        ("zarr", "slices.zarr", "slices.zarr: the name of the folder must end in .ome.zarr for the format zarr"),
    ],
)
def test_wrong_names_are_refused(capture: CaptureFolder, tmp_path: Path, kind: str, name: str, words: str) -> None:
    with pytest.raises(StorageError, match=words):
        export_capture(capture, kind, tmp_path / name)


def test_what_cannot_be_exported_is_said(capture: CaptureFolder, tmp_path: Path) -> None:
    folder = create_capture(tmp_path / "c", manifest())
    with pytest.raises(StorageError, match="has no slice yet"):
        export_capture(folder, "png", tmp_path / "png")
    folder.write(record_of(2), pixels(2))
    with pytest.raises(StorageError, match="no dark frame to subtract"):
        export_capture(folder, "exr", tmp_path / "exr", subtract_dark=True)
    with pytest.raises(StorageError, match="subtract_dark is for exr and png"):
        export_capture(capture, "zarr", tmp_path / "z", subtract_dark=True)
    assert export_capture(folder, "exr", tmp_path / "exr") == 1
    assert [path.name for path in (tmp_path / "exr").iterdir()] == ["slice_0002.exr"]
