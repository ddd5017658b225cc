"""`slopegate bench`: run time against error of every way to make a gated frame."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path

from slopegate.app.bench.check import BaselineError, baseline, load_baseline, summary_line, worse
from slopegate.app.bench.picture import save_picture
from slopegate.app.bench.report import as_csv, as_markdown, as_text, as_values, machine_line
from slopegate.app.bench.run import FULL, QUICK, RunSize
from slopegate.app.bench.session import QUICK_SCENES, Bench, errors_only, run
from slopegate.app.commands.bench_search import run_search_bench
from slopegate.app.commands.report import CommandError, finite, print_json
from slopegate.drivers.files.durable import write_durably
from slopegate.drivers.scenes.scene_files import scene_path, shipped_scenes

SHIPPED = "shipped"


def run_bench(options: Namespace) -> int:
    """Measure, print the table, leave the files; with --check compare with a baseline, exit code 1 if it is worse."""
    if options.search is not None:
        return run_search_bench(options)
    extent = replace(QUICK if options.quick or options.check else FULL, skip=options.skip)
    names = _scene_names(options)
    if options.check is not None:
        return _check(options, names, extent)
    options.out.mkdir(parents=True, exist_ok=True)
    bench = errors_only(names, extent, _say) if options.errors else run(names, extent, _say)
    _say("")
    _write(options.out, bench)
    if options.json:
        print_json(as_values(bench))
    else:
        print(as_text(bench))
        print(f"\nfiles in {options.out}: {', '.join(sorted(path.name for path in options.out.glob('b*.*')))}")
    return 0


def _scene_names(options: Namespace) -> list[str]:
    shipped = [entry.key for entry in shipped_scenes()]
    if options.scene is None:
        return list(QUICK_SCENES) if options.quick or options.check else shipped
    names = [name for word in options.scene for name in (shipped if word == SHIPPED else [word])]
    for name in names:
        scene_path(name)
    return names


def _write(folder: Path, bench: Bench) -> None:
    texts = {
        "bench.json": json.dumps(finite(as_values(bench)), indent=1) + "\n",
        "bench.csv": as_csv(bench.rows),
        "bench.md": as_markdown(bench),
        "baseline.json": json.dumps(finite(baseline(bench)), indent=1) + "\n",
    }
    for name, text in texts.items():
        write_durably(folder / name, text.encode())
    if bench.summaries:
        save_picture(folder / "bench.png", bench.summaries, machine_line(bench))


def _check(options: Namespace, names: list[str], extent: RunSize) -> int:
    try:
        before = load_baseline(options.check)
    except BaselineError as error:
        raise CommandError(str(error)) from error
    measure = partial(errors_only if options.errors else run, names, extent, _say)
    bench = measure()
    problems = worse(bench, before)
    if problems and not options.errors:
        problems = worse(bench, before, measure())
    _say("")
    compared = sum(len(figures) for figures in baseline(bench)["figures"].values())
    if options.json:
        print_json({"worse": problems, "compared": compared, "machine": bench.machine})
    else:
        print("\n".join([*problems, summary_line(problems, compared)]))
    return 1 if problems else 0


def _say(what: str) -> None:
    """What is going on, on one line of standard error; silent for programs."""
    if sys.stderr.isatty():
        print(f"\r{what[:78]:<78}" if what else "\r" + " " * 78 + "\r", end="", file=sys.stderr, flush=True)
