"""Captures, depth and the search on a camera with every fault: what they keep is what a camera without any gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from search_card import search_card
from slopegate.core.measure.sweep import DepthSweep, SweepSettings
from slopegate.core.search.search import begin
from slopegate.drivers.cameras.faults import Faults, FaultyCamera
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.contract.tap import Tap
from slopegate.drivers.stream.depth_run import frames_behind, frames_of, run_sweep
from slopegate.drivers.stream.search_run import run_search
from slopegate.drivers.stream.stream import Stream
from small_capture import COUNT, RIG, camera, frame_of, lit_slices, new_folder

EVERYTHING = Faults(0.1, 0.1, 0.1, 0.1, disconnected=0.03, jitter_us=150.0, late_s=0.008, away_s=0.15)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_slice_is_right_and_nothing_is_missing(seed: int, tmp_path: Path) -> None:
    source = camera(rate_hz=150.0)
    faulty = FaultyCamera(source, EVERYTHING, seed=seed)
    folder = new_folder(tmp_path / "capture", source, frames=4, dark=True)
    stream = Stream(faulty)
    recorder, detach, until_then = Recorder(stream, folder, source.cover), stream.detach, []

    def note(tap: Tap) -> None:
        until_then.append(faulty.counts)
        detach(tap)

    stream.detach = note  # type: ignore[method-assign]
    recorder.start()
    with stream:
        assert recorder.wait(240)
    progress, counts, alone = recorder.progress, until_then[0], camera()
    assert progress.state == "done", progress.doing
    assert folder.missing() == []
    for index, item in enumerate(lit_slices(alone)):
        np.testing.assert_array_equal(folder.total(index), 4 * frame_of(alone, item).astype(np.uint32))
    np.testing.assert_array_equal(folder.dark_mean(), round(source.info.black_count))
    assert min(counts.missed, counts.dropped, counts.late, counts.duplicated, counts.disconnected) > 0, counts
    # the last frame may come again when nobody looks any more
    assert 0 <= counts.duplicated - progress.tally.duplicated <= 1
    assert progress.frames == 4 * (COUNT + 1)
    assert progress.tally.lost <= counts.dropped + counts.disconnected


def test_depth_is_what_it_is_without_faults() -> None:
    alone = camera()
    settings = SweepSettings(repeats=2)
    alone.start()
    expected = run_sweep(frames_of(alone), DepthSweep(RIG, alone.info.black_count, settings))
    faulty = FaultyCamera(camera(rate_hz=150.0), EVERYTHING, seed=1)
    with Stream(faulty) as stream, frames_behind(stream) as take:
        found = run_sweep(take, DepthSweep(RIG, alone.info.black_count, settings))
    assert expected is not None
    assert found is not None
    np.testing.assert_array_equal(found.projector_row, expected.projector_row)
    assert min(faulty.counts.dropped, faulty.counts.duplicated, faulty.counts.late) > 0


def test_a_repeated_frame_is_averaged_once() -> None:
    """With noise, two frames of one gate differ; what counts twice would not."""
    faulty = FaultyCamera(camera(noise=True, rate_hz=150.0), Faults(duplicated=0.5), seed=1)
    gate = lit_slices(camera())[4]
    with Stream(faulty) as stream, frames_behind(stream) as take:
        taken = [take(gate) for _ in range(20)]
    images = {got[0].tobytes() for got in taken if got is not None}
    assert len(images) == 20
    assert faulty.counts.duplicated > 3


def test_the_search_finds_its_target_all_the_same() -> None:
    card = search_card(20.0, 0.9)
    inner = VirtualCamera(card.rig, card.scene, rate_hz=100.0)
    faulty = FaultyCamera(inner, EVERYTHING, seed=2)
    with Stream(faulty) as stream:
        state = run_search(stream, "mono12", begin(card.rig, card.target, black_count=inner.info.black_count))
    assert state.outcome is not None
    assert state.outcome.settings is not None
    assert card.overlap(state.outcome.settings) > 0.9
