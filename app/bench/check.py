"""The regression guard: ratios and errors of a quick run against a committed baseline."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from slopegate.app.bench.extras import NoiseRow
from slopegate.app.bench.results import Row
from slopegate.app.bench.session import Bench
from slopegate.core.rig.checks import UserError

TIME_MARGIN: Final = 1.6
"""How much larger a ratio to copying the frame may get: quietest runs against quietest runs still vary by a third.

Where another job of the machine hits one way alone it is more, so what seems slower is measured twice."""
ERROR_MARGIN: Final = 1.1
"""How much larger an error may get: processors round alike, but not the libraries that find triangles."""
LEAST_COUNTS: Final = 0.02
"""Errors in counts or percent that differ by less are equal."""
MEMORY_MARGIN: Final = 1.1

ERRORS: Final = {
    "gate": ("edge_rows_max", "level_counts", "edge_counts"),
    "area": ("rms_counts", "rms_rows"),
}


class BaselineError(UserError):
    """The baseline cannot be used; the message is one sentence."""


def baseline(bench: Bench) -> dict[str, Any]:
    """What a later run is compared with: ratios where there are any, errors and memory."""
    rows = {f"{row.scene}: {row.name}": _figures(row) for row in bench.rows if row.group != "peer"}
    noise = {f"noise: {row.name}": _noise_figures(row) for row in bench.noise}
    figures = {name: {kind: _rounded(value) for kind, value in item.items()} for name, item in (rows | noise).items()}
    return {"machine": bench.machine, "figures": figures}


def _rounded(value: float) -> float:
    """Five figures are more than a margin needs."""
    return float(f"{value:.5g}")


def _figures(row: Row) -> dict[str, float]:
    found = {"memory_mb": row.memory_mb}
    if row.cost is not None:
        found["ratio"] = row.cost.quiet_ratio
    for kind, names in ERRORS.items():
        error = getattr(row, kind)
        if error is not None:
            found |= {f"{kind}_{name}": value for name, value in asdict(error).items() if name in names}
    return found


def _noise_figures(row: NoiseRow) -> dict[str, float]:
    found = {f"noise_{name}": value for name, value in asdict(row.error).items() if name != "chance"}
    if row.ratio > 0:
        found["ratio"] = row.ratio
    return found


def load_baseline(path: Path) -> dict[str, dict[str, float]]:
    """The figures of a baseline file. Raises BaselineError."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BaselineError(f"{path} is no baseline of the bench ({type(error).__name__}: {error})") from error
    figures = stored.get("figures") if isinstance(stored, dict) else None
    if not isinstance(figures, dict) or not all(isinstance(item, dict) for item in figures.values()):
        raise BaselineError(f"{path} is no baseline of the bench: its figures are not a table")
    return dict(figures)


def worse(bench: Bench, before: dict[str, dict[str, float]], again: Bench | None = None) -> list[str]:
    """A sentence for every figure beyond its margin and every way that is gone; ratios where both runs have them.

    again: a second run of the same, of whose two ratios the smaller counts: what else the machine does adds only.
    """
    now = baseline(bench)["figures"]
    for name, figures in baseline(again)["figures"].items() if again else ():
        now[name] |= {kind: min(value, now[name][kind]) for kind, value in figures.items() if kind == "ratio"}
    found = [f"{name}: no longer measured" for name in before if name not in now]
    for name, figures in now.items():
        for kind, value in figures.items():
            old = before.get(name, {}).get(kind)
            if old is not None and value > limit(kind, old):
                found.append(f"{name}: {kind} was {old:.4g} and is {value:.4g}, allowed is {limit(kind, old):.4g}")
    return found


def limit(kind: str, old: float) -> float:
    """The most that a figure of this kind may be."""
    if kind == "ratio":
        return old * TIME_MARGIN
    if kind == "memory_mb":
        return old * MEMORY_MARGIN + 0.1
    least = LEAST_COUNTS if kind.endswith(("counts", "percent")) else 1e-3 if kind != "gate_edge_rows_max" else 1e-12
    return old * ERROR_MARGIN + least


def summary_line(problems: Sequence[str], compared: int) -> str:
    """One line for the end of a check."""
    margins = f"margins: ratios x{TIME_MARGIN:g}, errors x{ERROR_MARGIN:g}, memory x{MEMORY_MARGIN:g}"
    if problems:
        return f"{len(problems)} of {compared} figures got worse ({margins})"
    return f"nothing got worse: {compared} figures compared ({margins})"
