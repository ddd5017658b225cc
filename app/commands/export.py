"""`slopegate export`: a capture, or light transport, in the formats of other programs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

from slopegate.app.commands.options import add_json, add_overwrite, describe
from slopegate.app.commands.report import CommandError, ShareLine, print_json, print_warnings, say_line
from slopegate.drivers.captures.export import FORMATS, export_capture
from slopegate.drivers.captures.exported import open_any
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.transports.export import export_transport
from slopegate.drivers.transports.storage import TransportFolder, is_transport, open_transport


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Writes a capture in the format of other programs:\n"
        + "\n".join(f"  {name:<9} {item.what}" for name, item in FORMATS.items())
        + "\nor light transport ('slopegate transport acquire'), each slice under a fully lit projector:\n"
        "  zarr      a folder, Zarr 3 with OME-Zarr metadata: light of every slice, and the transport itself\n"
        "  exr       one OpenEXR file with a layer a slice\n"
        "  png       a folder of 8-bit previews with a contact sheet",
        epilog="examples:\n  slopegate export my_capture --format ome-tiff --out slices.ome.tif\n"
        "  slopegate export my_transport --format exr --out layers.exr",
    )
    able = " and ".join(name for name, item in FORMATS.items() if item.subtracts_dark)
    parser.add_argument(
        "capture",
        type=Path,
        metavar="IN",
        help="the folder of a capture, or what it was exported to (.ome.tif, .ome.zarr); or of light transport",
    )
    parser.add_argument("--format", choices=FORMATS, required=True, help="what to write")
    parser.add_argument("--out", type=Path, required=True, metavar="OUT", help="the file, or the new folder")
    parser.add_argument("--subtract-dark", action="store_true", help=f"{able}: subtract the dark frame")
    add_overwrite(parser)
    add_json(parser)


def run(options: Namespace) -> int:
    """Write one format; nothing is left behind unless all of it could be written."""
    if is_transport(options.capture):
        return _of_transport(options)
    folder = open_any(options.capture)
    try:
        count = export_capture(folder, options.format, options.out, options.subtract_dark, _say, options.overwrite)
    finally:
        say_line("")
    report = {
        "capture": str(options.capture),
        "format": options.format,
        "out": str(options.out),
        "slices": count,
        "missing": folder.missing(),
        "frames_a_slice": folder.manifest.frames,
        "steps_per_count": _steps(folder) if options.format == "ome-tiff" else None,
    }
    return _told(options, folder, report)


def _steps(folder: Capture) -> int:
    return folder.manifest.steps_per_count(folder.manifest.frames)


def _of_transport(options: Namespace) -> int:
    if options.subtract_dark:
        raise CommandError("light transport has no dark left to subtract: leave --subtract-dark out")
    folder = open_transport(options.capture)
    try:
        count = export_transport(folder, options.format, options.out, _say, options.overwrite)
    finally:
        say_line("")
    report = {
        "transport": str(options.capture),
        "format": options.format,
        "out": str(options.out),
        "slices": count,
        "missing": folder.missing(),
    }
    return _told(options, folder, report)


def _told(options: Namespace, folder: Capture | TransportFolder, report: dict[str, Any]) -> int:
    """Say what was exported; the exit code."""
    if options.json:
        print_json(report)
    else:
        print(f"{report['slices']} slices of {folder.manifest.scene} are in {options.out}")
        print_warnings([folder.unfinished()] if report["missing"] else [])
    return 0


_line = ShareLine("exporting")


def _say(share: float) -> bool:
    _line(share)
    return True
