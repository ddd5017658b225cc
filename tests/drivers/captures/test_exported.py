"""What a capture was exported to opens again, with the counts that were captured."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from slopegate.drivers.captures.export import export_capture
from slopegate.drivers.captures.exported import ExportedCapture, is_exported, open_any
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.storage import CaptureFolder, create_capture, open_capture
from slopegate.drivers.captures.summary import summarise
from slopegate.drivers.files.durable import StorageError
from small_capture import COUNT, record

from .test_storage import manifest, pixels
from .test_storage import record as record_of

OUT = {"ome-tiff": "slices.ome.tif", "zarr": "slices.ome.zarr"}
kinds = pytest.mark.parametrize("kind", OUT)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> CaptureFolder:
    """Four noisy frames a slice and a dark frame; slices without light left out."""
    return record(tmp_path_factory.mktemp("exported") / "c", noise=True, frames=4, dark=True, skip_empty=True)[0]


def exported(capture: CaptureFolder, kind: str, folder: Path) -> Path:
    out = folder / OUT[kind]
    export_capture(capture, kind, out)
    return out


@kinds
def test_it_is_the_capture(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    out = exported(capture, kind, tmp_path)
    assert is_exported(out)
    found = open_any(out)
    assert isinstance(found, ExportedCapture)
    assert found.sidecar == capture.sidecar
    assert found.rig == capture.rig
    assert (found.missing(), found.unfinished()) == ([], "")
    np.testing.assert_array_equal(found.dark_mean(), capture.dark_mean())
    everything = list(range(COUNT))
    for index, one in capture.records().items():
        np.testing.assert_array_equal(found.mean(index), capture.mean(index))
        if not one.empty:
            np.testing.assert_array_equal(found.total(index), capture.total(index))
    np.testing.assert_array_equal(found.pixel_means(everything, 30, 40), capture.pixel_means(everything, 30, 40))
    ours, theirs = summarise(found), summarise(capture)
    np.testing.assert_array_equal(ours.inverse_depth, theirs.inverse_depth)
    assert PlaybackCamera(found).settings == PlaybackCamera(capture).settings


@kinds
def test_an_export_of_an_export_is_the_same(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    (tmp_path / "again").mkdir()
    first = exported(capture, kind, tmp_path)
    second = tmp_path / "again" / OUT[kind]
    export_capture(open_any(first), kind, second)
    for index in range(COUNT):
        np.testing.assert_array_equal(open_any(second).mean(index), capture.mean(index))


@kinds
def test_an_unfinished_capture_stays_unfinished(tmp_path: Path, kind: str) -> None:
    folder = create_capture(tmp_path / "c", manifest())
    folder.write(record_of(2), pixels(2))
    found = open_any(exported(folder, kind, tmp_path))
    assert list(found.records()) == [2]
    assert found.missing() == folder.missing()
    np.testing.assert_array_equal(found.total(2), folder.total(2))
    assert found.dark_record() is None
    assert (found.dark_mean() == folder.manifest.camera.black_count).all()


def test_sums_of_many_frames_come_back_to_half_a_step(tmp_path: Path) -> None:
    """16 steps a count of 100 frames: a sum is right to 100 / 16 / 2 counts and a rounding, a mean to 1 / 32."""
    folder = create_capture(tmp_path / "c", manifest(frames=100))
    total = pixels(3, 100 * 4095)
    folder.write(record_of(0, 100), total)
    found = open_any(exported(folder, "ome-tiff", tmp_path))
    assert np.abs(found.total(0) - total.astype(float)).max() <= 100 / 16 / 2 + 0.5 + 1e-6
    assert np.abs(found.mean(0) - folder.mean(0)).max() <= 1 / 32 + 0.005 + 1e-6


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_the_dark_of_16_bit_counts_comes_back_to_half_a_step(tmp_path: Path, frames: int) -> None:
    """Two dark frames of 16 bits do not fit into 16 bits, even where one frame of a slice does."""
    made = manifest(frames=frames, dark=True)
    deep = made.camera.model_copy(update={"pixel_format": "mono16", "max_count": 65535})
    folder = create_capture(tmp_path / "c", made.model_copy(update={"camera": deep}))
    folder.write(record_of(0, frames), pixels(1, frames * 65535))
    folder.write(record_of(None, folder.manifest.dark_frames), pixels(2, folder.manifest.dark_frames * 65535))
    found = open_any(exported(folder, "ome-tiff", tmp_path))
    assert np.abs(found.dark_mean() - folder.dark_mean()).max() <= 0.5 + 0.01
    assert np.abs(found.mean(0) - folder.mean(0)).max() <= 0.5 + 0.01


def test_a_mean_within_half_a_step_is_not_a_sum_that_is_exact(tmp_path: Path) -> None:
    folder = create_capture(tmp_path / "c", manifest(frames=100))
    folder.write(record_of(0, 100), pixels(3, 100 * 4095))
    found = open_any(exported(folder, "zarr", tmp_path))
    np.testing.assert_array_equal(found.total(0), folder.total(0))


@kinds
def test_changed_pixels_are_noticed(capture: CaptureFolder, tmp_path: Path, kind: str) -> None:
    out = exported(capture, kind, tmp_path)
    lit = next(index for index, one in capture.records().items() if not one.empty)
    if kind == "zarr":
        chunk = next(path for path in (out / "0" / "c" / str(lit)).rglob("*") if path.is_file())
        shutil.copy(next(p for p in (out / "0" / "c" / str(lit + 1)).rglob("*") if p.is_file()), chunk)
    else:
        planes = tifffile.memmap(out, series=0)
        planes[lit, 5, 5] += 1
        planes.flush()
    found = open_any(out)
    with pytest.raises(StorageError, match="its pixels are not those that were written"):
        found.total(lit)


def test_what_is_cut_short_is_refused(capture: CaptureFolder, tmp_path: Path) -> None:
    out = exported(capture, "ome-tiff", tmp_path)
    data = out.read_bytes()
    out.write_bytes(data[: len(data) // 2])
    with pytest.raises(StorageError, match="damaged"):
        open_any(out)
    other = exported(capture, "zarr", tmp_path)
    shutil.rmtree(other / "0")
    with pytest.raises(StorageError, match="damaged, cut short, or was written anew"):
        open_any(other)


def test_planes_that_do_not_fit_the_facts_are_refused(capture: CaptureFolder, tmp_path: Path) -> None:
    out = exported(capture, "zarr", tmp_path)
    group = json.loads((out / "zarr.json").read_text("utf-8"))
    del group["attributes"]["slopegate"]["slices"][0]
    (out / "zarr.json").write_text(json.dumps(group), "utf-8")
    with pytest.raises(StorageError, match="it was changed after it was exported"):
        open_any(out)
    group["attributes"]["slopegate"]["capture"]["frames"] = "many"
    (out / "zarr.json").write_text(json.dumps(group), "utf-8")
    with pytest.raises(StorageError, match=r"cannot be used: capture.frames"):
        open_any(out)


@pytest.mark.parametrize("steps", [0, -1, 1.5, "many", True])
def test_steps_that_are_no_number_of_them_are_refused(capture: CaptureFolder, tmp_path: Path, steps: Any) -> None:
    out = exported(capture, "zarr", tmp_path)
    group = json.loads((out / "zarr.json").read_text("utf-8"))
    group["attributes"]["slopegate"]["steps_per_count"] = steps
    (out / "zarr.json").write_text(json.dumps(group), "utf-8")
    with pytest.raises(StorageError, match=r"steps_per_count is .*: it must be a whole number above 0"):
        open_any(out)


@pytest.mark.parametrize("frames", [0, 3])
def test_a_slice_of_other_frames_is_no_mean(capture: CaptureFolder, tmp_path: Path, frames: int) -> None:
    lit = next(index for index, one in capture.records().items() if not one.empty)
    shutil.copytree(capture.path, tmp_path / "c")
    path = tmp_path / "c" / f"slice_{lit:04d}.tif"
    path.write_bytes(path.read_bytes().replace(b'"frames": 4, "empty"', b'"frames": %d, "empty"' % frames))
    with pytest.raises(StorageError, match=f"has no slice {lit}"):
        open_capture(tmp_path / "c").mean(lit)
    out = exported(capture, "zarr", tmp_path)
    group = json.loads((out / "zarr.json").read_text("utf-8"))
    next(one for one in group["attributes"]["slopegate"]["slices"] if one["index"] == lit)["frames"] = frames
    (out / "zarr.json").write_text(json.dumps(group), "utf-8")
    with pytest.raises(StorageError, match="slices of more or fewer frames than its capture"):
        open_any(out)


def test_a_damaged_export_is_refused_without_a_log_line(capture: CaptureFolder, tmp_path: Path) -> None:
    """In a process that has read nothing yet, which is when libraries say most."""
    out = exported(capture, "ome-tiff", tmp_path)
    out.write_bytes(out.read_bytes()[:2000])
    lines = "from pathlib import Path; from slopegate.drivers.captures.exported import is_exported; import sys"
    command = [sys.executable, "-c", f"{lines}; print(is_exported(Path(sys.argv[1])))", str(out)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("False\n", "")


def test_a_chunk_that_could_unpack_to_anything_is_refused(capture: CaptureFolder, tmp_path: Path) -> None:
    out = exported(capture, "zarr", tmp_path)
    array = json.loads((out / "0" / "zarr.json").read_text("utf-8"))
    array["chunk_grid"]["configuration"]["chunk_shape"] = [100_000, 100_000, 100_000]
    (out / "0" / "zarr.json").write_text(json.dumps(array), "utf-8")
    with pytest.raises(StorageError, match="was written anew by another program"):
        open_any(out)


def test_other_files_and_folders_are_no_exports(capture: CaptureFolder, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "photo.tif", np.zeros((4, 4), np.uint8))
    tifffile.imwrite(tmp_path / "other.ome.tif", np.zeros((2, 4, 4), np.uint8), ome=True)
    (tmp_path / "empty.ome.zarr").mkdir()
    (tmp_path / "cut.tif").write_bytes(b"II*\0")
    for name in ("photo.tif", "other.ome.tif", "empty.ome.zarr", "cut.tif", "missing.tif"):
        assert not is_exported(tmp_path / name)
    with pytest.raises(StorageError, match=r"photo.tif is no capture and no OME-TIFF that one"):
        open_any(tmp_path / "photo.tif")
    assert not is_exported(capture.path)
    assert isinstance(open_any(capture.path), CaptureFolder)


@pytest.mark.skipif(os.name == "nt", reason="there are no pipes in folders")
def test_a_chunk_that_is_a_pipe_or_a_device_is_not_read(capture: CaptureFolder, tmp_path: Path) -> None:
    out = exported(capture, "zarr", tmp_path)
    chunk = next(item for item in (out / "0" / "c").rglob("*") if item.is_file())
    chunk.unlink()
    os.mkfifo(chunk)
    with pytest.raises(StorageError, match="is damaged"):
        open_any(out)
    chunk.unlink()
    chunk.symlink_to("/dev/zero")
    with pytest.raises(StorageError, match="is damaged"):
        open_any(out)
