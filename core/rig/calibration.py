"""How well a rig's numbers are known: what a calibration found out beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import require

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
            require(name in NUMBERS, "calibration.names", name, f"one of {', '.join(NUMBERS)}")
        count = len(self.names)
        square = len(self.covariance) == count and all(len(row) == count for row in self.covariance)
        require(
            square and count > 0, "calibration.covariance", len(self.covariance), f"{count} rows of {count} numbers"
        )
        array = self.array
        scale = np.sqrt(np.abs(np.diag(array)))
        fits = bool(np.isfinite(array).all()) and bool((np.diag(array) >= 0).all())
        fits = fits and bool(np.abs(array - array.T).max() <= 1e-6 * max(1e-300, float(np.outer(scale, scale).max())))
        require(fits, "calibration.covariance", "not one", "symmetric, with variances of 0 or more")

    @cached_property
    def array(self) -> Doubles:
        """The covariance, (N, N) float64."""
        return np.array(self.covariance, np.float64).reshape(len(self.names), -1)

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
