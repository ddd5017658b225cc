"""`slopegate bench`: run time against error of every way to make a gated frame."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.options import add_json, describe, whole
from slopegate.app.commands.report import finite, print_json, say_line
from slopegate.drivers.files.durable import write_durably
from slopegate.drivers.scenes.scene_files import scene_path, shipped_scenes

if TYPE_CHECKING:
    from slopegate.app.bench.run import RunSize
    from slopegate.app.bench.session import Bench

SHIPPED = "shipped"
ROWS = (
    ("its gate covers 80 % of the target", "covers", ""),
    ("covers and isolates as well as 80 % of the best gate", "right", ""),
    ("says that the gate shows only a part of the target", "part", ""),
    ("wrong: says found, and it is not", "wrong", ""),
    ("the same where the target is not findable", "wrong_not_findable", ""),
    ("frames, median", "median_frames", "{:.0f}"),
    ("intersection over union, median", "median_iou", "{:.3f}"),
    ("the same within the rectangle", "median_iou_inside", "{:.3f}"),
    ("that of the best gate there is", "median_best_iou", "{:.3f}"),
    ("keypoints kept where there is a gate, median", "median_kept_share", "{:.0%}"),
)


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Measures run time, error and memory of every way to make a gated frame, in one run, beside a\n"
        "plain copy of the frame. Prints tables; leaves bench.json, .csv, .md, .png and baseline.json in a folder.",
        epilog="examples:\n  slopegate bench --quick\n"
        "  slopegate bench --scene shipped my_capture --out figures\n"
        "  slopegate bench --check resources/bench/baseline.json",
    )
    parser.add_argument("--quick", action="store_true", help="two scenes and a smaller camera: half a minute")
    parser.add_argument(
        "--scene",
        nargs="+",
        metavar="S",
        help="scenes to measure on: names, files or folders (see 'render'); 'shipped' stands for all that come with "
        "the program (the default)",
    )
    parser.add_argument("--no-skip", action="store_false", dest="skip", help="no pixel and no ray is left out")
    parser.add_argument("--errors", action="store_true", help="errors and memory only, which do not depend on the time")
    parser.add_argument(
        "--search",
        type=whole(1, 100_000),
        nargs="?",
        const=220,
        metavar="CASES",
        help="instead of frames, score both methods of the search on so many seeded cases (220); leaves search.json",
    )
    parser.add_argument(
        "--light",
        action="store_true",
        help="instead of frames, every way to prepare light beyond the direct path, against finer ones and against "
        "Mitsuba 3 where it is installed; leaves light.json",
    )
    parser.add_argument(
        "--transport",
        action="store_true",
        help="instead of frames, every way to acquire light transport: frames, time, memory, how well random patterns "
        "are relit, and noise against theory; leaves transport.json",
    )
    parser.add_argument("--seed", type=whole(0, 2**32 - 1), default=7, metavar="N", help="which cases those are (7)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--out", type=Path, default=Path("bench-output"), metavar="DIR", help="where the files go (bench-output)"
    )
    where.add_argument(
        "--check",
        type=Path,
        metavar="BASELINE",
        help="a quick run, compared with a baseline.json: says what got worse by more than a margin, with exit code 1",
    )
    add_json(parser)


def run(options: Namespace) -> int:
    """Measure, print the table, leave the files; with --check compare with a baseline, exit code 1 if it is worse."""
    from slopegate.app.bench.report import as_text, as_values
    from slopegate.app.bench.run import FULL, QUICK
    from slopegate.app.bench.session import errors_only
    from slopegate.app.bench.session import run as measure_all

    if options.search is not None:
        return _score_search(options)
    if options.light:
        return _measure_light(options)
    if options.transport:
        return _measure_transport(options)
    extent = replace(QUICK if options.quick or options.check else FULL, skip=options.skip)
    names = _scene_names(options)
    if options.check is not None:
        return _check(options, names, extent)
    options.out.mkdir(parents=True, exist_ok=True)
    bench = errors_only(names, extent, say_line) if options.errors else measure_all(names, extent, say_line)
    say_line("")
    _write(options.out, bench)
    if options.json:
        print_json(as_values(bench))
    else:
        print(as_text(bench))
        print(f"\nfiles in {options.out}: {', '.join(sorted(path.name for path in options.out.glob('b*.*')))}")
    return 0


def _scene_names(options: Namespace) -> list[str]:
    from slopegate.app.bench.session import QUICK_SCENES

    shipped = [entry.key for entry in shipped_scenes()]
    if options.scene is None:
        return list(QUICK_SCENES) if options.quick or options.check else shipped
    names = [name for word in options.scene for name in (shipped if word == SHIPPED else [word])]
    for name in names:
        scene_path(name)
    return names


def _write(folder: Path, bench: Bench) -> None:
    from slopegate.app.bench.check import baseline
    from slopegate.app.bench.picture import save_picture
    from slopegate.app.bench.report import as_csv, as_markdown, as_values, machine_line

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
    from slopegate.app.bench.check import baseline, load_baseline, summary_line, worse
    from slopegate.app.bench.session import errors_only
    from slopegate.app.bench.session import run as measure_all

    before = load_baseline(options.check)
    measure = partial(errors_only if options.errors else measure_all, names, extent, say_line)
    bench = measure()
    problems = worse(bench, before)
    if problems and not options.errors:
        problems = worse(bench, before, measure())
    say_line("")
    compared = sum(len(figures) for figures in baseline(bench)["figures"].values())
    if options.json:
        print_json({"worse": problems, "compared": compared, "machine": bench.machine})
    else:
        print("\n".join([*problems, summary_line(problems, compared)]))
    return 1 if problems else 0


def _measure_light(options: Namespace) -> int:
    """Measure, print the tables, leave light.json."""
    from dataclasses import asdict

    from slopegate.app.bench.light import FULL, LIGHT_SCENES, QUICK, as_text, run_light
    from slopegate.drivers.files.rig_files import load_rig
    from slopegate.drivers.scenes.scene_files import open_scene

    names = list(LIGHT_SCENES) if options.scene is None else _scene_names(options)
    opened = [(Path(name).stem, *open_scene(scene_path(name), load_rig(None))) for name in names]
    options.out.mkdir(parents=True, exist_ok=True)
    bench = run_light(opened, QUICK if options.quick else FULL, say_line)
    say_line("")
    write_durably(options.out / "light.json", (json.dumps(finite(asdict(bench)), indent=1) + "\n").encode())
    if options.json:
        print_json(asdict(bench))
        return 0
    print(as_text(bench))
    print(f"\nall figures in {options.out / 'light.json'}")
    return 0


def _measure_transport(options: Namespace) -> int:
    """Measure, print the tables, leave transport.json."""
    from dataclasses import asdict

    from slopegate.app.bench.transport import FULL, QUICK, TRANSPORT_SCENES, as_text, run_transport
    from slopegate.drivers.files.rig_files import load_rig
    from slopegate.drivers.scenes.scene_files import open_scene

    usual = TRANSPORT_SCENES[:1] if options.quick else TRANSPORT_SCENES
    names = list(usual) if options.scene is None else _scene_names(options)
    opened = [(Path(name).stem, *open_scene(scene_path(name), load_rig(None))) for name in names]
    options.out.mkdir(parents=True, exist_ok=True)
    bench = run_transport(opened, QUICK if options.quick else FULL, say_line)
    say_line("")
    write_durably(options.out / "transport.json", (json.dumps(finite(asdict(bench)), indent=1) + "\n").encode())
    if options.json:
        print_json(asdict(bench))
        return 0
    print(as_text(bench))
    print(f"\nall figures in {options.out / 'transport.json'}")
    return 0


def _score_search(options: Namespace) -> int:
    """Score, print the table, leave search.json with every case."""
    from slopegate.app.bench.search_score import run as score_search

    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "search.json"
    report = score_search(options.search, options.seed, file, say_line)
    say_line("")
    if options.json:
        print_json({key: value for key, value in report.items() if key != "results"})
        return 0
    print(table(report))
    print(f"\nevery case in {file}")
    return 0


def table(report: dict[str, Any]) -> str:
    """The summary as aligned text."""
    from slopegate.core.search.state import METHODS

    summary = report["summary"]
    first = summary[METHODS[0]]
    lines = [f"{report['cases']} cases of seed {report['seed']}, {first['findable']} of them findable"]
    lines += [f"  not findable: {count} x {reason}" for reason, count in first["not_findable"].items()]
    lines += ["", f"{'of the findable ones':<54}" + "".join(f"{method:>12}" for method in METHODS)]
    for label, key, form in ROWS:
        lines.append(f"{label:<54}" + "".join(f"{_cell(summary[method][key], form):>12}" for method in METHODS))
    frames = summary["median_frames_where_both_cover"]
    label = f"frames, median of the {summary['both_cover']} that both cover"
    lines.append(f"{label:<54}" + "".join(f"{_cell(frames[method], '{:.0f}'):>12}" for method in METHODS))
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value) if form else str(value)
