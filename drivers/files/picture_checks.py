"""What every decoder of pictures holds to: how large they may be, what is said of damage, and which way is up."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.errors import SceneError

MAX_PIXELS: Final = 25_000_000
MAX_SCANNED: Final = 1_000_000_000
"""Pixels times scans of a JPEG: 40 scans of the largest picture; writers make about ten."""
JPEG_SCAN: Final = b"\xff\xda"
MAX_DECODED_BYTES: Final = 400_000_000
"""MAX_PIXELS of four channels of 32 bits."""


def check_pixels(source: Path | str, width: int, height: int, refusal: type[UserError] = SceneError) -> None:
    """Raise `refusal` for a picture with more than MAX_PIXELS pixels, or with none."""
    if width < 1 or height < 1:
        raise refusal(f"{source} has {width} x {height} pixels: at least one is needed")
    if width * height > MAX_PIXELS:
        raise refusal(
            f"{source} has {width} x {height} pixels ({width * height / 1e6:.0f} megapixels): at most"
            f" {MAX_PIXELS / 1e6:.0f} megapixels are allowed"
        )


def check_scans(source: Path | str, scans: int, pixels: int) -> None:
    """Raise SceneError for a JPEG in which every pixel is refined so often that decoding it would take minutes."""
    if scans * pixels > MAX_SCANNED:
        raise SceneError(
            f"{source} is a JPEG of {scans} scans over {pixels / 1e6:.3g} megapixels: at most"
            f" {MAX_SCANNED // pixels} scans are allowed for its size"
        )


def check_decoded(source: Path | str, size_bytes: int, limit_bytes: int = MAX_DECODED_BYTES) -> None:
    """Raise SceneError for what would take more than the limit once it is decoded."""
    if size_bytes > limit_bytes:
        raise SceneError(
            f"{source} would take {size_bytes / 1e6:.0f} MB of memory: at most {limit_bytes / 1e6:.0f} MB are"
            " allowed for a picture"
        )


def damaged(source: Path | str) -> SceneError:
    """What to say of bytes that no decoder takes."""
    return SceneError(f"{source} cannot be decoded: it is damaged, cut short, or of a kind that is not known here")


def turned(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Pixels (h, w) or (h, w, channels) turned and mirrored as the orientation of EXIF and TIFF says, 1..8."""
    if orientation in {5, 6, 7, 8}:
        pixels = pixels.swapaxes(0, 1)
    down, across = (-1 if orientation in mirrored else 1 for mirrored in ({3, 4, 7, 8}, {2, 3, 6, 7}))
    return pixels[::down, ::across]
