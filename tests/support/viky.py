"""Viky, the simulated GenTL producer that comes with the package genicam: three cameras with bouncing balls."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

RED, GREEN = "VikyTL_DEV_red", "VikyTL_DEV_green"


def need_gentl() -> None:
    """Skips the test where the extra gentl is not installed or cannot be loaded."""
    try:
        import_module("harvesters.core")
    except ImportError as error:
        pytest.skip(f"the extra gentl (harvesters, genicam) is not here: {error}")


def install(request: pytest.FixtureRequest) -> None:
    """Let the driver find it and no other; skips the test where it is not here."""
    monkeypatch: pytest.MonkeyPatch = request.getfixturevalue("monkeypatch")
    need_gentl()
    found = find_spec("genicam")
    assert found is not None
    assert found.origin is not None
    folder = Path(found.origin).parent
    if not (folder / "viky.cti").exists():
        pytest.skip("this package of genicam brings no simulated producer")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(folder))
