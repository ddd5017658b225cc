"""From the raw frames of a stage to what is kept of a slice's transport, tile by tile in two threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Singles
from slopegate.core.transport.adaptive import SomeBlocks, direct_light, parents, without_direct
from slopegate.core.transport.codes import Codes
from slopegate.core.transport.decode import decode
from slopegate.core.transport.even import EvenLight
from slopegate.core.transport.gray import GrayCodes, GrayImage, decode_gray
from slopegate.core.transport.keeping import KeepRule, KeptTile, joined, keep
from slopegate.core.transport.noise import FrameNoise
from slopegate.drivers.transports.raw_frames import RawFrames, Tile, tiles_of

THREADS: Final = 2
Found = TypeVar("Found")


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


def decode_coarse(
    raw: RawFrames, patterns: SomeBlocks, pairs: RawFrames, codes: GrayCodes, gray: GrayImage, view: SliceView
) -> tuple[KeptTile, Singles]:
    """Coarse entries of all pixels in the unit of light, and the direct light (H, W) in counts that they leave out.

    pairs: the frames of Gray code; raw: those of the coarse codes.
    """
    unit, noise, bits = np.float32(1 / view.unit), view.even.noise, codes.column_bits + codes.row_bits
    parent = np.append(parents(codes.grid, patterns.grid), np.int32(-1))

    def one(tile: Tile) -> tuple[Tile, KeptTile, Singles]:
        seen = _cut_gray(gray, tile)
        light = seen.value.reshape(-1)
        per_count = noise.variance_per_count / (view.frames * (bits + 1))
        shared = _variance(2 * noise.read_variance / view.even.frames, per_count, light)
        columns, spread = _columns(view.above_black(raw, tile), patterns.codes, view, light, shared)
        direct = direct_light(codes, patterns.grid, view.above_black(pairs, tile), seen)
        without_direct(columns, patterns.numbers, parent[seen.block.reshape(-1)], direct)
        columns *= unit
        kept = keep(columns, patterns.grid, spread * unit, patterns.numbers)
        return tile, kept, direct.reshape(seen.block.shape)

    direct = np.zeros(raw.shape, np.float32)
    kept = []
    for tile, part, part_direct in in_threads(one, tiles_of(raw.count, raw.shape)):
        kept.append(part)
        direct[tile.window] = part_direct
    return joined(kept), direct


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
        shape = tile.rows[1] - tile.rows[0], tile.columns[1] - tile.columns[0]
        even = np.stack([_cut(view.even.light, tile), np.zeros(pairs.shape[1], np.float32)])
        frames = np.concatenate([even, pairs]).reshape(-1, *shape)
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


def _cut_gray(gray: GrayImage, tile: Tile) -> GrayImage:
    """A tile of what Gray code told, still as a rectangle."""
    return GrayImage(gray.block[tile.window], gray.value[tile.window], gray.sure[tile.window])


def _variance(read: float, per_count: float, light: Singles) -> Singles:
    return np.asarray(read + per_count * np.maximum(light, 0), np.float32)


def _cut(image: Singles, tile: Tile) -> Singles:
    """A tile of an image (H, W) as (P,)."""
    return np.ascontiguousarray(image[tile.window]).reshape(-1)


@njit(cache=True, nogil=True)
def _above(sums: NDArray[Any], black: Singles, scale: np.float32, out: Singles) -> None:
    """out (N, P) = sums * scale - black (P,)."""
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            out[i, j] = np.float32(sums[i, j]) * scale - black[j]
