"""Takes one slice: the patterns that its codes need, decoded into entries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bools, Bytes, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.adaptive import (
    CHECKS,
    EVEN_AGAIN,
    EXCESS,
    MOST_DENSE,
    MOST_PATTERNS,
    CheckPatterns,
    LitBlocks,
    SomeBlocks,
    coarse_codes,
    gray_reads,
    line_codes,
    only_lit,
    predicted_by_gray,
    seen_blocks,
    smooth_rest,
    unexplained,
)
from slopegate.core.transport.codes import make_codes
from slopegate.core.transport.even import ROUNDING_VARIANCE, EvenLight, nonlinear_share
from slopegate.core.transport.gray import GrayCodes, GrayImage, gray_patterns
from slopegate.core.transport.plan import is_adaptive
from slopegate.core.transport.sliced import Entries, SliceTransport, one_a_pixel, relit
from slopegate.drivers.transports.decoding import (
    LightSplit,
    SliceView,
    all_light,
    decode_coarse,
    decode_codes,
    decode_direct,
    decode_gaps,
    decode_gray_stage,
    decode_lines,
)
from slopegate.drivers.transports.model import CodeName, StageName
from slopegate.drivers.transports.raw_frames import RawFrames
from slopegate.drivers.transports.stages import Stages


@dataclass(frozen=True, eq=False)
class TakenSlice:
    """A slice's transport, and what its record says of it."""

    transport: SliceTransport
    left_out: float = 0.0
    unexplained: float | None = None
    nonlinear: float = 0.0


_READS: Final = 2.05
"""`unexplained`'s reads: frame, black, and what codes of rows and columns leave."""


@dataclass(frozen=True)
class _Pair:
    """A chequered pattern and its inverse."""

    grid: BlockGrid
    count: int = 2

    def values(self, number: int) -> Bytes:
        row, column = np.indices((self.grid.rows, self.grid.columns))
        return ((row + column + number) % 2).astype(np.uint8)


def take_slice(stages: Stages, codes: CodeName, grid: BlockGrid, view: SliceView) -> TakenSlice:
    """The transport of a slice that has light."""
    if codes == "gray":
        return _take_gray(stages, grid, view)
    if is_adaptive(codes, grid):
        return _take_adaptive(stages, grid, view)
    patterns = make_codes("hadamard" if codes == "adaptive" else codes, grid)
    pair = stages.stack("check", _Pair(grid))
    nonlinear = nonlinear_share(_summed(pair, view), view.even)
    kept = decode_codes(stages.stack("codes", patterns), patterns, view)
    return TakenSlice(_transport(view, view.even.light, kept.layers), kept.left_out.share, nonlinear=nonlinear)


def _take_gray(stages: Stages, grid: BlockGrid, view: SliceView) -> TakenSlice:
    codes = gray_patterns(grid)
    gray, nonlinear, pairs = _gray_stage(stages, codes, view)
    if _is_noisy(view):
        gray = only_lit(_with_gaps(pairs, gray, view), view.noise, 1)
    return _explained_by_gray(grid, gray, view, nonlinear, None)


def _take_adaptive(stages: Stages, grid: BlockGrid, view: SliceView) -> TakenSlice:
    codes, checks = gray_patterns(grid), CheckPatterns(grid)
    gray, nonlinear, pairs = _gray_stage(stages, codes, view)
    shown = stages.stack("check", checks)
    frames = [view.image(shown, number) for number in range(checks.count)]

    def error(predict: Callable[[int], Singles], reads: float) -> float:
        return float(np.mean([unexplained(predict(k), frames[k], reads, view.noise) for k in range(CHECKS)]))

    if _is_noisy(view):
        gray = _with_gaps(pairs, gray, view)
    left = error(lambda k: predicted_by_gray(gray, checks.values(k)), gray_reads(gray))
    if left <= 1 + EXCESS:
        if _is_noisy(view):
            gray = only_lit(_with_less_noise(stages, codes, gray, view), view.noise, 1 + EVEN_AGAIN)
        return _explained_by_gray(grid, gray, view, nonlinear, left)
    some = _codes_for_rest(grid, _may_light(stages, grid, gray, view))
    raws = [stages.stack(name, patterns) for name, patterns in some]
    light = all_light(raws, [patterns for _, patterns in some], view)
    direct = decode_direct(pairs, codes, gray, light, view)
    split = LightSplit(grid, direct, smooth_rest(gray, light, direct, view.noise))
    if len(some) == 2:
        kept, light = decode_lines((raws[0], raws[1]), (some[0][1], some[1][1]), gray, split, view)
    else:
        kept = decode_coarse(raws[0], some[0][1], gray, split, view)
    transport = _transport(view, light, kept.layers)
    pictures = [grid.spread(checks.values(k)).astype(np.float32) for k in range(CHECKS)]
    left = error(lambda k: relit(transport, pictures[k]) * np.float32(view.unit), _READS)
    return TakenSlice(transport, kept.left_out.share, left, nonlinear)


def _codes_for_rest(grid: BlockGrid, lit: Bools) -> list[tuple[StageName, SomeBlocks]]:
    """What tells where other than direct light comes from: whole rows and whole columns, or larger blocks."""
    if grid.count <= MOST_DENSE:
        rows, columns = line_codes(grid, lit)
        return [("rows", rows), ("columns", columns)]
    return [("coarse", coarse_codes(grid, lit, MOST_PATTERNS - gray_patterns(grid).count - CHECKS - 1))]


def _is_noisy(view: SliceView) -> bool:
    """Whether there is noise beyond rounding."""
    return view.even.noise.read_variance > ROUNDING_VARIANCE


def _with_gaps(pairs: RawFrames, gray: GrayImage, view: SliceView) -> GrayImage:
    """Gray code's image with light that has the error of the one frame of black at most once."""
    light = np.where(gray.sure, decode_gaps(pairs, gray, view), view.even.light)
    return replace(gray, value=light.astype(np.float32))


def _with_less_noise(stages: Stages, codes: GrayCodes, gray: GrayImage, view: SliceView) -> GrayImage:
    """What Gray code told, with its light averaged with that of more frames."""
    black, white = stages.even(EVEN_AGAIN)
    pairs, more = codes.count // 2 - 1, white.count / view.frames
    light = white.mean - black.mean
    mixed = (pairs * gray.value + more * light) / (pairs + more)
    again = (view.even.light + more * light) / (1 + more)
    return replace(gray, value=np.where(gray.sure, mixed, again).astype(np.float32))


def _may_light(stages: Stages, grid: BlockGrid, gray: GrayImage, view: SliceView) -> Bools:
    """Which blocks may light something, (blocks,): those that pixels see, and if they light something the others."""
    lit = seen_blocks(gray, grid)
    if not lit.all():
        frame = view.image(stages.stack("unseen", LitBlocks(grid, ~lit)), 0)
        if not EvenLight(view.even.black, frame, view.frames, view.even.noise).is_dark:
            lit[:] = True
    return lit


def _gray_stage(stages: Stages, codes: GrayCodes, view: SliceView) -> tuple[GrayImage, float, RawFrames]:
    """What Gray code tells, how far light adds up, and the frames."""
    raw = stages.stack("gray", codes, first=2)
    return decode_gray_stage(raw, codes, view), nonlinear_share(_summed(raw, view), view.even), raw


def _summed(raw: RawFrames, view: SliceView) -> Singles:
    """A pattern and its inverse, the last ones of a stage, added up: mean counts (H, W)."""
    total = raw.image(raw.count - 2).astype(np.float32) + raw.image(raw.count - 1)
    return total / np.float32(view.frames)


def _explained_by_gray(
    grid: BlockGrid, gray: GrayImage, view: SliceView, nonlinear: float, left: float | None
) -> TakenSlice:
    """What Gray code found, as the light of each pixel's own block."""
    unit = np.float32(1 / view.unit)
    entries = one_a_pixel(grid, gray.block, np.maximum(gray.value, 0) * unit)
    return TakenSlice(_transport(view, gray.value, (entries,)), 0.0, left, nonlinear)


def _transport(view: SliceView, light: Singles, layers: tuple[Entries, ...]) -> SliceTransport:
    """The slice: all its light (H, W) in counts, and its entries."""
    return SliceTransport(light / np.float32(view.unit), layers)
