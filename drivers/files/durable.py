"""The one way to write a file: it appears whole or not at all, even if the process or the machine dies meanwhile."""

from __future__ import annotations

import errno
import os
import platform
import re
import shutil
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from os.path import exists, isdir
from pathlib import Path
from typing import Final

from slopegate.core.rig.checks import UserError

PART: Final = ".part"
"""Ending of the temporary names; such files may be removed when nobody is writing."""

OLD: Final = f".old{PART}"
"""Of a folder while another one takes its place."""
_HOST: Final = f"{zlib.crc32(platform.node().encode()):08x}"

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}


class StorageError(UserError):
    """A file or folder cannot be written or read; the message is one sentence that names it."""


def check_destination(path: Path, suffixes: Sequence[str], *, overwrite: bool = True) -> None:
    """Raise StorageError now for what would fail after a long computation: suffix, folder, permission.

    `overwrite` False: also for a file that exists.
    """
    if path.suffix.lower() not in suffixes:
        raise StorageError(f"{path} has the suffix {path.suffix!r}: it must be one of {', '.join(suffixes)}")
    if isdir(path):
        raise StorageError(f"{path} is a folder: name a file")
    if not isdir(path.parent):
        raise StorageError(f"{path}: there is no folder {path.parent}")
    if not overwrite:
        check_new(path)
    try:
        with suppress(FileNotFoundError):
            path.lstat()  # finds names that are too long
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise StorageError(f"{path} cannot be written to its folder ({error.strerror or error})") from None


def check_new(path: Path) -> None:
    """Raise StorageError for what exists, and would be overwritten."""
    if exists(path):
        raise StorageError(f"{path} exists already: take another name, or allow to overwrite it (--overwrite)")


def check_folder(path: Path) -> None:
    """Raise StorageError now for a folder that later could not be made, or not be written to."""
    if isdir(path):
        check_destination(path / "file.npy", (".npy",))
    elif exists(path):
        raise StorageError(f"{path} is a file: name a folder")
    else:
        check_destination(path.with_suffix(".npy"), (".npy",))


def make_folder(path: Path) -> None:
    """Make a folder with all above it, unless it is there. Raises StorageError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(reason(path, error)) from None


def remove(path: Path) -> None:
    """Remove a file, if it is there. Raises StorageError."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(reason(path, error)) from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; the file or folder written there is forced to the disk, then renamed.

    Whatever happens, `path` is afterwards what it was or the new thing, never a part of it; only of a folder that
    replaces a folder nothing may be left at `path`, if the process dies between two renamings: the next one brings it
    back. What a killed process left of an earlier attempt is removed first. An OSError becomes a StorageError.
    """
    remove_parts(path.parent, path.name)
    part = _part_of(path)
    try:
        yield part
        for item in (part, *part.rglob("*")):
            _sync(item)
        if part.is_dir() and path.is_dir():  # a folder can only be renamed to where none is
            old = _part_of(path, OLD)
            path.replace(old)
            part.replace(path)
            shutil.rmtree(old, ignore_errors=True)
        else:
            part.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise StorageError(reason(path, error)) from None
    finally:
        _remove(part)


def _part_of(path: Path, ending: str = PART) -> Path:
    return path.with_name(f"{_beginning(path.name)}{_HOST}-{os.getpid()}-{os.urandom(4).hex()}{ending}")


def write_durably(path: Path, *pieces: bytes | memoryview) -> None:
    """Write bytes to a file, replacing it whole. Raises StorageError and leaves what was there before."""
    with replacing(path) as part, part.open("xb") as stream:
        for piece in pieces:
            stream.write(piece)


def remove_parts(folder: Path, name: str = "", alone: bool = False) -> None:
    """Remove what killed processes of this computer were writing: all of it, or what was to get this name.

    alone: nobody else can be writing here, so whatever is unfinished goes. A folder that was to be replaced, and is not
    there any more, comes back.
    """
    beginning = _beginning(name) if name else "."
    with suppress(OSError), os.scandir(folder) as found:
        left = [one.name for one in found if one.name.startswith(beginning) and one.name.endswith(PART)]
        for part in left:
            if not (alone or _has_ended(part)):
                continue
            if part.endswith(OLD) and name and not exists(folder / name):
                (folder / part).replace(folder / name)
            else:
                _remove(folder / part)


def _beginning(name: str) -> str:
    """How the temporary names for a file or folder of this name begin."""
    return f".{name[:50]}."


def _has_ended(part: str) -> bool:
    """Whether the process that made this temporary name ran on this computer, and runs no more."""
    found = re.search(rf"\.{_HOST}-(\d{{1,9}})-[0-9a-f]+(?:\.old)?\.part$", part)
    if found is None or os.name == "nt":  # there, asking a process whether it runs would interrupt it
        return False
    try:
        os.kill(int(found[1]), 0)
    except ProcessLookupError:
        return True
    except OSError:
        pass
    return False


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part, ignore_errors=True)
    else:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def reason(path: Path, error: OSError) -> str:
    """Why this file cannot be written, as a sentence."""
    if error.errno in FULL:
        return f"{path.name} cannot be written: the disk of {path.parent} is full"
    if error.errno in _FORBIDDEN:
        return f"{path.name} cannot be written: the folder {path.parent} does not allow it"
    if not path.parent.exists():
        return f"{path.name} cannot be written: the folder {path.parent} has vanished"
    if error.errno is None:  # numpy's "76800 requested and 3984 written"
        return f"{path.name} cannot be written whole: the disk of {path.parent} is full, or fails"
    return f"{path} cannot be written ({error.strerror})"


def _sync(path: Path) -> None:
    """Force a file, or the names in a folder, to the disk. Windows does not know the latter and does not need it."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
