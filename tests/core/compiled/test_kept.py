"""Compiled functions are kept where that is possible, and used only while they are what the source says."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module, invalidate_caches
from pathlib import Path
from types import ModuleType

import numba
import pytest
from numba.core.caching import UserWideCacheLocator

from slopegate.core.compiled.kept import kept_folder, made_of, pack, unpack
from slopegate.drivers.files.kept_functions import damaged_functions

CALLEE = """
from slopegate.core.compiled.kept import njit

FACTOR = {factor}

@njit(cache=True)
def times(x):
    return FACTOR * x
"""
CALLER = """
from slopegate.core.compiled.kept import njit
from kept_callee import times

@njit(cache=True, nogil=True)
def twice(x):
    return times(x) + times(x)
"""
RUN = "import kept_caller; print(kept_caller.twice(1.5), sum(kept_caller.twice.stats.cache_hits.values()))"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two modules, one of which calls the other, whose functions are kept in `kept`."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    write(tmp_path)
    return tmp_path


def write(folder: Path, factor: int = 2) -> None:
    (folder / "kept_callee.py").write_text(CALLEE.format(factor=factor))
    (folder / "kept_caller.py").write_text(CALLER)


def run() -> tuple[float, int]:
    """What a fresh import computes, and how many functions it took from the disk."""
    for name in ("kept_callee", "kept_caller"):
        sys.modules.pop(name, None)
    invalidate_caches()
    twice = import_module("kept_caller").twice
    return twice(1.5), sum(twice.stats.cache_hits.values())


def in_a_process(folder: Path, before: str = "") -> subprocess.Popen[bytes]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-B", "-c", before + RUN]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def kept(folder: Path, name: str) -> Path:
    (path,) = (folder / "kept").rglob(name)
    return path


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("harm", ["cut", "empty", "garbage"])
def test_a_damaged_file_is_made_anew(folder: Path, suffix: str, harm: str) -> None:
    assert run() == (6.0, 0)
    path = kept(folder, f"kept_caller.*{suffix}")
    assert damaged_functions([path.parent]) == []
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[: len(whole) // 2], "empty": b"", "garbage": bytes(range(256))}[harm])
    assert damaged_functions([path.parent]) == [path]
    assert run() == (6.0, 0)
    assert damaged_functions([path.parent]) == []
    assert run() == (6.0, 1)


def test_a_single_flipped_bit_in_the_code_counts(folder: Path) -> None:
    run()
    path = kept(folder, "kept_caller.*.nbc")
    whole = path.read_bytes()
    place = len(whole) // 2
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
    assert damaged_functions([path.parent]) == [path]
    assert run() == (6.0, 0)


def test_a_constant_that_changed_elsewhere_counts(folder: Path) -> None:
    run()
    write(folder, factor=5)
    assert run() == (15.0, 0)
    assert run() == (15.0, 1)


def test_another_functions_code_is_not_taken(folder: Path) -> None:
    run()
    kept(folder, "kept_caller.*.nbc").write_bytes(kept(folder, "kept_callee.*.nbc").read_bytes())
    assert run() == (6.0, 0)


def test_another_versions_index_is_not_taken(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "__version__", "0.1")
    run()
    monkeypatch.undo()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / "kept"))
    assert run() == (6.0, 0)


def test_where_no_folder_can_be_written_it_runs_without(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "__pycache__").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / "__pycache__" / "below"))
    monkeypatch.setattr(UserWideCacheLocator, "from_function", lambda *_: None)
    assert run() == (6.0, 0)
    assert run() == (6.0, 0)
    assert kept_folder(import_module("kept_caller").twice) == ""


@pytest.mark.skipif(os.name == "nt", reason="needs a limit on the size of files")
def test_on_a_full_disk_it_runs_without(folder: Path) -> None:
    limited = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limited += "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)); "
    assert in_a_process(folder, limited).communicate()[0] == b"6.0 0\n"


def test_processes_at_once_get_along(folder: Path) -> None:
    assert [one.communicate()[0].split()[0] for one in [in_a_process(folder) for _ in range(3)]] == [b"6.0"] * 3
    assert run()[0] == 6.0


def test_packed_content_is_whole_or_refused() -> None:
    assert unpack(pack(b"abc")) == b"abc"
    for wrong in [(pack(b"abc")[0], b"abd"), (1, 2), None, ("version",)]:
        with pytest.raises(ValueError, match="damaged"):
            unpack(wrong)


def test_every_kernel_is_kept() -> None:
    module: ModuleType = import_module("slopegate.core.exposure.kernels")
    assert Path(kept_folder(module.gate)).is_dir()
    assert kept_folder(len) == ""


def test_what_a_function_is_made_of_is_the_same_in_every_process() -> None:
    command = "import slopegate.core.exposure.kernels as k; from slopegate.core.compiled.kept import made_of; "
    command += "print(made_of(k.gate.py_func))"
    other = subprocess.run([sys.executable, "-c", command], check=True, capture_output=True, text=True).stdout
    assert int(other) == made_of(import_module("slopegate.core.exposure.kernels").gate.py_func)
