"""Reads files that anybody may have written. Whatever is wrong with one is told in a sentence.

Here and beside, paths are looked up with `os.path`: unlike `Path.exists` and the like it takes a name that is too long,
or a folder that may not be searched, as absent, instead of raising OSError.
"""

from __future__ import annotations

import json
import logging
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from os.path import exists, isfile
from pathlib import Path
from typing import Any

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.errors import SceneError

_TOO_LONG = f"a whole number in it has more than {sys.get_int_max_str_digits()} digits"
_TALKERS = ("tifffile", "imagecodecs")
"""Libraries that log what they also raise."""
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
    text = _utf8(data, source, refusal)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise refusal(f"{source} is not valid TOML: {str(error).rstrip('.')}") from error
    except ValueError as error:
        raise refusal(f"{source} is not valid TOML: {_TOO_LONG}") from error
    except RecursionError as error:
        raise refusal(f"{source} is not valid TOML: its tables are nested too deeply") from error


def json_value(data: bytes, source: str, refusal: type[UserError] = SceneError) -> Any:
    """What a JSON file's bytes say; `source` names it in errors. Raises `refusal`."""
    text = _utf8(data, source, refusal)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise refusal(f"{source} is not valid JSON: {error.msg[:1].lower()}{error.msg[1:]} ({where})") from error
    except ValueError as error:
        raise refusal(f"{source} is not valid JSON: {_TOO_LONG}") from error
    except RecursionError as error:
        raise refusal(f"{source} is not valid JSON: its values are nested too deeply") from error


def _utf8(data: bytes, source: str, refusal: type[UserError]) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(f"{source} is not UTF-8 text: byte {error.start} cannot be read") from error


@contextmanager
def decoding(refusal: UserError) -> Iterator[None]:
    """Raise `refusal` for whatever the decoder inside stumbles over: libraries raise anything for damaged files.

    Only for calls of such libraries: a bug of this program in here would go unseen. What they log of it is not heard.
    """
    for library in _TALKERS:
        logging.getLogger(library).setLevel(logging.CRITICAL)
    try:
        yield
    except (UserError, MemoryError):
        raise
    except Exception as error:
        raise refusal from error
