"""The error of files that are read, and which fault of a table to name."""

from __future__ import annotations

import re

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slopegate.core.rig.checks import UserError, shown

_RULES = (
    ("be less than or equal to", "be at most"),
    ("be greater than or equal to", "be at least"),
    ("be less than", "be below"),
    ("be greater than", "be above"),
)

_PLACE = re.compile(r"at line (\d+) column (\d+)")


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
        return _json_fault(found["msg"])
    rule = found["msg"].removeprefix("Value error, ").replace("Input should", "it must")
    for long, short in _RULES:
        rule = rule.replace(long, short)
    return f"{where} is {shown(found['input'])}: {rule}"


def _json_fault(said: str) -> str:
    """What the parser says, in our words: where the file is cut short, or where it stops being JSON."""
    place = _PLACE.search(said)
    where = f"line {place[1]}, column {place[2]}" if place else ""
    if "EOF" in said:
        return f"it is cut short{f': it ends in the middle of a value or list, in {where}' if where else ''}"
    if "recursion" in said:
        return "it is not valid JSON: its values are nested too deeply"
    return f"it is not JSON{f' from {where} on' if where else ''}"


class SceneError(UserError):
    """A scene or picture cannot be read; one sentence that names the file or the field, and what is allowed."""
