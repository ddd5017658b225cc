"""The transport of one slice: how much light each block of the projector brings to each pixel through one gate.

It is kept sparse. What was not worth an entry is not lost: `SliceTransport.total` holds all light of a pixel, and what
no entry has of it is taken to come evenly from the whole projector.

With w a picture's mean over each entry's block and m its mean over the whole raster, a pixel shows
total m + sum of value (w - m). So under a picture that is the same everywhere the entries do not matter at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import require
from slopegate.core.rig.patterns import Raster


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

    @property
    def bytes(self) -> int:
        """Memory of all arrays."""
        kept = sum(layer.starts.nbytes + layer.block.nbytes + layer.value.nbytes for layer in self.layers)
        return self.total.nbytes + kept


def one_a_pixel(grid: BlockGrid, block: Ints, value: Singles) -> Entries:
    """Entries of pixels that see one block each: block (H, W) int32, -1 for none, and its light (H, W)."""
    seen = block.ravel() >= 0
    starts = np.concatenate([[0], np.cumsum(seen)]).astype(np.int64)
    return Entries(grid, starts, block.ravel()[seen].astype(np.int32), value.ravel()[seen].astype(np.float32))


def relit(transport: SliceTransport, picture: Singles) -> Singles:
    """Light (H, W) float32 under a picture (raster height, raster width) float32, 0..1; (H, W, 3) under one in colour.

    To rounding: 3e-7 of the pixel's total for each of its entries. Raises ValueError for a picture that does not fit.
    """
    if picture.ndim == 3:
        planes = [relit(transport, np.ascontiguousarray(picture[..., k])) for k in range(picture.shape[2])]
        return np.stack(planes, axis=2)
    out = np.empty(transport.total.shape, np.float32)
    mean, weights = picture_weights(transport, picture)
    relight_pixels(transport, mean, weights, (0, out.size), out)
    return out


def picture_weights(transport: SliceTransport, picture: Singles) -> tuple[float, list[Singles]]:
    """A picture's mean, and for every layer what its blocks (count,) have more than that mean."""
    mean = float(picture.mean(dtype=np.float64))
    return mean, [(layer.grid.means(picture).ravel() - np.float32(mean)) for layer in transport.layers]


def relight_pixels(
    transport: SliceTransport, mean: float, weights: list[Singles], pixels: tuple[int, int], out: Singles
) -> None:
    """Set the light of the pixels first .. last - 1 (flat) of out (H, W) under a picture (`picture_weights`).

    Works without the interpreter's lock, so several threads can take a range each.
    """
    first, last = pixels
    flat = out.reshape(-1)
    flat[first:last] = transport.total.reshape(-1)[first:last] * np.float32(mean)
    for layer, weight in zip(transport.layers, weights, strict=True):
        _add_products(layer.starts, layer.block, layer.value, weight, first, last, flat)


def projector_image(transport: SliceTransport, raster: Raster, column: int, row: int) -> Singles:
    """What light each pixel of the projector brings to one pixel of the camera: (raster height, raster width) float32.

    Light of a block is spread evenly over its pixels, so that the image adds up to the pixel's total. Raises InputError
    for a pixel outside the camera's image.
    """
    height, width = transport.total.shape
    require(0 <= column < width, "column", column, f"from 0 to {width - 1}")
    require(0 <= row < height, "row", row, f"from 0 to {height - 1}")
    pixel = row * width + column
    blocks = [np.zeros(layer.grid.count) for layer in transport.layers]
    for layer, sums in zip(transport.layers, blocks, strict=True):
        inside = slice(layer.starts[pixel], layer.starts[pixel + 1])
        np.add.at(sums, layer.block[inside], layer.value[inside])
    return _spread_evenly(transport, raster, blocks, float(transport.total[row, column]))


def camera_image(transport: SliceTransport, raster: Raster, column: int, row: int) -> Singles:
    """What the camera sees (H, W) when only the block around one pixel of the projector is lit.

    The block is the smallest of the layers' grids, without layers the whole raster. Raises InputError for a pixel
    outside the raster.
    """
    require(0 <= column < raster.width, "column", column, f"from 0 to {raster.width - 1}")
    require(0 <= row < raster.height, "row", row, f"from 0 to {raster.height - 1}")
    picture = np.ones((raster.height, raster.width), np.float32)
    if transport.layers:
        grid = max((layer.grid for layer in transport.layers), key=lambda grid: grid.count)
        place = np.array([column], np.float32), np.array([row], np.float32)
        lit = np.zeros((grid.rows, grid.columns), np.float32)
        lit.flat[grid.numbers(*place)[0]] = 1
        picture = grid.spread(lit)
    return relit(transport, picture)


def dual_image(transport: SliceTransport, raster: Raster, weights: Singles) -> Singles:
    """The scene as the projector would see it if the camera's pixels were lamps of these strengths (H, W).

    (raster height, raster width) float32: the transpose of `relit`. The inner product of `relit(picture)` with the
    weights is that of the picture with this.
    """
    if weights.shape != transport.total.shape:
        raise ValueError(f"weights {weights.shape} do not fit an image {transport.total.shape}")
    lamps = weights.ravel().astype(np.float64)
    blocks = [np.zeros(layer.grid.count) for layer in transport.layers]
    for layer, sums in zip(transport.layers, blocks, strict=True):
        _add_transposed(layer.starts, layer.block, layer.value, lamps, sums)
    return _spread_evenly(transport, raster, blocks, float((lamps * transport.total.ravel()).sum()))


def _spread_evenly(transport: SliceTransport, raster: Raster, blocks: list[Doubles], total: float) -> Singles:
    """Sums of light for the blocks of every layer, and all of it, as light of each pixel of the raster."""
    left = total - sum(float(sums.sum()) for sums in blocks)
    out = np.full((raster.height, raster.width), left / (raster.width * raster.height))
    for layer, sums in zip(transport.layers, blocks, strict=True):
        grid = layer.grid
        out += grid.spread(sums.reshape(grid.rows, grid.columns) / grid.areas)
    return out.astype(np.float32)


@njit(cache=True, nogil=True)
def _add_products(
    starts: Indices, block: Ints, value: Singles, weights: Singles, first: int, last: int, out: Singles
) -> None:
    """Add to out (pixels,) the sum of every entry's value times its block's weight."""
    for pixel in range(first, last):
        start, end = starts[pixel], starts[pixel + 1]
        if start < end:
            light = np.float32(0)
            for entry in range(start, end):
                light += value[entry] * weights[block[entry]]
            out[pixel] += light


@njit(cache=True, nogil=True)
def _add_transposed(starts: Indices, block: Ints, value: Singles, lamps: Doubles, sums: Doubles) -> None:
    """Add to sums (blocks,) the sum of every entry's value times its pixel's lamp (pixels,)."""
    for pixel in range(len(starts) - 1):
        for entry in range(starts[pixel], starts[pixel + 1]):
            sums[block[entry]] += value[entry] * lamps[pixel]
