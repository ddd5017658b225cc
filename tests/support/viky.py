"""Viky, the simulated GenTL producer that comes with the package genicam: three cameras with bouncing balls."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

RED, GREEN = "VikyTL_DEV_red", "VikyTL_DEV_green"


def install(request: pytest.FixtureRequest) -> None:
    """Let the driver find it and no other; skips the test where it is not here."""
    monkeypatch: pytest.MonkeyPatch = request.getfixturevalue("monkeypatch")
    if find_spec("harvesters") is None or (found := find_spec("genicam")) is None or found.origin is None:
        pytest.skip("the extra gentl (harvesters, genicam) is not installed")
    folder = Path(found.origin).parent
    if not (folder / "viky.cti").exists():
        pytest.skip("this package of genicam brings no simulated producer")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(folder))
