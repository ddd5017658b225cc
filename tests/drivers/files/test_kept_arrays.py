"""Kept arrays: whole or absent, whatever happens to the file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slopegate.drivers.files import kept_arrays
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.kept_arrays import key_of, load_kept, save_kept

TABLE = {"table": np.arange(12, dtype=np.float32).reshape(3, 4), "paths": np.array(16)}


def test_what_was_kept_comes_back_equal(tmp_path: Path) -> None:
    folder = tmp_path / "bakes"
    save_kept(folder, key_of(b"a"), TABLE)
    found = load_kept(folder, key_of(b"a"))
    assert found is not None
    assert found.keys() == TABLE.keys()
    for name, array in TABLE.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    assert load_kept(folder, key_of(b"b")) is None
    assert load_kept(tmp_path / "nowhere", key_of(b"a")) is None


def test_where_pieces_end_counts() -> None:
    assert key_of(b"ab", b"c") != key_of(b"a", b"bc")


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_counts_as_absent(tmp_path: Path, damage: str) -> None:
    key = key_of(b"a")
    save_kept(tmp_path, key, TABLE)
    (path,) = tmp_path.glob("*.npz")
    data = bytearray(path.read_bytes())
    if damage == "changed":
        data[len(data) // 2] ^= 1
    path.write_bytes({"cut": data[: len(data) // 2], "changed": data, "empty": b""}[damage])
    assert load_kept(tmp_path, key) is None
    save_kept(tmp_path, key, TABLE)
    assert load_kept(tmp_path, key) is not None


SAVE_FOR_EVER = """
import sys
from pathlib import Path
import numpy as np
from slopegate.drivers.files.kept_arrays import key_of, save_kept
while True:
    save_kept(Path(sys.argv[1]), key_of(b"a"), {"table": np.zeros(2_000_000, np.float32)})
"""


def test_a_process_killed_while_it_writes_leaves_it_whole_or_absent(tmp_path: Path) -> None:
    for _ in range(5):
        writer = subprocess.Popen([sys.executable, "-c", SAVE_FOR_EVER, str(tmp_path)])
        while not list(tmp_path.glob(".*")):
            assert writer.poll() is None
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        found = load_kept(tmp_path, key_of(b"a"))
        assert found is None or found["table"].shape == (2_000_000,)
        for part in tmp_path.glob(".*"):
            part.unlink()


def test_those_used_longest_ago_make_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_arrays, "MAX_BYTES", 250_000)
    large = {"table": np.zeros(25_000, np.float32)}
    for age, name in enumerate((b"old", b"used", b"new")):
        save_kept(tmp_path, key_of(name), large)
        path = tmp_path / f"{key_of(name)}.npz"
        os.utime(path, (1e9 + age, 1e9 + age))
        if name == b"used":
            assert load_kept(tmp_path, key_of(b"old")) is not None  # now the newest
    assert load_kept(tmp_path, key_of(b"used")) is None
    assert load_kept(tmp_path, key_of(b"old")) is not None


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match="file"):
        save_kept(tmp_path / "file" / "bakes", key_of(b"a"), TABLE)
