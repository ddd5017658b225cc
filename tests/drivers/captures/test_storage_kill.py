"""Killed at random moments, a capture loses the slice in flight and no other, and goes on where it stopped."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from kill_server import Server
from slopegate.drivers.captures.storage import is_capture, open_capture
from small_capture import COUNT, camera, frame_of, lit_slices

KILLS = int(os.environ.get("SLOPEGATE_KILLS", "40"))

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked, which this system cannot")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    made = Server("small_capture.py")
    yield made
    made.close()


def test_killed_at_random_moments_it_loses_one_slice_at_most_and_resumes(server: Server, tmp_path: Path) -> None:
    source = camera()
    expected = [3 * frame_of(source, item) for item in lit_slices(source)]
    rng = random.Random(20)
    begun = time.monotonic()
    server.begin(tmp_path / "whole")
    assert server.until_ended()[-1] == "done"
    longest_s = time.monotonic() - begun
    kills = captures = landed = 0
    while kills < KILLS:
        folder = tmp_path / f"capture{captures}"
        captures += 1
        taken_before = 0
        for _ in range(200):
            child = server.begin(folder)
            time.sleep(rng.uniform(0.0, longest_s))
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            said = server.until_ended()
            kills += 1
            reported = max([int(line.split()[1]) for line in said if line.startswith("kept ")], default=taken_before)
            if not is_capture(folder):
                longest_s *= 1.1
                assert not list(folder.glob("slice_*")), "the manifest is written first"
                continue
            found = open_capture(folder)
            taken = found.records()
            assert len(taken) >= reported, "a slice that was reported as kept is gone"
            assert len(taken) >= taken_before
            for index in taken:
                np.testing.assert_array_equal(found.total(index), expected[index])
            landed += len(taken) < COUNT
            longest_s *= 0.8 if len(taken) == COUNT else 1.1  # whatever becomes of the machine's speed
            taken_before = len(taken)
            if len(taken) == COUNT:
                break
        assert open_capture(folder).missing() == []
        assert not [name for name in folder.iterdir() if name.suffix == ".tif" and name.name.startswith(".")]
    assert landed > KILLS / 4, "most kills came after the end"
    print(f"{kills} kills, {captures} captures, {landed} kills in the middle")
