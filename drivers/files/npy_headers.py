"""What the header of a NumPy array file promises, to be compared with what is there before room is made for it."""

from __future__ import annotations

import math
from typing import IO

import numpy as np


def promised(stream: IO[bytes]) -> tuple[tuple[int, ...], int]:
    """Shape and size in bytes of the array that a .npy file's header tells of; reads up to the header's end.

    Raises ValueError for what is no such file.
    """
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = header(stream)
    return shape, math.prod(shape) * dtype.itemsize
