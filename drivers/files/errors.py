"""The one error of everything that reads scenes."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails
from slopegate.core.rig.checks import UserError


def first_fault(error: ValidationError) -> ErrorDetails:
    """The fault to name: a misspelt key before the one that it leaves out, else the first."""
    faults = error.errors(include_url=False)
    return next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])


class SceneError(UserError):
    """A scene cannot be opened; the message is one sentence that names the file or the field, and what is allowed."""
