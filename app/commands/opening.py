"""Opening the scene that a command names."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from slopegate.app.commands.report import print_warnings, say_share_done

if TYPE_CHECKING:
    from slopegate.app.api import OpenScene
    from slopegate.drivers.scenes.bakes import BakeReport


def opened(options: Namespace, time_s: float = 0.0, skip: bool = True) -> OpenScene:
    """The scene and rig that were named; what the scene file asks for in vain is a warning on standard error."""
    from slopegate.app.api import open_scene

    scene = open_scene(options.scene, options.rig, time_s=time_s, skip=skip)
    print_warnings(scene.remarks)
    return scene


def baked(options: Namespace, scene: OpenScene) -> None:
    """Bake what the options of `add_parts` ask for, if they ask for indirect light."""
    if scene.needs_bake(options.parts, options.max_order):
        report = scene.bake(
            paths=options.paths,
            error_percent=options.error_percent,
            max_order=options.max_order,
            patterns=getattr(options, "pattern", None) is not None,
            progress=say_share_done,
        )
        print_warnings(noisier(options, report))


def left_out(options: Namespace, scene: OpenScene) -> list[str]:
    """What to tell of parts that are asked for and that this scene cannot have."""
    shown = scene.shown_parts(options.parts, options.max_order)
    if "indirect" not in shown or scene.needs_bake(options.parts, options.max_order):
        return []
    return ["indirect light is left out: a photo with depth has no surfaces that light could go between"]


def noisier(options: Namespace, report: BakeReport) -> list[str]:
    """What to tell of a bake that ended before it was as good as the options of `add_bake` ask."""
    from slopegate.drivers.scenes.bakes import USUAL_ERROR_PERCENT

    asked = options.error_percent or USUAL_ERROR_PERCENT
    if options.paths is not None or report.error_percent <= asked:
        return []
    return [
        f"the noise of indirect light is {report.error_percent:.2g} %, not {asked:g} %, after {report.paths} paths a "
        "cell: --paths traces more"
    ]
