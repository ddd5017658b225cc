"""`slopegate relight`: acquired light transport under other light."""

from __future__ import annotations

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from slopegate.app.commands.options import add_json, add_overwrite, describe
from slopegate.app.commands.report import CommandError, decibels, finite, print_json, print_table, print_warnings
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.files.images import LINEAR_SUFFIXES, VIEWER_SUFFIX, save_image

if TYPE_CHECKING:
    from slopegate.app.api import OpenTransport, SliceLight

WEIGHTS: Final = ("tiling", "least-squares", "paper")
COLOURS: Final = {
    "black": (0.0, 0.0, 0.0),
    "white": (1.0, 1.0, 1.0),
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "cyan": (0.0, 1.0, 1.0),
    "magenta": (1.0, 0.0, 1.0),
    "yellow": (1.0, 1.0, 0.0),
    "orange": (1.0, 0.5, 0.0),
}
WHITE: Final = COLOURS["white"]


@dataclass(frozen=True)
class AskedLight:
    """What `--slice` asks for: a slice's number, and a colour or a file with a picture."""

    place: int
    colour: tuple[float, float, float] | None
    file: Path | None


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    names = ", ".join(COLOURS)
    describe(
        parser,
        description="Lights what was acquired anew: every slice of space by its own colour or picture, as if the\n"
        "projector had shown it there and nowhere else. Slices that are not named stay white. What the\n"
        "file holds follows its suffix:\n"
        "  .npy .exr   the light itself, float32, (H, W), or (H, W, 3) in colour: of a scene in the unit of\n"
        "              'slopegate render', of a camera in counts above the dark\n"
        "  .png        a picture to look at, 8 bit, whose white is that of the fully lit image\n"
        "psnr_db and ssim say how like the captured fully lit image the slices under white light are,\n"
        "added up with the weights chosen; they do not depend on the colours.",
        epilog="examples:\n  slopegate relight targets --slice 0=red --slice 1=#00ff80 --slice 2=black --out a.png\n"
        "  slopegate relight targets --pattern stripes.png --out relit.exr\n"
        "  slopegate relight bottle --slice 0=logo.png --slice 1=green --out composite.png --json",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="the folder of 'slopegate transport acquire'")
    parser.add_argument(
        "--slice",
        dest="slices",
        type=_asked_light,
        action="append",
        default=[],
        metavar="I=COLOUR|FILE",
        help=f"the light of slice I, counted from 0 as 'slopegate transport show' does: {names}, or #RRGGBB, each "
        "value of 255 of the light, linear; or a picture as for --pattern, grey or in colour; once a slice",
    )
    parser.add_argument(
        "--pattern",
        type=Path,
        metavar="FILE",
        help="what the projector shows in every slice that has no picture of its own: a PNG, 8-bit v meaning v/255 of "
        "the light, linear, of the projector's size or of any grid up to it",
    )
    parser.add_argument(
        "--weights",
        choices=WEIGHTS,
        default=WEIGHTS[0],
        help="how slices add up: tiling (the default): as they are, exact where they tile; least-squares: as even as "
        "they can be over what is lit, for slices that leave gaps or overlap; paper: |dz/dt_d| of its equation 15",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the image: .npy, .exr or .png")
    add_overwrite(parser)
    add_json(parser)


def run(options: Namespace) -> int:
    """Relight, and write the image."""
    from slopegate.app.api import open_transport

    check_destination(options.out, (*LINEAR_SUFFIXES, VIEWER_SUFFIX), overwrite=options.overwrite)
    transport = open_transport(options.folder)
    lights = _lights(options, transport)
    image = transport.relight(lights, weighting=options.weights)
    like = transport.agreement(options.weights)
    report = {
        "folder": str(options.folder),
        "slices": len(lights),
        "weights": options.weights,
        "weight_of_slice": list(transport.weights(options.weights)),
        "colour": image.ndim == 3,
        "unit": transport.linear_unit,
        "psnr_db": None if like is None else decibels(like.psnr_db),
        "ssim": None if like is None else like.ssim,
        "files": {"image": str(options.out)},
    }
    save = transport.viewer_ready(image) if options.out.suffix.lower() == VIEWER_SUFFIX else image
    save_image(options.out, save, finite(report))
    print_warnings([transport.folder.unfinished()] if transport.missing else [])
    if options.json:
        print_json(report)
        return 0
    print(f"{transport.scene_name}, {len(lights)} slices relit: {options.out}")
    if like is not None:
        print_table(
            [
                (
                    "PSNR",
                    like.psnr_db,
                    "dB",
                    f"of all slices in white, weights {options.weights}, against what was captured",
                ),
                ("SSIM", like.ssim, "", "the same"),
            ]
        )
    return 0


def _asked_light(text: str) -> AskedLight:
    place, equals, light = (part.strip() for part in text.partition("="))
    if not (equals and light and re.fullmatch(r"\d{1,5}", place)):
        raise ArgumentTypeError(f"{text!r} must be I=COLOUR or I=FILE, such as 0=red")
    if light.lower() in COLOURS:
        return AskedLight(int(place), COLOURS[light.lower()], None)
    if re.fullmatch(r"#[0-9a-fA-F]{6}", light):
        red, green, blue = (int(light[start : start + 2], 16) / 255 for start in (1, 3, 5))
        return AskedLight(int(place), (red, green, blue), None)
    if light.startswith("#"):
        raise ArgumentTypeError(f"{light!r} must be #RRGGBB, six hexadecimal digits")
    return AskedLight(int(place), None, Path(light))


def _lights(options: Namespace, transport: OpenTransport) -> tuple[SliceLight, ...]:
    """One for each slice, with the picture of `--pattern` unless the slice has its own."""
    from slopegate.app.api import SliceLight

    asked: dict[int, AskedLight] = {}
    for one in options.slices:
        count = len(transport.gates)
        if one.place >= count:
            raise CommandError(f"--slice {one.place}: {options.folder} has slices 0 to {count - 1}")
        if one.place in asked:
            raise CommandError(f"--slice {one.place} is given twice: a slice has one light")
        asked[one.place] = one
    common = None if options.pattern is None else transport.picture(options.pattern)
    lights = []
    for place in range(len(transport.gates)):
        one = asked.get(place, AskedLight(place, WHITE, None))
        picture = common if one.file is None else transport.picture(one.file)
        lights.append(SliceLight(one.colour or WHITE, picture, 1.0, True))
    return tuple(lights)
