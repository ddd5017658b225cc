"""Colour mosaics as linear light: what a filter lets through, and the colours between the filters.

A mosaic is told by the filters of its first two rows and columns, such as RGGB; an empty text stands for none.
"""

from __future__ import annotations

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Ints, Singles
from slopegate.core.rig.checks import require


def filter_table(mosaic: str) -> Ints:
    """Which colour (0 red, 1 green, 2 blue) the filters of the first two rows and columns pass, (2, 2) int32.

    Raises InputError for what is no mosaic of two green filters on a diagonal.
    """
    known = ("RGGB", "GRBG", "GBRG", "BGGR")
    require(mosaic in known, "mosaic", mosaic, f"one of {', '.join(known)}")
    return np.array(["RGB".index(letter) for letter in mosaic], np.int32).reshape(2, 2)


def filtered(light: Singles, mosaic: str) -> Singles:
    """(H, W, 3) -> (H, W) float32: of each pixel the colour that its filter passes."""
    out = np.empty(light.shape[:2], np.float32)
    for row, passed in enumerate(filter_table(mosaic)):
        for column, colour in enumerate(passed):
            out[row::2, column::2] = light[row::2, column::2, colour]
    return out


def demosaic(raw: Singles, mosaic: str) -> Singles:
    """(H, W) -> (H, W, 3) float32: missing colours are the means of the 2 or 4 nearest pixels that have them.

    Exact where the light is linear over 3 x 3 pixels. At the border the image is mirrored. Raises InputError for images
    of less than 2 x 2 pixels.
    """
    height, width = raw.shape
    require(min(height, width) >= 2, "image", f"{width} x {height} pixels", "at least 2 x 2 pixels for a mosaic")
    out = np.empty((height, width, 3), np.float32)
    line, table = np.empty((3, width), np.float32), filter_table(mosaic)
    for row in range(height):
        colour_row(raw, row, table, line)
        out[row] = line.T
    return out


@njit(cache=True, nogil=True)
def colour_row(raw: Singles, row: int, table: Ints, line: Singles) -> None:
    """Set line (3, W) to the colours of one row of a mosaic (H, W)."""
    height, width = raw.shape
    above = row - 1 if row > 0 else 1
    below = row + 1 if row < height - 1 else height - 2
    for column in range(width):
        left = column - 1 if column > 0 else 1
        right = column + 1 if column < width - 1 else width - 2
        own, beside = table[row & 1, column & 1], table[row & 1, (column & 1) ^ 1]
        line[own, column] = raw[row, column]
        across = raw[row, left] + raw[row, right]
        down = raw[above, column] + raw[below, column]
        if own == 1:
            line[beside, column] = across * np.float32(0.5)
            line[2 - beside, column] = down * np.float32(0.5)
        else:
            line[1, column] = (across + down) * np.float32(0.25)
            corners = raw[above, left] + raw[above, right] + raw[below, left] + raw[below, right]
            line[2 - own, column] = corners * np.float32(0.25)
