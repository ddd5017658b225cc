"""A stream asks a camera that can for the rows that matter, and for all of them while somebody looks at every frame."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigs import plain_rig, shutter
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.frame import Frame, FrameStamp
from slopegate.drivers.stream.stream import Stream

CLOCKS = PixelClocks(10 * 996.66866, (78.0,))
RIG = plain_rig(160, 120, 500 / 3, shutter(CLOCKS))
BALL = Scene("ball", objects=(Sphere("ball", (0.0, 0.0, 1.0), 0.3),), ambient=0.2)


class Witness:
    """Sees every frame."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int] | None] = []

    def wants(self) -> GateSettings | None:
        return None

    def see(self, image: NDArray[np.uint16], stamp: FrameStamp) -> None:
        assert (image != 40).any(axis=1).all()
        self.rows.append(stamp.rows)

    def fail(self, sentence: str) -> None:
        raise AssertionError(sentence)


def wait_for(stream: Stream, good: Callable[[Frame], bool]) -> Frame:
    end_s = time.monotonic() + 100
    while time.monotonic() < end_s:
        frame = stream.newest()
        if frame is not None and good(frame):
            return frame
        time.sleep(0.002)
    raise AssertionError(f"no such frame; {stream.error}")


def test_rows_travel_with_the_gate_and_a_tap_sees_whole_frames() -> None:
    first, second = (gate(CLOCKS.line_time_us(78), delay_us, 800.0) for delay_us in (2300.0, 2500.0))
    with Stream(VirtualCamera(RIG, BALL, rate_hz=200.0)) as stream:
        stream.submit(first, (40, 80))
        frame = wait_for(stream, lambda frame: frame.stamp.rows == (40, 80))
        assert frame.stamp.asked == first
        assert (frame.image[:40] == 40).all()
        witness = Witness()
        stream.attach(witness)
        wait_for(stream, lambda frame: len(witness.rows) > 2)
        assert set(witness.rows) == {None}
        stream.detach(witness)
        assert wait_for(stream, lambda frame: frame.stamp.rows is not None).stamp.rows == (40, 80)
        stream.submit(second)
        assert wait_for(stream, lambda frame: frame.stamp.asked == second and frame.stamp.rows is None).stamp.applied
        assert stream.error is None
