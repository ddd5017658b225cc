"""The weight that splits a halo between its closed form and the bake."""

from __future__ import annotations

import numpy as np

from slopegate.core.light.halo import HALO_RADIUS, halo_share


def test_the_share_falls_from_one_to_nothing_without_a_step() -> None:
    offsets = np.linspace(0.0, 1.5 * HALO_RADIUS, 400)
    shares = np.array([halo_share(offset) for offset in offsets])
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert (np.diff(shares) <= 0).all()
    assert np.abs(np.diff(shares)).max() < 0.02
