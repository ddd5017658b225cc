"""How commands speak: one JSON object, an aligned table, warnings and refusals."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from slopegate.core.rig.checks import UserError


class CommandError(UserError):
    """The command cannot be done; the message is one sentence for the user."""


def print_json(values: dict[str, Any]) -> None:
    """One JSON object on standard output; numbers that are not finite become null."""
    print(json.dumps(finite(values), indent=2, allow_nan=False))


def finite(value: Any) -> Any:
    """The same nested value with None for NaN and infinity, tuples as lists."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_table(rows: Sequence[tuple[str, float | str | None, str, str]]) -> None:
    """Label, value, unit and remark, aligned; None is a dash."""
    shown = [(label, _number(value), unit, remark) for label, value, unit, remark in rows]
    widths = [max(len(row[column]) for row in shown) for column in range(3)]
    for label, value, unit, remark in shown:
        print(f"  {label:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {remark}".rstrip())


def _number(value: float | str | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{round(value, 4) + 0.0:.4f}" if abs(value) < 1e9 else f"{value:.6g}"  # no minus before a zero


def print_warnings(warnings: Iterable[str]) -> None:
    """On standard error, one line each."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def say_share_done(share: float) -> bool:
    """Long work on a terminal: the share done, 0..1, on one line of standard error. Silent for programs."""
    if sys.stderr.isatty():
        print(f"\rrendering {100 * share:3.0f} %", end="", file=sys.stderr, flush=True)
    return True


def share_line_done() -> None:
    """Take the line away again."""
    if sys.stderr.isatty():
        print("\r" + " " * 60 + "\r", end="", file=sys.stderr, flush=True)
