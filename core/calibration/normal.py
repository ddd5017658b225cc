"""Normal equations whose numbers have units of their own: pixels beside radians, microseconds beside shares."""

from __future__ import annotations

import numpy as np

from slopegate.core.rig.arrays import Doubles


def scaled_inverse(normal: Doubles) -> Doubles:
    """Inverse (N, N) of a symmetric matrix without negative eigenvalues, taken in units that make its diagonal ones.

    A pseudo-inverse: of what nothing tells it has 0.
    """
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    both = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(normal / both, hermitian=True) / both, np.float64)
