"""Opening the scene that a command names."""

from __future__ import annotations

from argparse import Namespace

from slopegate.app.api import OpenScene, open_scene
from slopegate.app.commands.report import print_warnings


def opened(options: Namespace, time_s: float = 0.0, skip: bool = True) -> OpenScene:
    """The scene and rig that were named; what the scene file asks for in vain is a warning on standard error."""
    scene = open_scene(options.scene, options.rig, time_s=time_s, skip=skip)
    print_warnings(scene.remarks)
    return scene
