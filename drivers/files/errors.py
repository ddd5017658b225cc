"""The error of files that are read, and which fault of a table to name."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slopegate.core.rig.checks import UserError, shown

_RULES = (
    ("be less than or equal to", "be at most"),
    ("be greater than or equal to", "be at least"),
    ("be less than", "be below"),
    ("be greater than", "be above"),
)


def first_fault(error: ValidationError) -> ErrorDetails:
    """The fault to tell of several: a misspelt key rather than the key that is missing for it, else the first."""
    faults = error.errors(include_url=False)
    return next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])


def told_fault(error: ValidationError) -> str:
    """What is wrong as a sentence: the key, its value, and what is allowed."""
    found = first_fault(error)
    where = ".".join(str(part) for part in found["loc"]) or "the file"
    if found["type"] == "missing":
        return f"{where} is missing"
    if found["type"] == "extra_forbidden":
        return f"{where} is not a key that is known there"
    if found["type"] == "json_invalid":
        return f"it is not valid JSON ({found['msg'].removeprefix('Invalid JSON: ')})"
    rule = found["msg"].removeprefix("Value error, ").replace("Input should", "it must")
    for long, short in _RULES:
        rule = rule.replace(long, short)
    return f"{where} is {shown(found['input'])}: {rule}"


class SceneError(UserError):
    """A scene or picture cannot be read; one sentence that names the file or the field, and what is allowed."""
