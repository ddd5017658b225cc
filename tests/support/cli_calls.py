"""The command line, called as another program calls it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from slopegate.app.cli import main


def report(capsys: pytest.CaptureFixture[str], *command: str) -> dict[str, Any]:
    """What a command that succeeds tells with --json, and that it tells nothing else."""
    assert main([*command, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    assert isinstance(found, dict)
    return found


def refusal(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    """The one sentence of a command that is refused."""
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("slopegate: ")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err
