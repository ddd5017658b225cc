"""How well a rig's numbers are known: what a calibration found out beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import InputError, require, shortened
from slopegate.core.rig.plus_minus import plus_minus

LENS: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
GEOMETRY: Final = (
    *(f"camera.{name}" for name in LENS),
    *(f"projector.{name}" for name in LENS),
    *(f"rotation_{axis}_rad" for axis in "xyz"),
    *(f"offset_{axis}_m" for axis in "xyz"),
)
"""Both lenses in pixels, the projector's rotation vector, and its centre seen from the camera."""
TIMING: Final = ("period_us", "active_fraction", "clocks_per_line", "delay_offset_us")
NUMBERS: Final = (*GEOMETRY, *TIMING)
"""Every number of a rig that a calibration may tell."""
_ALL: Final = (
    f"camera.{LENS[0]} to {LENS[-1]}, projector.{LENS[0]} to {LENS[-1]}, {', '.join((*GEOMETRY[18:], *TIMING))}"
)
_MOST: Final = 1e12
"""Variance that can be told: far beyond any that says something."""
_ROUNDING: Final = 1e-6
"""Share of standard errors by which rounding may leave a covariance that is none."""


@dataclass(frozen=True)
class Calibration:
    """What a calibration found out about a rig, beside its numbers.

    names: of the `NUMBERS` that it told. covariance: theirs, row by row. facts: where they come from (pictures and
    their checksum, chart, date, counts, errors), as text.
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    facts: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        for name in self.names:
            require(name in NUMBERS, "calibration.names", shortened(name, 60), f"of {_ALL}")
        count = len(self.names)
        require(count > 0, "calibration.names", list(self.names), "the names of one number or more")
        require(len(set(self.names)) == count, "calibration.names", list(self.names), "names that differ")
        lengths = [len(row) for row in self.covariance]
        square = f"{count} rows of {count} numbers, one for each of calibration.names"
        told = f"{len(lengths)} rows of {min(lengths, default=0)} to {max(lengths, default=0)} numbers"
        if lengths != [count] * count:
            raise InputError(f"calibration.covariance has {told}: it must have {square}")
        self._check_values()

    def _check_values(self) -> None:
        array = self.array
        require(bool(np.isfinite(array).all()), "calibration.covariance", "not finite", "of finite numbers")
        for name, variance in zip(self.names, np.diag(array).tolist(), strict=True):
            allowed = f"from 0 to {_MOST:g}"
            require(0 <= variance <= _MOST, f"calibration.covariance of {name} with itself", variance, allowed)
        # the tests below are of what stands beside standard errors
        errors = np.sqrt(np.diag(array))
        scale = np.outer(errors, errors)
        apart = np.abs(array - array.T) - _ROUNDING * scale
        beyond = np.abs(array) - (1 + _ROUNDING) * scale
        for off, rule in (
            (apart, "the same both ways"),
            (beyond, "at most the product of both standard errors"),
        ):
            row, column = np.unravel_index(int(off.argmax()), off.shape)
            pair = f"calibration.covariance of {self.names[row]} with {self.names[column]}"
            require(bool(off[row, column] <= 0), pair, float(array[row, column]), rule)
        least = float(np.linalg.eigvalsh(self.correlation)[0])
        rule = "positive semidefinite: no sum of its numbers may have a variance below 0"
        require(least >= -_ROUNDING * len(self.names), "calibration.covariance", "not possible", rule)

    @cached_property
    def array(self) -> Doubles:
        """The covariance, (N, N) float64."""
        return np.array(self.covariance, np.float64).reshape(len(self.names), -1)

    @property
    def correlation(self) -> Doubles:
        """The covariance in units of standard errors, (N, N) float64; 0 beside a number that is known exactly."""
        errors = np.sqrt(np.diag(self.array))
        inverse = np.divide(1.0, errors, out=np.zeros_like(errors), where=errors > 0)
        return self.array * inverse[:, None] * inverse

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard error of each number."""
        return dict(zip(self.names, np.sqrt(np.diag(self.array)).tolist(), strict=True))


def joined(
    first: Calibration | None, second: Calibration, derivatives: Mapping[str, Doubles] | None = None
) -> Calibration:
    """Both, where the second tells what it tells anew.

    derivatives: by how much the second's numbers (n,) rise with a number of the first, by name; its covariance holds
    the first's share already. Nothing ties the other numbers of the two together.
    """
    if first is None:
        return second
    kept = [place for place, name in enumerate(first.names) if name not in second.names]
    names = tuple(first.names[place] for place in kept) + second.names
    own = first.array[np.ix_(kept, kept)]
    none = np.zeros(len(second.names))
    rises = np.array([(derivatives or {}).get(first.names[place], none) for place in kept]).reshape(len(kept), -1)
    across = own @ rises
    covariance = np.block([[own, across], [across.T, second.array]])
    facts = {**dict(first.facts), **dict(second.facts)}
    return Calibration(names, as_rows(covariance), tuple(facts.items()))


def as_rows(covariance: Doubles) -> tuple[tuple[float, ...], ...]:
    """An array as `Calibration.covariance`."""
    return tuple(tuple(map(float, row)) for row in covariance)


def told_number(name: str, value: float, error: float) -> str:
    """One of the `NUMBERS` with its standard error and unit, as people read it: "1666.70 +- 0.31 px"."""
    return f"{plus_minus(value, error)}{unit_of(name)}"


def unit_of(name: str) -> str:
    """The unit of one of the `NUMBERS`, with a space before it; empty where it has none."""
    key = name.removeprefix("projector.").removeprefix("camera.")
    if key in ("fx", "fy", "cx", "cy"):
        return " px"
    units = {"_rad": " rad", "_m": " m", "_us": " us"}
    return next((unit for end, unit in units.items() if key.endswith(end)), "")
