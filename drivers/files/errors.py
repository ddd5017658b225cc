"""The error of files that are read, and which fault of a table to name."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slopegate.core.rig.checks import UserError


def first_fault(error: ValidationError) -> ErrorDetails:
    """The fault to tell of several: a misspelt key rather than the key that is missing for it, else the first."""
    faults = error.errors(include_url=False)
    return next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])


class SceneError(UserError):
    """A scene or picture cannot be read; one sentence that names the file or the field, and what is allowed."""
