"""Recording at one gate from a running stream: every frame is kept or counted, memory is bounded, it opens again."""

from __future__ import annotations

import json
import math
import shutil
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

import waiting
from scripted_camera import USERS, Scripted
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures import film_preview, film_recorder, tiff_stack
from slopegate.drivers.captures.film import (
    FilmFolder,
    FilmWriter,
    check_new_film,
    create_film,
    is_film,
    make_film_manifest,
    open_film,
)
from slopegate.drivers.captures.film_camera import FilmCamera
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmRecorder, Pace
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.stream.stream import Stream
from small_capture import RIG, camera, frame_of, lit_slices

until = partial(waiting.until, seconds=60.0)
LIMITLESS = FilmLimits()


def new_film(path: Path, source: Any, wanted: GateSettings | None = USERS, every_s: float | None = None) -> FilmFolder:
    return create_film(path, make_film_manifest("A scene", RIG, source.info, wanted, every_s))


def brightest(source: VirtualCamera) -> GateSettings:
    """The slice that shows most."""
    return max(lit_slices(source), key=lambda item: int(frame_of(source, item).sum()))


def filmed(path: Path, source: Any, limits: FilmLimits, during: Callable[[FilmRecorder], object] | None = None) -> Any:
    """A whole recording of a scripted camera; the folder as it is opened again, and how it ended."""
    stream = Stream(source)
    recorder = FilmRecorder(stream, new_film(path, source, every_s=limits.every_s), limits)
    recorder.start()
    with stream:
        if during is not None:
            during(recorder)
            recorder.stop()
        assert recorder.wait(60)
    return open_film(path), recorder.progress


def test_every_frame_is_kept_with_its_number_time_and_gate(tmp_path: Path) -> None:
    folder, ended = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=50))
    assert (ended.state, ended.frames, ended.lost, len(folder)) == ("done", 50, 0, 50)
    records = [folder.record(number) for number in range(50)]
    assert [record.number for record in records] == list(range(50))
    first = records[0].sequence
    for number, record in enumerate(records):
        assert record.sequence == first + number
        assert (folder.frame(number) == record.sequence % 4096).all()
        assert record.asked is not None
        assert record.asked.settings() == USERS
        assert record.applied == record.asked
    assert sorted(records, key=lambda record: record.time_s) == records
    assert folder.end is not None
    assert folder.end.frames == 50
    assert folder.end.bytes == sum(path.stat().st_size for path in folder.files) == ended.bytes
    assert folder.counted() == folder.end


def test_a_frame_is_that_of_the_camera_bit_for_bit(tmp_path: Path) -> None:
    source = camera()
    wanted = brightest(source)
    expected = frame_of(source, wanted)
    stream = Stream(source)
    recorder = FilmRecorder(stream, new_film(tmp_path / "r", source, wanted), FilmLimits(frames=3))
    recorder.start()
    with stream:
        assert recorder.wait(60)
    stack = tifffile.imread(tmp_path / "r" / "frames_0000.tif")
    np.testing.assert_array_equal(stack, np.stack([expected] * 3))
    with tifffile.TiffFile(tmp_path / "r" / "frames_0000.tif") as tiff:
        told = json.loads(str(tiff.pages.first.description))
    assert told["recording"]["scene"] == "A scene"
    assert "[camera]" in told["recording"]["rig_toml"]


def test_frames_that_the_camera_lost_are_counted_where_they_are_missing(tmp_path: Path) -> None:
    source = Scripted()
    source.jumps = {20: 3, 30: -1}
    folder, ended = filmed(tmp_path / "r", source, FilmLimits(frames=40))
    assert (ended.frames, ended.lost_by_camera, ended.lost_by_disk) == (40, 3, 0)
    noted = {record.sequence: record.lost_by_camera for record in map(folder.record, range(40))}
    gaps = {b: b - a - 1 for a, b in zip(sorted(noted), sorted(noted)[1:], strict=False) if b - a > 1}
    assert gaps == {sequence: lost for sequence, lost in noted.items() if lost}
    assert folder.end is not None
    assert folder.end.repeated >= 1


def test_a_slow_disk_loses_frames_and_tells_of_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The buffers fill, frames are left out and counted, and what is kept is whole."""
    monkeypatch.setattr(film_recorder, "BUFFER_BYTES", 6 * 80 * 60 * 2)
    gone_on = threading.Event()
    add = FilmWriter.add

    def slowly(writer: FilmWriter, image: Any, record: Any) -> None:
        if record.number == 2:
            gone_on.wait(60)
        add(writer, image, record)

    monkeypatch.setattr(FilmWriter, "add", slowly)

    def during(recorder: FilmRecorder) -> None:
        until(lambda: recorder.progress.lost_by_disk >= 10)
        assert recorder.writing
        gone_on.set()
        kept = recorder.progress.frames
        until(lambda: recorder.progress.frames > kept + 10)

    folder, ended = filmed(tmp_path / "r", Scripted(), LIMITLESS, during)
    assert ended.state == "stopped"
    records = list(map(folder.record, range(len(folder))))
    lost = [record.lost_by_disk for record in records]
    gap = next(number for number, some in enumerate(lost) if some >= 10)
    assert gap >= 8, "two are written and six wait"
    assert sum(lost) <= ended.lost_by_disk
    assert records[gap].sequence - records[gap - 1].sequence == 1 + lost[gap] + records[gap].lost_by_camera
    for number, record in enumerate(records):
        assert (folder.frame(number) == record.sequence % 4096).all()


def test_it_leaves_room_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    free = iter([2e9, 2e9])

    def shrinking(_: object) -> Any:
        return usage._replace(total=int(1e12), free=int(next(free, 0.9e9)))

    monkeypatch.setattr(shutil, "disk_usage", shrinking)
    folder, ended = filmed(tmp_path / "r", Scripted(), LIMITLESS, lambda recorder: recorder.wait(60))
    assert ended.state == "failed"
    assert ended.doing.startswith("0.9 GB are left on the disk of")
    assert ended.doing.endswith("a recording leaves 1.0 GB free")
    assert ended.frames == len(folder) == 2


def test_a_full_disk_ends_it_and_what_was_kept_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add = FilmWriter.add

    def full(writer: FilmWriter, image: Any, record: Any) -> None:
        if record.number == 5:
            raise StorageError("frames_0000.tif cannot be written: the disk of somewhere is full")
        add(writer, image, record)

    monkeypatch.setattr(FilmWriter, "add", full)
    folder, ended = filmed(tmp_path / "r", Scripted(), LIMITLESS, lambda recorder: recorder.wait(60))
    assert (ended.state, ended.frames, len(folder)) == ("failed", 5, 5)
    assert ended.doing == "frames_0000.tif cannot be written: the disk of somewhere is full"
    assert ended.lost_by_disk >= 1, "the one that did not fit"


def test_a_bug_while_writing_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bugs: Any) -> None:
    monkeypatch.setattr(FilmWriter, "add", lambda *_: 1 / 0)
    folder, ended = filmed(tmp_path / "r", Scripted(), LIMITLESS, lambda recorder: recorder.wait(60))
    assert ended.state == "failed"
    assert "ZeroDivisionError" in ended.doing
    assert not len(folder)
    bugs.clear()


def test_the_gate_is_held_and_given_back(tmp_path: Path) -> None:
    source = Scripted()
    stream = Stream(source)
    other = replace(USERS, delay_us=77.0)
    recorder = FilmRecorder(stream, new_film(tmp_path / "r", source))
    recorder.start()
    with pytest.raises(InputError, match="something else sets the gate"):
        FilmRecorder(stream, new_film(tmp_path / "s", source)).start()
    with pytest.raises(StorageError, match="another process is recording"):
        FilmRecorder(Stream(Scripted()), open_film(tmp_path / "r")).start()
    with stream:
        until(lambda: recorder.progress.frames > 3)
        stream.submit(other)
        until(lambda: recorder.progress.frames > 30)
        recorder.stop()
        assert recorder.wait(60)
        until(lambda: source.told[-1] == other)
        assert waiting.next_frame(stream).image.any()
    assert {open_film(tmp_path / "r").record(number).asked for number in range(30)} == {
        open_film(tmp_path / "r").manifest.gate
    }


def test_a_camera_that_never_has_the_gate_is_given_up(tmp_path: Path) -> None:
    source = Scripted()
    source.stuck = True
    source.asked = replace(USERS, delay_us=5.0)
    folder, ended = filmed(tmp_path / "r", source, LIMITLESS, lambda recorder: recorder.wait(60))
    assert ended.state == "failed"
    assert "none of them with the gate asked for" in ended.doing
    assert (len(folder), ended.lost) == (0, 0)


def stamp(number: int, time_s: float) -> FrameStamp:
    return FrameStamp(number, time_s, USERS, USERS)


def paced(limits: FilmLimits, times: list[tuple[int, float]]) -> tuple[list[int], Pace]:
    """Numbers of the frames that a pace keeps until it is over."""
    pace, kept = Pace(limits), []
    for number, time_s in times:
        if pace.over(stamp(number, time_s)):
            break
        if pace.due(stamp(number, time_s)):
            kept.append(number)
    return kept, pace


def test_seconds_are_those_of_the_frames_whatever_they_round_to() -> None:
    beat = [(number, 100.0 + number * 0.05 + 1e-9 * (-1) ** number) for number in range(100)]
    assert paced(FilmLimits(seconds=1.0), beat)[0] == list(range(20))


def test_a_time_lapse_takes_the_frame_nearest_to_each_moment() -> None:
    beat = [(number, 5.0 + number * 0.3) for number in range(40)]
    kept, pace = paced(FilmLimits(every_s=1.0), beat)
    assert kept == [0, 3, 7, 10, 13, 17, 20, 23, 27, 30, 33, 37]
    assert pace.missed == 0
    as_often = [(number, number + 0.01 * (-1) ** number) for number in range(20)]
    assert paced(FilmLimits(every_s=1.0), as_often)[0] == list(range(20))


def test_moments_of_a_time_lapse_without_a_frame_are_lost() -> None:
    beat = [(number, number * 0.5) for number in range(60) if not 11 <= number <= 26]
    kept, pace = paced(FilmLimits(every_s=2.0, seconds=20.0), beat)
    assert kept == [0, 4, 8, 27, 28, 32, 36], "the first one back stands for the moment before"
    assert pace.missed == 3
    assert pace.seconds == 18.0


def test_a_time_lapse_is_as_far_as_its_time(tmp_path: Path) -> None:
    limits, source = FilmLimits(frames=5, every_s=10.0), Scripted()
    with Stream(source) as stream:
        recorder = FilmRecorder(stream, new_film(tmp_path / "r", source, every_s=limits.every_s), limits)
        image = np.zeros((source.info.height, source.info.width), np.uint16)
        for number in range(16):
            recorder.see(image, stamp(number, 100.0 + number))
        assert recorder.progress.share == pytest.approx(15 / 40), "between the frames, too"
        recorder.stop()


@pytest.mark.parametrize("field", ["frames", "seconds", "every_s"])
def test_limits_that_are_none_are_refused(field: str) -> None:
    with pytest.raises(InputError, match=f"{field} is 0"):
        FilmLimits(**{field: 0})


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """As many buffers exist after a thousand frames as before, and none is lost where the disk keeps up."""
    source = Scripted()
    source.pause_s = 0.0
    stream = Stream(source)
    recorder = FilmRecorder(stream, new_film(tmp_path / "r", source), FilmLimits(frames=1000))
    buffers = {id(buffer) for buffer in recorder._free}
    recorder.start()
    with stream:
        assert recorder.wait(60)
    assert {id(buffer) for buffer in recorder._free} == buffers
    assert recorder.progress.frames == 1000


def test_a_long_recording_goes_on_in_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiff_stack, "MAX_BYTES", 100_000)
    folder, ended = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=40))
    assert len(folder.files) > 3
    assert all(path.stat().st_size <= 100_000 for path in folder.files)
    assert sum(len(tifffile.imread(path)) for path in folder.files) == 40
    assert [folder.record(number).number for number in range(40)] == list(range(40))
    for path in folder.files:
        with tifffile.TiffFile(path) as tiff:
            assert "recording" in json.loads(str(tiff.pages.first.description))
    assert folder.counted().bytes == ended.bytes


def test_without_its_end_it_was_cut_short_and_its_frames_tell_the_rest(tmp_path: Path) -> None:
    source = Scripted()
    source.jumps = {20: 3}
    folder, _ = filmed(tmp_path / "r", source, FilmLimits(frames=40))
    whole = folder.counted()
    (tmp_path / "r" / "ended.json").unlink()
    told = open_film(tmp_path / "r").counted()
    assert "cut short" in told.ended
    assert (told.frames, told.lost_by_camera, told.seconds, told.bytes) == (40, 3, whole.seconds, whole.bytes)


def test_it_plays_over_and_over_with_the_gate_that_was_applied(tmp_path: Path) -> None:
    folder, _ = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=4))
    played = FilmCamera(folder, clock=lambda: 0.0)
    assert played.configure(USERS) == USERS
    with pytest.raises(InputError, match="The gate is fixed by the recording"):
        played.configure(replace(USERS, delay_us=1.0))
    image = np.zeros((60, 80), np.uint16)
    played.start()
    first = folder.record(0).sequence
    for number in range(9):
        played._due_s = 0.0
        found = played.read(image, 1.0)
        assert found is not None
        assert (found.sequence, found.applied) == (number, USERS)
        assert (image == (first + number % 4) % 4096).all()
    played.close()


def test_a_recording_without_a_frame_says_so(tmp_path: Path) -> None:
    new_film(tmp_path / "r", Scripted())
    with pytest.raises(StorageError, match="has no frame yet: there is nothing to play"):
        FilmCamera(open_film(tmp_path / "r"))
    with pytest.raises(StorageError, match="has no frame 0: it has 0"):
        open_film(tmp_path / "r").frame(0)


def test_damage_is_told_by_the_files_name(tmp_path: Path) -> None:
    folder, _ = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=3))
    path = folder.files[0]
    whole = path.read_bytes()
    tifffile.imwrite(path, np.zeros((9, 9), np.uint16))
    with pytest.raises(StorageError, match=r"frames_0000\.tif is damaged"):
        open_film(tmp_path / "r").frame(0)
    with pytest.raises(StorageError, match=r"frames_0000\.tif is damaged"):
        open_film(tmp_path / "r").record(0)
    path.write_bytes(b"no TIFF at all")
    with pytest.raises(StorageError, match=r"frames_0000\.tif is damaged"):
        open_film(tmp_path / "r")
    path.write_bytes(whole[: len(whole) // 3])
    with pytest.raises(StorageError, match=r"frames_0000\.tif is damaged"):
        open_film(tmp_path / "r")
    (tmp_path / "r" / "recording.json").write_text("{}", "utf-8")
    with pytest.raises(StorageError, match=r"recording\.json cannot be used"):
        open_film(tmp_path / "r")


def test_nothing_is_overwritten_unasked_and_nothing_foreign_ever(tmp_path: Path) -> None:
    source = Scripted()
    folder, _ = filmed(tmp_path / "r", source, FilmLimits(frames=3))
    manifest = make_film_manifest("Another", RIG, source.info, USERS)
    with pytest.raises(StorageError, match="holds a recording already"):
        create_film(tmp_path / "r", manifest)
    (tmp_path / "r" / "notes.txt").write_text("mine", "utf-8")
    with pytest.raises(StorageError, match=r"is not overwritten: notes\.txt is no part of a recording"):
        check_new_film(tmp_path / "r", overwrite=True)
    assert len(open_film(folder.path)) == 3
    (tmp_path / "r" / "notes.txt").unlink()
    assert not len(create_film(tmp_path / "r", manifest, overwrite=True))
    assert open_film(tmp_path / "r").manifest.scene == "Another"
    assert not list((tmp_path / "r").glob("frames_*"))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").write_text("mine", "utf-8")
    with pytest.raises(StorageError, match="is not empty: a recording needs a folder of its own"):
        create_film(tmp_path / "other", manifest, overwrite=True)
    assert not is_film(tmp_path / "other")


def test_the_preview_shows_the_frames_at_their_pace(tmp_path: Path) -> None:
    source = camera(rate_hz=50.0)
    wanted = brightest(source)
    stream = Stream(source)
    recorder = FilmRecorder(stream, new_film(tmp_path / "r", source, wanted), FilmLimits(frames=8))
    recorder.start()
    with stream:
        assert recorder.wait(60)
    assert recorder.progress.remark == ""
    film = cv2.VideoCapture(str(tmp_path / "r" / "preview.mp4"))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == 8
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(open_film(tmp_path / "r").rate_hz, abs=0.1)
    good, shown = film.read()
    film.release()
    assert good
    assert shown.shape[:2] == (60, 80)
    light = frame_of(source, wanted).astype(float)
    assert np.corrcoef(np.sqrt(light).ravel(), shown[:, :, 0].astype(float).ravel())[0, 1] > 0.95
    assert shown.max() > 200


def test_without_mpeg4_the_preview_is_webp_and_without_that_there_is_a_remark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image, features

    monkeypatch.setattr(film_preview, "_mp4", lambda *_: b"")
    folder, ended = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=6))
    assert ended.remark == ""
    assert folder.preview == tmp_path / "r" / "preview.webp"
    with Image.open(folder.preview) as picture:
        assert picture.size == (80, 60)
    monkeypatch.setattr(features, "check", lambda _: False)
    folder, ended = filmed(tmp_path / "s", Scripted(), FilmLimits(frames=6))
    assert ended.remark == film_preview.NO_CODEC
    assert (folder.preview, len(folder)) == (None, 6)


def test_of_a_long_recording_the_preview_shows_every_nth_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film_preview, "MAX_FRAMES", 10)
    folder, _ = filmed(tmp_path / "r", Scripted(), FilmLimits(frames=35))
    assert folder.rate_hz == pytest.approx(100.0)
    film = cv2.VideoCapture(str(folder.preview))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == math.ceil(35 / 4)
    film.release()
