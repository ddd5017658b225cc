"""How widely values scatter when a few of them are wrong."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

_MAD_TO_DEVIATION: Final = 1.4826
"""Median of absolute deviations -> standard deviation, of a normal distribution."""


def robust_deviation(values: ArrayLike, about: float | None = None) -> float:
    """Standard deviation of values (any shape) by their median absolute deviation; outliers hardly move it.

    `about` is the middle that deviations are taken from, None for the median.
    """
    every = np.asarray(values)
    middle = np.median(every) if about is None else about
    return _MAD_TO_DEVIATION * float(np.median(np.abs(every - middle)))
