"""`slopegate scenes`, and what SCENE means to the other commands."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from slopegate.app.commands.report import CommandError, print_json
from slopegate.drivers.scene_files import shipped_scenes


def run_scenes(options: Namespace) -> int:
    """List the scenes that ship with the program."""
    scenes = shipped_scenes()
    if options.json:
        print_json({"scenes": [{"key": s.key, "title": s.title, "description": s.description} for s in scenes]})
        return 0
    width = max((len(scene.key) for scene in scenes), default=0)
    for scene in scenes:
        print(f"  {scene.key:<{width}}  {scene.title}: {scene.description}")
    return 0


def scene_path(name: str) -> Path:
    """The file or folder that SCENE names: one that exists, else a shipped scene by its key. Raises CommandError."""
    path = Path(name)
    if path.exists():
        return path
    shipped = {scene.key: scene.path for scene in shipped_scenes()}
    if name not in shipped:
        raise CommandError(f"{name} is no file, no folder and none of the shipped scenes ({', '.join(shipped)})")
    return shipped[name]
