"""`slopegate scenes`."""

from __future__ import annotations

from argparse import Namespace

from slopegate.app.commands.report import print_json
from slopegate.drivers.scenes.scene_files import offered_scenes


def run_scenes(options: Namespace) -> int:
    """List the scenes that ship with the program."""
    scenes = offered_scenes()
    if options.json:
        print_json({"scenes": [{"key": s.key, "title": s.title, "description": s.description} for s in scenes]})
        return 0
    width = max((len(scene.key) for scene in scenes), default=0)
    for scene in scenes:
        print(f"  {scene.key:<{width}}  {scene.title}: {scene.description}")
    return 0
