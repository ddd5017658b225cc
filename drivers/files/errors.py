"""The one error of everything that reads scenes."""

from __future__ import annotations


class SceneError(Exception):
    """A scene cannot be opened; the message is one sentence that names the file or the field, and what is allowed."""
