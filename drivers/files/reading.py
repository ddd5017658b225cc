"""Reads files that anybody may have written. Whatever is wrong with one is told in a sentence.

Here and beside, paths are looked up with `os.path`: unlike `Path.exists` and the like it takes a name that is too long,
or a folder that may not be searched, as absent, instead of raising OSError.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from os.path import exists, isfile
from pathlib import Path
from typing import Any

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.errors import SceneError

MAX_FILE_BYTES = 400_000_000


def read_plain(path: Path, limit_bytes: int = MAX_FILE_BYTES, refusal: type[UserError] = SceneError) -> bytes:
    """All bytes of an ordinary file that is neither empty nor larger than the limit. Raises `refusal`."""
    if not exists(path):
        raise refusal(f"{path} is missing")
    if not isfile(path):
        raise refusal(f"{path} is not an ordinary file")
    try:
        size = path.stat().st_size
        if size == 0:
            raise refusal(f"{path} is empty (0 bytes)")
        if size > limit_bytes:
            raise refusal(f"{path} has {size / 1e6:.0f} MB: at most {limit_bytes / 1e6:.0f} MB are allowed")
        return path.read_bytes()
    except OSError as error:
        raise refusal(f"{path} cannot be read: {error.strerror or error}") from error


def toml_tables(data: bytes, source: str, refusal: type[UserError] = SceneError) -> dict[str, Any]:
    """The tables of a TOML file's bytes; `source` names it in errors. Raises `refusal`."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(f"{source} is not UTF-8 text: byte {error.start} cannot be read") from error
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, and what Python says to a number of thousands of digits
        raise refusal(f"{source} is not valid TOML: {str(error).rstrip('.')}") from error
    except RecursionError as error:
        raise refusal(f"{source} is not valid TOML: its tables are nested too deeply") from error


@contextmanager
def decoding(refusal: UserError) -> Iterator[None]:
    """Raise `refusal` for whatever the decoder inside stumbles over: libraries raise anything for damaged files.

    Only for calls of such libraries: a bug of this program in here would go unseen.
    """
    try:
        yield
    except (UserError, MemoryError):
        raise
    except Exception as error:
        raise refusal from error
