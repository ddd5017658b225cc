"""Edges of a gate on a plane: where, down a strip of the picture, the light of a gate begins and ends.

What counts is the share of the full light that a gate records: shading, colour and the chart's squares divide out. A
strip is a range of columns; its rows are averaged, so that an edge is found to some hundredths of a row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Singles

STRIPS: Final = 16
"""Narrow ones: an edge crosses the picture aslant, so that the rows of a wide strip mix what lies on its two sides, and
light of fog before the plane then counts as some of the step."""
LEAST_STEP: Final = 0.35
"""Of the full light: what a row of the picture gains or loses at an edge."""
SCALES: Final = (4, 8, 16, 32)
"""Rows on both sides over which an edge is looked for."""
REACH: Final = 4
"""Times as many rows, on both sides, that it is measured by, where there are as many before the next edge. Further away
light of fog bends."""
FARTHER: Final = 6
"""Times as many rows by which the edge is measured once more: what light that bends does to its place shows in it."""
LEAST_ROWS: Final = 4
"""On each side of an edge."""
MOST_SCATTER: Final = 0.1
"""Of the step, about the lines on its sides: more is no edge between two even parts."""
LEAST_COLUMNS: Final = 4
_TAILS: Final = 1.3


@dataclass(frozen=True)
class Edge:
    """Where the light of a gate begins or ends in a strip.

    `row`, `column` and `projector_row` are continuous coordinates, `slope` projector rows per camera row there,
    `across` their range over the strip's columns, `error_rows` the standard error of `row`. `rising`: lit below it,
    dark above. `soft_rows`: standard deviation of the Gaussian that makes a step as soft. `bent_rows`: by how much
    `row` is larger when it is measured by rows farther away.
    """

    row: float
    column: float
    projector_row: float
    slope: float
    across: float
    rising: bool
    error_rows: float
    soft_rows: float
    bent_rows: float = 0.0


@dataclass(frozen=True, eq=False)
class Profile:
    """A strip by its camera rows, all (N,) float64, NaN where nothing is known: share of the full light, its noise, the
    mean column that it comes from, the projector row there and its range over the columns."""

    share: Doubles
    error: Doubles
    column: Doubles
    projector_row: Doubles
    across: Doubles


def profiles(image: Singles, full: Singles, projector_row: Singles, known: Bools, noise: float) -> list[Profile]:
    """The strips of a gated image (H, W) in counts above the dark, beside the same with everything lit.

    projector_row (H, W): continuous rows that light the pixels; known (H, W): pixels of the plane. noise: standard
    deviation of a pixel of `image`, counts. A row of a strip is the ratio of sums, so that bright pixels count more.
    """
    return [
        _profile(image[:, part], full[:, part], projector_row[:, part], known[:, part], noise, part.start)
        for part in strips(image.shape[1])
    ]


def strips(width: int) -> list[slice]:
    """The columns of each strip of a picture."""
    ends = np.linspace(0, width, STRIPS + 1).astype(int)
    return [slice(int(low), int(high)) for low, high in pairwise(ends)]


def _profile(image: Singles, full: Singles, projector_row: Singles, known: Bools, noise: float, first: int) -> Profile:
    lit = np.where(known, full, 0).astype(np.float64)
    light, pixels = lit.sum(axis=1), known.sum(axis=1)
    safe = np.where((pixels >= LEAST_COLUMNS) & (light > 0), light, np.nan)
    share = np.where(known, image, 0).sum(axis=1, dtype=np.float64) / safe
    at = np.arange(image.shape[1]) + 0.5
    column = lit @ at / safe
    rows = np.where(known, projector_row, 0)
    middle = (lit * rows).sum(axis=1) / safe
    away = np.where(known, at - column[:, None], 0)
    spread = (away**2).sum(axis=1)
    tilt = (away * (rows - middle[:, None])).sum(axis=1) / np.where(spread > 0, spread, np.nan)
    return Profile(share, noise * np.sqrt(pixels) / safe, first + column, middle, np.abs(tilt) * pixels)


def edges_in(profile: Profile) -> list[Edge]:
    """The edges of a strip, from top to bottom."""
    rows = np.flatnonzero(np.isfinite(profile.share))
    if len(rows) < 4 * LEAST_ROWS:
        return []
    first, last = int(rows[0]), int(rows[-1]) + 1
    share = np.interp(np.arange(first, last), rows, profile.share[rows])
    steps = _steps(share)
    places = [place for place, _ in steps]
    # To the ends of the strip, and half the way to the next edges.
    rooms = [min(place, len(share) - place) for place in places]
    for number, (above, below) in enumerate(pairwise(places)):
        half = (below - above) // 2
        rooms[number], rooms[number + 1] = min(rooms[number], half), min(rooms[number + 1], half)
    found = []
    for (place, wide), most in zip(steps, rooms, strict=True):
        # As far up as down: what a soft edge's tails do to the lines on both sides then makes no difference.
        room = min(REACH * wide, most)
        edge = _measure(profile, share, first, (place - room, place, place + room), wide // 2)
        if edge is None:
            continue
        room = min(FARTHER * wide, most)
        other = _measure(profile, share, first, (place - room, place, place + room), wide // 2)
        found.append(edge if other is None else replace(edge, bent_rows=other.row - edge.row))
    return found


def _steps(share: Doubles) -> list[tuple[int, int]]:
    """Where the share changes most from one side to the other, and over how many rows.

    Extremes of the difference of two means, of few rows first: where an edge is blurred it shows in those of more.
    """
    sums = np.concatenate([[0.0], np.cumsum(share)])
    found: list[tuple[int, int]] = []
    for wide in SCALES:
        middle = np.arange(wide, len(share) - wide)
        left = np.abs(sums[middle + wide] - 2 * sums[middle] + sums[middle - wide]) / wide
        # The flanks of what fewer rows have shown already are no edges.
        for place, _ in found:
            left[np.abs(middle - place) <= 2 * wide] = 0
        while len(left) and left.max() >= LEAST_STEP:
            place = int(middle[left.argmax()])
            found.append((place, wide))
            left[np.abs(middle - place) <= 2 * wide] = 0
    return sorted(found)


def _measure(profile: Profile, share: Doubles, first: int, span: tuple[int, int, int], near: int) -> Edge | None:
    """The edge within rows low .. high, found `near` rows about `place`: by the area under the step between both sides'
    lines.

    The lines follow light that changes slowly, as fog's does, so that only the step counts.
    """
    low, place, high = span
    at, part = np.arange(low, high, dtype=np.float64) + 0.5, share[low:high]
    for _ in range(2):
        above, below = at < place - near, at > place + near
        if min(above.sum(), below.sum()) < LEAST_ROWS - 1:
            return None
        before, after = (_continued(at, part, side) for side in (above, below))
        step = after - before
        if np.abs(step).min() < LEAST_STEP or step.min() * step.max() < 0:
            return None
        lit = (part - before) / step
        passing = at[(lit > 0.1) & (lit < 0.9)]
        # A Gaussian's tails, below 10 and above 90 %. No more: lines that begin far from the edge miss it in fog.
        near = max(near, int(np.ceil(_TAILS * np.abs(passing - place).max() + 1)) if len(passing) else 0)
    scatter = float(np.std(np.concatenate([lit[above], lit[below] - 1])))
    if scatter > MOST_SCATTER:
        return None
    between = ~(above | below)
    row = float(at[between][-1] + 0.5 - lit[between].sum())
    soft = np.sqrt(np.pi) * max(0.0, float((lit[between] * (1 - lit[between])).sum()))
    noise = float(np.nanmedian(profile.error[first + low : first + high]) / np.abs(step).mean())
    error = max(noise, scatter, 1e-3) * _rows_root(float(between.sum()), float(above.sum()))
    known = profile.projector_row[first + low : first + high]
    fine = np.isfinite(known)
    if fine.sum() < LEAST_ROWS:
        return None
    _, slope, there = np.polyfit(at[fine] - row, known[fine], 2)
    column, across = (
        float(np.nanmean(values[first + low : first + high])) for values in (profile.column, profile.across)
    )
    rising = bool(step.mean() > 0)
    return Edge(first + row, column, float(there), float(slope), across, rising, float(error), soft)


def _rows_root(between: float, beside: float) -> float:
    """Error of the area under a step by that of one row: its rows', and the lines' that run on from both sides."""
    away = (between + beside) / 2
    line = 1 / beside + (12 * away**2 / beside**3 if beside >= 2 * LEAST_ROWS else 0.0)
    return float(np.sqrt(between + between**2 / 2 * line))


def _continued(at: Doubles, part: Doubles, side: Bools) -> Doubles:
    """The light of one side of an edge, carried on over it: a line, or a level where few rows are known."""
    if side.sum() < 2 * LEAST_ROWS:
        return np.full(at.shape, part[side].mean())
    level, middle = part[side].mean(), at[side].mean()
    away = at[side] - middle
    slope = float(away @ part[side]) / float(away @ away)
    return np.asarray(level + slope * (at - middle), np.float64)
