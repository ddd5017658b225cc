"""Captures on disk: what is written comes back bit for bit, and damage is never taken for data."""

from __future__ import annotations

import errno
import io
import json
import struct
import subprocess
import sys
import threading
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import tifffile
from filelock import FileLock
from numpy.typing import NDArray

from capture_schema import json_schema
from rigs import calibrated
from slopegate.core.rig.settings import gate
from slopegate.drivers.captures.model import Gate, Manifest, SlabFacts, SliceRecord
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.storage import (
    LOCK,
    CaptureFolder,
    claim,
    create_capture,
    is_capture,
    make_manifest,
    open_capture,
)
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.rig_files import rig_to_toml
from small_capture import RIG

INFO = CameraInfo("a camera", 80, 60, "mono12", 4095, 40.0, RIG.camera.shutter)
GATES = tuple(gate(250.0, 1000.0 + 0.1 * index, 300.0) for index in range(4))


def manifest(frames: int = 1, dark: bool = False, skip_empty: bool = False) -> Manifest:
    return make_manifest("A sc\u00e8ne", RIG, INFO, GATES, frames, dark, skip_empty)


def record(index: int | None, frames: int = 1, empty: bool = False) -> SliceRecord:
    asked = Gate.of(GATES[index or 0])
    where = SlabFacts(tilt_deg=1 / 3, distance_m=None, near_m=1.0, far_m=None, thickness_m=None)
    return SliceRecord(
        index=index,
        asked=asked,
        applied=asked,
        slab=where,
        frames=frames,
        empty=empty,
        saturated_share=0.25,
        started="2026-01-01T00:00:00+00:00",
        ended="2026-01-01T00:00:01+00:00",
        first_time_s=0.1,
        last_time_s=0.7,
        first_sequence=3,
        last_sequence=9,
        lost=1,
        duplicated=2,
        discarded=3,
    )


def pixels(seed: int, most: int = 4095) -> NDArray[np.uint32]:
    return np.random.default_rng(seed).integers(0, most + 1, (60, 80)).astype(np.uint32)


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    return create_capture(tmp_path / "new" / "capture", manifest())


def test_what_is_written_comes_back_bit_for_bit(folder: CaptureFolder) -> None:
    for index in (2, 0):
        folder.write(record(index), pixels(index))
    found = open_capture(folder.path)
    assert found.manifest == folder.manifest
    assert found.rig == RIG
    assert list(found.records()) == [0, 2]
    assert found.missing() == [1, 3]
    for index in (0, 2):
        total = found.total(index)
        assert total.dtype == np.uint16
        np.testing.assert_array_equal(total, pixels(index))
        kept = found.records()[index]
        assert kept == record(index).model_copy(update={"crc32": kept.crc32})
        assert kept.asked.settings() == GATES[index]
    assert open_capture(folder.path / "capture.json").manifest == found.manifest


def test_a_capture_keeps_how_well_its_rig_is_known(tmp_path: Path) -> None:
    known = calibrated(RIG)
    create_capture(tmp_path / "c", make_manifest("A scene", known, INFO, GATES, 1, False, False))
    found = open_capture(tmp_path / "c").rig
    assert found == RIG
    assert found.calibration == known.calibration


@pytest.mark.parametrize(("frames", "kind"), [(16, np.uint16), (17, np.uint32), (10_000, np.uint32)])
def test_sums_are_never_cut(tmp_path: Path, frames: int, kind: type) -> None:
    folder = create_capture(tmp_path / "c", manifest(frames))
    total = pixels(1, frames * 4095)
    total[0, 0] = frames * 4095
    folder.write(record(0, frames), total)
    assert folder.total(0).dtype == kind
    np.testing.assert_array_equal(folder.total(0), total)
    np.testing.assert_allclose(folder.mean(0), total / frames, rtol=1e-7)
    assert folder.mean(0).dtype == np.float32


def test_a_slice_alone_says_what_it_is(folder: CaptureFolder) -> None:
    folder.write(record(1), pixels(1))
    with tifffile.TiffFile(folder.path / "slice_0001.tif") as image:
        np.testing.assert_array_equal(image.asarray(), pixels(1))
        facts = json.loads(image.pages.first.description)
    assert facts["record"]["asked"] == {"line_time_us": 250.0, "delay_us": 1000.1, "exposure_us": 300.0}
    assert facts["capture"]["rig_toml"] == rig_to_toml(RIG)
    assert facts["capture"]["camera"]["name"] == "a camera"
    assert facts["capture"]["software"].startswith("slopegate ")
    assert facts["capture"]["scene"] == "A sc\u00e8ne"


def test_the_dark_frame_and_slices_without_light(tmp_path: Path) -> None:
    folder = create_capture(tmp_path / "c", manifest(skip_empty=True))
    assert folder.manifest.dark
    assert (folder.dark_mean() == 40).all()
    assert folder.dark_total() is None
    folder.write(record(None, frames=2), pixels(7))
    folder.write(record(3, frames=0, empty=True), None)
    np.testing.assert_array_equal(folder.dark_mean(), (pixels(7) / 2).astype(np.float32))
    np.testing.assert_array_equal(folder.mean(3), folder.dark_mean())
    assert folder.missing() == [0, 1, 2]
    with pytest.raises(StorageError, match=r"slice_0003.tif is missing or damaged"):
        folder.total(3)
    with pytest.raises(StorageError, match=r"has no slice 1: 3 of 4 are missing"):
        folder.mean(1)


@pytest.mark.parametrize("cut", [0, 7, 200, -1])
def test_a_cut_file_counts_as_not_taken_or_is_refused(folder: CaptureFolder, cut: int) -> None:
    folder.write(record(0), pixels(0))
    path = folder.path / "slice_0000.tif"
    path.write_bytes(path.read_bytes()[:cut])
    found = open_capture(folder.path)
    if found.missing() == [0, 1, 2, 3]:
        return
    with pytest.raises(StorageError, match=r"slice_0000.tif is damaged"):
        found.total(0)


def test_a_changed_pixel_is_refused(folder: CaptureFolder) -> None:
    folder.write(record(0), pixels(0))
    path = folder.path / "slice_0000.tif"
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    with pytest.raises(StorageError, match="its pixels are not those that were written"):
        open_capture(folder.path).total(0)


@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"tile": (16384, 16384)}])
def test_a_small_slice_cannot_ask_for_much(folder: CaptureFolder, options: dict[str, Any]) -> None:
    """A slice of 900 megapixels in a few kB is refused before it is decoded; so are tiles beyond the image."""
    folder.write(record(0), pixels(0))
    path = folder.path / "slice_0000.tif"
    with tifffile.TiffFile(path) as file:
        text = file.pages.first.description
    data = tiff_with_size(text, (60, 80) if "tile" in options else (30000, 30000), options)
    path.write_bytes(data)
    assert len(data) < 2_000_000
    words = (
        "is damaged, its pixels|has 30000 x 30000 pixels of uint16: the capture's images have 80 x 60|another program"
    )
    with pytest.raises(StorageError, match=words):
        open_capture(folder.path).total(0)
    if not options:
        with pytest.raises(StorageError, match=r"slice_0000.tif is damaged"):
            open_capture(folder.path).pixel_means([0], 5, 5)


def tiff_with_size(text: str, shape: tuple[int, int], options: dict[str, Any]) -> bytes:
    """A TIFF of 16 bits whose header says this shape, and that holds next to nothing."""
    data = io.BytesIO()
    layout = {"tile": (16, 16)} if options else {"rowsperstrip": 60}
    tifffile.imwrite(data, np.zeros((60, 80), np.uint16), description=text, metadata=None, compression="zlib", **layout)
    sizes = {256: shape[1], 257: shape[0]}
    if options:
        sizes |= {322: options["tile"][1], 323: options["tile"][0]}
    with tifffile.TiffFile(io.BytesIO(data.getvalue())) as file:
        places = {code: (file.pages.first.tags[code].valueoffset, file.pages.first.tags[code].dtype) for code in sizes}
    out = bytearray(data.getvalue())
    for code, (place, kind) in places.items():
        struct.pack_into("<H" if int(kind) == 3 else "<I", out, place, sizes[code])
    return bytes(out)


def test_a_damaged_slice_is_taken_again(folder: CaptureFolder, capfd: pytest.CaptureFixture[str]) -> None:
    (folder.path / "slice_0002.tif").write_bytes(b"no tiff")
    (folder.path / "slice_0001.empty.json").write_text("{}")
    assert folder.missing() == [0, 1, 2, 3]
    assert capfd.readouterr().err == "", "damage is told in sentences, not by a library"
    folder.write(record(2), pixels(2))
    np.testing.assert_array_equal(folder.total(2), pixels(2))


@pytest.mark.parametrize("skip_empty", [False, True])
def test_a_damaged_dark_frame_is_taken_again(tmp_path: Path, skip_empty: bool) -> None:
    folder = create_capture(tmp_path / "c", manifest(dark=True, skip_empty=skip_empty))
    folder.write(record(None, frames=2), pixels(7))
    path = folder.path / "dark.tif"
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    again = open_capture(folder.path)
    with pytest.raises(StorageError, match=r"dark.tif is damaged, its pixels are not those that were written"):
        again.dark_mean()
    assert again.set_damaged_aside().dark_record() is None
    assert path.with_suffix(".damaged").read_bytes() == data


def test_one_process_at_a_time_records(folder: CaptureFolder) -> None:
    path = str(folder.path)
    with claim(folder.path), pytest.raises(StorageError, match=f"another process is recording into {path}"):
        folder.set_damaged_aside()
    holder = (
        "import sys, time; from pathlib import Path; from slopegate.drivers.captures.storage import claim\n"
        "with claim(Path(sys.argv[1])):\n    print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", holder, path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(StorageError, match="another process is recording"):
            folder.set_damaged_aside()
        process.kill()
    folder.set_damaged_aside()


def test_the_right_to_write_moves_between_threads(folder: CaptureFolder) -> None:
    held = claim(folder.path)
    held.__enter__()
    leaving = threading.Thread(target=held.__exit__, args=(None, None, None))
    leaving.start()
    leaving.join()
    folder.set_damaged_aside()


def test_a_disk_without_locks_is_refused_in_a_sentence(folder: CaptureFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(lock: FileLock) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(FileLock, "_acquire", refuse)
    with pytest.raises(StorageError, match=rf"the disk of {folder.path} cannot lock files"), claim(folder.path):
        pass


def test_a_capture_is_read_without_a_lock(folder: CaptureFolder) -> None:
    """As from a disk that cannot be written."""
    folder.write(record(0), pixels(0))
    (folder.path / LOCK).unlink(missing_ok=True)
    before = sorted(folder.path.iterdir())
    camera = PlaybackCamera(open_capture(folder.path))
    camera.prepare(lambda share: True)
    assert camera.light(0).any()
    assert sorted(folder.path.iterdir()) == before


def test_too_many_slices_are_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="slices is 10001: it must be a whole number from 1 to 10000"):
        make_manifest("a", RIG, INFO, GATES[:1] * 10_001, 1, False, False)


def test_what_a_killed_process_left_is_cleaned_away(folder: CaptureFolder) -> None:
    left = folder.path / ".slice_0000.tif.12345678.part"
    left.write_bytes(b"half")
    assert folder.missing() == [0, 1, 2, 3]
    folder.clean()
    assert not left.exists()
    killed = folder.path.parent / "killed"
    killed.mkdir()
    (killed / ".capture.json.12345678.part").write_bytes(b"{")
    create_capture(killed, manifest())
    assert {path.name for path in killed.iterdir()} - {LOCK} == {"capture.json"}
    begun = folder.path.parent / "begun"
    begun.mkdir()
    (begun / LOCK).touch()
    create_capture(begun, manifest())
    assert is_capture(begun)


def test_a_capture_needs_a_folder_of_its_own(tmp_path: Path, folder: CaptureFolder) -> None:
    with pytest.raises(StorageError, match="is not empty: a capture needs a folder of its own"):
        create_capture(folder.path, manifest())
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="file is a file: a capture needs a folder"):
        create_capture(tmp_path / "file", manifest())
    with pytest.raises(StorageError, match=r"the folder .* cannot be made"):
        create_capture(tmp_path / "file" / "below", manifest())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text[:100], "cannot be used"),
        (lambda text: "[]", "cannot be used"),
        (lambda text: text.replace('"frames":', '"frame":'), "frame is not a key that is known there"),
        (lambda text: text.replace('"version": 1', '"version": 0'), "version is 0: it must be 1"),
        (
            lambda text: text.replace('"version": 1', '"new": 3, "version": 2'),
            "it has version 2 and this program reads up to 1, so it needs a newer one",
        ),
        (lambda text: text.replace('"width": 80', '"width": 81'), "81 x 60 pixels and the rig's lens 80 x 60"),
        (lambda text: text.replace("[projector]", "[projektor]"), "capture.json: projektor is not a key that is"),
    ],
)
def test_a_bad_manifest_is_refused_in_a_sentence(folder: CaptureFolder, change: object, words: str) -> None:
    path = folder.path / "capture.json"
    assert callable(change)
    text = json.dumps(json.loads(path.read_text("utf-8")), indent=1)
    path.write_text(change(text), "utf-8")
    with pytest.raises(StorageError, match="capture") as caught:
        open_capture(folder.path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_capture(tmp_path: Path, folder: CaptureFolder) -> None:
    assert is_capture(folder.path)
    assert is_capture(folder.path / "capture.json")
    assert not is_capture(tmp_path)
    assert not is_capture(tmp_path / "nothing")
    assert not is_capture(tmp_path / ("a" * 300))
    with pytest.raises(StorageError, match=r"is no capture: it has no capture\.json"):
        open_capture(tmp_path)
    with pytest.raises(StorageError, match="nothing is missing"):
        open_capture(tmp_path / "nothing")


def test_the_published_schema_is_the_models_own() -> None:
    published = json.loads((files("slopegate.resources") / "schemas" / "capture.schema.json").read_text("utf-8"))
    assert published == json_schema()
    jsonschema.Draft202012Validator.check_schema(published)


def test_sidecars_and_manifests_keep_the_schema(folder: CaptureFolder) -> None:
    folder.write(record(None, frames=2), pixels(7))
    folder.write(record(1), pixels(1))
    sidecar = json.loads(folder.sidecar.model_dump_json())
    validator = jsonschema.Draft202012Validator(json_schema())
    validator.validate(sidecar)
    assert sidecar["missing"] == [0, 2, 3]
    of_manifest = {"$ref": "#/$defs/Manifest", "$defs": json_schema()["$defs"]}
    jsonschema.Draft202012Validator(of_manifest).validate(json.loads((folder.path / "capture.json").read_text("utf-8")))
    for break_it in (
        lambda item: item.pop("dark"),
        lambda item: item["slices"][0].update(saturated_share=1.5),
        lambda item: item["capture"].update(slices=[]),
        lambda item: item["capture"]["camera"].update(pixel_format="rgb"),
        lambda item: item.update(more=1),
    ):
        broken = json.loads(json.dumps(sidecar))
        break_it(broken)
        assert not validator.is_valid(broken)
