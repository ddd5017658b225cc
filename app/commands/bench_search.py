"""`slopegate bench --search`: both methods of the search on scenes whose answer is known."""

from __future__ import annotations

import sys
from argparse import Namespace
from typing import Any

from slopegate.app.bench.search_score import run
from slopegate.app.commands.report import print_json
from slopegate.core.search.state import METHODS

ROWS = (
    ("found: says so, and covers 80 % of the target", "covers", ""),
    ("found and isolated as well as 80 % of the best gate", "right", ""),
    ("wrong: says found, and it is not", "wrong", ""),
    ("the same where the target is not findable", "wrong_not_findable", ""),
    ("frames, median", "median_frames", "{:.0f}"),
    ("intersection over union, median", "median_iou", "{:.3f}"),
    ("the same within the rectangle", "median_iou_inside", "{:.3f}"),
    ("that of the best gate there is", "median_best_iou", "{:.3f}"),
    ("keypoints kept where found, median", "median_kept_share", "{:.0%}"),
)


def run_search_bench(options: Namespace) -> int:
    """Score, print the table, leave search.json with every case."""
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "search.json"
    report = run(options.search, options.seed, file, _say)
    _say("")
    if options.json:
        print_json({key: value for key, value in report.items() if key != "results"})
        return 0
    print(table(report))
    print(f"\nevery case in {file}")
    return 0


def table(report: dict[str, Any]) -> str:
    """The summary as aligned text."""
    summary = report["summary"]
    first = summary[METHODS[0]]
    lines = [f"{report['cases']} cases of seed {report['seed']}, {first['findable']} of them findable"]
    lines += [f"  not findable: {count} x {reason}" for reason, count in first["not_findable"].items()]
    lines += ["", f"{'of the findable ones':<54}" + "".join(f"{method:>12}" for method in METHODS)]
    for label, key, form in ROWS:
        lines.append(f"{label:<54}" + "".join(f"{_cell(summary[method][key], form):>12}" for method in METHODS))
    frames = summary["median_frames_where_both_cover"]
    label = f"frames, median of the {summary['both_cover']} that both found"
    lines.append(f"{label:<54}" + "".join(f"{_cell(frames[method], '{:.0f}'):>12}" for method in METHODS))
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value) if form else str(value)


def _say(what: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{what:<40}" if what else "\r" + " " * 40 + "\r", end="", file=sys.stderr, flush=True)
