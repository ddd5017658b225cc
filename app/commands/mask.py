"""`slopegate mask`: the gate that keeps or hides a region of the image."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import add_noise, add_overwrite, add_rectangle, add_rig, add_scene, describe
from slopegate.app.commands.report import (
    CommandError,
    Row,
    print_json,
    print_table,
    print_warnings,
    read_out_values,
    say_line,
    say_share_done,
    settings_values,
    slab_rows,
)
from slopegate.core.rig.arrays import Bools
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.files.images import save_image
from slopegate.drivers.files.picture_files import read_region

if TYPE_CHECKING:
    from slopegate.app.api import MaskGate, OpenScene

NO_GOOD_GATE = 1


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="The gate, or the complement of one, that keeps or hides a region of the image: of all gates\n"
        "whose overlap with it is within 5 % of the greatest, the thinnest. How well it does is predicted, and\n"
        "counted in frames of the virtual camera. Exit code 0 when the overlap is good (0.5 or more), 1 when even the\n"
        "nearest gate's is not.",
        epilog="examples:\n  slopegate mask three_targets --region 120 220 530 820\n"
        "  slopegate mask table --region-png painted.png --hide --measured --json",
    )
    add_scene(parser)
    region = parser.add_mutually_exclusive_group(required=True)
    add_rectangle(region, "--region", "")
    region.add_argument(
        "--region-png",
        type=Path,
        metavar="FILE",
        help="a picture of the image's size, grey or colour, white where the region is: any colour above half of the "
        "brightest; what is transparent is not of the region",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--keep", action="store_false", dest="hide", help="keep the region, mask the rest (the default)")
    what.add_argument("--hide", action="store_true", dest="hide", help="mask the region, keep the rest")
    parser.set_defaults(hide=False)
    parser.add_argument(
        "--measured", action="store_true", help="with depth from a sweep of the gate instead of the scene's own"
    )
    parser.add_argument(
        "--mask-out",
        type=Path,
        metavar="FILE",
        help="a .png, 255 where the gate records light of the projector, else 0",
    )
    add_overwrite(parser)
    add_noise(parser, usual=True)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Find the gate, count in frames what it does, and say both; 1 when no gate does it well."""
    if options.mask_out is not None:
        check_destination(options.mask_out, (".png",), overwrite=options.overwrite)
    scene = opened(options)
    region = tuple(options.region) if options.region_png is None else _painted(options.region_png, scene.shape)
    noise, seed = options.noise, options.seed
    try:
        swept = scene.measure_depth(noise=noise, seed=seed, progress=say_share_done).map if options.measured else None
    finally:
        say_line("")
    found = scene.mask(region, hide=options.hide, depth=swept, noise=noise, seed=seed)
    if options.mask_out is not None:
        save_image(options.mask_out, np.where(scene.recorded(found.best.sent), 255, 0).astype(np.uint8))
    values = {
        "scene": scene.scene_name,
        "rig": scene.name,
        "hide": options.hide,
        "sweep_frames": 0 if swept is None else swept.frames,
    }
    values |= _values(scene, found.best) | {"achieved_iou": found.achieved_iou, "told_share": found.told_share}
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0 if found.best.good else NO_GOOD_GATE


def _painted(path: Path, shape: tuple[int, int]) -> Bools:
    painted = read_region(path)
    if painted.shape != shape:
        raise CommandError(
            f"{path} is {painted.shape[1]} x {painted.shape[0]} pixels: it must be of the image's size, "
            f"{shape[1]} x {shape[0]}"
        )
    return painted


def _values(scene: OpenScene, best: MaskGate) -> dict[str, Any]:
    found = scene.slab_if_any(best.gate)
    return {
        "good": best.good,
        "iou": best.iou,
        "hit_pixels": best.hit_pixels,
        "missed_pixels": best.missed_pixels,
        "extra_pixels": best.extra_pixels,
        "settings": settings_values(scene, best.gate) | {"complement": best.complement},
        "sent": settings_values(scene, best.sent),
        **read_out_values(found),
        "clocks_tried": best.line_times,
        "warnings": list(found.warnings),
    }


def _print(values: dict[str, Any]) -> None:
    from slopegate.core.measure.mask import GOOD_IOU

    verb = "hides" if values["hide"] else "keeps"
    word = "the best gate" if values["good"] else "no gate does it well; the nearest one"
    print(f"{values['scene']}: {word} {verb} the region with an overlap of {values['iou']:.3f}")
    settings = values["settings"]
    rows: list[Row] = []
    if settings["clock_mhz"] is not None:
        rows.append(("pixel clock", settings["clock_mhz"], "MHz", f"of {values['clocks_tried']} tried"))
    what = "everything but this gate is recorded" if settings["complement"] else ""
    rows += [
        ("delay", settings["delay_us"], "us", ""),
        ("exposure", settings["exposure_us"], "us", what),
        *slab_rows(values["slab"]),
        ("predicted", values["iou"], "", f"overlap (intersection over union; good from {GOOD_IOU:g})"),
        ("achieved", values["achieved_iou"], "", f"in frames, over {values['told_share']:.0%} of the lit pixels"),
    ]
    print_table(rows)
    print_warnings(values["warnings"])
