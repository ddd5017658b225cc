"""An independent renderer as peer: Mitsuba 3, one band of projector rows at a time (optional extra `peer`).

The same surfaces, lit by Mitsuba's own projector emitter with one band switched on, rendered by its own direct
integrator, and added up over the rows with what each camera row records of them (`gate.discrete_weights`). Its
pixels are means over their area by so many random rays, so it is compared with the exact area. It has a process of its
own: compiled by some LLVM libraries it aborts on some scenes, and what it allocates is then its alone.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np

from slopegate.app.bench.results import Cost, Row
from slopegate.app.bench.run import area_error
from slopegate.app.bench.subject import Area, Subject
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Lens

COMPILED, PLAIN = "llvm_ad_rgb", "scalar_rgb"
TIME_LIMIT_S: Final = 600


@dataclass(frozen=True, eq=False)
class PeerImage:
    """Counts of every gate (gates, H, W), how long all rows took by the wall's clock and of a core, and the memory."""

    samples: int
    counts: Doubles
    wall_ms: float
    spent_ms: float
    peak_mb: float


def why_not(subject: Subject) -> str | None:
    """Why Mitsuba cannot render this subject, in one sentence; None where it can."""
    if find_spec("mitsuba") is None:
        return "no peer: Mitsuba 3 is not installed (pip install mitsuba, or this program with its extra 'peer')"
    if subject.scene.capture is not None or subject.scene.moving:
        return "no peer for this scene: it is rendered only where surfaces are known and rest"
    rig = subject.rig
    if not (rig.is_ideal and _centred(rig.camera.lens) and _centred(rig.projector.lens)):
        return "no peer for this rig: its lenses and poses are beyond the peer's pinholes"
    return None


def _centred(lens: Lens) -> bool:
    return lens.cx == lens.width / 2 and lens.cy == lens.height / 2 and lens.fx == lens.fy


def render_gates(subject: Subject, samples: Sequence[int], band: int) -> list[PeerImage] | str:
    """The subject's gates at rising numbers of samples, `band` projector rows at a time, or why that failed.

    Compiled where the machine can; else interpreted, and then with the least number of samples only, since that is some
    ten times slower.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "subject.pickle").write_bytes(pickle.dumps(subject))
        if _run(folder, COMPILED, samples, band) is None:
            return [_load(folder, number) for number in samples]
        failure = _run(folder, PLAIN, samples[:1], band)
        return failure or [_load(folder, samples[0])]


def _run(folder: Path, variant: str, samples: Sequence[int], band: int) -> str | None:
    module = "slopegate.app.bench.peer_child"
    return failure_of([sys.executable, "-m", module, str(folder), variant, str(band), *map(str, samples)])


def failure_of(command: Sequence[str]) -> str | None:
    """Run a child that renders with Mitsuba: why that failed, in one sentence, or None."""
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        return f"no peer: Mitsuba 3 took longer than {TIME_LIMIT_S} s"
    if done.returncode == 0:
        return None
    said = done.stderr.strip().splitlines()
    return f"no peer: Mitsuba 3 failed ({said[-1] if said else f'exit code {done.returncode}'})"


def _load(folder: Path, samples: int) -> PeerImage:
    with np.load(folder / f"{samples}.npz") as stored:
        return PeerImage(
            samples, stored["counts"], float(stored["wall_ms"]), float(stored["spent_ms"]), float(stored["peak_mb"])
        )


def as_row(subject: Subject, area: Area, image: PeerImage, copy_ms: float) -> Row:
    """The figures of one number of samples; copy_ms: how long copying the frame takes."""
    height, width = subject.shape
    off = [
        np.abs(counts.reshape(-1)[area.pixels] - exact) for counts, exact in zip(image.counts, area.counts, strict=True)
    ]
    ratio = image.spent_ms / copy_ms
    per_pixel = image.spent_ms / (height * width / 1e6)
    spent = image.spent_ms
    cost = Cost(image.wall_ms, spent, spent, spent, 1, 1.0, ratio, ratio, per_pixel)
    name = f"Mitsuba 3, {image.samples} ray{'s' if image.samples > 1 else ''}"
    return Row(subject.name, "peer", name, False, width, height, cost, None, area_error(off, area.flood), image.peak_mb)
