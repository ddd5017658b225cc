"""What looks at every frame of a stream, as a recorder and a search do."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp


class Tap(Protocol):
    """Somebody who sees every frame, as a recorder does. All of it is called in the stream's thread and must be brief.

    What takes long, writing above all, belongs in a thread of the tap's own: a frame that it cannot take in time is its
    own to let go, never the stream's to wait for.
    """

    def wants(self) -> GateSettings | None:
        """The gate for the next frame, in place of what was submitted; None leaves that to others."""
        ...

    def see(self, image: NDArray[np.uint16], stamp: FrameStamp) -> None:
        """A frame, before it is shown; its pixels are valid during the call only."""
        ...

    def fail(self, sentence: str) -> None:
        """The gate wanted was refused, or the stream has ended."""
        ...
