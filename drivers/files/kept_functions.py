"""Looks through the files of compiled functions that numba keeps, so that `slopegate doctor` can tell of them."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numba

from slopegate.core.compiled.kept import kept_folder, unpack

SUFFIXES = (".nbi", ".nbc")
"""Of an index, which names the kept versions of one function, and of such a version."""


def kept_folders() -> list[Path]:
    """Where the functions of `core` are kept; none where no folder can be written. Imports all of them."""
    core = import_module("slopegate.core")
    for entry in walk_packages(core.__path__, "slopegate.core."):
        import_module(entry.name)
    loaded = [module for name, module in sys.modules.items() if name.startswith("slopegate.core.")]
    found = {kept_folder(value) for module in loaded for value in vars(module).values()}
    return [Path(folder) for folder in sorted(found) if folder]


def damaged_functions(folders: Iterable[Path]) -> list[Path]:
    """Files that cannot be used. The program makes them anew when it needs the function."""
    kept = [path for folder in folders for path in sorted(folder.iterdir()) if path.suffix in SUFFIXES]
    return [path for path in kept if not _is_whole(path)]


def _is_whole(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            content = pickle.load(stream)
            if path.suffix == ".nbc":
                unpack(content)
            elif content == numba.__version__:  # another version's is never looked into
                pickle.load(stream)
    except Exception:  # pickle raises anything for damaged files
        return False
    return True
