"""Opens what a capture was exported to, OME-TIFF or OME-Zarr, as a capture to read.

Both hold everything but the pixels as the sidecar (`model.Sidecar`), so that nothing but the planes is looked up.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from os.path import isdir, isfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pydantic import ValidationError

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import shown
from slopegate.drivers.captures.export import FORMATS
from slopegate.drivers.captures.model import VERSION, Sidecar, SliceRecord
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.captures.storage import MAX_MANIFEST_BYTES, is_capture, model_fault, open_capture, rig_of
from slopegate.drivers.captures.tiff import Sums, crc32_of, with_tiff
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.reading import decoding

_OME = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"
_GROUP = "zarr.json"
_TRANSPORT = "transport"


class ExportedCapture(Capture):
    """A capture in the file or folder that it was exported to.

    `steps` of a plane's numbers make one count of one frame. Where that is fewer than the frames of a slice, as in an
    OME-TIFF of many frames, sums are right to half of frames / steps.
    """

    def __init__(self, path: Path, sidecar: Sidecar, packed: int | None, planes: Any, dark: Any) -> None:
        """`planes` [slice, row, column] in the order of the sidecar; `dark` [row, column], or None. Use `open_any`.

        `packed`: the steps of planes of 16 bits; None where sums are kept as they are.
        """
        super().__init__(path, sidecar.capture, rig_of(path, sidecar.capture.rig_toml, sidecar.capture.camera))
        kept = {record.index: record for record in sidecar.slices if record.index is not None}
        dark_kept = sidecar.dark is None or dark is not None
        if planes.shape != (len(kept), *self.shape) or not dark_kept or (dark is not None and dark.shape != self.shape):
            raise StorageError(
                f"{path} holds planes of shape {planes.shape} and says that it has {len(kept)} slices of {self.shape}:"
                " it was changed after it was exported"
            )
        steps = sidecar.capture.frames if packed is None else packed
        every = [*sidecar.slices, *([sidecar.dark] if sidecar.dark else [])]
        if not all(map(sidecar.capture.promises, every)) or steps > sidecar.capture.frames:
            raise StorageError(f"{path} has slices of more or fewer frames than its capture: it was changed")
        self._records, self._dark_record, self._steps, self._packed = kept, sidecar.dark, steps, packed is not None
        self._places = {index: place for place, index in enumerate(kept)}
        self._planes, self._dark = planes, dark

    def records(self) -> dict[int, SliceRecord]:
        """The slices that were exported, by rising index."""
        return self._records

    def dark_record(self) -> SliceRecord | None:
        """The record of the dark frame, if there is one."""
        return self._dark_record

    def total(self, index: int) -> Sums:
        """The sum (H, W) of a slice's frames, to half of frames / steps. Raises StorageError."""
        record = self._records.get(index)
        if record is None or record.empty:
            raise StorageError(f"{self.path} has no pixels of slice {index}")
        return self._summed(lambda: self._planes[self._places[index]], record, self._steps)

    def dark_total(self) -> Sums | None:
        """The sum (H, W) of the dark frames; None without a dark frame. Raises StorageError."""
        record = self._dark_record
        return None if record is None else self._summed(lambda: self._dark[:], record, self._dark_steps(record))

    def pixel_means(self, indices: Sequence[int], row: int, column: int) -> Doubles:
        """Mean counts (N,) of one pixel in these slices."""
        found = np.full(len(indices), self.manifest.camera.black_count)
        with decoding(self._damaged()):
            for place, index in enumerate(indices):
                if self._records[index].empty:
                    if (record := self._dark_record) is not None:
                        found[place] = self._dark[row, column] / self._dark_steps(record)
                else:
                    found[place] = self._planes[self._places[index], row, column] / self._steps
        return found

    def _dark_steps(self, record: SliceRecord) -> int:
        return self.manifest.steps_per_count(record.frames) if self._packed else record.frames

    def _summed(self, read: Callable[[], Any], record: SliceRecord, steps: int) -> Sums:
        with decoding(self._damaged()):
            plane = np.ascontiguousarray(read())
        if steps == record.frames:
            if crc32_of(plane) != record.crc32:
                raise self._damaged()
            return plane
        return np.rint(plane * np.float64(record.frames / steps)).astype(np.uint32)

    def _damaged(self) -> StorageError:
        return StorageError(f"{self.path} is damaged, its pixels are not those that were written: export it again")


def is_exported(path: Path) -> bool:
    """Whether this is the file or folder of an export that can be opened as a capture, by what is written in it."""
    with suppress(StorageError):
        return _facts(path) is not None
    return False


def is_recorded(path: Path) -> bool:
    """Whether `open_any` opens this: a capture's own folder, or what one was exported to."""
    return is_capture(path) or is_exported(path)


def open_any(path: Path) -> Capture:
    """The capture in its own folder, or in an OME-TIFF or OME-Zarr that it was exported to. Raises StorageError."""
    if is_capture(path):
        return open_capture(path)
    facts = _facts(path)
    if facts is None and isfile(path):
        raise StorageError(f"{path} is no capture and no OME-TIFF that one was exported to, or is damaged")
    if facts is None:
        return open_capture(path)
    steps, _ = facts.pop("steps_per_count", None), facts.pop("pixel_size_at_m", None)
    if steps is not None and (type(steps) is not int or steps < 1):
        raise StorageError(
            f"{path} cannot be used: steps_per_count is {shown(steps)}: it must be a whole number above 0"
        )
    try:
        sidecar = Sidecar.model_validate_json(json.dumps(facts))
    except ValidationError as error:
        raise StorageError(f"{path} cannot be used: {model_fault(error, VERSION)}") from None
    open_planes = _zarr_planes if isdir(path) else _tiff_planes
    with decoding(StorageError(f"{path} is damaged, cut short, or was written anew by another program")):
        planes, dark = open_planes(path)
    return ExportedCapture(path, sidecar, steps, planes, dark)


def _facts(path: Path) -> dict[str, Any] | None:
    """The sidecar as it stands in an export; None where the path is something else. Raises StorageError."""
    if isdir(path):
        return _zarr_facts(path / _GROUP)
    return _tiff_facts(path) if path.suffix.lower() in FORMATS["ome-tiff"].suffixes and isfile(path) else None


def _zarr_facts(file: Path) -> dict[str, Any] | None:
    if not isfile(file) or file.stat().st_size > MAX_MANIFEST_BYTES:
        return None
    with decoding(StorageError(f"{file} cannot be read: it is no Zarr group")):
        found = json.loads(file.read_bytes()).get("attributes", {}).get("slopegate")
    if isinstance(found, dict) and _TRANSPORT in found:
        raise StorageError(f"{file.parent} is exported light transport: open the folder that it was exported from")
    return found if isinstance(found, dict) and "capture" in found else None


def _tiff_facts(path: Path) -> dict[str, Any] | None:
    def described(image: Any) -> Any:
        text = image.ome_metadata
        if text is None or len(text) > MAX_MANIFEST_BYTES:
            return None
        description = ElementTree.fromstring(text).findtext(f"{_OME}Image/{_OME}Description")
        return json.loads(description or "null") if (description or "").startswith("{") else None

    found = with_tiff(path, described)
    return found if isinstance(found, dict) and "capture" in found else None


def _tiff_planes(path: Path) -> tuple[Any, Any]:
    import tifffile

    with tifffile.TiffFile(path) as image:
        count = len(image.series)
        shape = image.series[0].shape
    planes = tifffile.memmap(path, series=0, mode="r").reshape(-1, *shape[-2:])
    return planes, tifffile.memmap(path, series=1, mode="r") if count > 1 else None


def _zarr_planes(path: Path) -> tuple[Any, Any]:
    import zarr

    # Zarr would wait without end for a pipe, and read a device until the memory is full.
    if any(not item.is_file() and not item.is_dir() for item in path.rglob("*")):
        raise ValueError("something in it is not an ordinary file")
    group: Any = zarr.open_group(str(path), mode="r")
    planes, dark = group["0"], group.get("dark")
    height, width = planes.shape[-2:]
    if planes.chunks != (1, height, width) or (dark is not None and dark.chunks != (height, width)):
        raise ValueError("a chunk is not one slice: unpacking it could take any memory")
    return planes, dark
