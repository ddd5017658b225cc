"""What is measured once a run, not on every scene: pixels, objects, threads, noise, and what skipping saves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

from slopegate.app.bench import noise, number_types, scaling
from slopegate.app.bench.measure import peak_bytes
from slopegate.app.bench.number_types import default_path
from slopegate.app.bench.run import RunSize, Say, errors, time_variants
from slopegate.app.bench.skipping import ways_to_skip
from slopegate.app.bench.subject import Subject, scaled_rig
from slopegate.app.bench.variant import Variant
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

STEP_GATES: Final = (1, 4, 8)
"""Gates that the errors of a step are measured on: one at every distance."""


@dataclass(frozen=True)
class SizeStep:
    """One size: core time of a frame with and without skipping, of the gate alone likewise, and of casting anew.

    frame_ratio: as a multiple of copying the frame. gate_counts: largest rounding error of a pixel, on average over
    where edges fall; area_rms_counts: against the mean over each pixel's area.
    """

    series: str
    size: float
    mpixels: float
    frame_ms: float
    frame_low_ms: float
    frame_high_ms: float
    frame_ratio: float
    every_frame_ms: float
    gate_ms: float
    every_gate_ms: float
    cast_ms: float
    gate_counts: float
    area_rms_counts: float
    memory_mb: float


@dataclass(frozen=True)
class Pair:
    """The same work done in different ways: milliseconds by the wall's clock and of cores, as a multiple of copying
    the frame, and of the first way: for threads by the wall's clock, else in core time."""

    group: str
    name: str
    wall_ms: float
    core_ms: float
    low_ms: float
    high_ms: float
    ratio: float
    times: float
    memory_mb: float


@dataclass(frozen=True)
class NoiseRow:
    """One way to draw noise: core time of a whole frame with it, and its errors."""

    name: str
    default: bool
    core_ms: float
    low_ms: float
    high_ms: float
    ratio: float
    memory_mb: float
    error: noise.NoiseError


def resolutions(rig: Rig, scene: Scene, extent: RunSize, say: Say) -> list[SizeStep]:
    """The same scene before cameras of more and more pixels."""
    lens = rig.camera.lens
    found = []
    for mpixels in extent.mpixels:
        say(f"{mpixels:g} megapixels")
        width = round(lens.width * (mpixels * 1e6 / (lens.width * lens.height)) ** 0.5)
        subject, cast_ms = scaling.timed_subject(scene.name, scaled_rig(rig, width), scene)
        size = subject.shape[0] * subject.shape[1] / 1e6
        found.append(_step("megapixels", size, subject, cast_ms, extent))
    return found


def object_counts(rig: Rig, extent: RunSize, say: Say) -> list[SizeStep]:
    """More and more objects before the same camera."""
    small = scaled_rig(rig, extent.width)
    found = []
    for count in extent.objects:
        say(f"{count} objects")
        subject, cast_ms = scaling.timed_subject(f"{count} objects", small, scaling.clutter(count))
        found.append(_step("objects", count, subject, cast_ms, extent))
    return found


def exponents(steps: Sequence[SizeStep]) -> dict[str, float]:
    """For every cost, the power of the size that it grows with."""
    sizes = [step.size for step in steps]
    kinds = ("frame_ms", "every_frame_ms", "gate_ms", "every_gate_ms", "cast_ms")
    return {kind: scaling.exponent(sizes, [getattr(step, kind) for step in steps]) for kind in kinds}


def _step(series: str, size: float, subject: Subject, cast_ms: float, extent: RunSize) -> SizeStep:
    path, default = default_path(subject), number_types.default_variant(subject)
    calls = [
        default,
        _timed("every pixel", path.without_tiles().run),
        _timed("gate", scaling.gate_only(subject, True)),
        _timed("gate, every pixel", scaling.gate_only(subject, False)),
    ]
    frame, every, gate, every_gate = time_variants(subject.shape, calls, extent)
    area = subject.area_counts(subject.lattice(extent.pixels // 2), extent.samples // 2)
    rounding, sampling = errors(subject, default, subject.exact_counts, STEP_GATES, area)
    assert rounding is not None
    assert sampling is not None
    return SizeStep(
        series,
        size,
        subject.shape[0] * subject.shape[1] / 1e6,
        frame.core_ms,
        frame.low_ms,
        frame.high_ms,
        frame.ratio,
        every.core_ms,
        gate.core_ms,
        every_gate.core_ms,
        cast_ms,
        rounding.counts,
        sampling.rms_counts,
        (default.kept_bytes + peak_bytes(partial(default.run, 0))) / 1e6,
    )


def _timed(name: str, run: Callable[[int], object], gates: int = 9, slow: bool = False) -> Variant:
    return Variant("", name, run, gates=gates, slow=slow)


def threads(subject: Subject, extent: RunSize) -> list[Pair]:
    """Frames, and casting, by one thread and by two; `times` is how much longer than by one."""
    path = default_path(subject)
    rig, scene = subject.rig, subject.scene
    with ThreadPoolExecutor(2) as pool:
        calls = [
            _timed("frame, 1 thread", path.run),
            _timed("frame, 2 threads", scaling.threaded(path, pool, 2)),
            _timed("casting, 1 thread", lambda index: scaling.cast_bands(rig, scene, None), 1, True),
            _timed("casting, 2 threads", lambda index: scaling.cast_bands(rig, scene, pool), 1, True),
        ]
        return list(_pairs("threads", subject, calls, extent))


def skipping(rig: Rig, moving: tuple[Rig, Scene], extent: RunSize, say: Say) -> list[Pair]:
    """What skipping saves: each kind of work with and without it, on a sparse and a crowded scene."""
    found: list[Pair] = []
    for shape, calls in ways_to_skip(rig, moving, extent.width):
        say(f"skipping: {calls[0].name}")
        found += _compared("skipping", shape, calls, extent)
    return found


def _pairs(group: str, subject: Subject, calls: Sequence[Variant], extent: RunSize) -> Iterator[Pair]:
    for first in range(0, len(calls), 2):
        yield from _compared(group, subject.shape, calls[first : first + 2], extent)


def _compared(group: str, shape: tuple[int, int], calls: Sequence[Variant], extent: RunSize) -> Iterator[Pair]:
    costs = time_variants(shape, calls, extent)
    for call, cost in zip(calls, costs, strict=True):
        memory = peak_bytes(partial(call.run, 0)) / 1e6
        walls, cores = cost.wall_ms / costs[0].wall_ms, cost.core_ms / costs[0].core_ms
        times = walls if group == "threads" else cores
        spread = (cost.low_ms, cost.high_ms)
        yield Pair(group, call.name, cost.wall_ms, cost.core_ms, *spread, cost.ratio, times, memory)


def noise_rows(subject: Subject, extent: RunSize, clocks: bool, say: Say) -> list[NoiseRow]:
    """Cost and error of every way to draw noise; the program's own for live frames comes first."""
    path = default_path(subject)
    found = []
    for name, make in noise.makers(subject.shape[1]).items():
        say(f"noise: {name}")
        fast = name.startswith(("pooled", "hash"))
        run = partial(_draw, make, path)
        spent, low, high, ratio = 0.0, 0.0, 0.0, 0.0
        if clocks:
            cost = time_variants(subject.shape, [_timed(name, run, gates=9 if fast else 1)], extent)[0]
            spent, low, high, ratio = cost.core_ms, cost.low_ms, cost.high_ms, cost.quiet_ratio
        memory = (path.kept_bytes() + peak_bytes(partial(run, 0))) / 1e6
        # Numbers drawn while the clock ran must not decide which ones the errors are measured on.
        anew = noise.makers(subject.shape[1])[name]
        error = noise.measure(anew, subject, extent.noise_frames)
        found.append(NoiseRow(name, name == "pooled", spent, low, high, ratio, memory, error))
    return found


def _draw(make: noise.Make, path: number_types.FramePath, index: int) -> None:
    make(path, index, index)
