"""From the raw frames of a stage to what is kept of a slice's transport, tile by tile in two threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.adaptive import (
    SomeBlocks,
    direct_light,
    fine_gaps,
    gap_light,
    own_block,
    spread_rest,
    without_direct,
)
from slopegate.core.transport.codes import Codes
from slopegate.core.transport.decode import decode
from slopegate.core.transport.even import EvenLight
from slopegate.core.transport.gray import GrayCodes, GrayImage, decode_gray
from slopegate.core.transport.keeping import KeepRule, KeptTile, joined, keep
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.sliced import one_a_pixel
from slopegate.drivers.transports.raw_frames import RawFrames, Tile, tiles_of

THREADS: Final = 2
Found = TypeVar("Found")
Number = TypeVar("Number", np.float32, np.int32, np.bool_)


@dataclass(frozen=True, eq=False)
class SliceView:
    """What all stages of a slice have in common."""

    even: EvenLight
    frames: int
    """That were added up for each pattern."""
    unit: float
    """Counts that make one of light."""

    @property
    def noise(self) -> FrameNoise:
        """Of the mean of a pattern's frames, counts."""
        noise = self.even.noise
        return FrameNoise(noise.read_variance / self.frames, noise.variance_per_count / self.frames)

    def image(self, raw: RawFrames, number: int) -> Singles:
        """Mean counts above black of one pattern, (H, W) float32."""
        return raw.image(number).astype(np.float32) / np.float32(self.frames) - self.even.black

    def above_black(self, raw: RawFrames, tile: Tile) -> Singles:
        """Mean counts above black of a tile, (patterns, pixels) float32."""
        sums = raw.tile(tile)
        out = np.empty(sums.shape, np.float32)
        _above(sums, _cut(self.even.black, tile), np.float32(1 / self.frames), out)
        return out


def decode_codes(raw: RawFrames, codes: Codes, view: SliceView, rule: KeepRule | None = None) -> KeptTile:
    """Entries of all pixels in the unit of light."""
    unit, noise = np.float32(1 / view.unit), view.even.noise

    def one(tile: Tile) -> KeptTile:
        light = _cut(view.even.light, tile)
        count = view.even.frames
        shared = _variance(2 * noise.read_variance / count, noise.variance_per_count / count, light)
        columns, spread = _columns(view.above_black(raw, tile), codes, view, light, shared)
        columns *= unit
        return keep(columns, codes.grid, spread * unit, None, rule)

    return joined(list(in_threads(one, tiles_of(raw.count, raw.shape))))


@dataclass(frozen=True, eq=False)
class LightSplit:
    """Light of each pixel (H, W), counts: what comes from its own block of the grid, and what does not."""

    grid: BlockGrid
    direct: Singles
    rest: Singles


def decode_gaps(pairs: RawFrames, gray: GrayImage, view: SliceView) -> Singles:
    """`gap_light` of all pixels, (H, W). pairs: the frames of Gray code."""

    def one(tile: Tile) -> tuple[Tile, Singles]:
        return tile, gap_light(view.above_black(pairs, tile), _cut(gray.sure, tile)).reshape(tile.shape)

    return _image(in_threads(one, tiles_of(pairs.count, pairs.shape)), pairs.shape)


def decode_direct(pairs: RawFrames, codes: GrayCodes, gray: GrayImage, light: Singles, view: SliceView) -> Singles:
    """`direct_light` of all pixels, (H, W). pairs: the frames of Gray code; light (H, W): all light."""

    def one(tile: Tile) -> tuple[Tile, Singles]:
        return tile, fine_gaps(codes, view.above_black(pairs, tile)).reshape(2, *tile.shape)

    gaps = np.zeros((2, *pairs.shape), np.float32)
    for tile, part in in_threads(one, tiles_of(pairs.count, pairs.shape)):
        gaps[:, *tile.window] = part
    return direct_light(gray, gaps, light, view.noise)


def all_light(raws: Sequence[RawFrames], codes: Sequence[SomeBlocks], view: SliceView) -> Singles:
    """All light of each pixel (H, W), counts: the mean of what the codes say, each of which lights every block."""

    def one(tile: Tile) -> tuple[Tile, Singles]:
        sums = [
            decode(some.codes, view.above_black(raw, tile)).sum(axis=0) for raw, some in zip(raws, codes, strict=True)
        ]
        return tile, np.mean(sums, axis=0, dtype=np.float32).reshape(tile.shape)

    count = max(raw.count for raw in raws)
    return _image(in_threads(one, tiles_of(count, raws[0].shape)), raws[0].shape)


def decode_lines(
    raws: tuple[RawFrames, RawFrames],
    lines: tuple[SomeBlocks, SomeBlocks],
    gray: GrayImage,
    split: LightSplit,
    view: SliceView,
) -> tuple[KeptTile, Singles]:
    """Entries in the unit of light, from frames of whole rows and columns of blocks; and all light (H, W) in counts."""
    unit, grid = np.float32(1 / view.unit), split.grid

    def one(tile: Tile) -> tuple[Tile, KeptTile, Singles]:
        rows, columns = (_whole(view.above_black(raw, tile), some) for raw, some in zip(raws, lines, strict=True))
        rest = _cut(split.rest, tile)
        noise = entry_noise(lines[0].codes, view.noise, _cut(split.direct, tile) + rest)
        told = _cut(split.direct, tile), noise
        block, direct = own_block(rows, columns, _cut(gray.block, tile), rest, *told)
        own = np.flatnonzero(direct > 0)
        for part, place in zip((rows, columns), np.divmod(block[own], grid.columns), strict=True):
            part[place, own] -= direct[own]
        whole = np.empty((grid.count, len(rest)), np.float32)
        noise = spread_rest(rows, columns, rest, noise, whole)
        whole[block[own], own] += direct[own]
        whole *= unit
        return tile, keep(whole, grid, noise * unit), (direct + rest).reshape(tile.shape)

    light, kept = np.zeros(view.even.light.shape, np.float32), []
    for tile, part, part_light in in_threads(one, tiles_of(max(grid.count, raws[0].count), raws[0].shape)):
        kept.append(part)
        light[tile.window] = part_light
    return joined(kept), light


def decode_coarse(
    raw: RawFrames, patterns: SomeBlocks, gray: GrayImage, split: LightSplit, view: SliceView
) -> KeptTile:
    """Entries in the unit of light, from frames of some blocks of a coarser grid."""
    unit, grid = np.float32(1 / view.unit), split.grid
    parent = np.append(grid.parents(patterns.grid), np.int32(-1))

    def one(tile: Tile) -> KeptTile:
        block, direct = _cut(gray.block, tile), _cut(split.direct, tile)
        light = direct + _cut(split.rest, tile)
        columns = decode(patterns.codes, view.above_black(raw, tile))
        without_direct(columns, patterns.numbers, parent[block], direct)
        columns *= unit
        noise = entry_noise(patterns.codes, view.noise, light)
        coarse = keep(columns, patterns.grid, noise * unit, patterns.numbers)
        fine = one_a_pixel(grid, np.where(direct > 0, block, -1).astype(np.int32), direct * unit)
        return KeptTile((fine, *coarse.layers), coarse.left_out)

    return joined(list(in_threads(one, tiles_of(raw.count, raw.shape))))


def _whole(frames: Singles, some: SomeBlocks) -> Singles:
    """Light of every block (blocks, P) of the grid of some blocks, counts; 0 of those that are not among them."""
    out = np.zeros((some.grid.count, frames.shape[1]), np.float32)
    out[some.numbers] = decode(some.codes, frames)
    return out


def _image(tiles: Iterator[tuple[Tile, Singles]], shape: tuple[int, int]) -> Singles:
    out = np.zeros(shape, np.float32)
    for tile, part in tiles:
        out[tile.window] = part
    return out


def _columns(
    frames: Singles, codes: Codes, view: SliceView, light: Singles, shared: Singles
) -> tuple[Singles, Singles]:
    """Light of each block alone (blocks, P) in counts, and the noise (P,) of each.

    light (P,): of all on. shared (P,): variance of the errors of black and of all on, which all patterns share.
    """
    if codes.kind in {"hadamard", "sequency"}:
        frames[0] = light
    columns, spread = decode(codes, frames), entry_noise(codes, view.noise, light)
    if codes.first == 0 and codes.kind != "impulse":
        # Errors that all patterns share end up in block 0.
        columns[0][columns[0] < 4 * np.sqrt(shared + spread**2)] = 0
    return columns, spread


def entry_noise(codes: Codes, noise: FrameNoise, light: Singles) -> Singles:
    """Standard deviation (P,) float32 of a decoded entry without light, counts, in pixels with so much light (P,)."""
    if codes.kind == "impulse":
        return np.full(light.shape, np.sqrt(noise.read_variance), np.float32)
    half = noise.read_variance + noise.variance_per_count * np.maximum(light, 0) / 2
    return np.sqrt(4 / codes.order * half).astype(np.float32)


def decode_gray_stage(raw: RawFrames, codes: GrayCodes, view: SliceView) -> GrayImage:
    """What Gray code tells of all pixels, in counts. `raw` holds the pairs; black and all on are the slice's own."""

    def one(tile: Tile) -> tuple[Tile, GrayImage]:
        pairs = view.above_black(raw, tile)
        even = np.stack([_cut(view.even.light, tile), np.zeros(pairs.shape[1], np.float32)])
        frames = np.concatenate([even, pairs]).reshape(-1, *tile.shape)
        return tile, decode_gray(codes, frames, view.noise)

    found = GrayImage(np.empty(raw.shape, np.int32), np.empty(raw.shape, np.float32), np.empty(raw.shape, np.bool_))
    for tile, part in in_threads(one, tiles_of(raw.count, raw.shape)):
        for name in ("block", "value", "sure"):
            getattr(found, name)[tile.window] = getattr(part, name)
    return found


def in_threads(work: Callable[[Tile], Found], tiles: Iterable[Tile]) -> Iterator[Found]:
    """What the work makes of each tile, in their order."""
    with ThreadPoolExecutor(THREADS, "slopegate-decode") as pool:
        yield from pool.map(work, tiles)


def _variance(read: float, per_count: float, light: Singles) -> Singles:
    return np.asarray(read + per_count * np.maximum(light, 0), np.float32)


def _cut(image: NDArray[Number], tile: Tile) -> NDArray[Number]:
    """A tile of an image (H, W) as (P,)."""
    return np.ascontiguousarray(image[tile.window]).reshape(-1)


@njit(cache=True, nogil=True)
def _above(sums: NDArray[Any], black: Singles, scale: np.float32, out: Singles) -> None:
    """out (N, P) = sums * scale - black (P,)."""
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            out[i, j] = np.float32(sums[i, j]) * scale - black[j]
