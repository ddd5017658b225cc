"""Recording from a running stream: every frame counts once, the gate comes back, the window stays live."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import waiting
from scripted_camera import USERS, Scripted
from slopegate.core.gating.slices import tile_times
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.captures import recorder as recorder_module
from slopegate.drivers.captures.recorder import COVER, UNCOVER, Recorder
from slopegate.drivers.captures.storage import LOCK, CaptureFolder, create_capture, open_capture
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.stream.stream import Stream
from small_capture import COUNT, RIG, SENSOR, camera, frame_of, lit_slices, new_folder, record

until = partial(waiting.until, seconds=60.0)

SLICES = tile_times(RIG, 250.0, 1000.0, 3000.0, 4)


@contextmanager
def recording(
    path: Path,
    source: Scripted,
    frames: int = 1,
    dark: bool = False,
    skip_empty: bool = False,
    hold: Callable[[Recorder], bool] = lambda _: False,
) -> Iterator[tuple[Recorder, Stream, CaptureFolder]]:
    """A scripted camera being recorded; the user's gate was submitted before. It waits while `hold` until `go_on`."""
    folder = new_folder(path, source, SLICES, frames, dark, skip_empty)  # type: ignore[arg-type]
    stream = Stream(source)
    stream.submit(USERS)
    recorder = Recorder(stream, folder)
    source.hold = lambda: hold(recorder)
    recorder.start()
    with stream:
        yield recorder, stream, folder
        recorder.cancel()
        assert recorder.wait(60)


def go_on(source: Scripted) -> None:
    source.hold = lambda: False


def kept(count: int) -> Callable[[Recorder], bool]:
    """Whether so many slices are kept; of the next one, no more than a frame has come by then."""
    return lambda recorder: recorder.progress.kept >= count


def used(frames: int) -> Callable[[Recorder], bool]:
    """Whether more than so many frames were used."""
    return lambda recorder: recorder.progress.frames > frames


def test_every_slice_holds_the_frames_of_its_own_gate(tmp_path: Path) -> None:
    folder, recorder = record(tmp_path / "c", frames=3)
    source = camera()
    assert recorder.progress.state == "done"
    assert recorder.progress.doing == f"All {COUNT} slices are in {folder.path}"
    for index, item in enumerate(lit_slices(source)):
        total = folder.total(index)
        assert total.dtype == np.uint16
        np.testing.assert_array_equal(total, 3 * frame_of(source, item).astype(np.uint32))
    record_of = folder.records()[2]
    assert record_of.asked == record_of.applied
    assert record_of.frames == 3
    assert record_of.last_sequence == record_of.first_sequence + 2
    assert record_of.discarded >= 1
    assert record_of.saturated_share == 0
    assert record_of.slab.distance_m is not None
    assert record_of.started <= record_of.ended


def test_slices_that_tile_add_up_to_the_floodlit_capture_exactly(tmp_path: Path) -> None:
    folder, _ = record(tmp_path / "c")
    source = camera()
    flood = frame_of(source, gate(lit_slices(source)[0].line_time_us, 0.0, 16667.0)).astype(np.int64)
    black = int(SENSOR.black_count)
    total = sum(folder.total(index).astype(np.int64) - black for index in range(COUNT))
    np.testing.assert_array_equal(total, flood - black)
    assert (flood > 200).mean() > 0.5


def test_with_noise_they_do_within_what_the_sensor_model_predicts(tmp_path: Path) -> None:
    frames = 8
    folder, _ = record(tmp_path / "c", noise=True, frames=frames)
    exact = camera()
    assert exact.buffers is not None
    flood = gate(lit_slices(exact)[0].line_time_us, 0.0, 16667.0)
    noisy = camera(noise=True, seed=99)
    lit = frame_of(exact, flood).astype(np.float64) - SENSOR.black_count
    noisy.start()
    noisy.configure(flood)
    image, floodlit = np.zeros((60, 80), np.uint16), np.zeros((60, 80))
    for _ in range(frames):
        assert noisy.read(image, 1.0) is not None
        floodlit += image
    total = sum(folder.total(index).astype(np.float64) for index in range(COUNT))
    # each frame: shot noise of the light, read noise, rounding; both sides have the same light
    one_frame = (SENSOR.read_noise_e / SENSOR.electrons_per_count) ** 2 + 1 / 12
    variance = frames * (2 * lit / SENSOR.electrons_per_count + (COUNT + 1) * one_frame)
    difference = total - floodlit - frames * (COUNT - 1) * SENSOR.black_count
    z = difference / np.sqrt(variance)
    # 4800 pixels: standard errors of 0.0144 for the mean and 0.0102 for the deviation
    assert abs(z.mean()) < 4 * 0.0144
    assert abs(z.std() - 1) < 4 * 0.0102
    assert np.abs(z).max() < 5.5


def test_lost_and_doubled_frames_are_counted_and_retaken(tmp_path: Path) -> None:
    source = Scripted()
    source.jumps = {6: 3, 14: -1, 20: 1, 30: -2}
    with recording(tmp_path / "c", source, frames=10) as (recorder, _, folder):
        assert recorder.wait(60)
        assert recorder.progress.state == "done"
        tally = recorder.progress.tally
    assert tally.lost == 4
    assert tally.duplicated == 3
    records = folder.records()
    assert sum(item.lost for item in records.values()) == 4
    for index, item in records.items():
        used = set(range(item.first_sequence, item.last_sequence + 1))
        missing = {6, 7, 8, 20}
        counted = sorted(used - missing)
        assert len(counted) == 10, "ten different frames"
        assert (folder.total(index) == sum(counted)).all()


def test_a_camera_without_the_flagged_frame_is_not_trusted(tmp_path: Path) -> None:
    """Every first frame after a change is lost, and with it the mark that it has not settled."""
    source = Scripted()
    configure = source.configure

    def losing(settings: GateSettings) -> GateSettings:
        changed = settings != source.asked
        applied = configure(settings)
        if changed:
            source.settled = True
            source.jumps[source.sequence] = 1
        return applied

    source.configure = losing  # type: ignore[method-assign]
    with recording(tmp_path / "c", source) as (recorder, _, folder):
        assert recorder.wait(60)
    for item in list(folder.records().values())[1:]:
        assert item.lost == 1
        assert item.discarded >= 1


def test_the_users_gate_waits_and_comes_back(tmp_path: Path) -> None:
    source = Scripted()
    with recording(tmp_path / "c", source, frames=5, hold=used(3)) as (recorder, stream, _):
        until(lambda: used(3)(recorder))
        moved = gate(200.0, 4321.0, 5000.0)
        stream.submit(moved)
        go_on(source)
        assert recorder.wait(60)
        until(lambda: source.told[-1] == moved)
    during = source.told[: source.told.index(moved)]
    assert [item for item in during if item != USERS] == list(SLICES)


def test_pause_gives_the_gate_back_and_resume_begins_the_slice_anew(tmp_path: Path) -> None:
    source = Scripted()
    with recording(tmp_path / "c", source, frames=20, hold=used(25)) as (recorder, stream, folder):
        until(lambda: used(25)(recorder))
        recorder.pause()
        go_on(source)
        until(lambda: source.told[-1] == USERS)
        assert recorder.progress.state == "paused"
        before, made = recorder.progress, stream.counters.made
        until(lambda: stream.counters.made > made + 10)
        assert (recorder.progress.kept, recorder.progress.frames) == (before.kept, before.frames)
        recorder.resume()
        assert recorder.wait(60)
        assert recorder.progress.state == "done"
    for item in folder.records().values():
        assert item.last_sequence - item.first_sequence == 19


def test_cancel_keeps_what_there_is_and_another_recorder_goes_on(tmp_path: Path) -> None:
    source = Scripted()
    with recording(tmp_path / "c", source, frames=10, hold=kept(2)) as (recorder, _, folder):
        until(lambda: recorder.progress.kept == 2)
        recorder.cancel()
        assert recorder.wait(60)
        until(lambda: source.told[-1] == USERS)
        assert recorder.progress.state == "cancelled"
        assert recorder.progress.doing == "The capture was cancelled; 2 of 4 slices are kept"
    assert folder.missing() == [2, 3]
    before = folder.total(0).copy()
    again = Scripted()
    stream = Stream(again)
    rest = Recorder(stream, open_capture(folder.path))
    rest.start()
    with stream:
        assert rest.wait(60)
    assert rest.progress.state == "done"
    assert [item for item in again.told if item != USERS] == list(SLICES[2:])
    assert folder.missing() == []
    assert (folder.total(0) == before).all()


def test_the_window_sees_frames_all_along(tmp_path: Path) -> None:
    source = Scripted()
    seen = [-1]
    unseen = lambda _: source.sequence > seen[-1] + 2  # noqa: E731
    with recording(tmp_path / "c", source, frames=30, hold=unseen) as (recorder, stream, _):
        while not recorder.wait(0.0):
            if (frame := stream.newest()) is not None:
                seen.append(frame.stamp.sequence)
    assert len(seen) > 60, "the camera waited for the window, which saw every other frame at least"


def test_one_recorder_at_a_time(tmp_path: Path) -> None:
    with recording(tmp_path / "c", Scripted(), frames=1000, hold=used(10)) as (recorder, stream, folder):
        with pytest.raises(StorageError, match="another process is recording into"):
            Recorder(stream, folder).start()
        other = create_capture(tmp_path / "other", folder.manifest)
        for _ in range(2):
            with pytest.raises(ValueError, match="something else sets the gate"):
                Recorder(stream, other).start()
        recorder.cancel()
        assert recorder.wait(60)
        again = Recorder(stream, folder)
        again.start()
        again.cancel()
        assert again.wait(60)


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("refuses", "delay_us is 7: it must be anything else"),
        ("broken", "The cable is loose"),
        ("stuck", "The camera made 200 frames and none of them with the gate asked for"),
    ],
)
def test_a_camera_that_fails_stops_the_capture(
    tmp_path: Path, fault: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("slopegate.drivers.stream.stream.RETRY_S", (0.001,) * 3)
    source = Scripted()
    with recording(tmp_path / "c", source, frames=100, hold=kept(1)) as (recorder, stream, _):
        until(lambda: recorder.progress.kept == 1)
        setattr(source, fault, True)
        if fault == "stuck":
            source.asked = USERS
        go_on(source)
        assert recorder.wait(60)
        assert recorder.progress.state == "failed"
        assert recorder.progress.doing == f"{sentence}; {recorder.progress.kept} of 4 slices are kept"
        assert recorder.progress.kept in (1, 2)
        if fault != "broken":
            assert stream.running


def test_stopping_the_stream_stops_the_capture(tmp_path: Path) -> None:
    with recording(tmp_path / "c", Scripted(), frames=1000, hold=used(10)) as (recorder, stream, _):
        until(lambda: used(10)(recorder))
        stream.stop()
        assert recorder.wait(60)
        assert recorder.progress.doing == "scripted was stopped; 0 of 4 slices are kept"


def test_a_slow_disk_costs_frames_and_no_slice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, source = CaptureFolder.write, Scripted()

    def slow(folder: CaptureFolder, *arguments: object) -> None:
        begun = source.sequence
        until(lambda: source.sequence > begun + 30)
        write(folder, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(CaptureFolder, "write", slow)
    with recording(tmp_path / "c", source, frames=3) as (recorder, stream, folder):
        assert recorder.wait(60)
        assert recorder.progress.state == "done"
        assert stream.counters.made > 100
        assert recorder.progress.frames == 12
    spans = [(item.first_sequence, item.last_sequence) for item in folder.records().values()]
    assert all(last - first == 2 for first, last in spans)


def test_dark_frames_with_a_cap(tmp_path: Path) -> None:
    assert camera().info.can.cover
    folder, _ = record(tmp_path / "c", noise=True, frames=4, dark=True)
    dark = folder.dark_record()
    assert dark is not None
    assert dark.index is None
    assert dark.frames == 4
    assert abs(folder.dark_mean().mean() - SENSOR.black_count) < 0.3
    assert folder.dark_mean().std() < 3
    assert dark.noise_counts == pytest.approx(SENSOR.read_noise_e / SENSOR.electrons_per_count, rel=0.05)
    assert folder.total(0).max() > 4 * 500


def test_without_a_cap_the_user_covers_the_lens(tmp_path: Path) -> None:
    source = Scripted()
    with recording(tmp_path / "c", source, dark=True) as (recorder, _, folder):
        until(lambda: recorder.progress.state == "waiting")
        assert recorder.progress.doing == COVER
        until(lambda: source.told and source.told[-1] == USERS)
        recorder.resume()
        until(lambda: recorder.progress.state == "waiting")
        assert recorder.progress.doing == UNCOVER
        until(folder.dark_record)
        recorder.resume()
        assert recorder.wait(60)
        assert recorder.progress.state == "done"
    dark = folder.dark_record()
    assert dark is not None
    assert dark.discarded >= recorder_module.DOUBTFUL_AFTER_PROMPT


def test_a_pause_uncovers_the_lens_and_resume_covers_it_again(tmp_path: Path) -> None:
    source = camera()
    folder = new_folder(tmp_path / "c", source, frames=40, dark=True)
    stream, states, paused, read = Stream(source), [], threading.Event(), source.read

    def cap(covered: bool) -> None:
        states.append(covered)
        source.cover(covered)

    def held(buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        if used(5)(recorder) and not paused.wait(timeout_s):
            return None
        return read(buffer, timeout_s)

    source.read = held  # type: ignore[method-assign]
    recorder = Recorder(stream, folder, cap)
    recorder.start()
    with stream:
        until(lambda: used(5)(recorder))
        recorder.pause()
        paused.set()
        assert states == [True, False]
        recorder.resume()
        until(lambda: folder.dark_record() is not None)
        recorder.cancel()
        assert recorder.wait(60)
    assert states[:4] == [True, False, True, False]
    assert states[-1] is False
    assert folder.dark_mean().max() == SENSOR.black_count


def test_slices_without_light_are_found_from_few_frames(tmp_path: Path) -> None:
    source = camera()
    lit = lit_slices(source)
    wide = tile_times(RIG, lit[0].line_time_us, -6000.0, 8000.0, 70)
    folder = new_folder(tmp_path / "c", source, wide, frames=5, skip_empty=True)
    stream = Stream(source)
    recorder = Recorder(stream, folder, source.cover)
    recorder.start()
    with stream:
        assert recorder.wait(60)
    assert recorder.progress.state == "done"
    records = folder.records()
    assert len(records) == 70
    bright = {index for index, item in enumerate(wide) if (frame_of(source, item) > SENSOR.black_count).any()}
    assert {index for index, item in records.items() if not item.empty} == bright
    assert 2 < len(bright) < 30
    assert recorder.progress.frames < 5 * len(bright) + 70
    assert (folder.mean(min(set(records) - bright)) == SENSOR.black_count).all()


def test_nothing_lit_costs_hardly_a_frame(tmp_path: Path) -> None:
    source = camera(noise=True)
    far = tile_times(RIG, lit_slices(source)[0].line_time_us, -6000.0, -2000.0, 30)
    folder = new_folder(tmp_path / "c", source, far, skip_empty=True)
    stream = Stream(source)
    recorder = Recorder(stream, folder, source.cover)
    recorder.start()
    with stream:
        assert recorder.wait(60)
    assert all(item.empty for item in folder.records().values())
    assert recorder.progress.frames == 2 + 1


def test_a_vanished_folder_stops_the_capture_with_a_sentence(tmp_path: Path) -> None:
    source = Scripted()
    with recording(tmp_path / "c", source, frames=20, hold=kept(1)) as (recorder, _, folder):
        until(lambda: recorder.progress.kept == 1)
        folder.path.rename(tmp_path / "elsewhere")
        go_on(source)
        assert recorder.wait(60)
        progress = recorder.progress
        until(lambda: source.told[-1] == USERS)
    assert progress.state == "failed"
    assert f"cannot be written: the folder {folder.path} has vanished; " in progress.doing
    assert not folder.path.exists()


def test_a_full_disk_stops_the_capture_and_keeps_what_there_is(tmp_path: Path) -> None:
    """A disk of 64 kB: room for the manifest and some of the 10 kB slices."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only the administrator can make a small disk")
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(disk)], check=False)
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    try:
        with recording(disk / "c", Scripted(), frames=5) as (recorder, _, folder):
            assert recorder.wait(60)
        progress = recorder.progress
        assert progress.state == "failed"
        assert f"the disk of {folder.path} is full; {progress.kept} of 4 slices are kept" in progress.doing
        assert progress.kept >= 1
        found = open_capture(folder.path)
        assert len(found.records()) == progress.kept
        assert {path.name for path in folder.path.glob(".*")} <= {LOCK}
        for index in found.records():
            assert found.total(index).any()
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_file_that_may_not_grow_stops_the_capture(tmp_path: Path) -> None:
    """The limit on file sizes stands in for a full disk where none can be mounted."""
    script = (
        "import resource, sys\n"
        "sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "from small_capture import *\n"
        "source = camera()\n"
        "folder = new_folder(Path(sys.argv[2]), source)\n"
        "stream = Stream(source)\n"
        "recorder = Recorder(stream, folder, source.cover)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))\n"
        "recorder.start()\n"
        "with stream:\n"
        "    assert recorder.wait(240)\n"
        "print(recorder.progress.state, recorder.progress.doing)\n"
    )
    where = str(Path(__file__).resolve().parents[2] / "support")
    command = [sys.executable, "-c", script, where, str(tmp_path / "c")]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.startswith("failed slice_0000.tif cannot be written: the disk of ")
    assert result.stdout.strip().endswith(f"is full; 0 of {COUNT} slices are kept")
    assert {path.name for path in (tmp_path / "c").iterdir()} - {LOCK} == {"capture.json"}


def test_a_folder_that_forbids_writing_stops_the_capture() -> None:
    if not hasattr(os, "geteuid"):
        pytest.skip("this system has no such permissions")
    root = os.geteuid() == 0
    home = Path(tempfile.mkdtemp(prefix="slopegate-forbidden-"))
    try:
        home.chmod(0o777)
        if root:
            os.seteuid(65534)
        try:
            version("slopegate")
        except PackageNotFoundError:
            pytest.skip("another user may not read this checkout")
        source = Scripted()
        with recording(home / "c", source, frames=20, hold=kept(1)) as (recorder, _, folder):
            until(lambda: recorder.progress.kept == 1)
            folder.path.chmod(0o500)
            go_on(source)
            assert recorder.wait(60)
            progress = recorder.progress
            folder.path.chmod(0o700)
        assert progress.state == "failed"
        assert f"the folder {folder.path} does not allow it; 1 of 4 slices are kept" in progress.doing
        assert len(open_capture(folder.path).records()) == 1
    finally:
        if root:
            os.seteuid(0)
        shutil.rmtree(home)
