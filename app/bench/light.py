"""Run time against error of every way to prepare a scene's light, and of an independent renderer on the same work."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np

from slopegate.app.bench import light_peer
from slopegate.app.bench.light_ways import (
    PreparedLight,
    Study,
    airlight_study,
    indirect_study,
    scatter_study,
    usual_parts,
)
from slopegate.app.bench.measure import core_clock
from slopegate.app.bench.report import number
from slopegate.app.bench.run import Say
from slopegate.app.bench.session import describe_machine
from slopegate.app.bench.subject import GateNumbers, Subject, make_subject, scaled_rig
from slopegate.app.session.aligned import aligned
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows, upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.lights import asked_parts
from slopegate.core.render.integrate import integrate
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

T = TypeVar("T")

LIGHT_SCENES: Final = ("cornell_fog",)
"""Measured where no scene is named."""

BLOCK: Final = 4
"""Errors are those of means over so many pixels each way: single pixels hold noise that no eye adds up."""


@dataclass(frozen=True)
class LightSize:
    """How much a run does. width: columns of the camera; paths: of the ways, then of what they are measured against;
    peer: columns, gates, and paths a pixel of the independent renderer; order: how often light may turn there."""

    width: int
    paths: tuple[int, ...]
    truth_paths: int
    area_samples: int
    peer_width: int
    peer_gates: int
    peer_paths: tuple[int, ...]
    order: int


FULL: Final = LightSize(400, (4, 16, 64), 256, 8, 200, 3, (4, 16), 7)
QUICK: Final = LightSize(160, (4, 16), 64, 4, 80, 2, (4,), 7)


@dataclass(frozen=True)
class LightRow:
    """One way to make one part's light, or with part "all" whole images, on one scene.

    prepare_ms: core time until any gate can be had; gate_ms: core time of one gate then. error_percent: root mean
    square of means over 4 x 4 pixels against the truth, without the truth's own noise, and bias_percent: the difference
    of the means, each over all gates and as a share of the mean with everything lit. memory_mb: what the prepared part
    keeps.
    """

    scene: str
    part: str
    name: str
    default: bool
    width: int
    height: int
    prepare_ms: float
    gate_ms: float
    error_percent: float
    bias_percent: float
    memory_mb: float | None


@dataclass(frozen=True)
class LightBench:
    """All figures of a run."""

    machine: dict[str, Any]
    rows: list[LightRow]
    remarks: list[str]


def run_light(scenes: Sequence[tuple[str, Rig, Scene]], extent: LightSize, say: Say) -> LightBench:
    """Measure every way on these scenes, each with a name and a rig."""
    machine = describe_machine()
    rows: list[LightRow] = []
    remarks: list[str] = []
    for name, rig, scene in scenes:
        subject = _lit_too(make_subject(name, scaled_rig(rig, extent.width), scene))
        say(f"{name}: what is exact")
        for study in _studies(subject, extent):
            rows += _rows(subject, study, say)
        found, said = _whole(name, rig, scene, extent, say)
        rows += found
        remarks += said
    return LightBench(machine, rows, remarks)


def _lit_too(subject: Subject) -> Subject:
    """The subject with one more gate: everything lit once."""
    settings = whole_period(subject.rig, upright_line_time(subject.rig))
    return replace(subject, gates=(*subject.gates, GateNumbers(settings, row_windows(subject.rig, settings), 1.0)))


def _studies(subject: Subject, extent: LightSize) -> list[Study]:
    """One for each part that the scene asks for and that there are several ways to prepare."""
    asked, found = asked_parts(subject.scene), []
    if "airlight" in asked:
        found.append(airlight_study(subject))
    if "scatter" in asked:
        found.append(scatter_study(subject))
    if "indirect" in asked:
        found.append(indirect_study(subject, extent.paths, extent.truth_paths, extent.order))
    return found


def _rows(subject: Subject, study: Study, say: Say) -> list[LightRow]:
    truth, noise = study.truth, np.zeros(len(subject.gates))
    exact = _images(truth.whole, subject)
    if truth.halves is not None:
        one, other = (_images(part, subject) for part in truth.halves)
        noise = (blocks(one - other) ** 2).mean(axis=(1, 2)) / 4
    rows = []
    for way in study.ways:
        say(f"{subject.name}: {study.part}, {way.name}")
        part, prepare_ms, memory_mb = _prepared(way.prepare)
        part.add(subject.gates[0].windows, np.zeros(subject.shape, np.float32))  # compiles
        start_s = core_clock()
        images = _images(part, subject)
        gate_ms = 1e3 * (core_clock() - start_s) / len(subject.gates)
        error, bias = misses(images, exact, noise)
        figures = (prepare_ms, gate_ms, error, bias, memory_mb)
        height, width = subject.shape
        rows.append(LightRow(subject.name, study.part, way.name, way.default, width, height, *figures))
    return rows


def _images(part: PreparedLight, subject: Subject) -> Doubles:
    """What a part brings to every gate, (gates, H, W)."""
    found = np.zeros((len(subject.gates), *subject.shape), np.float32)
    for gate, out in zip(subject.gates, found, strict=True):
        part.add(gate.windows, out)
    return found.astype(np.float64)


def _prepared(prepare: Callable[[], PreparedLight]) -> tuple[PreparedLight, float, float]:
    """The part, the milliseconds of a core that it took, and the MB that it keeps. Called twice: once compiles."""
    prepare()
    gc.collect()
    start_s = core_clock()
    prepare()
    spent_ms = 1e3 * (core_clock() - start_s)
    gc.collect()
    tracemalloc.start()
    part = prepare()
    gc.collect()
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return part, spent_ms, kept / 1e6


def blocks(images: Doubles) -> Doubles:
    """Means over BLOCK x BLOCK pixels of images (gates, H, W); what is over at the right and the bottom is left out."""
    count, height, width = images.shape
    high, wide = height // BLOCK, width // BLOCK
    cut = images[:, : high * BLOCK, : wide * BLOCK]
    return np.asarray(cut.reshape(count, high, BLOCK, wide, BLOCK).mean(axis=(2, 4)))


def misses(images: Doubles, exact: Doubles, noise: Doubles) -> tuple[float, float]:
    """Error and bias in percent of images (gates, H, W), the last with everything lit; noise (gates,): the exact ones'
    mean square deviation."""
    lit = float(exact[-1].mean())
    square = (blocks(images - exact) ** 2).mean(axis=(1, 2)) - noise
    bias = float((images - exact).mean())
    return 100 * float(np.sqrt(np.maximum(square, 0).mean())) / lit, 100 * bias / lit


def _whole(name: str, rig: Rig, scene: Scene, extent: LightSize, say: Say) -> tuple[list[LightRow], list[str]]:
    """Whole images, without ambient light, by the program and by the peer, and what is to be said about it."""
    subject = make_subject(name, scaled_rig(rig, extent.peer_width), replace(scene, ambient=0.0))
    some = _lit_too(replace(subject, gates=subject.gates[: extent.peer_gates]))
    say(f"{name}: whole images")
    truths = [study.truth.whole for study in _studies(some, extent)]
    exact = sum((_images(part, some) for part in truths), _direct(some, extent.area_samples))
    found: list[tuple[str, float, float, Doubles]] = []
    for count in extent.paths:
        parts, prepare_ms = _timed(partial(usual_parts, some, count, extent.order))
        images, all_ms = _timed(partial(_summed, some, parts))
        found.append((f"this program, {count} paths a cell", prepare_ms, all_ms / len(some.gates), images))
    remarks = []
    say(f"{name}: Mitsuba 3")
    peers = light_peer.why_not(some) or light_peer.render_light(some, extent.order, extent.peer_paths)
    if isinstance(peers, str):
        remarks.append(peers)
    else:
        found += [
            (f"Mitsuba 3, {one.samples} paths a pixel", 0.0, one.core_ms, one.light.astype(np.float64)) for one in peers
        ]
        how = "compiled" if peers[0].compiled else "interpreted, for want of an LLVM that it can use"
        remarks.append(f"Mitsuba 3 renders {name} one camera row at a time with that row's window, on one core, {how}.")
    height, width = some.shape
    quiet = np.zeros(len(some.gates))
    rows = [
        LightRow(name, "all", way, False, width, height, prepare_ms, gate_ms, *misses(images, exact, quiet), None)
        for way, prepare_ms, gate_ms, images in found
    ]
    return rows, remarks


def _summed(subject: Subject, parts: Sequence[PreparedLight]) -> Doubles:
    """Images of every gate by the program, (gates, H, W), direct light as means over 2 x 2 rays."""
    return sum((_images(part, subject) for part in parts), _direct(subject, 2))


def _direct(subject: Subject, samples: int) -> Doubles:
    """Direct light of every gate, (gates, H, W), means over samples x samples rays a pixel."""

    def one(gate: GateNumbers) -> Singles:
        return mono(integrate(subject.rig, subject.scene, gate.settings, samples, 0.0, lambda share: True))

    return np.stack([one(gate) for gate in subject.gates]).astype(np.float64)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What a call gives, and its milliseconds of a core."""
    start_s = core_clock()
    found = work()
    return found, 1e3 * (core_clock() - start_s)


HEADINGS = ("part and way", "prepare, core ms", "gate, core ms", "error, %", "bias, %", "MB")
LEGEND = (
    "prepare: time of one core until any gate can be had; gate: of one gate then, without direct light but for whole"
    " images.",
    "error: root mean square of means over 4 x 4 pixels against the truth, which is finer and slower, without its own"
    " noise; bias: difference of the means. Both over all gates, as a share of the mean with everything lit.",
    "Ways change one thing of the default, which is marked by *.",
)


def as_text(bench: LightBench) -> str:
    """All figures in aligned columns, one table a scene."""
    found = bench.machine
    parts = [f"{found['processor']}, {found['cores']} cores, {found['system']}, numpy {found['numpy']}"]
    for scene in dict.fromkeys(row.scene for row in bench.rows):
        rows = [row for row in bench.rows if row.scene == scene]
        parts += [scene, aligned(HEADINGS, [_cells(row) for row in rows])]
    return "\n\n".join([*parts, "\n".join(LEGEND), *bench.remarks])


def _cells(row: LightRow) -> list[str]:
    name = f"{row.part}: {row.name}{' *' if row.default else ''} ({row.width} x {row.height})"
    figures = (row.prepare_ms, row.gate_ms, row.error_percent, row.bias_percent, row.memory_mb)
    return [name, *map(number, figures)]
