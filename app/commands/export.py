"""`slopegate export`: a capture in the formats of other programs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from slopegate.app.commands.options import add_json, describe
from slopegate.app.commands.report import print_json, print_warnings, say_line
from slopegate.drivers.captures.export import FORMATS, export_capture
from slopegate.drivers.captures.export_ome import steps_per_count
from slopegate.drivers.captures.storage import open_capture


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Writes a capture in the format of other programs:\n"
        + "\n".join(f"  {name:<9} {item.what}" for name, item in FORMATS.items()),
        epilog="example:\n  slopegate export my_capture --format ome-tiff --out slices.ome.tif",
    )
    able = " and ".join(name for name, item in FORMATS.items() if item.subtracts_dark)
    parser.add_argument("capture", type=Path, metavar="IN", help="the folder of a capture")
    parser.add_argument("--format", choices=FORMATS, required=True, help="what to write")
    parser.add_argument("--out", type=Path, required=True, metavar="OUT", help="the file, or the new folder")
    parser.add_argument("--subtract-dark", action="store_true", help=f"{able}: subtract the dark frame")
    add_json(parser)


def run(options: Namespace) -> int:
    """Write one format; nothing is left behind unless all of it could be written."""
    folder = open_capture(options.capture)
    try:
        count = export_capture(folder, options.format, options.out, options.subtract_dark, _say)
    finally:
        say_line("")
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
    say_line(f"exporting {100 * share:3.0f} %")
    return True
