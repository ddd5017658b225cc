"""The options of `slopegate bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slopegate.app.commands.numbers import whole


def add_bench(commands: Any) -> None:
    """`slopegate bench`."""
    parser = commands.add_parser(
        "bench",
        help="run time against error of every way to make a gated frame",
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
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.bench", "run_bench"))
