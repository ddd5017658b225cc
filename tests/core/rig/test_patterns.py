"""Patterns, pixel by pixel, on rasters of any size."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.patterns import (
    KINDS,
    Axis,
    Raster,
    checkerboard,
    even,
    focus_grid,
    gray_bits,
    gray_code,
    one_line,
    ramp,
    stripes,
)

RASTERS = st.builds(Raster, st.integers(1, 70), st.integers(1, 70))
AXES = st.sampled_from(("rows", "columns"))


def lines(pattern: Bytes, axis: Axis) -> list[Bytes]:
    return list(pattern if axis == "rows" else pattern.T)


@given(RASTERS, AXES, st.data())
def test_one_line_is_lit_and_nothing_else(raster: Raster, axis: Axis, data: st.DataObject) -> None:
    index = data.draw(st.integers(0, raster.length(axis) - 1))
    for number, line in enumerate(lines(one_line(raster, axis, index), axis)):
        assert (line == (255 if number == index else 0)).all()


@given(RASTERS, st.integers(1, 40))
def test_neighbouring_squares_differ_and_squares_are_even(raster: Raster, square_px: int) -> None:
    pattern = checkerboard(raster, square_px)
    for row, column in np.ndindex(pattern.shape):
        assert pattern[row, column] == (255 if (row // square_px + column // square_px) % 2 == 0 else 0)


@given(RASTERS, AXES, st.integers(1, 40))
def test_stripes_have_their_width(raster: Raster, axis: Axis, width_px: int) -> None:
    for number, line in enumerate(lines(stripes(raster, axis, width_px), axis)):
        assert (line == (255 if number // width_px % 2 == 0 else 0)).all()


@given(RASTERS, AXES)
def test_a_ramp_never_falls_and_uses_the_whole_range(raster: Raster, axis: Axis) -> None:
    pattern = ramp(raster, axis)
    levels = [int(line[0]) for line in lines(pattern, axis)]
    assert all((line == line[0]).all() for line in lines(pattern, axis))
    assert levels == sorted(levels)
    if len(levels) > 1:
        assert (levels[0], levels[-1]) == (0, 255)
        assert max(np.diff(levels)) - min(np.diff(levels)) <= 1


@given(RASTERS, AXES)
def test_gray_code_numbers_every_line_and_neighbours_differ_in_one_bit(raster: Raster, axis: Axis) -> None:
    bits = gray_bits(raster, axis)
    code = np.zeros(raster.length(axis), np.int64)
    for bit in range(bits):
        pattern = gray_code(raster, axis, bit)
        assert set(np.unique(pattern)) <= {0, 255}
        assert all((line == line[0]).all() for line in lines(pattern, axis))
        code = 2 * code + [int(line[0]) // 255 for line in lines(pattern, axis)]
    assert all(int(a ^ b).bit_count() == 1 for a, b in itertools.pairwise(code))
    # decoded as everybody does: each binary digit is the parity of the Gray digits above it
    number = code.copy()
    for shift in range(1, bits):
        number ^= code >> shift
    assert number.tolist() == list(range(raster.length(axis)))


@given(RASTERS, st.integers(2, 40))
def test_the_grid_reaches_every_edge_and_corner(raster: Raster, spacing_px: int) -> None:
    pattern = focus_grid(raster, spacing_px)
    for edge in (pattern[0], pattern[-1], pattern[:, 0], pattern[:, -1]):
        assert (edge == 255).all()
    assert (pattern[::spacing_px] == 255).all()
    assert (pattern[:, ::spacing_px] == 255).all()
    # the diagonals touch every row and every column
    assert (pattern == 255).any(axis=0).all()


@given(RASTERS, st.data())
def test_every_kind_draws_at_both_ends_of_its_range(raster: Raster, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(KINDS))
    number = kind.number
    values = [0] if number is None else [number.low, number.high(raster), number.usual(raster)]
    for value in values:
        pattern = kind.draw(raster, value)
        assert pattern.shape == (raster.height, raster.width)
        assert pattern.dtype == np.uint8
        assert pattern.flags.c_contiguous


def test_keys_are_different() -> None:
    assert len({kind.key for kind in KINDS}) == len(KINDS)


@pytest.mark.parametrize(
    ("draw", "sentence"),
    [
        (lambda raster: even(raster, 256), "level is 256: it must be from 0 to 255"),
        (lambda raster: one_line(raster, "rows", 720), "row is 720: it must be from 0 to 719"),
        (lambda raster: one_line(raster, "columns", -1), "column is -1: it must be from 0 to 1279"),
        (lambda raster: checkerboard(raster, 0), "square_px is 0: it must be at least 1"),
        (lambda raster: stripes(raster, "rows", 0), "width_px is 0: it must be at least 1"),
        (lambda raster: focus_grid(raster, 1), "spacing_px is 1: it must be at least 2"),
        (lambda raster: gray_code(raster, "rows", 10), "bit is 10: it must be from 0 to 9"),
        (lambda raster: Raster(0, 5), "width is 0: it must be a whole number of at least 1"),
    ],
)
def test_numbers_that_a_raster_has_not_are_refused(draw: object, sentence: str) -> None:
    assert callable(draw)
    with pytest.raises(ValueError, match="it must be") as caught:
        draw(Raster(1280, 720))
    assert str(caught.value) == sentence
