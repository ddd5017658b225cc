"""JSON: one file with everything but the pixels, by the schema resources/schemas/capture.schema.json."""

from __future__ import annotations

from slopegate.drivers.captures.export import ExportJob


def write(job: ExportJob) -> None:
    """The sidecar."""
    job.target.write_text(job.folder.sidecar.model_dump_json(indent=1), encoding="utf-8")
