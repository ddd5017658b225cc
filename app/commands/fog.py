"""`slopegate fog`: how like the fog-free scene a gate's image is, at every exposure."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.opening import baked, opened
from slopegate.app.commands.options import (
    add_gate,
    add_parts,
    add_rectangle,
    add_rig,
    add_scene,
    asked_gate,
    describe,
    whole,
)
from slopegate.app.commands.report import (
    ShareLine,
    hardware_warnings,
    print_json,
    print_warnings,
    say_line,
    settings_values,
)
from slopegate.core.light.part import PARTS
from slopegate.core.rig.checks import require_rectangle

if TYPE_CHECKING:
    from slopegate.app.api import ExposureSweep, OpenScene
    from slopegate.core.rig.settings import GateSettings

MAX_COUNT = 1000
MAX_FRAMES = 1000


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="How like the same scene without fog a gate's image is, at every exposure: short ones leave out\n"
        "what they are to show and are noisy, long ones let in the light of the fog. Told of each exposure, from\n"
        "frames with the camera's noise: NCC (zero-mean normalised cross-correlation with the fully lit scene without\n"
        "fog), contrast (Michelson, of the means of what is bright and what is dark without fog), and the difference\n"
        "of the two over a pixel's noise. The exposure of the greatest NCC as measured, and as predicted before a\n"
        "frame is taken, from the light that is to be expected.",
        epilog="example:\n  slopegate fog fog_road --clock-mhz 78 --delay-us 3042 --region 1105 105 1415 380",
    )
    add_scene(parser)
    add_gate(parser, exposure=False)
    add_rectangle(parser, "--region", "what is to be seen (default: the whole image): ")
    parser.add_argument(
        "--count",
        type=whole(2, MAX_COUNT),
        default=40,
        metavar="N",
        help="exposures at equal ratios, from the camera's least to one period of the projector (40)",
    )
    parser.add_argument(
        "--frames",
        type=whole(2, MAX_FRAMES),
        default=5,
        metavar="N",
        help="frames taken of each exposure, whose figures are averaged (5)",
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="which noise: the same number, the same (0)"
    )
    add_parts(parser)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Sweep the exposure, and print what was seen and what was expected."""
    scene = opened(options)
    gate = asked_gate(options, scene)
    asked = gate.settings
    height, width = scene.shape
    region: tuple[int, int, int, int] = tuple(options.region or (0, 0, width, height))
    require_rectangle("region", region, width, height)
    try:
        baked(options, scene)
        found = scene.sweep_exposure(
            delay_us=asked.delay_us,
            line_time_us=asked.line_time_us,
            region=region,
            count=options.count,
            frames=options.frames,
            seed=options.seed,
            parts=options.parts,
            max_order=options.max_order,
            progress=ShareLine("sweeping"),
        )
    finally:
        say_line("")
    warnings = [*gate.warnings, *_warnings(scene, asked)]
    if options.json:
        print_json(_values(options, scene, region, asked, found) | {"warnings": warnings})
        return 0
    _print(scene, found)
    print_warnings(warnings)
    return 0


def _warnings(scene: OpenScene, asked: GateSettings) -> list[str]:
    found = hardware_warnings(scene, replace(asked, exposure_us=scene.rounded(asked).exposure_us))
    if scene.scene.fog is None:
        found.append("this scene has no fog")
    if scene.moving:
        found.append("something moves in this scene: every frame shows the instant 0")
    return found


def _values(
    options: Namespace,
    scene: OpenScene,
    region: tuple[int, int, int, int],
    asked: GateSettings,
    found: ExposureSweep,
) -> dict[str, Any]:
    settings = settings_values(scene, asked)
    del settings["exposure_us"]
    return {
        "scene": scene.scene_name,
        "rig": scene.name,
        "region": list(region),
        "settings": settings,
        "parts": [name for name in PARTS if name in scene.shown_parts(options.parts, options.max_order)],
        "max_order": options.max_order,
        "frames": options.frames,
        "seed": options.seed,
        "exposure_us": found.exposures_us,
        "ncc": [one.ncc for one in found.measured],
        "contrast": [one.contrast for one in found.measured],
        "cnr": [one.cnr for one in found.measured],
        "predicted_ncc": [one.ncc for one in found.expected],
        "best_us": found.best_us,
        "predicted_us": found.predicted_us,
        "regular_ncc": found.regular.ncc,
        "regular_contrast": found.regular.contrast,
        "regular_cnr": found.regular.cnr,
    }


def _print(scene: OpenScene, found: ExposureSweep) -> None:
    print(f"{scene.scene_name}: the image is most like the scene without fog at {found.best_us:g} us")
    print(f"  predicted before a frame was taken: {found.predicted_us:g} us")
    print(f"  {'exposure, us':>12}  {'NCC':>6}  {'predicted':>9}  {'contrast':>8}  {'contrast / noise':>16}")
    for exposure, one, other in zip(found.exposures_us, found.measured, found.expected, strict=True):
        mark = "  best" if exposure == found.best_us else ""
        print(f"  {exposure:>12g}  {one.ncc:>6.4f}  {other.ncc:>9.4f}  {one.contrast:>8.4f}  {one.cnr:>16.2f}{mark}")
    one = found.regular
    print(f"  {'fully lit':>12}  {one.ncc:>6.4f}  {'':>9}  {one.contrast:>8.4f}  {one.cnr:>16.2f}")
