"""Work during which the gate, the source or the program must stay: whoever would change them asks or waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

Needs = Literal["gate", "source", "program"]
"""What must stay: the gate (and so the source), the source (and so the program), or the program alone."""

_REACH: Final[dict[Needs, int]] = {"program": 0, "source": 1, "gate": 2}


class Hold:
    """One kind of work, such as the captures of a panel. It holds from `begin` to `end`."""

    def __init__(self, changed: Callable[[], None], by: str, fate: str, stop: Callable[[], None] | None) -> None:
        """`stop` ends the work early; None where it is so short that nobody is asked and everybody waits."""
        self.by = by
        """The work's name, to end a sentence: "held by the capture"."""
        self.fate = fate
        """What becomes of it when it is stopped, in one sentence."""
        self._stop, self._changed = stop, changed
        self._stopping = False
        self._needs: Needs | None = None

    def begin(self, needs: Needs) -> None:
        """Hold this from now on. Called again, something else instead, as a capture that is paused does."""
        if needs != self._needs:
            self._stopping = self._stopping and self._needs is not None
            self._needs = needs
            self._changed()

    def end(self) -> None:
        """Hold nothing any more; harmless where nothing was held."""
        if self._needs is not None:
            self._needs = None
            self._changed()

    def holds(self, needs: Needs) -> bool:
        """Whether this must stay now."""
        return self._needs is not None and _REACH[self._needs] >= _REACH[needs]

    @property
    def asks(self) -> bool:
        """Whether the user is asked before it is ended: not of work that is over in a moment."""
        return self._stop is not None and not self._stopping

    def stop(self) -> None:
        """End the work early. It ends by itself, a little later."""
        self._stopping = True
        if self._stop is not None:
            self._stop()

    @property
    def sentence(self) -> str:
        """Why something stays as it is."""
        return f"Held by {self.by}: let it end, or end it there."
