"""Colour mosaics of linear light."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from slopegate.core.exposure.sensor import bayer_rg
from slopegate.core.rig.checks import InputError
from slopegate.core.transport.mosaic import demosaic, filtered

MOSAICS = ("RGGB", "GRBG", "GBRG", "BGGR")


def test_filters_are_those_of_the_bench() -> None:
    light = np.random.default_rng(0).random((6, 8, 3), np.float32)
    assert (filtered(light, "RGGB") == bayer_rg(light)).all()


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_linear_light_is_restored_exactly(mosaic: str) -> None:
    """A ramp of its own for each colour; the border is a mirror image, so only the inside."""
    rows, columns = np.mgrid[:7, :9].astype(np.float32)
    light = np.stack([1 + rows, 20 - columns, 2 + rows + 2 * columns], axis=2)
    found = demosaic(filtered(light, mosaic), mosaic)
    assert np.abs(found - light)[1:-1, 1:-1].max() < 1e-5


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_even_light_is_even_up_to_the_border(mosaic: str) -> None:
    light = np.broadcast_to(np.array([3, 5, 7], np.float32), (4, 5, 3))
    assert (demosaic(filtered(light, mosaic), mosaic) == light).all()


def test_it_is_opencvs_bilinear_way() -> None:
    raw = np.random.default_rng(1).integers(0, 4000, (12, 14)).astype(np.uint16)
    expected = cv2.cvtColor(raw, cv2.COLOR_BayerBG2RGB).astype(np.float32)
    found = demosaic(raw.astype(np.float32), "RGGB")
    assert np.abs(found - expected)[2:-2, 2:-2].max() <= 0.5


@pytest.mark.parametrize("mosaic", ["", "RGB", "rggb", "RGBG"])
def test_what_is_no_mosaic_is_refused(mosaic: str) -> None:
    with pytest.raises(InputError, match="mosaic"):
        demosaic(np.zeros((4, 4), np.float32), mosaic)


def test_a_line_has_no_colours() -> None:
    with pytest.raises(InputError, match="2 x 2"):
        demosaic(np.zeros((1, 4), np.float32), "RGGB")
