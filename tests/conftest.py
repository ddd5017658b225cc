"""What every test gets: settings of its own, no window on anybody's screen, and a way to the shared data."""

from __future__ import annotations

import gc
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

SHARED = Path(__file__).resolve().parents[2] / "shared"
_home = tempfile.mkdtemp(prefix="slopegate-tests-")

# Qt and platformdirs read these once, so they are set before any test module is imported: a test run neither finds
# nor leaves window settings.
for _name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
    os.environ[_name] = os.path.join(_home, _name.lower())
# A test run asks nobody's network for cameras; the fake one runs in a network namespace, where it is asked for.
if os.environ.get("SLOPEGATE_TEST_NETNS") != "1":
    os.environ["SLOPEGATE_NO_NETWORK_SEARCH"] = "1"
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ["QT_QPA_PLATFORM"] = "offscreen"

# Numba's cache is not made for two processes that compile one kernel at once: every worker but the first has its own.
_worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
if _worker != "gw0":
    os.environ["NUMBA_CACHE_DIR"] = str(Path(__file__).resolve().parents[1] / ".pytest_cache" / "numba" / _worker)

# The usual run draws the same examples every time, the thorough one others; none is judged by how long it took.
_unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("slopegate", _unhurried, derandomize=True)
settings.register_profile("thorough", _unhurried, max_examples=2000)
settings.load_profile("slopegate")


def pytest_unconfigure() -> None:
    """Remove the settings of this run."""
    shutil.rmtree(_home, ignore_errors=True)


@pytest.fixture(autouse=True, scope="module")
def _what_is_there_stays() -> None:
    """What lives when a module's tests begin is imported code, all but a little: no later search for garbage, and the
    tests of the window search after every test, need look at it again."""
    gc.collect()
    gc.freeze()


class _Bugs(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self.records.append(record)


@pytest.fixture(autouse=True)
def bugs() -> Iterator[list[logging.LogRecord]]:
    """Every bug that the program logs: a test that means to see one clears the list, any other fails for it."""
    watch, program = _Bugs(), logging.getLogger("slopegate")
    program.addHandler(watch)
    yield watch.records
    program.removeHandler(watch)
    assert not watch.records, f"bugs were logged: {[record.getMessage() for record in watch.records]}"


@pytest.fixture
def log_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log of this test's own, which is not there yet."""
    from slopegate.app.session.log import log_path

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return log_path()


@pytest.fixture(scope="session")
def shared() -> Callable[[str], Path]:
    """Path of a file or folder of the shared data, such as "data/scenes"; the test is skipped where it is absent."""

    def find(relative: str) -> Path:
        path = SHARED / relative
        if not path.exists():
            pytest.skip(f"the shared data has no {relative} beside this checkout")
        return path

    return find


@pytest.fixture(scope="session")
def opengl() -> None:
    """For tests that draw in 3D: skipped on Qt's offscreen platform, which never draws OpenGL."""
    if os.environ.get("QT_QPA_PLATFORM") == "offscreen":
        pytest.skip("Qt's offscreen platform draws no OpenGL")
