"""Lists screens and OpenGL in a process of its own, because Qt ends the process where there is no display.

`python -m slopegate.app.devices.screen_probe` prints one JSON object.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import Any


def _screens() -> list[dict[str, Any]]:
    from PySide6.QtGui import QGuiApplication

    from slopegate.app.devices.projector_screens import facts

    return [asdict(facts(screen)) for screen in QGuiApplication.screens()]


def _opengl() -> dict[str, str]:
    from PySide6.QtGui import QOffscreenSurface, QOpenGLContext

    surface, context = QOffscreenSurface(), QOpenGLContext()
    surface.create()
    if not context.create() or not context.makeCurrent(surface):
        return {"error": "no OpenGL context could be made"}
    from OpenGL import GL

    words = {"renderer": GL.GL_RENDERER, "version": GL.GL_VERSION}
    told = {name: (GL.glGetString(code) or b"").decode("ascii", "replace") for name, code in words.items()}
    context.doneCurrent()
    return told


def main() -> int:
    """Print the screens and the OpenGL driver."""
    from PySide6.QtGui import QGuiApplication

    application = QGuiApplication(sys.argv[:1])
    facts: dict[str, Any] = {"platform": application.platformName(), "screens": _screens()}
    try:
        facts["opengl"] = _opengl()
    except Exception as error:  # whatever a graphics driver does
        facts["opengl"] = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
