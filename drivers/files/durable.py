"""Files that are there whole or not at all, whatever happens to the process or the machine while they are written."""

from __future__ import annotations

import errno
import os
import secrets
from contextlib import suppress
from pathlib import Path
from typing import Final

from slopegate.core.rig.checks import UserError

PART: Final = ".part"
"""Ending of files that were being written; safe to remove when nobody is writing."""

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}


class StorageError(UserError):
    """A capture cannot be written or read; the message is one sentence that names the file or folder."""


def write_durably(path: Path, *pieces: bytes | memoryview) -> None:
    """Write a file under another name in the same folder, force it to the disk, then give it its name.

    A crash at any moment leaves the old file, the new one or nothing under this name, never a part of one. Raises
    StorageError and leaves what was there before.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    try:
        with part.open("xb") as stream:
            for piece in pieces:
                stream.write(piece)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise StorageError(reason(path, error)) from None


def remove_parts(folder: Path) -> None:
    """Clear away what a killed process was writing."""
    with suppress(OSError):
        for part in folder.glob(f".*{PART}"):
            part.unlink(missing_ok=True)


def reason(path: Path, error: OSError) -> str:
    """Why this file cannot be written, as a sentence."""
    if error.errno in _FULL:
        return f"{path.name} cannot be written: the disk of {path.parent} is full"
    if error.errno in _FORBIDDEN:
        return f"{path.name} cannot be written: the folder {path.parent} does not allow it"
    if error.errno == errno.ENOENT or not path.parent.exists():
        return f"{path.name} cannot be written: the folder {path.parent} has vanished"
    return f"{path} cannot be written ({error.strerror or error})"


def _sync_folder(folder: Path) -> None:
    """Force the names in a folder to the disk; Windows has no such thing and needs none."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
