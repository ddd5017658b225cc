"""Takes one slice: the patterns that its codes need, decoded into entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.adaptive import (
    CHECKS,
    EXCESS,
    CheckPatterns,
    LitBlocks,
    SomeBlocks,
    budget,
    coarse_codes,
    predicted_by_gray,
    seen_blocks,
    unexplained,
)
from slopegate.core.transport.codes import make_codes
from slopegate.core.transport.even import EvenLight, nonlinear_share
from slopegate.core.transport.gray import GrayCodes, GrayImage, gray_patterns
from slopegate.core.transport.sliced import Entries, SliceTransport, one_a_pixel, relit
from slopegate.drivers.transports.decoding import (
    SliceView,
    decode_coarse,
    decode_codes,
    decode_gray_stage,
)
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.raw_frames import RawFrames
from slopegate.drivers.transports.stages import Stages


@dataclass(frozen=True, eq=False)
class TakenSlice:
    """A slice's transport, and what its record says of it."""

    transport: SliceTransport
    left_out: float = 0.0
    unexplained: float | None = None
    nonlinear: float = 0.0


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
    if codes == "adaptive":
        return _take_adaptive(stages, grid, view)
    patterns = make_codes(codes, grid)
    pair = stages.stack("check", _Pair(grid))
    nonlinear = nonlinear_share(_summed(pair, view), view.even)
    kept = decode_codes(stages.stack("codes", patterns), patterns, view)
    return TakenSlice(_transport(view, view.even.light, kept.layers), kept.left_out.share, nonlinear=nonlinear)


def _take_gray(stages: Stages, grid: BlockGrid, view: SliceView) -> TakenSlice:
    codes = gray_patterns(grid)
    gray, nonlinear, _ = _gray_stage(stages, codes, view)
    return _explained_by_gray(grid, gray, view, nonlinear, None)


def _take_adaptive(stages: Stages, grid: BlockGrid, view: SliceView) -> TakenSlice:
    codes, checks = gray_patterns(grid), CheckPatterns(grid)
    gray, nonlinear, raw = _gray_stage(stages, codes, view)
    shown = stages.stack("check", checks)
    frames = [view.image(shown, number) for number in range(checks.count)]
    light = view.even.light

    def error(number: int, predicted: Singles) -> float:
        return unexplained(predicted, frames[number], view.even, view.noise)

    left = float(np.mean([error(k, predicted_by_gray(gray, light, checks.values(k))) for k in range(CHECKS)]))
    spent = codes.count + CHECKS
    more = None if left <= 1 + EXCESS else _coarse(stages, grid, gray, view, budget(grid) - spent)
    if more is None:
        return _explained_by_gray(grid, gray, view, nonlinear, left)
    kept, direct = decode_coarse(stages.stack("coarse", more), more, raw, codes, gray, view)
    unit = np.float32(1 / view.unit)
    fine = one_a_pixel(grid, np.where(direct > 0, gray.block, -1).astype(np.int32), direct * unit)
    transport = _transport(view, gray.value, (fine, *kept.layers))
    again = [relit(transport, grid.spread(checks.values(k)).astype(np.float32)) for k in range(CHECKS)]
    left = float(np.mean([error(k, image * np.float32(view.unit)) for k, image in enumerate(again)]))
    return TakenSlice(transport, kept.left_out.share, left, nonlinear)


def _coarse(stages: Stages, grid: BlockGrid, gray: GrayImage, view: SliceView, left: int) -> SomeBlocks | None:
    """Codes for the blocks that may light something; None where no patterns are left for them."""
    lit = seen_blocks(gray, grid)
    if not lit.all():
        frame = view.image(stages.stack("unseen", LitBlocks(grid, ~lit)), 0)
        left -= 1
        if not EvenLight(view.even.black, frame, view.frames, view.even.noise).is_dark:
            lit[:] = True
    return coarse_codes(grid, lit, left)


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
