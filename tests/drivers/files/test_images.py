import json
import os
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray

from settings_inside import read_settings
from slopegate.drivers.files.durable import StorageError, check_destination
from slopegate.drivers.files.images import save_image

SETTINGS = {"settings": {"delay_us": -1697.2, "line_time_us": 1 / 3}, "scene": 'Tür "6" µ 門', "distance_m": None}
RNG = np.random.default_rng(5)
COUNTS = RNG.integers(0, 4096, (7, 9), np.uint16)
COLOUR_COUNTS = RNG.integers(0, 65536, (7, 9, 3), np.uint16)
SIGNAL = RNG.normal(size=(7, 9)).astype(np.float32)
COLOUR_SIGNAL = RNG.normal(size=(7, 9, 3)).astype(np.float32)


def read_pixels(path: Path) -> NDArray[Any]:
    """The pixels as other programs see them, colour as RGB."""
    if path.suffix == ".npy":
        return np.asarray(np.load(path))
    if path.suffix == ".exr":
        with OpenEXR.File(str(path)) as image:
            (channel,) = image.channels().values()
            return np.array(channel.pixels)
    if path.suffix.startswith(".tif"):
        return np.asarray(tifffile.imread(path))
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    return np.asarray(pixels[..., ::-1] if pixels.ndim == 3 else pixels)


CASES = [
    ("a.npy", SIGNAL),
    ("a.npy", COUNTS),
    ("a.exr", SIGNAL),
    ("a.exr", COLOUR_SIGNAL),
    ("a.tif", COUNTS),
    ("a.tiff", COLOUR_COUNTS),
    ("a.tif", SIGNAL),
    ("a.TIF", COUNTS),
    ("a.png", COUNTS),
    ("a.png", COLOUR_COUNTS),
    ("a.png", (COUNTS >> 4).astype(np.uint8)),
    ("a.png", COLOUR_COUNTS[::2, ::-1]),
]


@pytest.mark.parametrize(("name", "array"), CASES)
def test_pixels_survive_to_the_last_bit(tmp_path: Path, name: str, array: NDArray[Any]) -> None:
    path = tmp_path / name
    save_image(path, array, SETTINGS)
    lower = path.rename(path.with_suffix(path.suffix.lower()))
    found = read_pixels(lower)
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize(("name", "array"), [case for case in CASES if not case[0].endswith("npy")])
def test_settings_survive_inside(tmp_path: Path, name: str, array: NDArray[Any]) -> None:
    path = tmp_path / name
    save_image(path, array, SETTINGS)
    assert read_settings(path) == SETTINGS


def test_other_programs_find_the_settings(tmp_path: Path) -> None:
    pillow = pytest.importorskip("PIL.Image")
    for name in ("a.png", "a.tif"):
        save_image(tmp_path / name, COUNTS, SETTINGS)
        with pillow.open(tmp_path / name) as image:
            image.load()
            text = image.text["slopegate"] if name == "a.png" else image.tag_v2[270]
            np.testing.assert_array_equal(np.asarray(image), COUNTS)
        assert json.loads(text) == SETTINGS


def test_every_png_chunk_has_its_checksum(tmp_path: Path) -> None:
    save_image(tmp_path / "a.png", COUNTS, SETTINGS)
    data, at, kinds = (tmp_path / "a.png").read_bytes(), 8, []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        kinds.append(data[at + 4 : at + 8])
        assert zlib.crc32(data[at + 4 : at + 8 + length]) == int.from_bytes(
            data[at + 8 + length : at + 12 + length], "big"
        )
        at += 12 + length
    assert kinds[0] == b"IHDR"
    assert kinds[-1] == b"IEND"
    assert kinds.count(b"iTXt") == 1


def test_an_image_replaces_the_old_one_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    save_image(path, COUNTS)
    np.testing.assert_array_equal(read_pixels(path), COUNTS)
    assert [item.name for item in tmp_path.iterdir()] == ["a.png"]


def test_a_failed_write_leaves_the_old_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npy"
    np.save(path, COUNTS)

    def disk_full(stream: BinaryIO, *_: object, **__: object) -> None:
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", disk_full)
    with pytest.raises(StorageError, match="is full") as refusal:
        save_image(path, SIGNAL)
    assert path.name in str(refusal.value)
    assert str(path.parent) in str(refusal.value)
    np.testing.assert_array_equal(np.load(path), COUNTS)
    assert [item.name for item in tmp_path.iterdir()] == ["a.npy"]


@pytest.mark.parametrize(
    ("name", "array", "why"),
    [
        ("a.jpg", COUNTS, r"suffix '\.jpg'"),
        ("a", COUNTS, "suffix ''"),
        ("a.exr", COUNTS, "float32"),
        ("a.png", SIGNAL, "uint8 or uint16"),
        ("a.png", COUNTS.astype(np.int32), "int32"),
        ("a.tif", COUNTS[0], r"\(9,\)"),
        ("a.tif", COUNTS[:0], r"\(0, 9\)"),
        ("a.tif", np.dstack([COUNTS] * 4), r"\(7, 9, 4\)"),
        ("none/a.tif", COUNTS, "no folder"),
        ("folder.png", COUNTS, "is a folder"),
        ("a" * 300 + ".png", COUNTS, "too long"),
    ],
)
def test_what_cannot_be_written_gets_one_sentence(tmp_path: Path, name: str, array: NDArray[Any], why: str) -> None:
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(StorageError, match=why) as refusal:
        save_image(tmp_path / name, array)
    assert str(tmp_path / name) in str(refusal.value)
    assert [item.name for item in tmp_path.iterdir()] == ["folder.png"]


def test_settings_that_json_cannot_hold_are_a_fault_of_the_caller(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        save_image(tmp_path / "a.png", COUNTS, {"far_m": float("nan")})
    assert not any(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_permission_is_refused_beforehand(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(StorageError, match="cannot be written to"):
            check_destination(tmp_path / "a.png", (".png",))
    finally:
        tmp_path.chmod(0o700)


def test_a_good_destination_is_left_untouched(tmp_path: Path) -> None:
    check_destination(tmp_path / "a.PNG", (".png",))
    assert not any(tmp_path.iterdir())
