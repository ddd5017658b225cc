"""A growing TIFF: read by other programs, and by them at every moment of being written."""

from __future__ import annotations

import errno
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from slopegate.drivers.captures import tiff_stack
from slopegate.drivers.captures.tiff_stack import TiffStack, pages_of
from slopegate.drivers.files.durable import StorageError

RNG = np.random.default_rng(5)
FRAMES = [RNG.integers(0, 65536, (7, 5)).astype(np.uint16) for _ in range(4)]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("width", [5, 6])
def test_other_programs_read_every_page(tmp_path: Path, dtype: Any, width: int) -> None:
    path = tmp_path / "a.tif"
    frames = [RNG.integers(0, np.iinfo(dtype).max + 1, (7, width)).astype(dtype) for _ in range(4)]
    stack = TiffStack(path)
    for number, frame in enumerate(frames):
        stack.add(frame, b'{"n": %d}' % (10**number))  # texts of odd and even length
    stack.close()
    assert stack.bytes == path.stat().st_size
    np.testing.assert_array_equal(tifffile.imread(path), np.stack(frames))
    with tifffile.TiffFile(path) as tiff:
        assert [page.description for page in tiff.pages] == [f'{{"n": {10**number}}}' for number in range(4)]
    good, found = cv2.imreadmulti(str(path), flags=cv2.IMREAD_UNCHANGED)
    assert good
    np.testing.assert_array_equal(np.stack(list(found)), np.stack(frames))
    with Image.open(path) as picture:
        for number, frame in enumerate(frames):
            picture.seek(number)
            np.testing.assert_array_equal(np.asarray(picture), frame)


def test_cut_at_any_byte_it_holds_the_whole_pages_before(tmp_path: Path) -> None:
    """What a reader finds after each of the writes that the file is made of, cut short anywhere."""
    writes: list[tuple[int, bytes]] = []
    stack = TiffStack(tmp_path / "a.tif")
    put = stack._put

    def noted(place: int, data: bytes | memoryview) -> None:
        writes.append((place, bytes(data)))
        put(place, data)

    stack._put = noted  # type: ignore[method-assign]
    image = bytearray((tmp_path / "a.tif").read_bytes())
    done = []
    for number, frame in enumerate(FRAMES):
        stack.add(frame, str(number).encode())
        done += [number, number, number + 1]
    stack.close()
    for (place, data), whole in zip(writes, done, strict=True):
        for cut in {1, len(data) // 2, len(data)}:
            if len(data) == 4 and cut < 4:
                continue  # four aligned bytes are written at once
            grown = bytearray(image)
            grown[place : place + cut] = data[:cut]
            (tmp_path / "cut.tif").write_bytes(grown)
            with tifffile.TiffFile(tmp_path / "cut.tif") as tiff:
                kept = [page.asarray() for page in tiff.pages]
            assert len(kept) == (whole if cut == len(data) else done[writes.index((place, data))])
            for found, frame in zip(kept, FRAMES, strict=False):
                np.testing.assert_array_equal(found, frame)
        image[place : place + len(data)] = data
    assert bytes(image) == (tmp_path / "a.tif").read_bytes()


@pytest.mark.parametrize("cut", [0, 3, 8])
def test_a_file_without_a_page_has_none(tmp_path: Path, cut: int) -> None:
    TiffStack(tmp_path / "a.tif").close()
    (tmp_path / "a.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:cut])
    assert pages_of(tmp_path / "a.tif") == []


def test_what_is_read_back_is_what_was_written_and_anything_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    stack = TiffStack(path)
    for number, frame in enumerate(FRAMES):
        stack.add(frame, f"text {number}".encode())
    stack.close()
    for number, page in enumerate(pages_of(path)):
        np.testing.assert_array_equal(page.pixels(), FRAMES[number])
        assert page.text() == f"text {number}"
    whole = path.read_bytes()
    rng, refused = np.random.default_rng(3), 0
    for _ in range(300):
        broken = bytearray(whole)
        for _ in range(3):
            broken[int(rng.integers(len(broken)))] = int(rng.integers(256))
        path.write_bytes(broken[: int(rng.integers(9, len(broken) + 1))])
        try:
            for page in pages_of(path):
                page.pixels()
                page.text()
        except StorageError:
            refused += 1
    assert refused > 100


def test_a_page_that_does_not_fit_on_the_disk_leaves_those_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack = TiffStack(tmp_path / "a.tif")
    stack.add(FRAMES[0], b"0")
    whole, file = stack.bytes, stack._file

    class Full:
        def __getattr__(self, name: str) -> Any:
            return getattr(file, name)

        def write(self, data: memoryview) -> int:
            file.write(data[:10])
            raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr(stack, "_file", Full())
    with pytest.raises(StorageError, match=r"a\.tif cannot be written: the disk of .+ is full"):
        stack.add(FRAMES[1], b"1")
    monkeypatch.undo()
    assert (tmp_path / "a.tif").stat().st_size == whole
    stack.add(FRAMES[2], b"2")  # and there is room again
    stack.close()
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), np.stack([FRAMES[0], FRAMES[2]]))


def test_it_says_when_it_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiff_stack, "MAX_BYTES", 1000)
    stack = TiffStack(tmp_path / "a.tif")
    while stack.room_for(FRAMES[0], b"x"):
        stack.add(FRAMES[0], b"x")
    stack.close()
    assert 500 < (tmp_path / "a.tif").stat().st_size <= 1000


def test_pages_are_read_while_others_are_added(tmp_path: Path) -> None:
    """As by one who watches a recording: never less than before, and never taken for damaged."""
    path, done = tmp_path / "a.tif", threading.Event()
    stack = TiffStack(path)
    stack.add(np.zeros((8, 8), np.uint16), b"0")

    def write() -> None:
        for number in range(1, 4000):
            stack.add(np.zeros((8, 8), np.uint16), str(number).encode())
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    seen = 0
    while not done.is_set():
        count = len(pages_of(path))
        assert count >= seen
        seen = count
    writer.join()
    stack.close()
    assert len(pages_of(path)) == 4000
