"""The data of a slice's transport."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slopegate.core.transport.sliced import SliceTransport


def test_a_slice_is_frozen() -> None:
    found = SliceTransport(np.zeros((2, 3), np.float32), ())
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.layers = ()  # type: ignore[misc]
