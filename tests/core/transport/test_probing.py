"""Probing matrices: the paper's, their identities, and the operator against them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import WIDE_LIMITS
from slopegate.core.gating.gate import recorded_times, row_windows
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Lens, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.core.transport.probing import Convention, Probing

CONVENTIONS: tuple[Convention, ...] = ("equations", "printed")
SMALL = st.integers(1, 9)


def matrix(probing: Probing) -> np.ndarray:
    """Pi itself, (rows, rows)."""
    rows = np.arange(probing.rows)
    return probing.weights(rows[:, None], rows[None, :])


def by_permutations(rows: int, delay: int, exposure: int) -> np.ndarray:
    """Equation 12, with sigma_n(I) the identity whose n-th row comes first."""
    return sum(
        (np.roll(np.eye(rows, dtype=np.int64), -(delay - k), axis=0) for k in range(exposure)),
        np.zeros((rows, rows), np.int64),
    )


def test_the_papers_five_pixels_in_both_conventions() -> None:
    printed = np.array([[0, 0, 0, 0, 1], [1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0]])
    assert (matrix(Probing(5, 1, 1, "printed")) == printed).all()
    assert (matrix(Probing(5, 1, 1)) == printed.T).all()
    assert (matrix(Probing(5, 0, 1)) == np.eye(5)).all()
    # The text of figure 3b: three entries above the diagonal and two below, as printed.
    third = matrix(Probing(5, 3, 1, "printed"))
    assert (np.triu(third, 1).sum(), np.tril(third, -1).sum()) == (3, 2)


def test_a_camera_row_sees_the_projector_row_that_equations_7_and_8_say() -> None:
    rows, delay = 720, 37
    camera = np.arange(rows - delay)
    assert (Probing(rows, delay, 1).weights(camera, camera + delay) == 1).all()
    assert Probing(rows, delay, 1).weights(camera, camera + delay + 1).sum() == 0


@given(SMALL, st.integers(-20, 20), st.integers(0, 20))
def test_it_is_the_papers_sum_of_permutations(rows: int, delay: int, exposure: int) -> None:
    expected = by_permutations(rows, delay, exposure)
    assert (matrix(Probing(rows, delay, exposure)) == expected).all()
    assert (matrix(Probing(rows, delay, exposure, "printed")) == expected.T).all()


@given(SMALL, st.integers(0, 20), st.sampled_from(CONVENTIONS))
def test_all_delays_add_up_to_the_exposure_everywhere(rows: int, exposure: int, convention: Convention) -> None:
    total = sum(matrix(Probing(rows, delay, exposure, convention)) for delay in range(rows))
    assert (total == exposure).all()


@given(SMALL, st.integers(-9, 9), st.integers(0, 9), st.integers(0, 9), st.sampled_from(CONVENTIONS))
def test_exposures_add_up_where_one_ends_as_the_other_begins(
    rows: int, delay: int, first: int, second: int, convention: Convention
) -> None:
    whole = matrix(Probing(rows, delay, first + second, convention))
    parts = [(delay, first), (delay - first, second)]
    assert (whole == sum(matrix(Probing(rows, *part, convention)) for part in parts)).all()


@st.composite
def transports(draw: st.DrawFn) -> tuple[Probing, np.ndarray, np.random.Generator]:
    rows = draw(SMALL)
    probing = Probing(rows, draw(st.integers(-20, 20)), draw(st.integers(0, 20)), draw(st.sampled_from(CONVENTIONS)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return probing, rng.integers(0, 1000, (rows, draw(st.integers(1, 4)), rows, draw(st.integers(1, 4)))), rng


@given(transports())
def test_the_operator_is_the_dense_product_in_whole_numbers(
    drawn: tuple[Probing, np.ndarray, np.random.Generator],
) -> None:
    probing, transport, rng = drawn
    height, width, rows, columns = transport.shape
    pattern, image = rng.integers(0, 100, (rows, columns)), rng.integers(0, 100, (height, width))
    # One block of equal entries for each pair of rows.
    dense = np.kron(matrix(probing), np.ones((width, columns), np.int64))
    flat = dense * transport.reshape(height * width, rows * columns)
    assert (probing.probed(transport).reshape(flat.shape) == flat).all()
    assert (probing.image(transport, pattern).ravel() == flat @ pattern.ravel()).all()
    assert (probing.adjoint(transport, image).ravel() == flat.T @ image.ravel()).all()


@given(transports())
def test_the_adjoint_is_the_adjoint(drawn: tuple[Probing, np.ndarray, np.random.Generator]) -> None:
    probing, counts, rng = drawn
    transport = counts * rng.random(counts.shape)
    pattern, image = rng.random(counts.shape[2:]), rng.random(counts.shape[:2])
    forth = (probing.image(transport, pattern) * image).sum()
    back = (probing.adjoint(transport, image) * pattern).sum()
    assert abs(forth - back) <= 1e-12 * max(abs(forth), abs(back))


@given(transports(), st.integers(0, 9))
def test_pieces_of_rows_are_the_whole(drawn: tuple[Probing, np.ndarray, np.random.Generator], cut: int) -> None:
    probing, transport, rng = drawn
    cut = min(cut, probing.rows)
    pattern, image = rng.integers(0, 100, transport.shape[2:]), rng.integers(0, 100, transport.shape[:2])
    pieces = [(transport[first:last], image[first:last], first) for first, last in ((0, cut), (cut, probing.rows))]
    pieces = [piece for piece in pieces if piece[0].shape[0]]
    images = np.concatenate([probing.image(rows, pattern, first) for rows, _, first in pieces])
    assert (images == probing.image(transport, pattern)).all()
    seen = sum(probing.adjoint(rows, lines, first) for rows, lines, first in pieces)
    assert (seen == probing.adjoint(transport, image)).all()


def test_slices_that_tile_the_delays_add_up_to_the_transport() -> None:
    transport = np.random.default_rng(1).random((6, 3, 6, 2)).astype(np.float32)
    slices = [Probing(6, delay, 2).probed(transport) for delay in (1, 3, 5)]
    assert all(each.dtype == np.float32 for each in slices)
    assert (sum(slices) == transport).all()


@pytest.mark.parametrize(("delay", "exposure"), [(0, 1), (3, 1), (5, 2), (7, 4), (2, 9), (6, 8), (3, 17)])
def test_a_gate_of_the_program_records_what_the_operator_says(delay: int, exposure: int) -> None:
    rows, row_us = 8, 1024.0
    lens = Lens(4, rows, 10.0, 10.0, 2.0, 4.0)
    rig = ideal_rig(RigCamera(lens, WIDE_LIMITS), RigProjector(lens, rows * row_us, active_fraction=1.0), 0.1)
    settings = gate(row_us, (delay - (exposure - 1) / 2) * row_us, exposure * row_us)
    numbers = np.arange(rows)
    recorded = recorded_times(row_windows(rig, settings), numbers[:, None], numbers[None, :] + 0.5)
    assert (recorded == matrix(Probing(rows, delay, exposure))).all()


@pytest.mark.parametrize(("rows", "exposure", "field"), [(0, 1, "rows"), (5, -1, "exposure")])
def test_what_is_no_sweep_is_refused(rows: int, exposure: int, field: str) -> None:
    with pytest.raises(InputError, match=field):
        Probing(rows, 0, exposure)
