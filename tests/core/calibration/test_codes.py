"""Gray code to a place: exact without noise, to a border between neighbours, and in doubt rather than wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slopegate.core.calibration.codes import (
    BEYOND,
    DOUBT,
    FINE_PX,
    IN_DOUBT,
    MOST_LOST,
    SIGMAS,
    CodeOrder,
    decode,
    white_first,
    white_last,
)
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster, even, gray_code


def shown(order: CodeOrder) -> np.ndarray:
    """All patterns of a sequence in its order, 0..1."""
    raster = order.raster
    found = np.zeros((order.count, raster.height, raster.width))
    for first, axis, bits in zip((order.first_column, order.first_row), ("columns", "rows"), order.bits, strict=True):
        for bit in range(bits):
            found[first + 2 * bit] = gray_code(raster, axis, bit) / 255  # type: ignore[arg-type]
            found[first + 2 * bit + 1] = 1 - found[first + 2 * bit]
    found[order.white] = even(raster, 255) / 255
    return found


def places(raster: Raster) -> np.ndarray:
    """The middle of every pixel of the projector, (height, width, 2)."""
    rows, columns = np.mgrid[: raster.height, : raster.width]
    return np.stack([columns, rows], axis=-1) + 0.5


@pytest.mark.parametrize("order_of", [white_first, white_last])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@given(width=st.integers(2, 70), height=st.integers(2, 70))
@settings(max_examples=15)
def test_without_noise_every_pixel_is_exact(order_of, kind, width: int, height: int) -> None:
    order = order_of(Raster(width, height))
    found = decode(order, (10 + 180 * shown(order)).astype(kind))
    assert np.array_equal(found.place, places(order.raster).astype(np.float32))
    assert not found.beyond.any()
    assert np.all(found.direct == 180)


def test_a_pixel_between_two_neighbours_lies_on_their_border() -> None:
    order = white_last(Raster(40, 24))
    frames = shown(order)
    between = (frames[:, :, :-1] + frames[:, :, 1:]) / 2
    found = decode(order, np.rint(10 + 180 * between).astype(np.uint8))
    assert np.array_equal(found.place[..., 0], np.broadcast_to(np.arange(1, 40, dtype=np.float32), (24, 39)))
    assert np.array_equal(found.place[..., 1], places(order.raster)[:, :-1, 1].astype(np.float32))


@pytest.mark.parametrize(("kept", "off"), [(1, 1.0), (2, 2.0)])
def test_stripes_that_are_not_resolved_cost_their_own_width_only(kept: int, off: float) -> None:
    order = white_last(Raster(64, 32))
    frames = shown(order)
    for lost in range(1, kept + 1):
        for first, bits in zip((order.first_column, order.first_row), order.bits, strict=True):
            k = first + 2 * (bits - lost)
            frames[k : k + 2] = 0.5
    found = decode(order, (10 + 180 * frames).astype(np.uint8))
    apart = np.abs(found.place - places(order.raster))
    assert np.isfinite(found.place).all()
    assert apart.max() <= off
    assert np.abs((found.place - places(order.raster)).mean(axis=(0, 1))).max() < 1e-6
    assert found.contrast[0, 5] == pytest.approx(0, abs=0.01)


def test_three_lost_bits_are_too_many() -> None:
    order = white_last(Raster(64, 64))
    frames = shown(order)
    first = order.first_column + 2 * (order.bits[0] - 3)
    frames[first : first + 6] = 0.5
    assert np.isnan(decode(order, (10 + 180 * frames).astype(np.uint8)).place).all()


def test_codes_beyond_the_projector_are_told_from_doubt() -> None:
    """Patterns of 64 columns, read as of 50: what the last 14 columns light is beyond."""
    shown_by, read_as = white_last(Raster(64, 32)), white_last(Raster(50, 32))
    found = decode(read_as, (10 + 180 * shown(shown_by)).astype(np.uint8))
    assert np.array_equal(found.beyond, np.broadcast_to(np.arange(64) >= 50, (32, 64)))
    assert np.array_equal(np.isnan(found.place[..., 0]), found.beyond)


def test_noise_makes_doubt_and_no_errors() -> None:
    order, rng = white_last(Raster(128, 96)), np.random.default_rng(3)
    frames = 20 + 40 * shown(order) + rng.normal(0, 3, (order.count, 96, 128))
    frames[:, :, 100:] = 20 + rng.normal(0, 3, (order.count, 96, 28))
    found = decode(order, np.clip(np.rint(frames), 0, 255).astype(np.uint8))
    lit = np.isfinite(found.place[:, :100, 0])
    assert lit.mean() > 0.9
    apart = np.abs(found.place - places(order.raster))[:, :100][lit].max(axis=-1)
    assert (apart <= 2).mean() > 0.999
    # where there is no light there is no place
    assert np.isfinite(found.place[:, 100:, 0]).mean() < 0.002
    assert np.median(found.noise[:, :100]) == pytest.approx(3 * np.sqrt(2), rel=0.2)


@pytest.mark.parametrize("around", [0.5, 1.0, 2.0])
def test_light_that_comes_round_makes_doubt_and_no_errors(around: float) -> None:
    """Half of the wall lights the other half: every pixel gets the mirrored half's mean light too."""
    order = white_last(Raster(64, 48))
    frames = shown(order)
    bounced = np.empty_like(frames)
    bounced[:, :, :32] = frames[:, :, 32:].mean(axis=(1, 2), keepdims=True)
    bounced[:, :, 32:] = frames[:, :, :32].mean(axis=(1, 2), keepdims=True)
    found = decode(order, np.rint(5 + 60 * frames + 60 * around * bounced).astype(np.uint8))
    known = np.isfinite(found.place[..., 0])
    assert np.abs(found.place - places(order.raster))[known].max(initial=0) <= 0.5
    # direct light alone counts
    assert found.direct[known] == pytest.approx(60, abs=2)
    # mirrored light that is as bright as the own hides the coarsest bit: then only its border is known
    assert known.all() if around < 1 else known.mean() < 0.05


def reference(order: CodeOrder, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rules pixel by pixel, slow and plain: places (H, W, 2) and who is beyond (H, W)."""
    frames = frames.astype(float)
    height, width = frames.shape[1:]
    place, beyond = np.full((height, width, 2), np.nan), np.zeros((height, width), bool)
    sizes = (order.raster.width, order.raster.height)
    for y in range(height):
        for x in range(width):
            values = frames[:, y, x]
            pairs = [
                [values[first + 2 * bit : first + 2 * bit + 2] for bit in range(bits)]
                for first, bits in zip((order.first_column, order.first_row), order.bits, strict=True)
            ]
            fine = np.concatenate(
                [
                    pair
                    for axis in pairs
                    for k, pair in enumerate(axis)
                    if 2 ** (len(axis) - k) <= FINE_PX or len(axis) - k <= 2
                ]
            )
            own, black = fine.max() - fine.min(), values[order.black]
            sums = [values[order.white] + black, *(sum(pair) for axis in pairs for pair in axis)]
            noise = np.std(sums, ddof=1) + 0.3
            if own <= SIGMAS * noise or own < 1:
                continue
            around = 2 * max(fine.min() - black, 0)
            least = max(DOUBT * own, SIGMAS * noise + max(around - own, 0))
            both = [numbered([a - b for a, b in axis], least, size) for axis, size in zip(pairs, sizes, strict=True)]
            if min(both) >= 0:
                place[y, x] = both
            beyond[y, x] = BEYOND in both
    return place, beyond


def numbered(gaps: list[float], least: float, size: int) -> float:
    """One axis: the middle of what the sure bits leave, or a border."""
    lost = 0
    while lost < len(gaps) - 1 and abs(gaps[len(gaps) - 1 - lost]) < least:
        lost += 1
    if lost > MOST_LOST:
        return IN_DOUBT
    gaps, step = gaps[: len(gaps) - lost], 2**lost
    doubtful = [k for k, gap in enumerate(gaps) if abs(gap) < least]
    if len(doubtful) > 1:
        return IN_DOUBT
    bits = [gap > 0 for gap in gaps]
    one = binary(bits)
    if not doubtful:
        return (one * step + min((one + 1) * step, size)) / 2 if one * step < size else BEYOND
    bits[doubtful[0]] = not bits[doubtful[0]]
    other = binary(bits)
    border = max(one, other) * step
    return float(border) if abs(one - other) == 1 and border < size else IN_DOUBT


def binary(gray: list[bool]) -> int:
    """The number that a Gray code stands for."""
    total, bit = 0, False
    for one in gray:
        bit ^= one
        total = 2 * total + bit
    return total


@given(seed=st.integers(0, 2**32 - 1), noise=st.sampled_from([0.0, 2.0, 8.0, 20.0]), width=st.integers(3, 40))
@settings(max_examples=30)
def test_decoding_is_the_slow_reference(seed: int, noise: float, width: int) -> None:
    rng = np.random.default_rng(seed)
    order = white_first(Raster(width, 17)) if seed % 2 else white_last(Raster(width, 17))
    # patterns of a few more columns than are read, softened, with light from elsewhere
    wide = CodeOrder(Raster(2 ** order.bits[0], 17), order.first_column, order.first_row, order.white, order.black)
    light = shown(wide)
    light = (1 - rng.uniform(0, 0.6)) * light + rng.uniform(0, 0.6) * np.roll(light, 1, axis=2)
    light = light + rng.uniform(0, 1) * light.mean(axis=2, keepdims=True)
    frames = np.clip(np.rint(5 + 90 * light + rng.normal(0, noise, light.shape)), 0, 255).astype(np.uint8)
    found, (place, beyond) = decode(order, frames), reference(order, frames)
    np.testing.assert_array_equal(found.place, place.astype(np.float32))
    np.testing.assert_array_equal(found.beyond, beyond)


def test_another_number_of_frames_is_refused() -> None:
    order = white_last(Raster(1024, 768))
    with pytest.raises(InputError, match=r"has 41 frames: a projector of 1024 x 768 pixels needs 42 \(10 pairs"):
        decode(order, np.zeros((41, 4, 4), np.uint8))
