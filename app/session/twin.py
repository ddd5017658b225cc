"""Keeps what a depth sweep saw as a scene folder, in which gates are tried without the rig."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from slopegate.core.measure.sweep import DepthMap
from slopegate.core.measure.twin import make_twin
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset
from slopegate.core.transport.mosaic import demosaic
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.scenes.twin_files import save_twin


def keep_twin(
    folder: Path,
    rig: Rig,
    found: DepthMap,
    pixel_format: str,
    seen: str,
    gates: Sequence[Preset] = (),
    overwrite: bool = False,
) -> Path:
    """Write the scene folder and return it. `seen`: what was swept; `gates` come along by their names.

    Raises StorageError, and InputError for a sweep that found nothing.
    """
    mosaic = filters(pixel_format)
    twin = make_twin(rig, found, demosaic(found.lit_counts, mosaic) if mosaic else found.lit_counts)
    content = f"Depth of {seen}, swept {datetime.now():%Y-%m-%d %H:%M} in {found.frames} settings of the gate."
    return save_twin(folder, rig, twin, f"{seen} (swept)", content, gates, overwrite)
