"""How often something happens, lately."""

from __future__ import annotations

import numpy as np


class Rate:
    """Frames a second over the latest 32 of them, falling when they stop coming."""

    def __init__(self) -> None:
        self._times_s = np.zeros(32)
        self._count = 0

    def add(self, time_s: float) -> None:
        """Note one event."""
        self._times_s[self._count % self._times_s.size] = time_s
        self._count += 1

    def at(self, now_s: float) -> float:
        """Events a second; 0 before the second one."""
        size = self._times_s.size
        if self._count < 2:
            return 0.0
        kept = min(self._count, size)
        first_s = float(self._times_s[(self._count - kept) % size])
        last_s = float(self._times_s[(self._count - 1) % size])
        usual_s = (last_s - first_s) / (kept - 1)
        # While the next event is overdue, count the silence as well.
        span_s = max(last_s, now_s - 2 * usual_s) - first_s
        return (kept - 1) / span_s if span_s > 0 else 0.0
