"""A folder of light transport that was made up, so that every number of it is known: nothing was rendered."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs import FINE_LINES, check_rig
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import tile_depths
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.sliced import Entries, SliceTransport
from slopegate.drivers.captures.model import Gate
from slopegate.drivers.contract.frame import CameraInfo, PixelFormat
from slopegate.drivers.transports.model import StageFacts, TransportRecord
from slopegate.drivers.transports.storage import TransportFolder, create_transport, make_transport

RIG = check_rig(16, FINE_LINES)
SHAPE = RIG.camera.lens.height, RIG.camera.lens.width
RASTER = Raster(RIG.projector.lens.width, RIG.projector.lens.height)
GRID = BlockGrid(RASTER, 4, 2)
MAX_COUNT, BLACK_COUNT = 4095, 40.0


def half_lit(left: bool) -> SliceTransport:
    """Light of 1 in the left half of the image, or of 0.5 in the right one, each pixel by one block of the projector.

    Pixel (row, column) sees block (2 row // H, 4 column // W); pixels of the upper row have a quarter from nowhere.
    """
    height, width = SHAPE
    rows, columns = np.mgrid[:height, :width]
    lit = (columns < width // 2) == left
    total = np.where(lit, 1.0 if left else 0.5, 0.0).astype(np.float32)
    block = (2 * rows // height * 4 + 4 * columns // width).astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(lit.ravel())]).astype(np.int64)
    value = np.where(rows == 0, 0.75, 1.0).astype(np.float32) * total
    return SliceTransport(total, (Entries(GRID, starts, block[lit], value[lit]),))


def made_transport(
    path: Path, *, taken: int = 3, white: bool = True, pixel_format: PixelFormat = "mono12"
) -> TransportFolder:
    """Three slices: the image's left half, nothing, and its right half, of which the first `taken` are there."""
    info = CameraInfo("c", SHAPE[1], SHAPE[0], pixel_format, MAX_COUNT, BLACK_COUNT, RIG.camera.shutter)
    gates = tile_depths(RIG, upright_line_time(RIG), 0.5, 2.0, 3, "delay")
    folder = create_transport(
        path, make_transport("Two halves", RIG, info, GRID, "hadamard", gates, counts_per_unit=900.0)
    )
    left, right = half_lit(True), half_lit(False)
    if white:
        folder.write_even(left.total + right.total, np.full(SHAPE, BLACK_COUNT, np.float32), FrameNoise(16.0, 0.5))
    for index, transport in enumerate((left, None, right)[:taken]):
        folder.write_slice(_record(index, Gate.of(gates[index]), transport), transport)
    return folder


def _record(index: int, gate: Gate, transport: SliceTransport | None) -> TransportRecord:
    stages = [StageFacts(name="even", patterns=2, frames=2, grid=(4, 2))]
    if transport is not None:
        stages.append(StageFacts(name="codes", patterns=8, frames=8, grid=(4, 2)))
    entries = 0 if transport is None else sum(len(layer.value) for layer in transport.layers)
    return TransportRecord(
        index=index, asked=gate, applied=gate, empty=transport is None, stages=stages, entries=entries, left_out=0.0,
        unexplained=None, noise_counts=0.0, saturated_share=0.0, nonlinear_share=0.0, started="2026-01-01T00:00:00Z",
        ended="2026-01-01T00:00:01Z", seconds=1.0, lost=0, duplicated=0, discarded=0,
    )  # fmt: skip
