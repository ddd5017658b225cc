"""Kept and refused light of each part: they add up to the fully lit picture, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.light.amounts import Amounts
from slopegate.core.light.part import PartName
from slopegate.core.rig.arrays import Singles


def images(seed: int, scale: float) -> dict[PartName, Singles]:
    random = np.random.default_rng(seed)
    names: tuple[PartName, ...] = ("ambient", "direct", "airlight")
    return {name: (scale * random.random((6, 8))).astype(np.float32) for name in names}


def test_kept_and_refused_are_the_fully_lit_picture() -> None:
    lit = images(1, 1.0)
    kept = {name: (0.3 * image).astype(np.float32) for name, image in lit.items()}
    kept["direct"][:, :4] = 0.0
    kept["direct"][:, 4:] = lit["direct"][:, 4:]
    amounts = Amounts(kept, lit)
    assert amounts.names == ("direct", "airlight", "ambient")
    assert amounts.shape == (6, 8)
    for name, split in amounts.at(5, 2).items():
        assert split.kept == kept[name][2, 5]
        assert split.kept + split.refused == pytest.approx(lit[name][2, 5], rel=1e-6)
    for name, split in amounts.mean().items():
        assert split.kept == pytest.approx(kept[name].mean(), rel=1e-6)
        assert split.kept + split.refused == pytest.approx(lit[name].mean(), rel=1e-6)


def test_what_is_recorded_twice_is_not_refused_elsewhere() -> None:
    lit: dict[PartName, Singles] = {"direct": np.ones((1, 2), np.float32)}
    kept: dict[PartName, Singles] = {"direct": np.array([[2.0, 0.0]], np.float32)}
    amounts = Amounts(kept, lit)
    assert amounts.at(0, 0)["direct"] == (2.0, 0.0)
    assert amounts.at(1, 0)["direct"] == (0.0, 1.0)
    assert amounts.mean()["direct"] == (1.0, 0.5)
