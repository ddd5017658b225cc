"""What the depth panel lets a worker do, and how it tells of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.core.measure.depth_map import DepthError, DepthMap, depth_error
from slopegate.core.measure.sweep import DepthSweep, SweepSettings
from slopegate.core.render.render import Buffers
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.depth_files import points_m, save_depth
from slopegate.drivers.stream.depth_run import frames_behind, run_sweep
from slopegate.drivers.stream.stream import Stream


@dataclass(frozen=True, eq=False)
class Measured:
    """A finished sweep: the map, the rig that it belongs to, and its error where the truth is known."""

    rig: Rig
    found: DepthMap
    points: NDArray[np.float32]
    settings: SweepSettings
    error: DepthError | None
    scene: str


def sweep_job(
    stream: Stream,
    rig: Rig,
    black_count: float,
    settings: SweepSettings,
    truth: Buffers | None,
    scene: str,
    progress: Progress,
) -> Measured:
    """Run the sweep behind the live stream. Raises CameraError, ValueError or CancelledError."""
    sweep = DepthSweep(rig, black_count, settings)

    def given_up() -> bool:
        return not progress.report(sweep.share_done, f"{sweep.frames} settings")

    with frames_behind(stream, given_up) as take:
        found = run_sweep(take, sweep)
    if found is None:
        raise CancelledError
    error = None if truth is None else depth_error(found, truth.projector_row, truth.inverse_depth)
    return Measured(rig, found, points_m(rig, found), settings, error, scene)


def report_text(result: Measured) -> str:
    """Frames against a plain sweep, and the error where the truth is known."""
    found, error = result.found, result.error
    text = f"{found.frames} settings; equal steps take {found.plain_frames}."
    if not found.known.any():
        return text + " Nothing was lit within this range."
    if error is None:
        return text + f" Depth for {found.known.mean():.0%} of the pixels."
    return text + (
        f" Depth for {error.known_share:.1%} of the lit pixels. Error: median {error.median_mm:.1f}, rms "
        f"{error.rms_mm:.1f}, 95 % below {error.p95_mm:.1f} mm."
    )


def as_buffers(found: DepthMap) -> Buffers:
    """What was measured where the program looks for what it knows of a scene; no light, for none was measured."""
    dark = np.zeros((*found.inverse_depth.shape, 3), np.float32)
    return Buffers(found.projector_row, found.inverse_depth, dark, dark)


def facts_of(result: Measured) -> dict[str, Any]:
    """What belongs to a saved map, fit for JSON."""
    return {
        "scene": result.scene,
        "rig": result.rig.name,
        "settings": asdict(result.settings),
        "frames": result.found.frames,
        "plain_frames": result.found.plain_frames,
        "error": None if result.error is None else asdict(result.error),
    }


def write(path: Path, result: Measured) -> Path:
    """Save and return the path."""
    save_depth(path, result.rig, result.found, facts_of(result))
    return path
