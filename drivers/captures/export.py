"""Writes a capture in the formats of other programs: one module per format, listed in FORMATS.

Slices come in the order of capture. Slices without light hold what the camera counts in the dark. An export appears
whole or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from os.path import exists, isdir
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from slopegate.core.rig.checks import require
from slopegate.drivers.files.durable import StorageError, check_destination, replacing

if TYPE_CHECKING:  # the command line imports this module for the names of the formats alone
    from slopegate.core.rig.arrays import Singles
    from slopegate.drivers.captures.model import SliceRecord
    from slopegate.drivers.captures.storage import CaptureFolder

Step = Callable[[float], bool]
"""Told the share done; False stops the export."""


@dataclass(frozen=True)
class ExportFormat:
    """One line of FORMATS."""

    what: str
    """For the help of the command line and the window."""
    module: str
    """In this room; its `write(job: ExportJob)` writes to `job.target` and calls `job.step`. Imported when chosen."""
    suffixes: tuple[str, ...] = ()
    """Endings of a format that is one file; none for a folder."""
    ending: str = ""
    """What a file dialog adds to the capture's name."""
    subtracts_dark: bool = False
    needs_slices: bool = True


FORMATS: Final = {
    "ome-tiff": ExportFormat(
        "one file, 16 bit, one plane per slice, for ImageJ, napari and others",
        "export_ome",
        (".tif", ".tiff"),
        ".ome.tif",
    ),
    "zarr": ExportFormat(
        "a folder, Zarr 3 with OME-Zarr metadata: the sums of frames as captured", "export_zarr", ending="-zarr"
    ),
    "exr": ExportFormat(
        "a folder of OpenEXR files: mean counts as 32-bit numbers", "export_exr", ending="-exr", subtracts_dark=True
    ),
    "png": ExportFormat(
        "a folder of 8-bit previews with a contact sheet", "export_png", ending="-png", subtracts_dark=True
    ),
    "json": ExportFormat("one file: everything but the pixels", "export_json", (".json",), ".json", needs_slices=False),
}


@dataclass(frozen=True, eq=False)
class ExportJob:
    """What a format's `write` gets: the capture, the slices taken so far, and where the result goes."""

    folder: CaptureFolder
    records: dict[int, SliceRecord]
    target: Path
    """Does not exist yet."""
    subtract_dark: bool
    step: Callable[[float], None]
    """To be told the share done, before each slice."""

    @property
    def facts(self) -> dict[str, Any]:
        """Everything but the pixels, fit for JSON."""
        return self.folder.sidecar.model_dump(mode="json")

    def means(self) -> Iterator[tuple[SliceRecord, Singles]]:
        """Record and mean counts (H, W) float32 of each slice, the dark subtracted if that is asked for."""
        dark = self.folder.dark_mean() if self.subtract_dark else None
        for place, (index, record) in enumerate(self.records.items()):
            self.step(place / len(self.records))
            mean = self.folder.mean(index)
            yield record, mean if dark is None else mean - dark


def export_capture(
    folder: CaptureFolder, kind: str, out: Path, subtract_dark: bool = False, progress: Step | None = None
) -> int:
    """Write the slices taken so far in one of FORMATS; returns how many there are.

    Raises StorageError, and Cancelled when `progress` returns False; then nothing is left behind.
    """
    from slopegate.core.render.render import Cancelled

    require(kind in FORMATS, "format", kind, f"one of {', '.join(FORMATS)}")
    chosen, records = FORMATS[kind], folder.records()
    if chosen.needs_slices and not records:
        raise StorageError(f"{folder.path} has no slice yet: there is nothing to export")
    if subtract_dark and not chosen.subtracts_dark:
        able = " and ".join(name for name, item in FORMATS.items() if item.subtracts_dark)
        raise StorageError(f"the format {kind} holds what was captured: subtract_dark is for {able}")
    if subtract_dark and folder.dark_record() is None:
        raise StorageError(f"{folder.path} has no dark frame to subtract")
    check_out(out, kind, chosen.suffixes)

    def step(share: float) -> None:
        if progress is not None and not progress(share):
            raise Cancelled("The export was stopped")

    write = import_module(f"{__package__}.{chosen.module}").write
    with replacing(out) as part:
        write(ExportJob(folder, records, part, subtract_dark, step))
    return len(records)


def check_out(out: Path, kind: str, suffixes: Sequence[str]) -> None:
    """Raise StorageError now for a file (with one of the suffixes), or new folder, that could not be written later."""
    if suffixes:
        check_destination(out, suffixes)
    elif exists(out):
        raise StorageError(f"{out} exists already: the format {kind} needs a new folder")
    elif not isdir(out.absolute().parent):
        raise StorageError(f"{out}: there is no folder {out.parent}")
