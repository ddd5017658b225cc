"""Killed at random moments, an acquisition loses no finished slice and becomes what it would have been, to the byte."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from kill_server import Server
from slopegate.drivers.transports.storage import is_transport, open_transport

KILLS = int(os.environ.get("SLOPEGATE_KILLS", "20"))

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked, which this system cannot")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    made = Server("small_transport.py")
    yield made
    made.close()


def arrays(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.npz"))}


def test_killed_at_random_moments_it_loses_no_slice_and_resumes_to_the_byte(server: Server, tmp_path: Path) -> None:
    begun = time.monotonic()
    server.begin(tmp_path / "whole")
    assert server.until_ended()[-1] == "done"
    longest_s = time.monotonic() - begun
    expected, rng = arrays(tmp_path / "whole"), random.Random(21)
    assert len(expected) == 6
    kills = acquisitions = landed = 0
    while kills < KILLS:
        folder, before = tmp_path / f"acquisition{acquisitions}", 0
        acquisitions += 1
        for _ in range(50):
            child = server.begin(folder)
            time.sleep(rng.uniform(0.0, longest_s))
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            said = server.until_ended()
            kills += 1
            if not is_transport(folder):
                longest_s *= 1.1
                continue
            taken = open_transport(folder).records()
            reported = max([int(line.split()[1]) for line in said if line.startswith("kept ")], default=before)
            assert len(taken) >= max(reported, before), "a finished slice is gone"
            for index in taken:
                name = f"slice_{index:04d}.npz"
                assert (folder / name).read_bytes() == expected[name]
            before = len(taken)
            landed += before < 4
            longest_s *= 0.8 if before == 4 else 1.1  # whatever becomes of the machine's speed
            if before == 4:
                break
        assert arrays(folder) == expected
        assert not list(folder.glob("raw_*"))
    assert landed > KILLS / 4, "most kills came after the end"
    print(f"{kills} kills, {acquisitions} acquisitions, {landed} kills in the middle")
