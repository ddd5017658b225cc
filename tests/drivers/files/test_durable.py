"""Files and folders appear whole or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from slopegate.drivers.files.durable import OLD, PART, StorageError, remove_parts, replacing, write_durably


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_durably(path, b"old")

    (tmp_path / "taken").mkdir()
    with pytest.raises(StorageError, match="cannot be written"):
        write_durably(tmp_path / "taken", b"new")
    assert path.read_bytes() == b"old"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["file", "taken"]
    write_durably(path, b"new", memoryview(b"er"))
    assert path.read_bytes() == b"newer"


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    with replacing(tmp_path / "made") as part:
        (part / "below").mkdir(parents=True)
        (part / "below" / "a").write_text("1")
        assert [item.name for item in tmp_path.iterdir()] == [part.name]
    assert (tmp_path / "made" / "below" / "a").read_text() == "1"
    assert [item.name for item in tmp_path.iterdir()] == ["made"]


def begin(path: Path, as_folder: bool, interruption: BaseException) -> None:
    with replacing(path) as part:
        if as_folder:
            part.mkdir()
        (part / "a" if as_folder else part).write_text("half")
        raise interruption


@pytest.mark.parametrize("interruption", [ZeroDivisionError(), KeyboardInterrupt()])
def test_what_is_interrupted_leaves_nothing(tmp_path: Path, interruption: BaseException) -> None:
    (tmp_path / "file").write_text("old")
    for name in ("file", "folder"):
        with pytest.raises(type(interruption)):
            begin(tmp_path / name, name == "folder", interruption)
    assert [item.name for item in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "old"


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "file cannot be written: the disk of {folder} is full"),
        (errno.EACCES, "file cannot be written: the folder {folder} does not allow it"),
        (errno.EIO, "{folder}/file cannot be written (Input/output error)"),
    ],
)
def test_why_it_failed_is_told_in_a_sentence(tmp_path: Path, number: int, words: str) -> None:
    with pytest.raises(StorageError) as told, replacing(tmp_path / "file"):
        raise OSError(number, os.strerror(number))
    assert str(told.value) == words.format(folder=tmp_path)


def test_what_numpy_says_of_a_full_disk_is_no_sentence(tmp_path: Path) -> None:
    with pytest.raises(StorageError) as told, replacing(tmp_path / "file"):
        raise OSError("76800 requested and 3984 written")
    assert str(told.value) == f"file cannot be written whole: the disk of {tmp_path} is full, or fails"


def test_a_name_may_be_as_long_as_the_disk_allows(tmp_path: Path) -> None:
    write_durably(tmp_path / ("a" * 255), b"new")
    assert [item.name for item in tmp_path.iterdir()] == ["a" * 255]


def test_a_folder_that_has_vanished_is_told(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"the folder .*gone has vanished"):
        write_durably(tmp_path / "gone" / "file", b"new")


def test_what_a_killed_process_was_writing_can_be_removed(tmp_path: Path) -> None:
    script = (
        "import os, sys; from pathlib import Path; from slopegate.drivers.files.durable import replacing\n"
        "with replacing(Path(sys.argv[1])) as part:\n    part.write_text('half'); os._exit(9)"
    )
    (tmp_path / "file").write_text("old")
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path / "file")], check=False)
    assert done.returncode == 9
    assert len(list(tmp_path.iterdir())) == 2
    remove_parts(tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "old"


KILLED = """
import os, sys, time
from pathlib import Path
from slopegate.drivers.files import durable
with durable.replacing(Path(sys.argv[1])) as part:
    if sys.argv[2] == "folder":
        part.mkdir()
    (part / "a" if sys.argv[2] == "folder" else part).write_text("half")
    print("begun", flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(os.name == "nt", reason="there nobody can ask whether a process still runs")
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_the_next_write_removes_what_a_killed_one_left_and_not_what_is_being_written(tmp_path: Path, kind: str) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "out"), kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begun\n"
        write_durably(tmp_path / "out", b"whole")
        assert len(list(tmp_path.glob(".out.*.part"))) == 1, "somebody is writing that"
        process.kill()
    write_durably(tmp_path / "out", b"whole")
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_was_being_replaced_comes_back(tmp_path: Path) -> None:
    with replacing(tmp_path / "out") as part:
        part.mkdir()
    gone = part.name.replace(f"-{os.getpid()}-", "-999999999-").removesuffix(PART) + OLD
    (tmp_path / "out").rename(tmp_path / gone)
    remove_parts(tmp_path, "out")
    assert [item.name for item in tmp_path.iterdir()] == ["out"]
