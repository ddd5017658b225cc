"""`slopegate` alone: the window."""

from __future__ import annotations

from argparse import Namespace


def run_window(options: Namespace) -> int:
    """Open the window and stay until it is closed."""
    from slopegate.app.window import run

    return run(options.window_scene, options.window_rig)
