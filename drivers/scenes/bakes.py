"""Bakes of indirect light: what the disk has of one is taken up, the rest is traced, and the result is kept.

A file is named by everything that its content depends on, so a bake of the same rig and scene is found again by any
program of the same version. It is written whole or not at all, whenever the work is stopped or killed.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Final

from slopegate.core.light.bake import MOST_PATHS, Bake, bake_until
from slopegate.core.light.baked import Baked, BakeSettings, fingerprint, memory_bytes
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.render.render import Progress
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.kept_arrays import cache_folder, key_of, load_kept, save_kept
from slopegate.drivers.files.workers import Worker

_log = logging.getLogger(__name__)

USUAL_ERROR_PERCENT: Final = 1.0
"""Noise of indirect light where no other is asked for, in percent (`Bake.error_percent`)."""


@dataclass(frozen=True)
class BakeGoal:
    """When a bake is good enough: by paths a cell, or for None by its noise."""

    paths: int | None = None
    error_percent: float = USUAL_ERROR_PERCENT

    def is_missed(self, paths: int, error_percent: float) -> bool:
        """Whether a bake that has ended so is noisier than was asked for."""
        return self.paths is None and error_percent > self.error_percent and paths >= MOST_PATHS


@dataclass(frozen=True)
class BakeReport:
    """What a bake took and gave."""

    seconds: float
    paths: int
    """Paths a cell."""
    error_percent: float
    """Root mean square noise over 4 x 4 pixels of a gate that records all twice, percent of the fully lit mean."""
    memory_bytes: int
    cached: bool
    """Whether the disk had it, good enough, and nothing was traced."""


def begin_bake(
    rig: Rig, scene: Scene, settings: BakeSettings, progress: Progress | None = None, folder: Path | None = None
) -> Bake:
    """The bake as far as the disk has it. `folder` is the cache's usual one where None.

    Raises UserError where the scene has no surfaces or embree is missing, InputError where the memory does not
    suffice, Cancelled when progress returns False.
    """
    surfaces = Surfaces(scene)
    check_memory(memory_bytes(rig, surfaces, settings))
    kept = load_kept(folder or bake_folder(), bake_key(rig, scene, settings))
    begun = None if kept is None else Baked(**kept)
    return Bake(rig, scene, settings, begun, progress, surfaces)


def bake_to(bake: Bake, goal: BakeGoal, progress: Progress | None = None, folder: Path | None = None) -> BakeReport:
    """Trace until the goal is met, on two cores where there are, and keep the result on the disk.

    A disk that cannot be written is logged; the bake is good without. Cancelled is raised when progress returns
    False: what whole passes brought is kept.
    """
    started, before = time.monotonic(), bake.paths
    try:
        error = bake_until(bake, goal.paths, goal.error_percent, progress, trace_both)
    finally:
        if bake.paths > before:
            keep_bake(bake, folder)
    needed = memory_bytes(bake.rig, bake.surfaces, bake.settings)
    return BakeReport(time.monotonic() - started, bake.paths, error, needed, bake.paths == before)


def keep_bake(bake: Bake, folder: Path | None = None) -> None:
    """Keep what a bake has so far on the disk; a disk that cannot be written is logged."""
    held = bake.snapshot()
    arrays = {item.name: getattr(held, item.name) for item in fields(held)}
    try:
        save_kept(folder or bake_folder(), bake_key(bake.rig, bake.scene, bake.settings), arrays)
    except StorageError as error:
        _log.warning("The bake of %s is not kept: %s", bake.scene.name, error)


def bake_folder() -> Path:
    """Where bakes are kept."""
    return cache_folder("bakes")


def bake_key(rig: Rig, scene: Scene, settings: BakeSettings) -> str:
    """The name of a bake: of all that it depends on."""
    return key_of(*fingerprint(rig, scene, settings))


def check_memory(needed: int, there: int | None = None) -> None:
    """Raise InputError where a bake needs more memory than there is; `there` is asked of the computer where None."""
    available = free_bytes() if there is None else there
    if available is not None and needed > available:
        raise InputError(
            f"the bake of indirect light needs {needed / 1e6:.0f} MB of memory, and {available / 1e6:.0f} MB are free: "
            "it must be done with a camera of fewer pixels, or without indirect light"
        )


def free_bytes() -> int | None:
    """Memory that programs may still have; None where the system does not tell."""
    try:
        for line in Path("/proc/meminfo").read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass
    return None


def trace_both(bake: Bake, each: int, progress: Progress | None) -> None:
    """One pass of both halves in threads of their own: embree and the kernels let go of the interpreter.

    On one core in turn. Raises what the first half or the second raised, or an interrupt (Ctrl+C), when both have
    ended: none finds a half to which only a part of a pass has been added, for what there is will be kept.
    """
    shares, faults = [0.0, 0.0], list[BaseException]()

    def told(half: int) -> Callable[[float], bool]:
        def tell(share: float) -> bool:
            shares[half] = share
            return not faults and (progress is None or progress(sum(shares) / 2))

        return tell

    def work(*halves: int) -> None:
        try:
            for half in halves:
                bake.trace(half, each, told(half))
        except BaseException as fault:  # handed to the caller's thread
            faults.append(fault)

    shared_out = [(0, 1)] if os.cpu_count() == 1 else [(0,), (1,)]
    workers = [Worker(partial(work, *halves), "bake") for halves in shared_out]
    try:
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.wait()
    except BaseException as interrupt:  # who reports the next share ends
        faults.insert(0, interrupt)
        for worker in workers:
            worker.finish()
    if faults:
        raise faults[0]
