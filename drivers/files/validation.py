"""Which of a file's faults its reader is told first."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails


def first_fault(error: ValidationError) -> ErrorDetails:
    """The fault to name: a misspelt key before the one that it leaves out, else the first."""
    faults = error.errors(include_url=False)
    return next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])
