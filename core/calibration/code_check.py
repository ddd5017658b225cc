"""Whether the pictures of a Gray code stand in their order, by the pictures alone.

Decoding believes the order that it is told: a picture in a wrong place gives wrong places of the projector, which then
look like a bad view, or like a slightly worse one. In their order, pattern and inverse are lit and dark the other way
about, neighbouring pixels have neighbouring numbers, and columns and rows turn the same way in both pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.calibration.codes import CodeOrder
from slopegate.core.rig.arrays import Bytes, Counts, Ints

MOST_LINES: Final = 64
"""Of pixels, across and down, that are looked at."""
LEAST_PAIRS: Final = 20
"""Of neighbours, that have to tell something."""
STRIDES: Final = (4, 2, 1)
"""Pixels between neighbours: on the border itself of two stripes a pixel is neither lit nor dark."""
MOST_JUMPS: Final = 0.25
"""Share of neighbours with other numbers that may differ by more than the code's step."""
MOST_UNLIKE: Final = 0.35
"""Share of pixels that may be lit or dark in both of a pattern and its inverse, or dark in white."""
MOST_DARK: Final = 0.15
"""Share of pixels that may be dark in both a pattern and its inverse: of two other patterns a quarter is."""
_LIT: Final = 0.15
"""Of the difference of the brightest parts, what a pixel must have between its brightest and its darkest picture."""
_CLEAR: Final = 0.15
"""Of a pixel's own difference, by which it must be brighter or darker than halfway."""


Signs = NDArray[np.int8]
"""Lit (1), dark (-1) or in doubt (0)."""


@dataclass(frozen=True, eq=False)
class CodeSigns:
    """Where pixels of some lines are lit (1), dark (-1) or in doubt (0), in every picture: (count, lines, length) int8,
    across and down the picture."""

    across: Signs
    down: Signs

    def unlike(self, one: int, other: int) -> float:
        """Share of pixels in which two pictures are not lit and dark the other way about."""
        products = [(lines[one] * lines[other]).ravel() for lines in (self.across, self.down)]
        told = np.concatenate(products)
        told = told[told != 0]
        return float((told > 0).mean()) if told.size else 0.0

    def both_dark(self, one: int, other: int) -> float:
        """Share of pixels that are dark in both of two pictures: too much light makes none."""
        dark = [(lines[one] < 0) & (lines[other] < 0) for lines in (self.across, self.down)]
        told = [(lines[one] != 0) & (lines[other] != 0) for lines in (self.across, self.down)]
        return sum(int(part.sum()) for part in dark) / max(1, sum(int(part.sum()) for part in told))

    def evenly(self, picture: int, sign: int) -> bool:
        """Whether a picture is lit (1) or dark (-1) all over."""
        told = np.concatenate([lines[picture].ravel() for lines in (self.across, self.down)])
        told = told[told != 0]
        return bool((told == sign).mean() > 1 - MOST_UNLIKE) if told.size else True


def code_signs(frames: Bytes | Counts) -> CodeSigns:
    """Of frames (count, H, W)."""
    height, width = frames.shape[1:]
    rows, columns = max(1, height // MOST_LINES), max(1, width // MOST_LINES)
    return CodeSigns(_signs(frames[:, ::rows]), _signs(frames[:, :, ::columns].transpose(0, 2, 1)))


def _signs(lines: Bytes | Counts) -> Signs:
    least, most = lines.min(axis=0).astype(np.float32), lines.max(axis=0).astype(np.float32)
    contrast = most - least
    lit = contrast > max(_LIT * float(np.percentile(contrast, 99)), 2.0)
    middle, doubt = (least + most) / 2, _CLEAR * contrast
    found = np.zeros(lines.shape, np.int8)
    for sign, line in zip(found, lines, strict=True):
        sign[lit & (line > middle + doubt)] = 1
        sign[lit & (line < middle - doubt)] = -1
    return found


def misplaced(order: CodeOrder, signs: CodeSigns, pictures: Ints | None = None) -> tuple[int, ...]:
    """The first places of the order whose pictures cannot stand there; none where all can.

    pictures (count,): the picture that stands in each place, if not each in its own.
    """
    at = _in_place(order) if pictures is None else pictures
    if not (signs.evenly(int(at[order.white]), 1) and signs.evenly(int(at[order.black]), -1)):
        return order.white, order.black
    for first in pairs_of(order):
        if signs.unlike(int(at[first]), int(at[first + 1])) > MOST_UNLIKE:
            return first, first + 1
    turns = np.zeros((2, 2))
    for axis, first in enumerate((order.first_column, order.first_row)):
        runs = _runs(order, signs, at, axis)
        main = max(runs, key=lambda run: max(run.changes))
        if (bit := main.first_jump) is not None:
            return first + 2 * bit, first + 2 * bit + 1
        turns[axis] = [run.rise for run in runs]
    if float(np.linalg.det(turns)) < 0 and np.abs(turns).max(axis=1).min() > 0:
        return order.first_column, order.first_row
    return ()


@dataclass(frozen=True)
class WrongOrder:
    """What mends an order: all pictures are sorted in another way, said in words, or some have changed places."""

    words: str = ""
    swapped: tuple[tuple[int, int], ...] = ()

    @staticmethod
    def kinds() -> tuple[str, ...]:
        """Ways to sort all pictures wrongly."""
        return tuple(_SORTED)

    def mended(self, order: CodeOrder) -> Ints:
        """The picture (count,) that belongs into each place."""
        at = _in_place(order)
        for one, other in self.swapped:
            at[[one, other]] = other, one
        return _SORTED[self.words](order) if self.words else at


def wrong_order(order: CodeOrder, signs: CodeSigns) -> WrongOrder | None:
    """What explains pictures that cannot stand in this order, None where nothing simple does."""
    few = CodeSigns(signs.across[:, ::4], signs.down[:, ::4])
    for one in _explanations(order, few):
        if not misplaced(order, few, one.mended(order)) and not misplaced(order, signs, one.mended(order)):
            return one
    return None


def _explanations(order: CodeOrder, signs: CodeSigns) -> Iterator[WrongOrder]:
    """The likely ones first."""
    yield from map(WrongOrder, _SORTED)
    pairs = pairs_of(order)
    broken = [place for first in pairs if signs.unlike(first, first + 1) > MOST_UNLIKE for place in (first, first + 1)]
    yield from (WrongOrder(swapped=(two,)) for two in combinations(sorted({*broken, order.white, order.black}), 2))
    if broken:
        return
    # columns or rows that count backwards: either mends that they turn the other way, and upright is what most are
    ahead = [_runs(order, signs, _in_place(order), axis)[axis].rise >= 0 for axis in range(2)]
    upright = {order.first_column: ahead[0], order.first_row: ahead[1]}
    yield from (WrongOrder(swapped=((one, one + 1),)) for one in sorted(pairs, key=lambda one: upright.get(one, False)))
    for one, other in combinations(pairs, 2):
        yield WrongOrder(swapped=((one, other), (one + 1, other + 1)))


def _in_place(order: CodeOrder) -> Ints:
    return np.arange(order.count, dtype=np.int32)


def _inverse_first(order: CodeOrder) -> Ints:
    at = _in_place(order)
    for first in pairs_of(order):
        at[[first, first + 1]] = first + 1, first
    return at


def _rows_first(order: CodeOrder) -> Ints:
    at, (columns, rows) = _in_place(order), order.bits
    start = order.first_column
    at[order.first_row : order.first_row + 2 * rows] = start + np.arange(2 * rows)
    at[start : start + 2 * columns] = start + 2 * rows + np.arange(2 * columns)
    return at


def _finest_first(order: CodeOrder) -> Ints:
    at = _in_place(order)
    for first, bits in zip((order.first_column, order.first_row), order.bits, strict=True):
        at[first : first + 2 * bits] = at[first : first + 2 * bits].reshape(bits, 2)[::-1].ravel()
    return at


def _as_words(first: int) -> Callable[[CodeOrder], Ints]:
    """Pictures counted from `first` that were sorted by the letters of their numbers."""

    def sort(order: CodeOrder) -> Ints:
        letters = sorted(range(order.count), key=lambda place: str(place + first))
        return np.asarray(np.argsort(letters), np.int32)

    return sort


_SORTED: Final[dict[str, Callable[[CodeOrder], Ints]]] = {
    "every inverse stands before its pattern": _inverse_first,
    "rows stand before columns": _rows_first,
    "rows stand before columns, and every inverse before its pattern": lambda order: _rows_first(order)[
        _inverse_first(order)
    ],
    "the finest stripes stand first": _finest_first,
    "they were sorted by letters, which puts 10 before 2": _as_words(1),
    "they were sorted by letters, which puts 10 before 2, and counted from 0": _as_words(0),
}


def pairs_of(order: CodeOrder) -> list[int]:
    """Where the pairs of pattern and inverse begin."""
    starts = zip((order.first_column, order.first_row), order.bits, strict=True)
    return [first + 2 * bit for first, bits in starts for bit in range(bits)]


def _runs(order: CodeOrder, signs: CodeSigns, at: Ints, axis: int) -> list[_Run]:
    """Of the columns' code (axis 0) or the rows', across and down the picture."""
    first, bits = (order.first_column, order.first_row)[axis], order.bits[axis]
    shown = [int(at[first + 2 * bit]) for bit in range(bits)]
    return [_Run.of(lines[shown]) for lines in (signs.across, signs.down)]


@dataclass(frozen=True)
class _Run:
    """How the number of a code goes on along lines of pixels.

    changes: how many neighbours have another number, by the coarsest two bits, then by one more each. first_jump: the
    first bit with which they differ by too much, None: they never do. rise: mean step of the number.
    """

    changes: tuple[int, ...]
    first_jump: int | None
    rise: float

    @classmethod
    def of(cls, signs: Signs) -> _Run:
        """signs (bits, lines, length): of the patterns, the coarsest first."""
        bit = number = (signs[0] > 0).astype(np.int32)
        known = signs[0] != 0
        changes: list[int] = []
        slope, rise, jump = 0.0, 0.0, None
        for place in range(1, len(signs)):
            bit = bit ^ (signs[place] > 0)
            number = 2 * number + bit
            known = known & (signs[place] != 0)
            stride = next((one for one in STRIDES if one * slope <= 1), None)
            if stride is None:  # the camera does not resolve what follows
                break
            both = known[:, stride:] & known[:, :-stride]
            steps = (number[:, stride:] - number[:, :-stride])[both]
            moved = steps[steps != 0]
            changes.append(len(moved))
            if len(moved) >= LEAST_PAIRS:
                if (np.abs(moved) > 1 + stride * slope).mean() > MOST_JUMPS:
                    jump = place
                    break
                rise = float(np.sign(moved).mean()) * len(moved) / len(steps)
            slope = 2 * len(moved) / max(1, len(steps)) / stride
        return cls(tuple(changes) or (0,), jump, rise)
