"""Screen pixels against what they stand for, computed the slow way."""

from __future__ import annotations

import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.app.widgets.colour_maps import COLOUR_MAPS, ColourMap, ramp
from slopegate.app.widgets.paint import (
    MAX_SCALE,
    Resampler,
    Viewport,
    auto_levels,
    demosaic,
    fitted,
    level_table,
    shade_table,
)
from slopegate.drivers.contract.frame import filters

IDENTITY = np.minimum(np.arange(65536), 255).astype(np.uint8)


def grey(screen: np.ndarray) -> np.ndarray:
    assert (screen >> 24 == 255).all()
    assert ((screen & 255) == ((screen >> 8) & 255)).all()
    return screen & 255


def test_one_to_one_shows_every_pixel_unchanged() -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 50)).astype(np.uint16)
    screen = Resampler().draw(image, IDENTITY, Viewport(1.0, 0.0, 0.0), (50, 40))
    np.testing.assert_array_equal(grey(screen), image)


def test_magnified_pixels_are_squares() -> None:
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    screen = Resampler().draw(image, IDENTITY, Viewport(8.0, 0.0, 0.0), (32, 24))
    np.testing.assert_array_equal(grey(screen), np.kron(image, np.ones((8, 8), np.uint16)))


def test_half_size_is_the_mean_of_four_and_agrees_with_opencv() -> None:
    image = np.random.default_rng(1).integers(0, 256, (60, 80)).astype(np.uint16)
    screen = grey(Resampler().draw(image, IDENTITY, fitted((80, 60), (40, 30)), (40, 30)))
    wanted = image.reshape(30, 2, 40, 2).mean(axis=(1, 3))
    assert np.abs(screen - wanted).max() <= 1.0
    fractional = grey(Resampler().draw(image, IDENTITY, fitted((80, 60), (64, 48)), (64, 48)))
    linear = cv2.resize(image.astype(np.float32), (64, 48), interpolation=cv2.INTER_LINEAR)
    assert np.abs(fractional - linear).max() <= 2.0


def test_beyond_the_image_is_transparent() -> None:
    image = np.full((10, 10), 7, np.uint16)
    screen = Resampler().draw(image, IDENTITY, fitted((10, 10), (30, 20)), (30, 20))
    assert (screen[:, :5] == 0).all()
    assert (screen[:, 25:] == 0).all()
    assert (screen[:, 5:25] == 0xFF070707).all()


def test_colour_keeps_its_channels_apart() -> None:
    image = np.zeros((6, 6, 3), np.uint16)
    image[..., 0], image[..., 1], image[..., 2] = 10, 20, 30
    screen = Resampler().draw(image, IDENTITY, Viewport(0.9, 0.0, 0.0), (5, 5))
    assert (screen == 0xFF0A141E).all()


def test_largest_counts_do_not_overflow() -> None:
    image = np.full((8, 8), 65535, np.uint16)
    table = level_table(0, 65535, srgb=False)
    assert (Resampler().draw(image, table, Viewport(0.7, 0.0, 0.0), (5, 5)) == 0xFFFFFFFF).all()


@pytest.mark.parametrize("kind", ["rg", "gr", "gb", "bg"])
def test_demosaic_knows_where_red_is(kind: str) -> None:
    pattern = filters(f"bayer_{kind}12")
    counts = {"R": 3000, "G": 200, "B": 40}
    mosaic = np.zeros((16, 16), np.uint16)
    for place, letter in enumerate(pattern):
        mosaic[place // 2 :: 2, place % 2 :: 2] = counts[letter]
    assert pattern.lower().startswith(kind)
    rgb = np.empty((16, 16, 3), np.uint16)
    before = rgb.ctypes.data
    demosaic(mosaic, rgb, pattern)
    assert rgb.ctypes.data == before
    np.testing.assert_array_equal(rgb[8, 8], [3000, 200, 40])
    np.testing.assert_array_equal(rgb[7, 7], [3000, 200, 40])


@pytest.mark.parametrize("shape", [(1200, 1600), (1200, 1600, 3)])
def test_drawing_allocates_nothing_per_frame(shape: tuple[int, ...]) -> None:
    image, table, view = np.zeros(shape, np.uint16), level_table(0, 4095, srgb=True), fitted((1600, 1200), (800, 600))
    resampler = Resampler()
    first = resampler.draw(image, table, view, (800, 600))
    tracemalloc.start()
    for _ in range(5):
        assert resampler.draw(image, table, view, (800, 600)) is first
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000  # the screen alone is 1 920 000 bytes


def test_levels() -> None:
    table = level_table(100, 1100, srgb=False)
    assert table[0] == table[100] == 0
    assert table[600] == 128
    assert table[1100] == table[65535] == 255
    curve = level_table(0, 1000, srgb=True)
    assert curve[214] == 127  # 21.4 % linear is middle grey on an sRGB screen
    assert (np.diff(curve.astype(int)) >= 0).all()
    assert level_table(500, 500, srgb=False)[501] == 255  # levels that meet divide nothing by zero


def test_auto_levels_enclose_the_counts_and_never_meet() -> None:
    counts = np.random.default_rng(2).normal(1000, 50, (400, 400)).astype(np.uint16)
    low, high = auto_levels(counts, 4095)
    assert 780 < low < 900
    assert 1100 < high < 1250
    low, high = auto_levels(np.full((64, 64), 4095, np.uint16), 4095)
    assert 0 <= low < high


@given(
    scale=st.floats(0.05, 64),
    left=st.floats(-100, 100),
    factor=st.floats(0.1, 10),
    x=st.floats(0, 1000),
    y=st.floats(0, 800),
)
def test_zoom_keeps_the_point_under_the_cursor(scale: float, left: float, factor: float, x: float, y: float) -> None:
    before = Viewport(scale, left, -left)
    after = before.zoomed(factor, x, y, 0.01)
    assert after.to_image(x, y) == pytest.approx(before.to_image(x, y), abs=1e-6)
    assert 0.01 <= after.scale <= MAX_SCALE


@given(scale=st.floats(0.05, 64), left=st.floats(-5000, 5000), top=st.floats(-5000, 5000))
def test_held_never_shows_beyond_an_image_that_covers_the_view(scale: float, left: float, top: float) -> None:
    held = Viewport(scale, left, top).held((1600, 1200), (800, 600))
    for start, length, view in ((held.left, 1600, 800), (held.top, 1200, 600)):
        seen = view / scale
        if seen >= length:
            assert start == pytest.approx((length - seen) / 2)
        else:
            assert -1e-9 <= start <= length - seen + 1e-9


@pytest.mark.parametrize("name", COLOUR_MAPS)
def test_colour_maps_shade_counts_in_even_steps_of_lightness(name: ColourMap) -> None:
    colours = ramp(name)
    rgb = np.stack([colours >> 16 & 255, colours >> 8 & 255, colours & 255], axis=1).astype(np.uint8)
    lightness = cv2.cvtColor(rgb[None].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[0, :, 0]
    steps = np.diff(lightness[:: 255 // 15])
    assert (np.sign(steps) == np.sign(steps.mean())).all()
    assert np.abs(steps).max() < 2.2 * np.abs(steps).mean()
    image = np.arange(12, dtype=np.uint16).reshape(3, 4) * 20
    screen = Resampler().draw(image, shade_table(IDENTITY, colours), Viewport(1.0, 0.0, 0.0), (4, 3))
    np.testing.assert_array_equal(screen, colours[image])


@pytest.mark.parametrize("scale", [0.1, 0.37, 1.0, 5.0])
def test_a_single_pixel_at_an_end_is_marked_at_every_zoom_and_no_other(scale: float) -> None:
    counts = np.full((60, 80), 1000, np.uint16)
    counts[33, 41], counts[10, 20] = 4095, 12
    size = (round(80 * scale), round(60 * scale))
    resampler, view = Resampler(), Viewport(scale, 0.0, 0.0)
    plain = resampler.draw(counts, level_table(0, 4095, srgb=False), view, size).copy()
    resampler.mark(counts, (50, 4095), view, (0xFF0000FF, 0xFFFF0000))
    for tone, (column, row) in ((0xFFFF0000, (41, 33)), (0xFF0000FF, (20, 10))):
        rows, columns = np.nonzero(resampler.screen == tone)
        assert rows.size
        assert (np.abs((rows + 0.5) / scale - row - 0.5) < 0.5 + 0.5 / scale + 1e-9).all()
        assert (np.abs((columns + 0.5) / scale - column - 0.5) < 0.5 + 0.5 / scale + 1e-9).all()
    marked = (resampler.screen == 0xFFFF0000) | (resampler.screen == 0xFF0000FF)
    np.testing.assert_array_equal(resampler.screen[~marked], plain[~marked])


def test_automatic_levels_leave_as_many_pixels_as_they_are_told() -> None:
    counts = np.random.default_rng(5).integers(0, 4096, (1024, 1024)).astype(np.uint16)
    low, high = auto_levels(counts, 4095, 10.0, 25.0)
    assert low == pytest.approx(409, abs=60)
    assert high == pytest.approx(3071, abs=60)
