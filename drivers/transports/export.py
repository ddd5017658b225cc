"""Writes light transport in the formats of other programs: one function a format, listed in TRANSPORT_FORMATS.

Slices come in the order of acquisition, those without light as black. Light is linear: of a scene in the unit of
`render`, of a camera in counts above the dark. An export appears whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require
from slopegate.drivers.captures.axes import axes_of
from slopegate.drivers.captures.export import OME_ZARR, Step, check_out
from slopegate.drivers.captures.export_png import BRIGHT_PERCENTILE, MOSAICS, preview, sheet, thumb
from slopegate.drivers.captures.export_zarr import axis_names, ome
from slopegate.drivers.files.durable import StorageError, replacing
from slopegate.drivers.files.images import write_image, write_layers
from slopegate.drivers.transports.model import TransportRecord
from slopegate.drivers.transports.storage import TransportFolder


@dataclass(frozen=True, eq=False)
class TransportJob:
    """What a format's function gets: the folder, the slices taken so far, and where the result goes."""

    folder: TransportFolder
    records: dict[int, TransportRecord]
    target: Path
    """Does not exist yet."""
    step: Callable[[float], None]
    """To be told the share done."""

    @property
    def facts(self) -> dict[str, Any]:
        """Everything but the numbers, fit for JSON."""
        records = [record.model_dump(mode="json") for record in self.records.values()]
        return {"transport": self.folder.manifest.model_dump(mode="json"), "slices": records}

    def totals(self) -> Iterator[tuple[int, Singles]]:
        """Number and light (H, W) under a fully lit projector of each slice."""
        for place, index in enumerate(self.records):
            self.step(place / len(self.records))
            yield index, self.folder.slice(index).total


def _write_exr(job: TransportJob) -> None:
    """Layers: Y, the sum of the slices; slice_0000.Y and so on; white.Y, what was captured fully lit, if it was."""
    layers = {f"slice_{index:04d}.Y": total for index, total in job.totals()}
    layers["Y"] = np.asarray(sum(layers.values()), np.float32)
    white = job.folder.white()
    if white is not None:
        layers["white.Y"] = white
    write_layers(job.target, layers, json.dumps(job.facts, allow_nan=False))


def _write_zarr(job: TransportJob) -> None:
    """Array `0` (slices, H, W): light under a fully lit projector; group `transport`: the sparse entries of each slice.

    Those of slice i, grid k stand in transport/i/k as starts, block and value, with the grid as attributes.
    """
    import zarr

    height, width = job.folder.shape
    applied = [None if record.applied is None else record.applied.settings() for record in job.records.values()]
    axes = axes_of(job.folder.rig, applied)
    group = zarr.create_group(store=str(job.target), zarr_format=3)
    totals = group.create_array(
        "0",
        shape=(len(job.records), height, width),
        chunks=(1, height, width),
        dtype=np.float32,
        dimension_names=axis_names(axes),
    )
    for place, index in enumerate(job.records):
        job.step(place / len(job.records))
        transport = job.folder.slice(index)
        totals[place] = transport.total
        for number, layer in enumerate(transport.layers):
            entries = group.create_group(f"transport/{index}/{number}")
            entries.attrs.update({"columns": layer.grid.columns, "rows": layer.grid.rows})
            for name in ("starts", "block", "value"):
                array = getattr(layer, name)
                if array.size:
                    entries.create_array(name, data=array)
    group.attrs.update({"ome": ome(job.folder.manifest.scene, axes), "slopegate": job.facts})


def _write_png(job: TransportJob) -> None:
    """slice_0000.png ... with levels common to all, and contact.png; white is the brightest slice's light."""
    job.target.mkdir()
    white = max(float(np.percentile(total[::4, ::4], BRIGHT_PERCENTILE)) for _, total in job.totals()) or 1.0
    mosaic = MOSAICS.get(job.folder.manifest.camera.pixel_format[:8])
    small = []
    for index, total in job.totals():
        picture, record = preview(total, 0.0, white, mosaic), job.records[index]
        write_image(job.target / f"slice_{index:04d}.png", ".png", picture, record.model_dump(mode="json"))
        small.append(thumb(picture, f"{index}" + ("  no light" if record.empty else "")))
    write_image(job.target / "contact.png", ".png", sheet(small), job.facts)


@dataclass(frozen=True)
class TransportFormat:
    """One line of TRANSPORT_FORMATS."""

    what: str
    """For the help."""
    write: Callable[[TransportJob], None]
    suffixes: tuple[str, ...] = ()
    """Endings that the name must have; none for a folder of any name."""
    is_folder: bool = False
    """Whether something with a suffix is a folder."""


TRANSPORT_FORMATS: Final = {
    "zarr": TransportFormat(
        "a folder, Zarr 3 with OME-Zarr metadata: light of every slice, and the transport",
        _write_zarr,
        (OME_ZARR,),
        is_folder=True,
    ),
    "exr": TransportFormat("one OpenEXR file, a layer a slice", _write_exr, (".exr",)),
    "png": TransportFormat("a folder of 8-bit previews with a contact sheet", _write_png),
}


def export_transport(
    folder: TransportFolder, kind: str, out: Path, progress: Step | None = None, overwrite: bool = False
) -> int:
    """Write the slices taken so far in one of TRANSPORT_FORMATS; returns how many there are.

    `overwrite`: replace what is there. Raises StorageError, and Cancelled when `progress` returns False; then nothing
    is left behind or changed.
    """
    require(kind in TRANSPORT_FORMATS, "format", kind, f"one of {', '.join(TRANSPORT_FORMATS)} for light transport")
    chosen, records = TRANSPORT_FORMATS[kind], folder.records()
    if not records:
        raise StorageError(f"{folder.path} has no slice yet: there is nothing to export")
    check_out(out, kind, chosen.suffixes, chosen.is_folder, overwrite)

    def step(share: float) -> None:
        if progress is not None and not progress(share):
            raise Cancelled("The export was stopped")

    with replacing(out) as part:
        chosen.write(TransportJob(folder, records, part, step))
    return len(records)
