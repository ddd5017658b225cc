"""The slanted-edge MTF: against published curves, edges whose MTF is known, and regions that hold no edge."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.special import erf

from slopegate.core.exposure.sensor import REC709
from slopegate.core.measure.slanted_edge import slanted_edge_mtf
from slopegate.core.rig.checks import InputError

GAUSSIAN_MTF50 = math.sqrt(math.log(2) / 2) / math.pi
"""Times 1 / sigma: 0.1874."""


def gaussian_edge(
    sigma_px: float, angle_deg: float, shape: tuple[int, int] = (100, 80), away_px: float = 0.0
) -> np.ndarray:
    """A point-sampled edge, dark on the left, turned clockwise, 0.2 to 0.8."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    angle = math.radians(angle_deg)
    across = (x - shape[1] / 2 - away_px) * math.cos(angle) + (y - shape[0] / 2) * math.sin(angle)
    return 0.5 + 0.3 * erf(across / (sigma_px * math.sqrt(2)))


@given(
    sigma_px=st.floats(0.8, 3),
    angle_deg=st.floats(2, 24),
    turns=st.integers(0, 3),
    leans_left=st.booleans(),
    away_px=st.floats(-8, 8),
)
def test_a_gaussian_edge_has_the_mtf_that_theory_says(
    sigma_px: float, angle_deg: float, turns: int, leans_left: bool, away_px: float
) -> None:
    angle_deg = -angle_deg if leans_left else angle_deg
    found = slanted_edge_mtf(np.rot90(gaussian_edge(sigma_px, angle_deg, away_px=away_px), turns))
    assert found.mtf50_cy_per_px == pytest.approx(GAUSSIAN_MTF50 / sigma_px, rel=0.01)
    assert found.edge_angle_deg == pytest.approx(angle_deg, abs=0.05)
    assert found.near == ("horizontal" if turns % 2 else "vertical")
    low = found.frequencies_cy_per_px < 0.5
    theory = np.exp(-2 * (np.pi * sigma_px * found.frequencies_cy_per_px[low]) ** 2)
    np.testing.assert_allclose(found.mtf[low], theory, atol=0.01)


def test_the_widest_tilt_is_still_right() -> None:
    found = slanted_edge_mtf(gaussian_edge(1.5, 29.5, (70, 90)))
    assert found.mtf50_cy_per_px == pytest.approx(GAUSSIAN_MTF50 / 1.5, rel=0.01)


def test_noise_moves_it_little() -> None:
    rng = np.random.default_rng(0)
    edge = gaussian_edge(1.5, 5, (200, 80))
    found = [slanted_edge_mtf(edge + rng.normal(0, 0.02, edge.shape)).mtf50_cy_per_px or math.nan for _ in range(20)]
    assert np.mean(found) == pytest.approx(GAUSSIAN_MTF50 / 1.5, rel=0.01)
    assert np.std(found) < 0.01 * GAUSSIAN_MTF50


def test_an_even_veil_and_any_gain_divide_out() -> None:
    edge = gaussian_edge(1.2, 6)
    clear = slanted_edge_mtf(edge)
    for veiled in (edge + 5.0, 100 * edge, (edge * 3000 + 100).astype(np.float32)):
        found = slanted_edge_mtf(veiled)
        np.testing.assert_allclose(found.mtf, clear.mtf, atol=1e-5)


def test_a_published_measurement_is_met(shared: Callable[[str], Path]) -> None:
    """Burns' own edge with his table, sfrmat3, without an OECF: 0.1980 cycles per pixel."""
    folder = shared("data/mtf")
    pixels = np.asarray(Image.open(folder / "h_edge.tif"), np.float64)
    found = slanted_edge_mtf(pixels @ np.array(REC709))
    assert found.mtf50_cy_per_px == pytest.approx(0.1980, rel=0.01)
    assert found.near == "horizontal"
    with (folder / "h_edge_sfrmat3_published.csv").open() as table:
        rows = np.array([[float(line["cycles_per_pixel"]), float(line["lum"])] for line in csv.DictReader(table)])
    rows = rows[rows[:, 0] < 0.5]
    np.testing.assert_allclose(np.interp(rows[:, 0], found.frequencies_cy_per_px, found.mtf), rows[:, 1], atol=0.01)


def test_a_nearly_ideal_edge_is_as_another_program_finds_it(shared: Callable[[str], Path]) -> None:
    pixels = np.asarray(Image.open(shared("data/mtf") / "slant_uonder.png").convert("RGB"), np.float64)
    found = slanted_edge_mtf(pixels @ np.array(REC709))
    assert found.mtf50_cy_per_px == pytest.approx(0.474556, rel=0.001)
    assert found.edge_angle_deg == pytest.approx(6.0, abs=0.01)


def test_a_curve_that_never_falls_has_no_mtf50() -> None:
    found = slanted_edge_mtf(gaussian_edge(0.05, 5))
    assert found.mtf50_cy_per_px is None
    assert found.mtf[0] == 1


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.full((60, 60), 0.5), "no single straight edge"),
        (np.random.default_rng(0).normal(1, 0.1, (60, 60)), "no single straight edge"),
        (gaussian_edge(1, 5)[:15], "region is '80 x 15 pixels': it must be at least 16 x 16"),
        (gaussian_edge(1, 0.2), "sideways travel of the edge through the region is 0.35: it must be at least 1 pixel"),
        (gaussian_edge(1, 38, (60, 90)), "at most 30 degrees off"),
        (gaussian_edge(1, math.degrees(math.atan(0.5)), (60, 90), 0.1), "crosses pixels at too few different places"),
        (gaussian_edge(1, 5, away_px=38), "region's border is"),
        (np.where(np.isclose(gaussian_edge(1, 5), 0.2), np.nan, 0.5), "region is 'not a number in places'"),
        (np.zeros((40, 40, 3)), "one plane of pixels"),
        (np.hypot(*(np.mgrid[:60, :60] - 40)) < 25, "no single straight edge"),
    ],
)
def test_what_holds_no_edge_is_refused_in_a_sentence(image: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        slanted_edge_mtf(image)
    assert "\n" not in str(refused.value)


def test_a_saturated_edge_is_refused_where_full_scale_is_known() -> None:
    counts = np.minimum(gaussian_edge(1.5, 5) * 6000, 4095).astype(np.uint16)
    with pytest.raises(InputError, match="saturated in 4"):
        slanted_edge_mtf(counts, full_scale=4095)
    assert slanted_edge_mtf(counts).mtf50_cy_per_px is not None
    dim = (gaussian_edge(1.5, 5) * 5000).astype(np.uint16)
    assert slanted_edge_mtf(dim, 4095).mtf50_cy_per_px == slanted_edge_mtf(dim).mtf50_cy_per_px
