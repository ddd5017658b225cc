"""Slices lit one by one: colours, pictures, gains, and the live mixture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport import relight as module
from slopegate.core.transport.mosaic import demosaic, filtered
from slopegate.core.transport.relight import LiveRelight, SliceLight, relight
from slopegate.core.transport.sliced import SliceTransport, one_a_pixel, relit

GRID = BlockGrid(Raster(16, 12), 4, 3)
SHAPE = 6, 9


def some_slices(count: int = 3) -> list[SliceTransport]:
    generator = np.random.default_rng(0)
    made = []
    for _ in range(count):
        block = generator.integers(-1, GRID.count, SHAPE).astype(np.int32)
        value = generator.uniform(0.2, 1, SHAPE).astype(np.float32)
        made.append(SliceTransport(value * np.float32(1.1), (one_a_pixel(GRID, block, value),)))
    return made


def a_picture(*colours: int, seed: int = 1) -> Singles:
    return np.random.default_rng(seed).random((GRID.raster.height, GRID.raster.width, *colours), np.float32)


LIGHTS = [
    SliceLight((1.0, 0.5, 0.0)),
    SliceLight((0.2, 1.0, 0.4), a_picture(), 2.0),
    SliceLight((1.0, 1.0, 0.5), a_picture(3), 0.5),
]


def expected_light(slices: list[SliceTransport], lights: list[SliceLight], mosaic: str) -> Singles:
    """Equation 14, slice by slice."""
    out = np.zeros((*SHAPE, 3), np.float32)
    for transport, light in zip(slices, lights, strict=True):
        picture = np.ones((GRID.raster.height, GRID.raster.width)) if light.picture is None else light.picture
        coloured = picture if picture.ndim == 3 else picture[..., None].repeat(3, axis=2)
        shown = relit(transport, coloured.astype(np.float32))
        out += shown * np.array(light.strength, np.float32)
    return demosaic(filtered(out, mosaic), mosaic) if mosaic else out


@pytest.mark.parametrize("mosaic", ["", "RGGB", "GBRG"])
def test_every_slice_is_lit_in_its_own_way(mosaic: str) -> None:
    slices = some_slices()
    found = relight(slices, LIGHTS, mosaic=mosaic)
    assert np.abs(found - expected_light(slices, LIGHTS, mosaic)).max() < 1e-5


def test_white_light_on_everything_is_the_sum() -> None:
    slices = some_slices()
    found = relight(slices, [SliceLight()] * 3)
    assert np.allclose(found, sum(one.total for one in slices)[..., None], rtol=1e-6)  # type: ignore[index]


def test_weights_scale_slices() -> None:
    slices = some_slices()
    found = relight(slices, LIGHTS, [2.0, 0.0, 0.5])
    scaled = [replace(light, gain=light.gain * weight) for light, weight in zip(LIGHTS, (2, 0, 0.5), strict=True)]
    assert np.allclose(found, relight(slices, scaled))


@pytest.mark.parametrize("mosaic", ["", "GRBG"])
def test_changes_one_by_one_end_where_a_fresh_start_does(mosaic: str) -> None:
    """Pictures in grey and colour come and go in any order, so that planes move."""
    slices = some_slices()
    live = LiveRelight(slices, mosaic=mosaic)
    generator = np.random.default_rng(2)
    pictures = [None, a_picture(seed=3), a_picture(3, seed=4), a_picture(3, seed=5)]
    for _ in range(40):
        index, picture = int(generator.integers(3)), pictures[int(generator.integers(4))]
        live.light(index, SliceLight((1.0, float(generator.random()), 0.3), picture, visible=generator.random() < 0.8))
        assert (live.linear() == relight(slices, live.lights, mosaic=mosaic)).all()


def test_colour_gain_and_visibility_need_no_product(monkeypatch: pytest.MonkeyPatch) -> None:
    live = LiveRelight(some_slices())
    live.light(1, LIGHTS[1])
    products = 0

    def counted(transport: SliceTransport, picture: Singles) -> Singles:
        nonlocal products
        products += 1
        return relit(transport, picture)

    monkeypatch.setattr(module, "relit", counted)
    live.light(1, replace(LIGHTS[1], colour=(0.1, 0.1, 0.1), gain=3.0, visible=False))
    live.weigh([1.0, 2.0, 3.0])
    live.paint(1.0, np.empty((*SHAPE, 3), np.uint8))
    assert products == 0
    live.light(1, replace(LIGHTS[1], picture=a_picture(seed=9)))
    assert products == 1


def curve(light: Singles) -> Singles:
    level = np.clip(light, 0, 1)
    return np.asarray(255 * np.where(level <= 0.0031308, 12.92 * level, 1.055 * level ** (1 / 2.4) - 0.055), np.float32)


@pytest.mark.parametrize("mosaic", ["", "RGGB", "BGGR"])
@pytest.mark.parametrize("white", [1.0, 3.0])
def test_a_painted_picture_follows_the_curve(mosaic: str, white: float) -> None:
    live = LiveRelight(some_slices(), mosaic=mosaic)
    for index, light in enumerate(LIGHTS):
        live.light(index, light)
    out: Bytes = np.empty((*SHAPE, 3), np.uint8)
    live.paint(white, out)
    assert np.abs(out - curve(live.linear() / np.float32(white))).max() < 1
    assert np.ptp(out) > 50


def test_hidden_slices_are_black() -> None:
    live = LiveRelight(some_slices(1))
    live.light(0, SliceLight(visible=False))
    out = np.full((*SHAPE, 3), 9, np.uint8)
    live.paint(1.0, out)
    assert not out.any()


def test_what_does_not_fit_is_refused() -> None:
    slices = some_slices()
    with pytest.raises(InputError, match="lights"):
        relight(slices, LIGHTS[:2])
    with pytest.raises(InputError, match="weights"):
        relight(slices, LIGHTS, [1.0])
    with pytest.raises(InputError, match="slices"):
        LiveRelight([])
    with pytest.raises(InputError, match="colour"):
        SliceLight((1.0, -1.0, 0.0))
    with pytest.raises(InputError, match="white"):
        LiveRelight(slices).paint(0.0, np.empty((*SHAPE, 3), np.uint8))
    with pytest.raises(InputError, match="mosaic"):
        LiveRelight(slices, mosaic="RGB")
