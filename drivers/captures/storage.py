"""Captures on disk: a folder with a manifest and one file per slice, which is there whole or not at all.

    capture.json             the manifest: rig, camera, every gate asked for; written first, never changed
    dark.tif                 the dark frame, if one was taken
    slice_0000.tif ...       one slice each: the sum of its frames and its record
    slice_0003.empty.json    the record of a slice without light
    .lock                    empty; locked by the process that records here

Each .tif is an ordinary grey TIFF, 16 bit where the sum fits, else 32, with manifest and record as JSON in its
description, so that a file alone says what it is. Every file is written whole or not at all (`files.durable`): killing
the process at any moment loses the slice in flight and no other. The slices taken are the files that are there; there
is no list that could disagree with them.
"""

from __future__ import annotations

import errno
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Final, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from slopegate.core.rig.arrays import Doubles, Words
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.limits import MAX_SLICES
from slopegate.drivers.captures.model import VERSION, CameraFacts, Gate, Manifest, SliceRecord
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.captures.tiff import Sums, crc32_of, read_facts, read_tiff, tiff_bytes
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.files.durable import PART, StorageError, reason, remove_parts, write_durably
from slopegate.drivers.files.errors import told_fault
from slopegate.drivers.files.reading import decoding
from slopegate.drivers.files.rig_files import RigError, parse_rig, rig_to_toml

MANIFEST: Final = "capture.json"
DARK: Final = "dark.tif"
LOCK: Final = ".lock"
MAX_MANIFEST_BYTES: Final = 20_000_000
_NO_LOCKS: Final = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}


def software() -> str:
    """Name and version of this program."""
    return f"slopegate {version('slopegate')}"


def is_capture(path: Path) -> bool:
    """Whether this is the folder of a capture, or its manifest."""
    return isfile(path / MANIFEST) or (path.name == MANIFEST and isfile(path))


@contextmanager
def claim(folder: Path) -> Iterator[None]:
    """Hold the only right to write into a capture's folder; it ends with the process, however that ends.

    Raises StorageError while another process or thread holds it, and where files cannot be locked.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(folder / LOCK, timeout=0, thread_local=False)  # a recorder's writer lets go in a thread of its own
    try:
        lock.acquire()
    except Timeout:
        raise StorageError(
            f"another process is recording into {folder}: wait until it has ended, or take another folder"
        ) from None
    except OSError as error:
        if error.errno in _NO_LOCKS:
            raise StorageError(
                f"the disk of {folder} cannot lock files, so two programs could record there: take another disk"
            ) from None
        raise StorageError(reason(folder / LOCK, error)) from None
    try:
        yield
    finally:
        lock.release()


class CaptureFolder(Capture):
    """One capture. Every call looks into the folder anew, so a capture can be read while it is being recorded."""

    def __init__(self, path: Path, manifest: Manifest, rig: Rig) -> None:
        """Use `create_capture` or `open_capture`."""
        super().__init__(path, manifest, rig)
        self._records: dict[Path, SliceRecord] = {}

    def records(self) -> dict[int, SliceRecord]:
        """The slices taken so far, by rising index. A file that cannot be read counts as not taken."""
        found = {}
        for index in range(len(self.manifest.slices)):
            record = self._record(self._empty_path(index)) or self._record(self._path(index))
            if record is not None:
                found[index] = record
        return found

    def dark_record(self) -> SliceRecord | None:
        """The record of the dark frame, if there is one."""
        return self._record(self.path / DARK)

    def clean(self) -> None:
        """Remove what a killed process left unfinished. Only for the holder of the `claim`."""
        remove_parts(self.path, alone=True)

    def require_begun_with(self, rig: Rig, info: CameraInfo) -> None:
        """Raise StorageError unless this rig and camera began it, so that what they take fits what is there."""
        manifest = self.manifest
        if self.rig != rig or not manifest.same_camera(info):
            raise StorageError(
                f"{self.path} was begun with another scene, camera or rig ({manifest.scene}, "
                f"{manifest.camera.pixel_format}): it cannot be resumed with this"
            )

    def noise_to_go_on_with(self, noise: bool | None, seed: int | None) -> tuple[bool, int]:
        """Whether the virtual camera has noise, and which; None: as it was begun. Raises StorageError for another."""
        begun = self.manifest
        if begun.noise is None:
            return noise is not False, seed or 0
        if noise not in (None, begun.noise):
            kind = "with" if begun.noise else "without"
            raise StorageError(f"{self.path} was begun {kind} noise: it cannot be resumed in another way")
        if seed not in (None, begun.seed):
            raise StorageError(
                f"{self.path} was begun with the seed {begun.seed}: it cannot be resumed with {seed} (leave it out)"
            )
        return begun.noise, begun.seed or 0

    def set_damaged_aside(self) -> Self:
        """Rename slices with damaged pixels, and such a dark frame, so that they count as missing. Reads all of them.

        Raises StorageError while another process records here.
        """
        with claim(self.path):
            try:
                self.dark_total()
            except StorageError:
                self._set_aside(self.path / DARK)
            for index, record in self.records().items():
                try:
                    if not record.empty:
                        self.total(index)
                except StorageError:
                    self._set_aside(self._path(index))
        return self

    def write(self, record: SliceRecord, total: Words | None) -> None:
        """Write a slice, or the dark frame. `total` (H, W): the sum of record.frames frames, None for an empty slice.

        Raises StorageError.
        """
        path = self.path / DARK if record.index is None else self._path(record.index)
        if total is None:
            assert record.index is not None
            write_durably(self._empty_path(record.index), record.model_dump_json(indent=1).encode())
            return
        pixels: Sums = total.astype(np.uint16) if self._fits_16_bit(record.frames) else total
        record = record.model_copy(update={"crc32": crc32_of(pixels)})
        write_durably(path, tiff_bytes(pixels, self._description(record), software()))
        self._records.pop(path, None)

    def total(self, index: int) -> Sums:
        """The sum (H, W) of a slice's frames. Raises StorageError, also for a slice without pixels."""
        return self._pixels(self._path(index))

    def pixel_means(self, indices: Sequence[int], row: int, column: int) -> Doubles:
        """Mean counts (N,) of one pixel in these slices, without reading the rest of them."""
        import tifffile

        records, dark = self.records(), self.path / DARK
        found = np.full(len(indices), self.manifest.camera.black_count)
        for place, index in enumerate(indices):
            record = records.get(index)
            path = self._path(index)
            if record is not None and record.empty:
                record, path = self.dark_record(), dark
            if record is not None:
                with decoding(StorageError(f"{path} is damaged or cannot be read")):
                    pixels = tifffile.memmap(path, mode="r")
                if pixels.shape != self.shape:
                    raise StorageError(f"{path} is damaged: its pixels are not those that were written")
                found[place] = pixels[row, column] / record.frames
        return found

    def dark_total(self) -> Sums | None:
        """The sum (H, W) of the dark frames, as it was written; None without a dark frame."""
        return None if self.dark_record() is None else self._pixels(self.path / DARK)

    def _set_aside(self, path: Path) -> None:
        try:
            path.replace(path.with_suffix(".damaged"))
        except OSError as error:
            raise StorageError(reason(path.with_suffix(".damaged"), error)) from None

    def _path(self, index: int) -> Path:
        return self.path / f"slice_{index:04d}.tif"

    def _empty_path(self, index: int) -> Path:
        return self.path / f"slice_{index:04d}.empty.json"

    def _fits_16_bit(self, frames: int) -> bool:
        return frames * self.manifest.camera.max_count <= np.iinfo(np.uint16).max

    def _description(self, record: SliceRecord) -> str:
        common = self.manifest.model_dump(mode="json", exclude={"slices"})
        return json.dumps({"record": record.model_dump(mode="json"), "capture": common}, allow_nan=False)

    def _record(self, path: Path) -> SliceRecord | None:
        if not isfile(path):
            self._records.pop(path, None)
            return None
        if path not in self._records:
            try:
                text = path.read_bytes() if path.suffix == ".json" else json.dumps(read_facts(path).get("record"))
                found = SliceRecord.model_validate_json(text)
            except (StorageError, OSError, ValidationError):
                return None
            if not self.manifest.promises(found):
                return None
            self._records[path] = found
        return self._records[path]

    def _pixels(self, path: Path) -> Sums:
        record = self._record(path)
        if record is None:
            raise StorageError(f"{path} is missing or damaged")
        pixels = read_tiff(path, self.shape)
        if crc32_of(pixels) != record.crc32:
            again = "remove it and resume the capture to take it again"
            raise StorageError(f"{path} is damaged, its pixels are not those that were written: {again}")
        return pixels


def make_manifest(
    scene: str,
    rig: Rig,
    info: CameraInfo,
    slices: Sequence[GateSettings],
    frames: int,
    dark: bool,
    skip_empty: bool,
    noise: bool | None = None,
    seed: int | None = None,
) -> Manifest:
    """The manifest of a new capture. `skip_empty` compares with the dark, so it always comes with a dark frame.

    `noise`, `seed`: of the virtual camera, where they must hold over a resume.

    Raises InputError for none or too many slices.
    """
    require(1 <= len(slices) <= MAX_SLICES, "slices", len(slices), f"a whole number from 1 to {MAX_SLICES}")
    return Manifest(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        software=software(),
        scene=scene,
        rig_toml=rig_to_toml(rig),
        camera=CameraFacts.of(info),
        frames=frames,
        dark=dark or skip_empty,
        skip_empty=skip_empty,
        noise=noise,
        seed=seed,
        slices=[Gate.of(item) for item in slices],
    )


def create_capture(path: Path, manifest: Manifest) -> CaptureFolder:
    """Make the folder of a new capture. Raises StorageError where it cannot be made or holds something already."""
    rig = rig_of(path, manifest.rig_toml, manifest.camera)
    begin_folder(path, MANIFEST, manifest, "a capture")
    return CaptureFolder(path, manifest, rig)


def begin_folder(path: Path, file: str, manifest: BaseModel, what: str) -> None:
    """Make a folder of its own with a manifest in it. Raises StorageError as `check_new_folder` does."""
    check_new_folder(path, what)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"the folder {path} cannot be made ({error.strerror or error})") from None
    with claim(path):
        check_new_folder(path, what)  # once more, now that nobody else can begin here
        remove_parts(path, alone=True)
        write_durably(path / file, manifest.model_dump_json(indent=1).encode())


def check_new_folder(path: Path, what: str = "a capture") -> None:
    """Raise StorageError now for a folder that a new capture cannot have, before any work is done for it."""
    if exists(path) and not isdir(path):
        raise StorageError(f"{path} is a file: {what} needs a folder")
    try:
        taken = isdir(path) and any(item.suffix != PART and item.name != LOCK for item in path.iterdir())
    except OSError as error:
        raise StorageError(f"the folder {path} cannot be read ({error.strerror or error})") from None
    if taken:
        raise StorageError(f"the folder {path} is not empty: {what} needs a folder of its own")


def open_capture(path: Path) -> CaptureFolder:
    """The capture in a folder (or of a manifest file). Raises StorageError; missing slices are no error."""
    folder = path.parent if path.name == MANIFEST else path
    manifest = read_manifest(folder, MANIFEST, Manifest, VERSION, "capture")
    return CaptureFolder(folder, manifest, rig_of(folder / MANIFEST, manifest.rig_toml, manifest.camera))


Kept = TypeVar("Kept", bound=BaseModel)


def read_manifest(folder: Path, name: str, kind: type[Kept], newest: int, what: str) -> Kept:
    """The manifest of that name and kind in a folder; `newest`: the highest version known. Raises StorageError."""
    file = folder / name
    if not exists(folder):
        raise StorageError(f"{folder} is missing")
    if not isdir(folder):
        raise StorageError(f"{folder} is no folder of a {what}")
    if not isfile(file):
        raise StorageError(f"{folder} is no {what}: it has no {name}")
    try:
        if file.stat().st_size > MAX_MANIFEST_BYTES:
            raise StorageError(f"{file} is larger than {MAX_MANIFEST_BYTES // 1_000_000} MB: that is no manifest")
        return kind.model_validate_json(file.read_bytes())
    except ValidationError as error:
        raise StorageError(f"{file} cannot be used: {model_fault(error, newest)}") from None
    except OSError as error:
        raise StorageError(f"{file} cannot be read ({error.strerror or error})") from None


def model_fault(error: ValidationError, newest: int) -> str:
    """The first thing that is wrong; of all, that the manifest is a later program's."""
    faults = error.errors(include_url=False)
    for fault in faults:
        version = fault["input"]
        if fault["loc"] == ("version",) and isinstance(version, int) and version > newest:
            return f"it has version {version} and this program reads up to {newest}, so it needs a newer one"
    return told_fault(error)


def rig_of(path: Path, rig_toml: str, camera: CameraFacts) -> Rig:
    """The rig that a manifest holds as text. Raises StorageError, also when the camera has another size."""
    try:
        rig = parse_rig(rig_toml, f"the rig of {path}")
    except RigError as error:
        raise StorageError(str(error)) from None
    size = rig.camera.lens
    if (size.width, size.height) != (camera.width, camera.height):
        raise StorageError(
            f"{path}: the camera has {camera.width} x {camera.height} pixels and the rig's lens "
            f"{size.width} x {size.height}"
        )
    return rig
