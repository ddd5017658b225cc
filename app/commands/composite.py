"""`slopegate composite`: the foreground of acquired light transport before a new background."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

from slopegate.app.commands.options import add_json, add_overwrite, describe
from slopegate.app.commands.report import CommandError, Row, finite, print_json, print_table, print_warnings
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.files.images import LINEAR_SUFFIXES, VIEWER_SUFFIX, save_image, shares8
from slopegate.drivers.files.picture_files import read_colour


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Cuts out what lies in some slices and puts a new background behind it, without a green screen:\n"
        "how much of a pixel is foreground is the share of its light that came from the foreground's\n"
        "slices, so green things before a green wall are cut out as well as any others, and fine edges\n"
        "softly. With --relight the foreground is lit by its own light transport with the background's\n"
        "colours, so that it looks as if it stood there. What the file holds follows its suffix: .png is\n"
        "a picture to look at (8 bit), .npy and .exr hold linear light.",
        epilog="example:\n  slopegate composite targets --foreground 0,1 --background beach.jpg --relight --out a.png",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="the folder of 'slopegate transport acquire'")
    parser.add_argument(
        "--foreground",
        type=_places,
        required=True,
        metavar="I[,J...]",
        help="the slices that are kept, counted from 0 as 'slopegate transport show' does",
    )
    parser.add_argument(
        "--background",
        type=Path,
        required=True,
        metavar="FILE",
        help="a picture (.png .jpg .jpeg .bmp .webp .tif), which is cut and resized to the camera's image",
    )
    parser.add_argument(
        "--relight", action="store_true", help="light the foreground by its transport with the background's colours"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the image: .png, .npy or .exr")
    parser.add_argument(
        "--matte-out",
        type=Path,
        metavar="FILE",
        help="the matte: a .png, 255 where all of a pixel is foreground; or a .npy or .exr of shares, 0 to 1",
    )
    add_overwrite(parser)
    add_json(parser)


def _places(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdigit() and len(part) < 6 for part in parts) or len({int(part) for part in parts}) < len(parts):
        raise ArgumentTypeError(f"{text!r} must be different slices' numbers with commas in between, such as 0,2")
    return tuple(int(part) for part in parts)


def run(options: Namespace) -> int:
    """Compose, and write the image and the matte."""
    from slopegate.app.api import open_transport

    files = _destinations(options)
    transport = open_transport(options.folder)
    background = read_colour(options.background)
    made = transport.composite(options.foreground, background, relit=options.relight)
    report: dict[str, Any] = {
        "folder": str(options.folder),
        "foreground": list(options.foreground),
        "background": str(options.background),
        "relight": options.relight,
        "foreground_share": float(made.matte.mean()),
        "mixed_share": float(((made.matte > 0) & (made.matte < 1)).mean()),
        "unit": transport.linear_unit,
        "files": {kind: str(path) for kind, path in files.items()},
    }
    facts = finite(report)
    viewer = options.out.suffix.lower() == VIEWER_SUFFIX
    save_image(options.out, transport.viewer_ready(made.image) if viewer else made.image, facts)
    if "matte" in files:
        shares = files["matte"].suffix.lower() != VIEWER_SUFFIX
        save_image(files["matte"], made.matte if shares else shares8(made.matte), facts)
    print_warnings([transport.folder.unfinished()] if transport.missing else [])
    if options.json:
        print_json(report)
        return 0
    print(f"{transport.scene_name} before {options.background.name}: {options.out}")
    rows: list[Row] = [
        ("foreground", 100 * report["foreground_share"], "%", "of the image"),
        ("mixed", 100 * report["mixed_share"], "%", "of the pixels show both"),
    ]
    print_table(rows)
    return 0


def _destinations(options: Namespace) -> dict[str, Path]:
    """What goes where, refused before any work if it could not be written."""
    files: dict[str, Path] = {"image": options.out}
    if options.matte_out is not None:
        files["matte"] = options.matte_out
        if options.matte_out.resolve() == options.out.resolve():
            raise CommandError(f"{options.out} is named twice: each output needs a file of its own")
    for path in files.values():
        check_destination(path, (VIEWER_SUFFIX, *LINEAR_SUFFIXES), overwrite=options.overwrite)
    return files
