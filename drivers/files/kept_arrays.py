"""Arrays that took long to compute, kept in the platform's cache folder: whole and as they were written, or absent.

A file is named by a key that stands for everything its content depends on. What cannot be read, is damaged or belongs
to another key counts as absent; what cannot be written is a StorageError, which the caller may do without.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import platformdirs
from numpy.typing import NDArray

from slopegate.drivers.files.durable import StorageError, reason, remove_parts, write_durably

Kept = dict[str, NDArray[Any]]

MAX_BYTES: Final = 1_000_000_000
"""Most that a folder of kept arrays holds: those used longest ago go first."""
_SUM_BYTES: Final = 32


def cache_folder(kind: str) -> Path:
    """Where this platform keeps what may be lost, and in it the folder for arrays of this kind."""
    return platformdirs.user_cache_path("slopegate", appauthor=False) / kind


def key_of(*pieces: bytes) -> str:
    """The key of everything that a result depends on; where one piece ends and the next begins counts."""
    hashed = hashlib.sha256()
    for piece in pieces:
        hashed.update(len(piece).to_bytes(8, "little"))
        hashed.update(piece)
    return hashed.hexdigest()


def damaged_arrays(folder: Path) -> list[Path]:
    """Files of this folder that are not as they were written. Whoever looks for one of them removes it."""
    with suppress(OSError):
        return [path for path in sorted(folder.glob("*.npz")) if not _is_whole(path.read_bytes())]
    return []


def load_kept(folder: Path, key: str) -> Kept | None:
    """The arrays kept under a key; None where there are none or the file is damaged."""
    path = _path(folder, key)
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if not _is_whole(data):
        with suppress(OSError):
            path.unlink()
        return None
    with np.load(io.BytesIO(memoryview(data)[_SUM_BYTES:]), allow_pickle=False) as found:
        arrays = {name: found[name] for name in found.files}
    with suppress(OSError):
        os.utime(path)  # used now: others are removed before it
    return arrays


def save_kept(folder: Path, key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Keep arrays under a key, and remove those used longest ago beyond MAX_BYTES. Raises StorageError."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **dict(arrays))
    body = stream.getvalue()
    path = _path(folder, key)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(reason(folder, error)) from None
    remove_parts(folder)
    write_durably(path, hashlib.sha256(body).digest(), body)
    _prune(folder, path)


def _is_whole(data: bytes) -> bool:
    return hashlib.sha256(memoryview(data)[_SUM_BYTES:]).digest() == data[:_SUM_BYTES]


def _path(folder: Path, key: str) -> Path:
    return folder / f"{key}.npz"


def _prune(folder: Path, newest: Path) -> None:
    with suppress(OSError):
        files = sorted(
            ((path.stat().st_mtime, path.stat().st_size, path) for path in folder.glob("*.npz") if path != newest),
            reverse=True,
        )
        total = newest.stat().st_size
        for _, size, path in files:
            total += size
            if total > MAX_BYTES:
                path.unlink(missing_ok=True)
