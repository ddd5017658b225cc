"""OpenEXR: a folder of float32 mean counts, one file per slice, each with its record in the header."""

from __future__ import annotations

from slopegate.drivers.captures.export import ExportJob
from slopegate.drivers.files.images import write_image


def write(job: ExportJob) -> None:
    """slice_0000.exr ... and dark.exr, channel Y. A mosaic stays a mosaic."""
    job.target.mkdir()
    common = job.folder.manifest.model_dump(mode="json", exclude={"slices"})
    for record, mean in job.means():
        facts = {"record": record.model_dump(mode="json"), "capture": common, "dark_subtracted": job.subtract_dark}
        write_image(job.target / f"slice_{record.index:04d}.exr", ".exr", mean, facts)
    dark = job.folder.dark_record()
    if dark is not None:
        facts = {"record": dark.model_dump(mode="json"), "capture": common}
        write_image(job.target / "dark.exr", ".exr", job.folder.dark_mean(), facts)
