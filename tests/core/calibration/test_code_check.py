"""Pictures of a Gray code in a wrong order are noticed by themselves, and what happened to them is found."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from chart_views import code_of, hidden_pair, pictures, poses
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.code_check import (
    WrongOrder,
    code_signs,
    misplaced,
    pairs_of,
    wrong_order,
)

CHART = chart_from("6x5:30")
PAIR = hidden_pair(6, (400, 300), (320, 240))
ORDER = code_of(PAIR)
EVERY = range(ORDER.count)


@lru_cache(maxsize=1)
def frames() -> np.ndarray:
    return pictures(PAIR, CHART, poses(PAIR, CHART, 1, 6)[0], np.random.default_rng(6))


def as_they_are() -> list[int]:
    return list(EVERY)


def test_pictures_in_order_are_believed() -> None:
    assert misplaced(ORDER, code_signs(frames())) == ()


@pytest.mark.parametrize("words", WrongOrder.kinds())
def test_every_way_to_sort_them_wrongly_is_named(words: str) -> None:
    belongs = WrongOrder(words).mended(ORDER)
    stands = np.empty(ORDER.count, int)
    stands[belongs] = np.arange(ORDER.count)
    signs = code_signs(frames()[stands])
    assert misplaced(ORDER, signs)
    assert wrong_order(ORDER, signs) == WrongOrder(words)


@pytest.mark.parametrize("bit", range(len(pairs_of(ORDER))))
def test_a_pattern_and_its_inverse_that_have_changed_places_are_named(bit: int) -> None:
    first = pairs_of(ORDER)[bit]
    stands = as_they_are()
    stands[first : first + 2] = first + 1, first
    assert wrong_order(ORDER, code_signs(frames()[stands])) == WrongOrder(swapped=((first, first + 1),))


@pytest.mark.parametrize(("one", "other"), [(4, 9), (7, 28), (ORDER.white, ORDER.black), (5, ORDER.black)])
def test_two_pictures_that_have_changed_places_are_named(one: int, other: int) -> None:
    stands = as_they_are()
    stands[one], stands[other] = other, one
    assert wrong_order(ORDER, code_signs(frames()[stands])) == WrongOrder(swapped=((one, other),))


def test_two_bits_that_have_changed_places_are_named() -> None:
    stands = as_they_are()
    stands[4:6], stands[8:10] = stands[8:10], stands[4:6]
    assert wrong_order(ORDER, code_signs(frames()[stands])) == WrongOrder(swapped=((4, 8), (5, 9)))


def test_what_nothing_simple_explains_is_noticed_all_the_same() -> None:
    stands = as_they_are()
    stands[4], stands[9], stands[24] = 9, 24, 4
    signs = code_signs(frames()[stands])
    assert wrong_order(ORDER, signs) is None
    first, second = misplaced(ORDER, signs)
    assert (first, second) == (4, 5)
    assert signs.both_dark(first, second) > 0.2
