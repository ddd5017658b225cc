"""Measures every way on one scene: run time, error and memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from slopegate.app.bench import baselines, edges, number_types
from slopegate.app.bench.measure import TimedCall, Timing, peak_bytes, time_all
from slopegate.app.bench.results import AreaError, Cost, GateError, Row
from slopegate.app.bench.subject import Area, Subject, make_subject, scaled_rig
from slopegate.app.bench.variant import Variant
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

Say = Callable[[str], None]

WRONG_COUNTS: Final = 1.0
"""A pixel that is off by more than this lies on the wrong side of an edge."""
DIM_COUNTS: Final = 100.0


@dataclass(frozen=True)
class RunSize:
    """How much a run does. width: columns of the camera before scenes of objects; a capture has its own."""

    width: int
    pixels: int
    samples: int
    sub_rows: tuple[int, ...]
    cast_rays: tuple[int, ...]
    fast_repeats: int
    slow_repeats: int
    mpixels: tuple[float, ...]
    objects: tuple[int, ...]
    noise_frames: int
    peer: tuple[int, tuple[int, ...], int]
    """Columns of the camera, rays a pixel, and projector rows at a time, of the independent renderer."""
    skip: bool = True
    """Whether the program leaves out tiles and rays."""


FULL: Final = RunSize(
    width=1600,
    pixels=20_000,
    samples=16,
    sub_rows=(2, 4, 8),
    cast_rays=(2, 4, 8),
    fast_repeats=9,
    slow_repeats=3,
    mpixels=(0.3, 0.8, 1.92, 5.0, 10.0, 20.0),
    objects=(1, 3, 10, 30, 100, 300, 1000),
    noise_frames=64,
    peer=(320, (1, 4, 16), 1),
)
QUICK: Final = replace(
    FULL,
    width=800,
    pixels=6_000,
    samples=12,
    cast_rays=(2, 4),
    fast_repeats=7,
    slow_repeats=1,
    mpixels=(0.3, 0.8, 1.92),
    objects=(1, 30, 1000),
    noise_frames=16,
    peer=(160, (1,), 6),
)


def open_subject(name: str, rig: Rig, scene: Scene, extent: RunSize) -> Subject:
    """The scene before a camera of the run's size, or its own where it is a capture."""
    return make_subject(name, rig if scene.capture is not None else scaled_rig(rig, extent.width), scene)


def all_variants(subject: Subject, extent: RunSize) -> list[Variant]:
    """Every way that is measured on every scene; the default is among the first."""
    found = number_types.variants(subject, extent.skip)
    found += edges.variants(subject, extent.sub_rows, extent.cast_rays)
    return found + baselines.variants(subject, extent.skip)


def measure(subject: Subject, extent: RunSize, clocks: bool, say: Say) -> list[Row]:
    """All ways on one scene; without `clocks` their errors and memory only, which are the same on every run."""
    say(f"{subject.name}: what is exact")
    area = subject.area_counts(subject.lattice(extent.pixels), extent.samples)
    exact = [subject.exact_counts(index) for index in range(len(subject.gates))]
    variants = all_variants(subject, extent)
    costs: Sequence[Cost | None] = [None] * len(variants)
    if clocks:
        say(f"{subject.name}: run time")
        costs = time_variants(subject.shape, variants, extent)
    rows = []
    for variant, cost in zip(variants, costs, strict=True):
        say(f"{subject.name}: error of {variant.name}")
        rows.append(_row(subject, variant, cost, exact, area))
    return rows


def time_variants(shape: tuple[int, int], variants: Sequence[Variant], extent: RunSize) -> list[Cost]:
    """Run times of variants that make frames of this shape, all in turn, beside a plain copy of such a frame."""
    frame = np.ones(shape, np.uint16)
    copy = np.empty_like(frame)
    jobs = [TimedCall(partial(_repeat, 9, partial(np.copyto, copy, frame)), 9, 2 * extent.fast_repeats)]
    for variant in variants:
        repeats = extent.slow_repeats if variant.slow else extent.fast_repeats
        jobs.append(TimedCall(partial(_every_gate, variant), variant.gates * variant.share, repeats))
    base, *timings = time_all(jobs)
    mpixels = shape[0] * shape[1] / 1e6
    return [_cost(timing, base, mpixels, variant) for timing, variant in zip(timings, variants, strict=True)]


def _repeat(times: int, call: Callable[[], object]) -> None:
    for _ in range(times):
        call()


def _every_gate(variant: Variant) -> None:
    for index in range(variant.gates):
        variant.run(index)


def _cost(timing: Timing, base: Timing, mpixels: float, variant: Variant) -> Cost:
    return Cost(
        timing.wall_ms,
        timing.core_ms,
        timing.low_ms,
        timing.high_ms,
        timing.repeats,
        variant.share,
        timing.core_ms / base.core_ms,
        timing.least_ms / base.least_ms,
        timing.core_ms / mpixels,
    )


def _row(subject: Subject, variant: Variant, cost: Cost | None, exact: Sequence[Doubles], area: Area) -> Row:
    height, width = subject.shape
    memory = variant.kept_bytes + peak_bytes(partial(variant.run, 0))
    gate, found = errors(subject, variant, exact.__getitem__, range(len(exact)), area)
    return Row(
        subject.name,
        variant.group,
        variant.name,
        variant.default,
        width,
        height,
        cost,
        gate,
        found,
        memory / 1e6,
    )


def errors(
    subject: Subject, variant: Variant, exact: Callable[[int], Doubles], gates: Sequence[int], area: Area
) -> tuple[GateError | None, AreaError | None]:
    """Both kinds of error over these gates, None where the variant has it not; exact(gate) gives counts (H, W)."""
    off = []
    most = squares = level = 0.0
    wrong = 0
    for index in gates:
        if variant.counts is not None:
            counts = variant.counts(index)
            difference = np.abs(counts - exact(index))
            far = difference > WRONG_COUNTS
            most, squares = max(most, float(difference.max())), squares + float((difference**2).mean())
            wrong, level = wrong + int(far.sum()), max(level, float(difference[~far].max(initial=0.0)))
            off.append(np.abs(counts.reshape(-1)[area.pixels] - area.counts[index]))
        elif variant.at is not None:
            off.append(np.abs(variant.at(index, area.pixels) - area.counts[index]))
    gate = None
    if variant.counts is not None and variant.edge_rows is not None:
        rms = float(np.sqrt(squares / len(gates)))
        at_edge = variant.edge_rows[0] * subject.sensor.max_count
        gate = GateError(most, rms, wrong, level, *variant.edge_rows, at_edge)
    return gate, area_error(off, area.flood) if off else None


def area_error(off: Sequence[Doubles], flood: Doubles) -> AreaError:
    """From how many counts every pixel is off, one (n,) array a gate, and its light recorded once, (n,)."""
    bright = flood >= DIM_COUNTS
    counts = np.concatenate(off)
    rows = np.concatenate([part[bright] / flood[bright] for part in off])
    return AreaError(
        float(counts.max()),
        float(np.sqrt((counts**2).mean())),
        float(rows.max(initial=0.0)),
        float(np.sqrt((rows**2).mean())) if rows.size else 0.0,
    )
