"""Captures in the formats of other programs.

| format | what is written | pixels |
| --- | --- | --- |
| ome-tiff | one file, a plane per slice (axis Z), OME metadata | uint16, `steps_per_count` steps a count |
| zarr | one folder, Zarr 3 with OME-Zarr 0.5 metadata: array `0` (slices), `dark` | sums of frames, as captured |
| exr | a folder, a file per slice and dark.exr | float32 mean counts |
| png | a folder, an 8-bit preview per slice and contact.png | levels common to all, sRGB curve |
| json | one file, everything but the pixels (resources/schemas/capture.schema.json) | |

Slices come in the order of capture; those without light hold what is counted in the dark. Everything appears whole or
not at all: it is written beside its place and then renamed.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Singles
from slopegate.drivers.captures.limits import Format
from slopegate.drivers.captures.model import SliceRecord
from slopegate.drivers.captures.storage import CaptureFolder
from slopegate.drivers.files.durable import StorageError, reason

SUFFIXES: Final[dict[Format, tuple[str, ...]]] = {
    "ome-tiff": (".ome.tif", ".ome.tiff", ".tif", ".tiff"),
    "json": (".json",),
}
"""Endings of the formats that are one file; the others are folders."""

Step = Callable[[float], bool]
"""Told the share done; False stops the export."""


@dataclass(frozen=True, eq=False)
class ExportJob:
    """What a format's writer gets: the capture, what has been taken of it, and where the result goes."""

    folder: CaptureFolder
    records: dict[int, SliceRecord]
    target: Path
    subtract_dark: bool
    step: Callable[[float], None]

    @property
    def facts(self) -> dict[str, Any]:
        """The sidecar, fit for JSON."""
        return self.folder.sidecar.model_dump(mode="json")

    def means(self) -> Iterator[tuple[SliceRecord, Singles]]:
        """Records and mean counts (H, W) float32, less the dark frame where that is wanted, one slice at a time."""
        dark = self.folder.dark_mean() if self.subtract_dark else None
        for place, (index, record) in enumerate(self.records.items()):
            self.step(place / len(self.records))
            mean = self.folder.mean(index)
            yield record, mean if dark is None else mean - dark


def steps_per_count(folder: CaptureFolder) -> int:
    """How many steps of a 16-bit plane make one count: the number of frames where their sum fits, so that it is exact.

    Otherwise the largest whole number for which full scale fits; the mean is then rounded to the nearest step.
    """
    most = 65535 // folder.manifest.camera.max_count
    return min(folder.manifest.frames, most)


def export_capture(
    folder: CaptureFolder, kind: Format, out: Path, subtract_dark: bool = False, progress: Step | None = None
) -> int:
    """Write what has been taken of a capture; returns the number of slices. `subtract_dark` is for exr and png.

    Raises StorageError, one sentence, and Cancelled when `progress` returns False; then nothing is left behind.
    """
    records = folder.records()
    if not records and kind != "json":
        raise StorageError(f"{folder.path} has no slice yet: there is nothing to export")
    if subtract_dark and kind not in ("exr", "png"):
        raise StorageError(f"the format {kind} holds what was captured: subtract_dark is for exr and png")
    if subtract_dark and folder.dark_record() is None:
        raise StorageError(f"{folder.path} has no dark frame to subtract")
    _check(kind, out)

    def step(share: float) -> None:
        if progress is not None and not progress(share):
            raise Cancelled("The export was stopped")

    with _placed(out) as part:
        _writer(kind)(ExportJob(folder, records, part, subtract_dark, step))
    return len(records)


def _writer(kind: Format) -> Callable[[ExportJob], None]:
    """Libraries are imported when their format is wanted."""
    if kind == "ome-tiff":
        from slopegate.drivers.captures.export_ome import write_ome_tiff

        return write_ome_tiff
    if kind == "zarr":
        from slopegate.drivers.captures.export_zarr import write_zarr

        return write_zarr
    if kind == "exr":
        from slopegate.drivers.captures.export_exr import write_exr

        return write_exr
    if kind == "png":
        from slopegate.drivers.captures.export_png import write_png

        return write_png
    return _write_json


def _write_json(job: ExportJob) -> None:
    job.target.write_text(job.folder.sidecar.model_dump_json(indent=1), encoding="utf-8")


def _check(kind: Format, out: Path) -> None:
    suffixes = SUFFIXES.get(kind)
    if suffixes is not None:
        if not out.name.lower().endswith(suffixes):
            raise StorageError(f"{out} is no name for the format {kind}: it must end in {' or '.join(suffixes)}")
        if out.is_dir():
            raise StorageError(f"{out} is a folder: the format {kind} needs a file")
    elif out.exists():
        raise StorageError(f"{out} exists already: the format {kind} needs a new folder")
    if not out.absolute().parent.is_dir():
        raise StorageError(f"{out}: there is no folder {out.parent}")


@contextmanager
def _placed(out: Path) -> Iterator[Path]:
    """A name beside `out` to write to; renamed afterwards, or removed."""
    part = out.with_name(f".{secrets.token_hex(4)}-{out.name}")
    try:
        yield part
        part.replace(out)
    except OSError as error:
        raise StorageError(reason(out, error)) from None
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            with suppress(OSError):
                part.unlink(missing_ok=True)
