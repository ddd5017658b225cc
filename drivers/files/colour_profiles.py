"""What the numbers of a picture mean where it says so itself: by an ICC profile, or by the gamma in a PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Singles
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.reading import decoding

SRGB_GAMMA: Final = 0.45455
"""What writers of sRGB put into a PNG: sRGB's own curve is meant, which is near it."""
_NEAR: Final = 0.005
_POSSIBLE: Final = (0.05, 20.0)
_ALIKE: Final = 2 * 257
"""Of 65535: no more than the rounding of a profile of sRGB."""
_SPACES: Final = {b"RGB ": "rgb", b"GRAY": "gray"}


def as_srgb(source: Path | str, pixels: NDArray[Any], profile: bytes) -> NDArray[Any]:
    """Pixels (h, w) or (h, w, 3) of 8 or 16 bits as sRGB (h, w, 3) of 16; as they were where the profile says sRGB.

    Colours that sRGB does not have become the nearest that it has. Raises SceneError for a profile that is damaged, or
    of other colours than these.
    """
    space = _SPACES.get(profile[16:20])
    if space is None:
        raise _unusable(source)
    if space == "rgb" and pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if space == "gray" and pixels.ndim == 3:
        raise _unusable(source)
    with decoding(_unusable(source)):
        probe = np.arange(256, dtype=np.uint8)[None]
        if space == "rgb":
            steps = np.arange(0, 256, 51, dtype=np.uint8)
            probe = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
        meant = probe if space == "rgb" else np.repeat(probe[:, :, None], 3, axis=2)
        if np.abs(_transformed(probe, profile, space) - 257.0 * meant).max() <= _ALIKE:
            return pixels
        return _transformed(np.ascontiguousarray(pixels), profile, space)


def linear_by_gamma(pixels: NDArray[Any], gamma: float) -> Singles | None:
    """Linear light 0..1 (float32) of a PNG's numbers by its gamma; None where it is sRGB's or not told."""
    if not _POSSIBLE[0] <= gamma <= _POSSIBLE[1] or abs(gamma - SRGB_GAMMA) < _NEAR:
        return None
    full = np.iinfo(pixels.dtype).max
    table = ((np.arange(full + 1) / full) ** (1 / gamma)).astype(np.float32)
    return np.asarray(table[pixels], np.float32)


def _transformed(pixels: NDArray[Any], profile: bytes, space: str) -> NDArray[Any]:
    import imagecodecs

    srgb, fine = imagecodecs.cms_profile("srgb"), imagecodecs.CMS.FLAGS.HIGHRESPRECALC  # of 16 bits it makes a table
    return np.asarray(
        imagecodecs.cms_transform(
            pixels, profile, srgb, colorspace=space, outcolorspace="rgb", outdtype="uint16", flags=fine
        )
    )


def _unusable(source: Path | str) -> SceneError:
    return SceneError(
        f"{source} has a colour profile that cannot be applied: it must be of RGB or grey and undamaged, or be left out"
    )
