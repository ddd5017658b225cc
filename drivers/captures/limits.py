"""What a capture may be and which formats it is exported to; imported by the command line, so nothing heavy."""

from __future__ import annotations

from typing import Final, Literal, get_args

MAX_FRAMES: Final = 10_000
"""Frames in one slice: their sum fits in 32 bits for every camera of up to 16."""
MAX_SLICES: Final = 10_000

Format = Literal["ome-tiff", "zarr", "exr", "png", "json"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)
