"""`slopegate scenes`: what comes with the program to look at."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from slopegate.app.commands.options import add_json, describe
from slopegate.app.commands.report import print_json
from slopegate.drivers.scenes.scene_files import offered_scenes


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="The scenes that ship with the program; 'render' takes the first word of a line as SCENE.",
        epilog="example:\n  slopegate scenes",
    )
    add_json(parser)


def run(options: Namespace) -> int:
    """List the scenes that ship with the program."""
    scenes = offered_scenes()
    if options.json:
        print_json({"scenes": [{"key": s.key, "title": s.title, "description": s.description} for s in scenes]})
        return 0
    width = max((len(scene.key) for scene in scenes), default=0)
    for scene in scenes:
        print(f"  {scene.key:<{width}}  {scene.title}: {scene.description}")
    return 0
