"""Bakes indirect light beside a running camera: shown after the first pass, refined while one looks."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from slopegate.core.light.bake import MOST_PATHS, Bake, bake_until
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.indirect import Indirect
from slopegate.core.light.part import Filter, LightPart
from slopegate.core.render.render import Cancelled, Progress
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.library_words import fault_inside
from slopegate.drivers.files.workers import Worker
from slopegate.drivers.scenes.bakes import BakeGoal, begin_bake, keep_bake

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BakeState:
    """How far a bake is."""

    doing: Literal["beginning", "baking", "done", "stopped", "failed"] = "beginning"
    share: float = 0.0
    """0..1; a guess, for how fast the noise falls is not known beforehand."""
    paths: int = 0
    """Paths a cell that the picture shows."""
    needed: float = 0.0
    """Paths a cell that are expected to be enough, by the noise that the picture has; 0 before that is known."""
    error_percent: float = float("inf")
    """Noise of what the picture shows, in percent of the fully lit image's mean."""
    stale: bool = False
    """Things in the scene move: what they light, and what they keep in the dark, is shown as at time 0."""
    why: str = ""
    """Why it failed, in a sentence."""


class LiveBake:
    """One bake in a thread of its own; every better table is handed to `put`. Methods may be called from any thread."""

    def __init__(
        self,
        rig: Rig,
        scene: Scene,
        light_filter: Filter,
        put: Callable[[LightPart], None],
        goal: BakeGoal | None = None,
        folder: Path | None = None,
    ) -> None:
        """`folder`: where bakes are kept, None for the cache's usual one."""
        self._rig, self._scene, self._filter, self._put = rig, scene, light_filter, put
        self._goal, self._folder = goal or BakeGoal(), folder
        self._bake: Bake | None = None
        self._part: Indirect | None = None
        self._state = BakeState(stale=scene.moving)
        self._stop = threading.Event()
        self._worker: Worker | None = None

    @property
    def state(self) -> BakeState:
        """How far it is now."""
        return self._state

    def begin(self, progress: Progress) -> None:
        """Take up what the disk has, or trace the first pass, and show it. In the caller's thread.

        Where it cannot be done, for lack of memory say, `state` tells. Raises Cancelled when progress returns False.
        """
        try:
            bake = begin_bake(self._rig, self._scene, BakeSettings(), lambda share: progress(0.5 * share), self._folder)
        except UserError as error:
            self._state = replace(self._state, doing="failed", why=str(error))
            return
        if bake.paths == 0:
            bake_until(bake, 1, 0.0, lambda share: progress(0.5 + 0.5 * share))
        self._bake, self._part = bake, Indirect(self._rig, bake.picture, self._filter)
        self._show(bake, self._part)

    def start(self) -> None:
        """Begin, or go on, in a thread of its own until the goal is met; does nothing while it runs."""
        if self._state.doing in ("done", "failed") or (self._worker and self._worker.running):
            return
        self._stop.clear()
        self._worker = Worker(self._work, "bake")
        self._worker.start()

    def stop(self) -> None:
        """Trace no more; what has been shown stays, and is kept on the disk. `start` goes on."""
        self._stop.set()

    def close(self, timeout_s: float = 5.0) -> None:
        """Stop, wait for the thread, and hand over nothing any more."""
        self.stop()
        try:
            if self._worker is not None:
                self._worker.finish(timeout_s)
        finally:
            # else the camera and its bake would hold each other, and all their light, until Python looks for such rings
            self._put = lambda part: None

    def _work(self) -> None:
        try:
            if self._bake is None:
                self.begin(lambda share: not self._stop.is_set())
            if self._bake is not None and self._part is not None:
                self._refine(self._bake, self._part)
        except Cancelled:
            self._state = replace(self._state, doing="stopped")
        except Exception as error:
            _log.exception("Baking %s failed", self._scene.name)
            self._state = replace(self._state, doing="failed", why=f"it {fault_inside(error)}")

    def _refine(self, bake: Bake, part: Indirect) -> None:
        before = bake.paths
        try:
            while self._state.doing != "done":
                wanted = bake.paths + 2 * bake.next_pass
                bake_until(bake, wanted, 0.0, partial(self._tell, wanted))
                self._show(bake, part)
            self._state = replace(self._state, doing="done", share=1.0)
        finally:
            if bake.paths > before:
                keep_bake(bake, self._folder)

    def _tell(self, wanted: int, share: float) -> bool:
        """This share of the paths wanted is traced; noise falls with their root: how many it takes is a guess."""
        shown, error = self._state.paths, self._state.error_percent
        needed = min(max(shown * (error / self._goal.error_percent) ** 2, shown), MOST_PATHS)
        self._state = replace(self._state, doing="baking", share=min(share * wanted / needed, 1.0), needed=needed)
        return not self._stop.is_set()

    def _show(self, bake: Bake, part: Indirect) -> None:
        part.show(bake.snapshot())
        self._put(part)
        error = bake.error_percent()
        met = error <= self._goal.error_percent or self._goal.is_missed(bake.paths, error)
        self._state = replace(
            self._state,
            doing="done" if met else self._state.doing,
            share=1.0 if met else self._state.share,
            paths=bake.paths,
            error_percent=error,
        )
