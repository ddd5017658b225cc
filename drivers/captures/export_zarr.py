"""Zarr 3: a folder with the sums as captured, one chunk per slice, OME-Zarr 0.5 metadata and the sidecar."""

from __future__ import annotations

from typing import Any

import numpy as np

from slopegate.drivers.captures.axes import StackAxes, axes_of
from slopegate.drivers.captures.export import ExportJob
from slopegate.drivers.captures.tiff import Sums


def write(job: ExportJob) -> None:
    """Array `0` (slices, H, W): sums of `frames` frames each; array `dark` (H, W), if there is one, likewise.

    What is counted in the dark stands in for slices without light, times the capture's number of frames.
    """
    import zarr

    folder, frames = job.folder, job.folder.manifest.frames
    totals = _dtype(frames * folder.manifest.camera.max_count)
    group = zarr.create_group(store=str(job.target), zarr_format=3)
    height, width = folder.shape
    records = job.records.values()
    axes = axes_of(folder.rig, [record.applied.settings() for record in records])
    slices = group.create_array(
        "0",
        shape=(len(job.records), height, width),
        chunks=(1, height, width),
        dtype=totals,
        dimension_names=axis_names(axes),
    )
    for place, (index, record) in enumerate(job.records.items()):
        job.step(place / len(job.records))
        total = np.rint(folder.mean(index) * np.float64(frames)) if record.empty else folder.total(index)
        slices[place] = total.astype(totals)
    dark: Sums | None = folder.dark_total()
    of_dark = folder.dark_record()
    if dark is not None and of_dark is not None:
        kept = group.create_array("dark", shape=dark.shape, chunks=dark.shape, dtype=dark.dtype)
        kept[:] = dark
        kept.attrs["frames"] = of_dark.frames
    slices.attrs["frames"] = frames
    group.attrs.update({"ome": ome(folder.manifest.scene, axes), "slopegate": job.facts})


def _dtype(most: int) -> type[np.uint16] | type[np.uint32]:
    return np.uint16 if most <= np.iinfo(np.uint16).max else np.uint32


def axis_names(axes: StackAxes) -> tuple[str, str, str]:
    """Names of the dimensions of the array `0`."""
    return ("z" if axes.along == "distance" else "delay", "y", "x")


def ome(name: str, axes: StackAxes) -> Any:
    """OME-Zarr 0.5 metadata of the array `0` (slices, H, W) of a group.

    Where every slice lies, `places`, and the distance at which pixels have their size stand beside the axes, since
    those have room for equal steps alone.
    """
    first, *plane = axis_names(axes)
    kinds = {"distance": {"type": "space", "unit": "meter"}, "delay": {"type": "delay", "unit": "microsecond"}}
    metres = [{"name": axis, **kinds["distance"]} for axis in plane]
    moves = [
        {"type": "scale", "scale": [axes.step, *axes.pixel_m]},
        {"type": "translation", "translation": [axes.places[0], 0.0, 0.0]},
    ]
    return {
        "version": "0.5",
        "multiscales": [
            {
                "name": name,
                "axes": [{"name": first, **kinds[axes.along]}, *metres],
                "datasets": [{"path": "0", "coordinateTransformations": moves}],
                "metadata": {"places": list(axes.places), "pixel_size_at_m": axes.at_m},
            }
        ],
    }
