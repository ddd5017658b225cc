"""The transport of one slice: how much light each block of the projector brings to each pixel through one gate.

It is kept sparse. What was not worth an entry is not lost: `SliceTransport.total` holds all light of a pixel, and what
no entry has of it is taken to come evenly from the whole projector.
"""

from __future__ import annotations

from dataclasses import dataclass

from slopegate.core.rig.arrays import Indices, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid


@dataclass(frozen=True, eq=False)
class Entries:
    """Sparse light of pixels by blocks of one grid: those of pixel p (flat) stand at starts[p] .. starts[p + 1].

    starts (H W + 1,) int64; block (N,) int32, rising within a pixel; value (N,) float32: the light when this block
    alone is fully lit, in the unit of `SliceTransport`.
    """

    grid: BlockGrid
    starts: Indices
    block: Ints
    value: Singles


@dataclass(frozen=True, eq=False)
class SliceTransport:
    """Transport of one slice for a camera's pixels (H, W).

    total (H, W) float32: light of each pixel when the whole projector is fully lit, seen through the slice's gate,
    without ambient light. Linear: on the bench in the unit of `render.Buffers`, of a camera in counts above the dark.
    layers: entries of one or more grids, whose light adds up: fine ones where light is direct, coarse ones for what is
    smooth.
    """

    total: Singles
    layers: tuple[Entries, ...]
