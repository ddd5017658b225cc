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
from slopegate.drivers.files.durable import StorageError, check_destination, check_new, replacing

if TYPE_CHECKING:  # the command line imports this module for the names of the formats alone
    from slopegate.core.rig.arrays import Singles
    from slopegate.drivers.captures.model import SliceRecord
    from slopegate.drivers.captures.reading import Capture

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
    """Endings that the name must have; none for a folder of any name."""
    ending: str = ""
    """What a file dialog adds to the capture's name."""
    subtracts_dark: bool = False
    needs_slices: bool = True
    is_folder: bool = False
    """Whether something with a suffix is a folder."""


OME_ZARR: Final = ".ome.zarr"
"""Ending of OME-Zarr folders, by which other programs know them."""

FORMATS: Final = {
    "ome-tiff": ExportFormat(
        "one file, 16 bit, one plane per slice, for ImageJ, napari and others",
        "export_ome",
        (".tif", ".tiff"),
        ".ome.tif",
    ),
    "zarr": ExportFormat(
        "a folder, Zarr 3 with OME-Zarr metadata: the sums of frames as captured",
        "export_zarr",
        (OME_ZARR,),
        OME_ZARR,
        is_folder=True,
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

    folder: Capture
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
    folder: Capture,
    kind: str,
    out: Path,
    subtract_dark: bool = False,
    progress: Step | None = None,
    overwrite: bool = False,
) -> int:
    """Write the slices taken so far in one of FORMATS; returns how many there are. `overwrite`: replace what is there.

    Raises StorageError, and Cancelled when `progress` returns False; then nothing is left behind or changed.
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
    check_out(out, kind, chosen.suffixes, chosen.is_folder, overwrite)

    def step(share: float) -> None:
        if progress is not None and not progress(share):
            raise Cancelled("The export was stopped")

    write = import_module(f"{__package__}.{chosen.module}").write
    with replacing(out) as part:
        write(ExportJob(folder, records, part, subtract_dark, step))
    return len(records)


def check_out(out: Path, kind: str, endings: Sequence[str], is_folder: bool = False, overwrite: bool = False) -> None:
    """Raise StorageError now for a file or folder that could not be written later.

    Endings: those that the name may have, any where there are none; then it is a folder, as it is where so told. What
    exists is refused unless it may be overwritten; of folders only what was exported before, for all that is in them
    goes.
    """
    if endings and not is_folder:
        check_destination(out, endings, overwrite=overwrite)
        return
    if endings and not out.name.lower().endswith(tuple(endings)):
        raise StorageError(f"{out}: the name of the folder must end in {' or '.join(endings)} for the format {kind}")
    if not isdir(out.absolute().parent):
        raise StorageError(f"{out}: there is no folder {out.parent}")
    if not overwrite:
        check_new(out)
    if exists(out) and not (isdir(out) and _EXPORTED & {item.name for item in out.iterdir()}):
        raise StorageError(f"{out} was not made by an export: it is not overwritten")


_EXPORTED: Final = {"zarr.json", "slice_0000.png", "contact.png", "slice_0000.exr", "dark.exr"}
"""One of these is in every folder that an export makes."""
