"""OME-TIFF: one file with a 16-bit plane per slice along Z, readable by Bio-Formats, ImageJ and napari."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.drivers.captures.axes import axes_of
from slopegate.drivers.captures.export import ExportJob
from slopegate.drivers.captures.storage import software


def write(job: ExportJob) -> None:
    """Planes one by one, so that memory holds one; then the dark frame, if there is one, as an image of its own.

    The sidecar is in the first image's Description.
    """
    import tifffile

    folder = job.folder
    shape = (len(job.records), *folder.shape)
    of_dark, dark = folder.dark_record(), folder.dark_total()
    large = 2 * math.prod((len(job.records) + 1, *folder.shape)) > 3.9e9
    with tifffile.TiffWriter(job.target, ome=True, bigtiff=large) as writer:
        writer.write(
            _planes(job),
            shape=shape,
            dtype=np.uint16,
            photometric="minisblack",
            software=software(),
            metadata=_metadata(job),
        )
        if of_dark is not None and dark is not None:
            steps = folder.manifest.steps_per_count(of_dark.frames)
            plane = np.rint(dark * np.float64(steps / of_dark.frames)).astype(np.uint16)
            writer.write(plane, photometric="minisblack", metadata={"axes": "YX", "Name": "dark"})


def _planes(job: ExportJob) -> Iterator[Counts]:
    manifest = job.folder.manifest
    steps = manifest.steps_per_count(manifest.frames)
    for place, (index, record) in enumerate(job.records.items()):
        job.step(place / len(job.records))
        if record.frames == steps:
            yield job.folder.total(index).astype(np.uint16)
        else:
            yield np.rint(job.folder.mean(index) * np.float64(steps)).astype(np.uint16)


def _metadata(job: ExportJob) -> dict[str, Any]:
    records, manifest = list(job.records.values()), job.folder.manifest
    steps = manifest.steps_per_count(manifest.frames)
    count = len(records)
    axes = axes_of(job.folder.rig, [record.applied.settings() for record in records])
    plane: dict[str, Any] = {
        "ExposureTime": [record.applied.exposure_us for record in records],
        "ExposureTimeUnit": ["\u00b5s"] * count,
        "DeltaT": [record.first_time_s - records[0].first_time_s for record in records],
        "DeltaTUnit": ["s"] * count,
    }
    sizes: dict[str, Any] = {
        "PhysicalSizeX": axes.pixel_m[1],
        "PhysicalSizeXUnit": "m",
        "PhysicalSizeY": axes.pixel_m[0],
        "PhysicalSizeYUnit": "m",
    }
    if axes.along == "distance":
        plane |= {"PositionZ": list(axes.places), "PositionZUnit": ["m"] * count}
        sizes |= {"PhysicalSizeZ": abs(axes.step), "PhysicalSizeZUnit": "m"}
    facts = {"steps_per_count": steps, "pixel_size_at_m": axes.at_m, **job.facts}
    return {
        "axes": "ZYX",
        "Name": job.folder.manifest.scene,
        "Description": json.dumps(facts, allow_nan=False),
        "Plane": plane,
        **sizes,
    }
