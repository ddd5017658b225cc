"""The scene that a command names."""

from __future__ import annotations

from argparse import Namespace

from slopegate.app.commands.report import print_warnings
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path


def opened(options: Namespace) -> tuple[Rig, Scene]:
    """The rig and the scene that were named; what the scene file asks for in vain is a warning on standard error."""
    rig, scene = open_scene(scene_path(options.scene), load_rig(options.rig))
    print_warnings(scene.remarks)
    return rig, scene
