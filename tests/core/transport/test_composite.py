"""The foreground over another background."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.composite import composite, covering, surrounding_light


def test_mixed_pixels_are_as_if_the_foreground_had_stood_there() -> None:
    """With the true matte the composite is the picture of the foreground before the new background, exactly."""
    generator = np.random.default_rng(0)
    alpha = generator.random((5, 6), np.float32)
    front, back = generator.random((5, 6, 3), np.float32), generator.random((5, 6, 3), np.float32)
    found = composite(alpha[..., None] * front, alpha, back)
    assert np.allclose(found, alpha[..., None] * front + (1 - alpha[..., None]) * back)
    assert found.dtype == np.float32


def test_sizes_must_agree() -> None:
    light = np.zeros((4, 5, 3), np.float32)
    with pytest.raises(InputError, match="alpha"):
        composite(light, np.zeros((4, 4), np.float32), light)
    with pytest.raises(InputError, match="background"):
        composite(light, np.zeros((4, 5), np.float32), light[:2])


@pytest.mark.parametrize(("rows", "columns"), [(100, 50), (30, 200), (7, 9), (40, 60)])
def test_a_picture_covers_any_size_and_keeps_its_middle(rows: int, columns: int) -> None:
    """A ramp both ways stays one, with the middle in the middle and the same scale both ways."""
    down, across = np.mgrid[:rows, :columns].astype(np.float32) + np.float32(0.5)
    picture = np.stack([down - rows / 2, across - columns / 2, np.ones_like(down)], axis=2)
    found = covering(picture, 60, 40)
    assert found.shape == (40, 60, 3)
    scale = max(60 / columns, 40 / rows)
    inside = found[10:30, 15:45]
    # round sizes move the middle by up to half a pixel
    down, across = np.mgrid[10:30, 15:45].astype(np.float32) + np.float32(0.5)
    assert np.abs(inside[..., 0] * scale - (down - 20)).max() < 1
    assert np.abs(inside[..., 1] * scale - (across - 30)).max() < 1


def test_the_light_of_a_background_has_its_colours_at_their_sides() -> None:
    background = np.zeros((90, 160, 3), np.float32)
    background[:, :80], background[:, 80:] = (0.8, 0.2, 0.0), (0.0, 0.1, 0.4)
    light = surrounding_light(background, Raster(64, 36))
    assert light.shape == (36, 64, 3)
    assert light.dtype == np.float32
    assert light.max() == 1
    assert light[18, 2] == pytest.approx([1.0, 0.25, 0.0], abs=0.02)
    assert light[18, 61] == pytest.approx([0.0, 0.125, 0.5], abs=0.02)


def test_a_black_background_lights_nothing() -> None:
    with pytest.raises(InputError, match="background"):
        surrounding_light(np.zeros((9, 16, 3), np.float32), Raster(16, 9))
