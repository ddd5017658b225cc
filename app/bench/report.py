"""The figures as text: a table for people, Markdown for the README, CSV and JSON for programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from slopegate.app.bench.results import HALF_COUNT, Row, WaySummary
from slopegate.app.bench.session import Bench
from slopegate.app.session.aligned import aligned

HEADINGS = (
    "way",
    "core ms per Mpixel",
    "range over scenes",
    "x copy",
    "rounding, counts",
    "edge, rows",
    "area RMS, counts",
    "area RMS, rows",
    "MB",
)


def as_text(bench: Bench) -> str:
    """All figures in aligned columns, for people."""
    parts = [
        machine_line(bench),
        aligned(HEADINGS, [_cells(item) for item in bench.summaries]),
        "\n".join(LEGEND),
        *verdict_lines(bench),
        *choice_lines(bench),
        aligned(SCALE_HEADINGS, _scale_cells(bench)),
        *_exponent_lines(bench),
        aligned(PAIR_HEADINGS, _pair_cells(bench)),
        aligned(NOISE_HEADINGS, _noise_cells(bench)),
        *bench.remarks,
    ]
    return "\n\n".join(part for part in parts if part)


LEGEND = (
    "core ms per Mpixel: median time of one core, geometric mean over the scenes. x copy: in units of numpy.copyto of"
    " the frame.",
    "rounding: largest error of a pixel against the exact gate of the same ray, on average over where an edge falls in"
    " it. edge: how far edges lie off, in camera rows.",
    "area: against the mean over each pixel's area, by 144 or 256 rays; in rows: as a share of the pixel's light.",
    "MB: arrays kept, and the peak while a frame is made, at the largest scene. * is the default.",
)


SHORT: tuple[int, ...] = (0, 1, 3, 4, 6, 8)
"""Columns of the table in Markdown."""


def as_markdown(bench: Bench) -> str:
    """The main table, shortened, and the conclusions, as Markdown."""
    headings, *rows = ([cells[column] for column in SHORT] for cells in (HEADINGS, *map(_cells, bench.summaries)))
    table = ["| " + " | ".join(headings) + " |", "| --- |" + " ---: |" * (len(SHORT) - 1)]
    table += ["| " + " | ".join(cells) + " |" for cells in rows]
    said = [*LEGEND, *verdict_lines(bench), *choice_lines(bench), *_exponent_lines(bench), *bench.remarks]
    return "\n\n".join([machine_line(bench), "\n".join(table), "\n".join(f"- {line}" for line in said)]) + "\n"


def machine_line(bench: Bench) -> str:
    """Which machine, and how busy it was."""
    found = bench.machine
    before, after = found.get("load_before"), found.get("load_after")
    busy = f"; load {before} before and {after} after" if before is not None else ""
    return f"{found['processor']}, {found['cores']} cores, {found['system']}, numpy {found['numpy']}{busy}"


def verdict_lines(bench: Bench) -> list[str]:
    """Which way is the default, and why."""
    found = bench.verdict
    if found is None:
        return []
    lines = [
        f"Cheapest with rounding below {HALF_COUNT} count: {found.cheapest}. Default: {found.default}"
        f" ({found.default_counts:.2g} counts).",
        f"The default is {'' if found.on_gate_front else 'NOT '}on the Pareto front of rounding and"
        f" {'' if found.on_area_front else 'NOT '}on that of sampling.",
    ]
    if found.row_by_row_times is not None and found.row_by_row_counts is not None:
        lines.append(
            f"It is {found.row_by_row_times:,.0f} times faster than the row-by-row simulation, whose rounding is"
            f" {found.row_by_row_counts:.3g} counts."
        )
    return lines


def choice_lines(bench: Bench) -> list[str]:
    """What the other choices, besides rounding, cost and gain."""
    lines = []
    named = {item.name: item for item in bench.summaries}
    hard, ramp = next((item for item in bench.summaries if item.default), None), named.get("trapezoid")
    if hard and ramp and hard.area_rms_counts and ramp.area_rms_counts:
        times = ramp.core_ms_per_mpixel / hard.core_ms_per_mpixel
        lines.append(
            f"Hard edges show what one ray sees. Ramps cost {times:.2f} times as much and leave"
            f" {ramp.area_rms_counts / hard.area_rms_counts:.2f} of the error against the area."
        )
    pairs = {pair.name: pair for pair in bench.threads}
    one, two = pairs.get("frame, 1 thread"), pairs.get("frame, 2 threads")
    if one and two:
        lines.append(
            f"One thread: two make a frame in {two.wall_ms / one.wall_ms:.2f} of the time with"
            f" {two.core_ms / one.core_ms:.2f} times the core time, and the window needs a core to paint."
        )
    if bench.noise:
        pooled, exact = bench.noise[0], bench.noise[-1]
        lines.append(
            f"Pooled noise: its cumulative probability is off by {pooled.error.probability:.1e} at most, and drawing"
            f" photons anew makes a frame {exact.ratio / pooled.ratio:.0f} times as expensive."
            if pooled.ratio > 0
            else f"Pooled noise: its cumulative probability is off by {pooled.error.probability:.1e} at most."
        )
    return lines


def _cells(item: WaySummary) -> list[str]:
    return [
        item.name + (" *" if item.default else ""),
        number(item.core_ms_per_mpixel),
        f"{number(item.fastest)} - {number(item.slowest)}",
        number(item.ratio),
        number(item.gate_counts),
        number(item.edge_rows),
        number(item.area_rms_counts),
        number(item.area_rms_rows),
        number(item.memory_mb),
    ]


SCALE_HEADINGS = (
    "size",
    "frame, core ms",
    "quartiles",
    "x copy",
    "unskipped",
    "gate ms",
    "unskipped",
    "cast ms",
    "area RMS",
    "MB",
)


def _scale_cells(bench: Bench) -> list[list[str]]:
    return [
        [
            f"{step.size:.3g} {step.series}",
            number(step.frame_ms),
            f"{number(step.frame_low_ms)} - {number(step.frame_high_ms)}",
            number(step.frame_ratio),
            number(step.every_frame_ms),
            number(step.gate_ms),
            number(step.every_gate_ms),
            number(step.cast_ms),
            number(step.area_rms_counts),
            number(step.memory_mb),
        ]
        for step in (*bench.resolutions, *bench.objects)
    ]


def _exponent_lines(bench: Bench) -> list[str]:
    names = {
        "frame_ms": "frame",
        "every_frame_ms": "frame without skipping",
        "gate_ms": "gate",
        "every_gate_ms": "gate without skipping",
        "cast_ms": "casting",
    }
    return [
        f"Cost grows with {series} to the power of: "
        + ", ".join(f"{names[kind]} {power:.2f}" for kind, power in powers.items())
        + "."
        for series, powers in bench.exponents.items()
    ]


PAIR_HEADINGS = ("the same work", "wall ms", "core ms", "quartiles", "x copy", "times the first", "peak MB")


def _pair_cells(bench: Bench) -> list[list[str]]:
    return [
        [
            pair.name,
            number(pair.wall_ms),
            number(pair.core_ms),
            f"{number(pair.low_ms)} - {number(pair.high_ms)}",
            number(pair.ratio),
            number(pair.times),
            number(pair.memory_mb),
        ]
        for pair in (*bench.threads, *bench.skipping)
    ]


NOISE_HEADINGS = (
    "noise",
    "frame, core ms",
    "x copy",
    "mean, counts",
    "deviation, %",
    "probability",
    "correlation",
    "chance",
    "MB",
)


def _noise_cells(bench: Bench) -> list[list[str]]:
    return [
        [
            row.name + (" *" if row.default else ""),
            number(row.core_ms),
            number(row.ratio),
            number(row.error.mean_counts),
            number(row.error.deviation_percent),
            number(row.error.probability),
            number(row.error.correlation),
            number(row.error.chance),
            number(row.memory_mb),
        ]
        for row in bench.noise
    ]


def number(value: float | None) -> str:
    """Three figures, without an exponent where that is readable; a dash for none."""
    if value is None:
        return "-"
    if value == 0:
        return "0"
    size = abs(value)
    if size >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}" if size >= 1e-3 else f"{value:.1e}"


def as_values(bench: Bench) -> dict[str, Any]:
    """Everything, fit for JSON."""
    return asdict(bench)


def as_csv(rows: Sequence[Row]) -> str:
    """One line for every way and scene."""
    lines = [_flat(asdict(row)) for row in rows]
    names = list(dict.fromkeys(name for line in lines for name in line))
    out = io.StringIO()
    writer = csv.DictWriter(out, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}_")
        elif value is not None:
            flat[prefix + name] = value
    return flat
