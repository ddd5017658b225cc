"""An independent renderer as peer for all light of a scene: Mitsuba 3, one camera row at a time (extra `peer`).

Its own path integrators know nothing of rolling shutters. But a camera row has one window, so each row rendered alone,
with a projector that shows just its window, is what the gate records, to whole projector rows.
"""

from __future__ import annotations

import math
import pickle
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slopegate.app.bench import peer
from slopegate.app.bench.subject import Subject
from slopegate.core.rig.arrays import Singles


@dataclass(frozen=True, eq=False)
class PeerLight:
    """Light (gates, H, W) without ambient light, and milliseconds a gate by the wall's clock and of a core."""

    samples: int
    light: Singles
    wall_ms: float
    core_ms: float
    compiled: bool


def why_not(subject: Subject) -> str | None:
    """Why Mitsuba cannot render this subject's light, in one sentence; None where it can."""
    refusal = peer.why_not(subject)
    if refusal is not None:
        return refusal
    if any(item.material is not None for item in subject.scene.objects):
        return "no peer for this scene: only matt surfaces are described to it"
    fog = subject.scene.fog
    if fog is not None:
        if not all(map(math.isfinite, (*fog.lo_m, *fog.hi_m))):
            return "no peer for this scene: its fog has no end"
        stands = (subject.rig.camera_centre_m, subject.rig.projector_centre_m)
        if any(bool(np.all(stand >= fog.lo_m) and np.all(stand <= fog.hi_m)) for stand in stands):
            return "no peer for this scene: the rig stands in its fog"
    return None


def render_light(subject: Subject, order: int, samples: Sequence[int]) -> list[PeerLight] | str:
    """The light of the subject's gates at rising numbers of paths a pixel, or why that failed.

    order: how often light may change its direction. Compiled where the machine can; else interpreted, and then with the
    least number of paths only.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "subject.pickle").write_bytes(pickle.dumps(subject))
        if _run(folder, peer.COMPILED, order, samples) is None:
            return [_load(folder, number, True) for number in samples]
        failure = _run(folder, peer.PLAIN, order, samples[:1])
        return failure or [_load(folder, samples[0], False)]


def _run(folder: Path, variant: str, order: int, samples: Sequence[int]) -> str | None:
    words = [str(folder), variant, *map(str, (order, *samples))]
    command = [sys.executable, "-m", "slopegate.app.bench.light_child", *words]
    return peer.failure_of(command)


def _load(folder: Path, samples: int, compiled: bool) -> PeerLight:
    with np.load(folder / f"{samples}.npz") as stored:
        return PeerLight(samples, stored["light"], float(stored["wall_ms"]), float(stored["core_ms"]), compiled)
