"""`slopegate export`: a capture in the formats of other programs."""

from __future__ import annotations

import sys
from argparse import Namespace

from slopegate.app.commands.report import print_json, print_warnings, share_line_done
from slopegate.drivers.captures.export import export_capture
from slopegate.drivers.captures.export_ome import steps_per_count
from slopegate.drivers.captures.storage import open_capture


def run_export(options: Namespace) -> int:
    """Write one format; nothing is left behind unless all of it could be written."""
    folder = open_capture(options.capture)
    try:
        count = export_capture(folder, options.format, options.out, options.subtract_dark, _say)
    finally:
        share_line_done()
    report = {
        "capture": str(options.capture),
        "format": options.format,
        "out": str(options.out),
        "slices": count,
        "missing": folder.missing(),
        "frames_a_slice": folder.manifest.frames,
        "steps_per_count": steps_per_count(folder) if options.format == "ome-tiff" else None,
    }
    if options.json:
        print_json(report)
    else:
        print(f"{count} slices of {folder.manifest.scene} are in {options.out}")
        print_warnings([folder.unfinished()] if report["missing"] else [])
    return 0


def _say(share: float) -> bool:
    if sys.stderr.isatty():
        print(f"\rexporting {100 * share:3.0f} %", end="", file=sys.stderr, flush=True)
    return True
