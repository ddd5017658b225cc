"""A stream with every fault at once: nothing grows, and no frame goes by the wrong settings.

SLOPEGATE_SOAK_S=3600 makes it an hour; its figures are printed with -s.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import asdict

import pytest

import soak
from slopegate.drivers.cameras.faults import Faults, FaultyCamera

SOAK_S = float(os.environ.get("SLOPEGATE_SOAK_S", "5"))
FAULTS = Faults(0.05, 0.05, 0.05, 0.05, disconnected=0.01, jitter_us=150.0, late_s=0.03, away_s=0.3)
RATE_HZ = 30.0
GROWTH_MB = 16.0

pytestmark = pytest.mark.timeout(300 + 2 * SOAK_S)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads what the process holds from Linux' /proc")
def test_nothing_grows_and_every_frame_is_what_its_settings_make() -> None:
    rig = soak.small_rig()
    wanted = soak.references(rig, soak.gates(rig, 24))
    camera = FaultyCamera(soak.still_camera(rig, RATE_HZ), FAULTS, seed=15)
    begun_s = time.monotonic()

    def enough(trial: soak.Trial) -> bool:
        return min(asdict(camera.counts).values()) > 0 and min(trial.tapped.right, trial.shown.right) > 0

    trial, stream = soak.soak(camera, wanted, SOAK_S, lambda line: print(line, flush=True), enough=enough)
    counters, faults = stream.counters, camera.counts
    print(f"{time.monotonic() - begun_s:.0f} s, {trial.submitted} settings", asdict(counters), asdict(faults))
    print("every frame:", trial.tapped.right, "right", trial.tapped.wrong, "wrong", trial.tapped.unsettled, "unsettled")
    print("usage, first quarter on:", *trial.usage[len(trial.usage) // 4 :: 5], trial.usage[-1])

    for seen in (trial.tapped, trial.shown):
        assert (seen.wrong, seen.unknown) == (0, 0)
        assert seen.right > 0
    assert trial.tapped.right + trial.tapped.unsettled == counters.made
    # the last frame may have been about to come again, and one that was lost just before the end is not missing yet
    assert 0 <= faults.duplicated - counters.repeated <= 1
    assert 0 <= faults.dropped + faults.disconnected - counters.lost <= 3
    assert min(asdict(faults).values()) > 0
    (_, warm), (_, last) = trial.usage[len(trial.usage) // 4], trial.usage[-1]
    assert last.rss_mb < warm.rss_mb + GROWTH_MB
    assert last.threads <= warm.threads
    assert last.files <= warm.files


def test_the_trial_finds_a_frame_that_goes_by_the_wrong_settings() -> None:
    rig = soak.small_rig()
    wanted = soak.references(rig, soak.gates(rig, 24))
    late = FaultyCamera(soak.still_camera(rig, RATE_HZ), Faults(late=0.5, late_s=0.1), seed=1)
    trial, _ = soak.soak(soak.misattributing(late), wanted, 0.0, enough=lambda trial: trial.tapped.wrong > 0)
    assert trial.tapped.wrong > 0
