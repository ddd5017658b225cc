"""How large a capture may be. Imported by the command line, so nothing heavy here."""

from __future__ import annotations

from typing import Final

MAX_FRAMES: Final = 10_000
"""Frames in one slice: their sum fits in 32 bits for every camera of up to 16."""
MAX_SLICES: Final = 10_000
