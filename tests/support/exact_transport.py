"""Light transport of a small scene without an acquisition: every pixel's light comes from the block that it sees."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import row_windows, upright_line_time
from slopegate.core.gating.slices import occupied_times, tile_times
from slopegate.core.render.render import Renderer
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.sliced import SliceTransport, one_a_pixel
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.transports.model import StageFacts, TransportRecord
from slopegate.drivers.transports.storage import TransportFolder, create_transport, make_transport


def write_transport(path: Path, rig: Rig, scene: Scene, slices: int, grid: tuple[int, int] = (16, 8)) -> Singles:
    """Make the folder, complete; the light (H, W) of everything lit."""
    folder, lit, parts = begin_transport(path, rig, scene, slices, grid)
    for index, one in enumerate(parts):
        write_slice(folder, index, one)
    folder.write_even(lit, np.zeros_like(lit), FrameNoise(0.0, 0.0))
    return lit


def begin_transport(
    path: Path, rig: Rig, scene: Scene, slices: int, grid: tuple[int, int]
) -> tuple[TransportFolder, Singles, list[SliceTransport]]:
    """Make the folder without any slice; the light (H, W) of everything lit, and the slices that tile it."""
    lens, projector = rig.camera.lens, rig.projector.lens
    blocks = BlockGrid(Raster(projector.width, projector.height), *grid)
    seen, _ = Renderer(rig, scene).at(0.0)
    direct = np.ascontiguousarray(seen.direct.mean(axis=2) if seen.direct.ndim == 3 else seen.direct)
    line = upright_line_time(rig)
    times = occupied_times(rig, line, seen.projector_row)
    assert times is not None
    gates = tile_times(rig, line, *times, slices)
    number = blocks.numbers(seen.projector_column, seen.projector_row)
    parts = []
    for settings in gates:
        light = gated(seen.projector_row, direct, np.zeros_like(direct), row_windows(rig, settings), 0.0)
        parts.append(SliceTransport(light, (one_a_pixel(blocks, np.where(light > 0, number, -1), light),)))
    info = CameraInfo(scene.name, lens.width, lens.height, "mono12", 4095, 40.0, rig.camera.shutter)
    folder = create_transport(
        path, make_transport(scene.name, rig, info, blocks, "hadamard", gates, counts_per_unit=1e3)
    )
    return folder, np.asarray(sum(one.total for one in parts), np.float32), parts


def write_slice(folder: TransportFolder, index: int, transport: SliceTransport) -> None:
    """Finish one slice."""
    manifest, at = folder.manifest, "2026-01-01T00:00:00Z"
    blocks = math.prod(manifest.grid)
    record = TransportRecord(
        index=index, asked=manifest.slices[index], applied=manifest.slices[index], empty=False,
        stages=[StageFacts(name="codes", patterns=blocks, frames=blocks, grid=manifest.grid)],
        entries=sum(len(layer.value) for layer in transport.layers), left_out=0.0, unexplained=None, noise_counts=0.0,
        saturated_share=0.0, nonlinear_share=0.0, started=at, ended=at, seconds=1.0, lost=0, duplicated=0, discarded=0,
    )  # fmt: skip
    folder.write_slice(record, transport)
