"""One writer for each capture: a claim on its folder, which ends with the process that holds it, however that ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from slopegate.drivers.files.durable import StorageError, reason


@contextmanager
def claim(folder: Path) -> Iterator[None]:
    """The only right to write into a capture's folder. Raises StorageError while another process or thread has it.

    On Windows, where folders cannot be locked, it is not exclusive. Nor is it on disks that know no locks.
    """
    if sys.platform == "win32":
        yield
        return
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise StorageError(reason(folder, error)) from None
    try:
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)


def _lock(handle: int, folder: Path) -> None:
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StorageError(
            f"another process is recording into {folder}: wait until it has ended, or take another folder"
        ) from None
    except OSError:
        return
