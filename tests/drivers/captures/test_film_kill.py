"""Killed at random moments, a recording keeps every frame that it said was kept, whole and in order."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import tifffile

from kill_server import Server
from slopegate.drivers.captures.film import is_film, open_film

KILLS = int(os.environ.get("SLOPEGATE_KILLS", "25"))

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked, which this system cannot")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    made = Server("small_film.py")
    yield made
    made.close()


def test_killed_at_random_moments_nothing_that_was_kept_is_lost(server: Server, tmp_path: Path) -> None:
    rng = random.Random(11)
    landed = frames = 0
    longest_s = 0.2
    for kill in range(KILLS):
        path = tmp_path / f"r{kill}"
        child = server.begin(path)
        time.sleep(rng.uniform(0.0, longest_s))
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        said = server.until_ended()
        reported = max([int(line.split()[1]) for line in said if line.startswith("kept ")], default=0)
        longest_s *= 0.95 if reported else 1.2  # whatever becomes of the machine's speed
        if not is_film(path):
            assert not list(path.glob("frames_*")), "the manifest is written first"
            continue
        found = open_film(path)
        assert len(found) >= reported, "a frame that was reported as kept is gone"
        records = [found.record(number) for number in range(len(found))]
        for number, record in enumerate(records):
            assert record.number == number
            assert (found.frame(number) == record.sequence % 4096).all()
        told = found.counted()
        assert told.frames == len(found)
        if records:
            stack = tifffile.imread(found.files[0]).reshape(-1, 60, 80)
            assert (stack[:, 0, 0] == [record.sequence % 4096 for record in records]).all()
        landed += found.end is None and reported > 0
        frames += len(found)
    assert landed > KILLS / 4, "most kills came before the first frame or after the end"
    print(f"{KILLS} kills, {landed} in the middle, {frames} frames")
