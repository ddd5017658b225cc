"""OME-TIFF: one file with a 16-bit plane per slice along Z, readable by Bio-Formats, ImageJ and napari."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.drivers.captures.export import ExportJob
from slopegate.drivers.captures.storage import CaptureFolder, software


def write(job: ExportJob) -> None:
    """Planes one by one, so that memory holds one. The sidecar is in the image's Description."""
    import tifffile

    shape = (len(job.records), *job.folder.shape)
    with tifffile.TiffWriter(job.target, ome=True, bigtiff=2 * math.prod(shape) > 3.9e9) as writer:
        writer.write(
            _planes(job),
            shape=shape,
            dtype=np.uint16,
            photometric="minisblack",
            software=software(),
            metadata=_metadata(job),
        )


def steps_per_count(folder: CaptureFolder) -> int:
    """How many steps of a 16-bit plane make one count: the number of frames if their sum fits, which keeps it exact.

    Otherwise the largest whole number for which full scale fits; the mean is then rounded to the nearest step.
    """
    most = 65535 // folder.manifest.camera.max_count
    return min(folder.manifest.frames, most)


def _planes(job: ExportJob) -> Iterator[Counts]:
    steps = steps_per_count(job.folder)
    for place, (index, record) in enumerate(job.records.items()):
        job.step(place / len(job.records))
        if record.frames == steps:
            yield job.folder.total(index).astype(np.uint16)
        else:
            yield np.rint(job.folder.mean(index) * np.float64(steps)).astype(np.uint16)


def _metadata(job: ExportJob) -> dict[str, Any]:
    records, steps = list(job.records.values()), steps_per_count(job.folder)
    count = len(records)
    distances = [record.distance_m for record in records]
    plane: dict[str, Any] = {
        "ExposureTime": [record.applied.exposure_us for record in records],
        "ExposureTimeUnit": ["\u00b5s"] * count,
        "DeltaT": [record.first_time_s - records[0].first_time_s for record in records],
        "DeltaTUnit": ["s"] * count,
    }
    if all(distance is not None for distance in distances):
        plane |= {"PositionZ": distances, "PositionZUnit": ["m"] * count}
    return {
        "axes": "ZYX",
        "Name": job.folder.manifest.scene,
        "Description": json.dumps({"steps_per_count": steps, **job.facts}, allow_nan=False),
        "Plane": plane,
    }
