"""The one set of names for typed arrays. A docstring gives the shape and the unit; the name gives the number type."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]
"""Light, inverse depths, projector rows: what a frame is computed in."""
Doubles = NDArray[np.float64]
"""Geometry, times and whatever a figure is derived from."""
Counts = NDArray[np.uint16]
"""What a sensor gives, or any other 16-bit picture."""
Bytes = NDArray[np.uint8]
"""8-bit pictures, patterns and marks."""
Words = NDArray[np.uint32]
"""Sums of counts, and pixels of the screen as 0xffRRGGBB."""
Ints = NDArray[np.int32]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]
"""Masks."""
