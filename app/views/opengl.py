"""Whether the display can draw in 3D."""

from __future__ import annotations

from PySide6.QtGui import QGuiApplication, QOffscreenSurface, QOpenGLContext

_NO_3D = ("offscreen", "minimal", "linuxfb", "vnc")
_OLDEST = (2, 1)


def opengl_missing() -> str:
    """Why there is no 3D picture here, as a clause, or an empty string; tries a real context."""
    platform = QGuiApplication.platformName()
    if platform in _NO_3D:
        return f"the display platform '{platform}' draws no OpenGL"
    context = QOpenGLContext()
    if not context.create():
        return "no OpenGL context could be created"
    surface = QOffscreenSurface()
    surface.setFormat(context.format())
    surface.create()
    if not context.makeCurrent(surface):
        return "the OpenGL context cannot be used"
    context.doneCurrent()
    version = context.format().version()
    if not context.isOpenGLES() and version < _OLDEST:
        return f"the OpenGL driver is version {version[0]}.{version[1]}; 2.1 is the oldest that will do"
    return ""
