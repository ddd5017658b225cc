"""Runs the whole bench: opens the scenes one by one, measures everything, and returns all figures."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from slopegate.app.bench import edges, extras, peer
from slopegate.app.bench.measure import TimedCall, time_all
from slopegate.app.bench.number_types import default_variant
from slopegate.app.bench.results import Row, Verdict, WaySummary, judge, summarise
from slopegate.app.bench.run import RunSize, Say, errors, measure, open_subject
from slopegate.app.bench.subject import Area, Subject
from slopegate.app.bench.variant import Variant
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene, scene_path

MAIN: Final = "three_targets"
"""The scene that pixels, threads, noise and the peer are measured on; the quick run's first."""
MOVING: Final = "door"
QUICK_SCENES: Final = (MAIN, "aloe")


@dataclass(frozen=True)
class Bench:
    """All figures of a run; lists are empty where they were not asked for."""

    machine: dict[str, Any]
    rows: list[Row]
    summaries: list[WaySummary]
    verdict: Verdict | None
    resolutions: list[extras.SizeStep]
    objects: list[extras.SizeStep]
    exponents: dict[str, dict[str, float]]
    threads: list[extras.Pair]
    skipping: list[extras.Pair]
    noise: list[extras.NoiseRow]
    remarks: list[str]


def run(names: Sequence[str], extent: RunSize, say: Say) -> Bench:
    """Measure everything on the scenes of these names or paths."""
    cv2.setNumThreads(1)
    machine = describe_machine()
    rig = load_rig(None)
    rows: list[Row] = []
    for name in names:
        say(f"{name}: casting rays")
        subject = opened(name, rig, extent)
        rows += measure(subject, extent, True, say)
    main_rig, main_scene = open_scene(scene_path(MAIN), rig)
    subject = open_subject(MAIN, main_rig, main_scene, extent)
    peers, remarks = _peer_rows(main_rig, main_scene, extent, say)
    summaries = summarise(rows + peers)
    resolutions = extras.resolutions(main_rig, main_scene, extent, say)
    objects = extras.object_counts(main_rig, extent, say)
    say("threads")
    threads = extras.threads(subject, extent)
    skipping = extras.skipping(main_rig, open_scene(scene_path(MOVING), rig), extent, say)
    noise = extras.noise_rows(subject, extent, True, say)
    exponents = {"megapixels": extras.exponents(resolutions), "objects": extras.exponents(objects)}
    machine["load_after"] = _load()
    return Bench(
        machine,
        rows + peers,
        summaries,
        judge(summaries),
        resolutions,
        objects,
        exponents,
        threads,
        skipping,
        noise,
        remarks,
    )


def errors_only(names: Sequence[str], extent: RunSize, say: Say) -> Bench:
    """Measure errors and memory only, which do not depend on the machine's speed."""
    cv2.setNumThreads(1)
    rig = load_rig(None)
    rows: list[Row] = []
    for name in names:
        rows += measure(opened(name, rig, extent), extent, False, say)
    noise = extras.noise_rows(opened(MAIN, rig, extent), extent, False, say)
    return Bench(describe_machine(), rows, [], None, [], [], {}, [], [], noise, [])


def opened(name: str, rig: Rig, extent: RunSize) -> Subject:
    """The scene of this name or path before the camera of the run. Raises SceneError."""
    path = scene_path(name)
    own_rig, scene = open_scene(path, rig)
    return open_subject(Path(name).stem or path.stem, own_rig, scene, extent)


def _peer_rows(rig: Rig, scene: Scene, extent: RunSize, say: Say) -> tuple[list[Row], list[str]]:
    """The independent renderer on the main scene, and what is to be said about it."""
    columns, samples, band = extent.peer
    subject = open_subject(MAIN, rig, scene, replace(extent, width=columns))
    refusal = peer.why_not(subject)
    if refusal is not None:
        return [], [refusal]
    say("Mitsuba 3")
    images = peer.render_gates(subject, samples, band)
    if isinstance(images, str):
        return [], [images]
    area = subject.area_counts(subject.lattice(extent.pixels), extent.samples)
    copy_ms = _copy_ms(subject)
    height, width = subject.shape
    own = [_area_rms(subject, way, area) for way in (default_variant(subject), edges.cast_area(subject, 4))]
    rows = "one projector row" if band == 1 else f"{band} projector rows"
    remark = (
        f"Mitsuba 3 lights {MAIN} {rows} at a time, on one core, at {width} x {height} pixels; there the default is off"
        f" from the area by {own[0]:.3g} counts RMS, and 4 x 4 rays by {own[1]:.3g}."
    )
    return [peer.as_row(subject, area, image, copy_ms) for image in images], [remark]


def _area_rms(subject: Subject, variant: Variant, area: Area) -> float:
    gates = range(len(subject.gates))
    found = errors(subject, variant, subject.exact_counts, gates, area)[1]
    return found.rms_counts if found else 0.0


def _copy_ms(subject: Subject) -> float:
    frame = np.ones(subject.shape, np.uint16)
    copy = np.empty_like(frame)
    return time_all([TimedCall(lambda: np.copyto(copy, frame), 1, 101)])[0].core_ms


def describe_machine() -> dict[str, Any]:
    """Processor, cores, versions and load: what the figures belong to."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "opencv": cv2.__version__,
        "slopegate": version("slopegate"),
        "load_before": _load(),
    }


def _processor() -> str:
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _load() -> float | None:
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
