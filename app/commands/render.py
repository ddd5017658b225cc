"""`slopegate render`: one gated image of a scene, into files."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slopegate.app.commands.opening import baked, left_out, opened
from slopegate.app.commands.options import (
    NO_SKIP,
    add_gate,
    add_noise,
    add_overwrite,
    add_parts,
    add_rig,
    asked_gate,
    describe,
    number,
    whole,
)
from slopegate.app.commands.report import (
    CommandError,
    finite,
    hardware_warnings,
    print_json,
    print_table,
    print_warnings,
    read_out_values,
    say_line,
    say_share_done,
    settings_values,
    slab_rows,
)
from slopegate.app.session.describe import meaning_text
from slopegate.core.light.lights import total
from slopegate.core.light.part import PARTS, PartName
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.files.durable import check_destination, check_folder, check_new, make_folder
from slopegate.drivers.files.images import LINEAR_SUFFIXES, save_image
from slopegate.drivers.files.picture_files import read_pattern
from slopegate.drivers.files.rig_files import rig_to_toml

if TYPE_CHECKING:
    from slopegate.app.api import OpenScene

COUNT_SUFFIXES = (".tif", ".tiff", ".png")
MAX_SAMPLES = 64


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="One gated image of a scene. What the file holds follows its suffix:\n"
        "  .npy .exr   the light itself, float32: a gate of exactly one projector period is the fully lit image, and\n"
        "              a white frontal surface 1 m from the projector is 1; with --noise, counts as float32\n"
        "  .tif .png   counts of a 12-bit camera, 0 to 4095 as 16-bit integers, with the settings inside",
        epilog="examples:\n"
        "  slopegate render three_targets --clock-mhz 76 --delay-us 1853 --exposure-us 400 --out gated.png\n"
        "  slopegate render three_targets --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1 --out gated.png",
    )
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="a shipped scene (see 'slopegate scenes'), a scene file (.toml), a mesh (.obj .ply .stl .glb .gltf) or a "
        "folder with photo, depth and intrinsics",
    )
    add_gate(parser)
    parser.add_argument("--complement", action="store_true", help="record everything but the slab")
    add_noise(parser, usual=False)
    parser.add_argument(
        "--samples",
        type=whole(1, MAX_SAMPLES),
        default=1,
        metavar="N",
        help=f"rays a pixel along each axis, 1 to {MAX_SAMPLES}; 1 (the default) looks at pixel centres only",
    )
    add_parts(parser)
    parser.add_argument(
        "--pattern",
        type=Path,
        metavar="FILE",
        help="what the projector shows in place of white: a grey 8-bit PNG of its size or of any smaller grid, whose "
        "pixels become even blocks; v is v/255 of the light, linear. Ambient light, which is not the projector's, is "
        "then left out unless --parts names it",
    )
    parser.add_argument("--colour", action="store_true", help="red, green and blue instead of one luminance channel")
    parser.add_argument(
        "--time-s",
        type=number(0.0, 1e6, "a number from 0 to 1e6"),
        default=0.0,
        metavar="S",
        help="the instant of a moving scene, in seconds (0)",
    )
    parser.add_argument("--no-skip", dest="skip", action="store_false", help=NO_SKIP)
    _add_outputs(parser)
    add_rig(parser)


def _add_outputs(parser: ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the image: .npy, .exr, .tif or .png")
    parser.add_argument(
        "--mask-out",
        type=Path,
        metavar="FILE",
        help="a .png, 255 where the gate records light of the projector, else 0",
    )
    parser.add_argument(
        "--depth-out",
        type=Path,
        metavar="FILE",
        help="a .npy, metres from the camera along its axis, NaN where unknown",
    )
    parser.add_argument(
        "--parts-out",
        type=Path,
        metavar="DIR",
        help="a folder for each part of the light as a .npy, linear; they add up to the image's light",
    )
    add_overwrite(parser)


def run(options: Namespace) -> int:
    """Render, gate, and write what was asked for; nothing is written unless all of it could be computed."""
    files = _destinations(options)
    scene = opened(options, options.time_s, options.skip)
    pattern = None if options.pattern is None else read_pattern(options.pattern, scene.rig.projector.raster)
    gate = asked_gate(options, scene)
    asked, but_it = gate.settings, options.complement != gate.complement
    applied = scene.complement(asked) if but_it else asked
    found, recorded = scene.slab_if_any(asked), scene.recorded(applied)
    warnings = [*gate.warnings, *hardware_warnings(scene, asked), *left_out(options, scene), *found.warnings]
    report = _report(options, scene, asked, applied) | {
        "pattern": None if options.pattern is None else str(options.pattern),
        "parts": [name for name in PARTS if name in scene.shown_parts(options.parts, options.max_order, pattern)],
        **read_out_values(found),
        "lit_fraction": float(recorded.mean()),
        "warnings": warnings,
    }
    image, parts = _image(options, scene, applied, pattern)
    if _counted(options):
        report["sensor"] = asdict(scene.sensor(colour=options.colour))
    save_image(files["image"], image, finite(report | {"rig_toml": rig_to_toml(scene.rig)}))
    if "mask" in files:
        save_image(files["mask"], np.where(recorded, 255, 0).astype(np.uint8))
    if "depth" in files:
        save_image(files["depth"], scene.depth_m)
    if "parts" in files:
        make_folder(files["parts"])
        for name, light in parts.items():
            save_image(files["parts"] / f"{name}.npy", light)
    report["files"] = {kind: str(path) for kind, path in files.items()}
    if options.json:
        print_json(report)
        return 0
    _print_report(report, scene)
    if found.slab is None:
        print(f"  keeps: {meaning_text(scene.rig, applied)}")
    print_warnings(warnings)
    return 0


def _destinations(options: Namespace) -> dict[str, Path]:
    """What goes where, refused before any work if it could not be written."""
    wanted = (
        ("image", options.out, (*LINEAR_SUFFIXES, *COUNT_SUFFIXES)),
        ("mask", options.mask_out, (".png",)),
        ("depth", options.depth_out, (".npy",)),
    )
    files: dict[str, Path] = {}
    for kind, path, suffixes in wanted:
        if path is None:
            continue
        check_destination(path, suffixes, overwrite=options.overwrite)
        if path.resolve() in [other.resolve() for other in files.values()]:
            raise CommandError(f"{path} is named twice: each output needs a file of its own")
        files[kind] = path
    if options.parts_out is not None:
        check_folder(options.parts_out)
        for name in () if options.overwrite else PARTS:
            check_new(options.parts_out / f"{name}.npy")
        files["parts"] = options.parts_out
    return files


def _counted(options: Namespace) -> bool:
    """Whether the file is to hold counts, and not the light itself."""
    return bool(options.noise) or options.out.suffix.lower() in COUNT_SUFFIXES


def _image(
    options: Namespace, scene: OpenScene, applied: GateSettings, pattern: Singles | None
) -> tuple[Singles | Counts, dict[PartName, Singles]]:
    """The pixels as the file is to hold them, and the light of each part."""
    colour = options.colour
    try:
        baked(options, scene)
        parts = scene.light_by_part(
            applied,
            colour=colour,
            samples=options.samples,
            parts=options.parts,
            max_order=options.max_order,
            pattern=pattern,
            progress=say_share_done,
        )
    finally:
        say_line("")
    light = total(parts, (*scene.shape, 3) if colour else scene.shape)
    if not _counted(options):
        return light, parts
    counts = scene.expose(light, noise=options.noise, seed=options.seed, colour=colour)
    return counts.astype(np.float32) if options.out.suffix.lower() in LINEAR_SUFFIXES else counts, parts


def _report(options: Namespace, scene: OpenScene, asked: GateSettings, applied: GateSettings) -> dict[str, Any]:
    return {
        "program": f"slopegate {version('slopegate')}",
        "scene": scene.scene_name,
        "rig": scene.name,
        "settings": settings_values(scene, asked) | {"complement": asked != applied},
        "rendered": asdict(applied),
        "unit": "counts" if _counted(options) else "linear, E = 1",
        "noise": options.noise,
        "seed": options.seed,
        "samples": options.samples,
        "colour": options.colour,
        "max_order": options.max_order,
        "time_s": options.time_s,
    }


def _print_report(report: dict[str, Any], scene: OpenScene) -> None:
    height, width = scene.shape
    print(f"{report['scene']} on {scene.name or 'this rig'}, {width} x {height} pixels")
    lit = ("lit", 100 * report["lit_fraction"], "%", "of the pixels receive light through the gate")
    print_table([*slab_rows(report["slab"]), lit])
    for kind, path in report["files"].items():
        print(f"  {kind}: {path}")
