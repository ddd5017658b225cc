"""What the set-up says on a machine where something is missing and nothing may be installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SETUP = Path(__file__).resolve().parents[1] / ".ci" / "setup"
TOOLS = ("bash", "cat", "dirname", "echo", "grep", "id", "sed", "sha256sum", "uname", "xargs")
LIBRARIES = "libgl1 libegl1 libdbus-1-3 libfontconfig1 libglib2.0-0 libxkbcommon0 libxkbcommon-x11-0 libxcb-cursor0"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="system packages are looked for on Linux only")


@pytest.fixture
def poor_machine(tmp_path: Path) -> Path:
    """A checkout and a `bin` with the plainest tools: no apt-get, no sudo, no Python, no virtual screen."""
    (tmp_path / ".ci").mkdir()
    # The script looks in the system's folders for ldconfig; here it shall find the one below and nothing else.
    script = SETUP.read_text(encoding="utf-8").replace("PATH=$PATH:/usr/sbin:/sbin\n", "")
    (tmp_path / ".ci" / "setup").write_text(script, encoding="utf-8")
    (tmp_path / "pyproject.toml").write_text("")
    (tmp_path / "bin").mkdir()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found, tool
        (tmp_path / "bin" / tool).symlink_to(found)
    return tmp_path


def run_setup(machine: Path, *arguments: str, libraries: str) -> subprocess.CompletedProcess[str]:
    ldconfig = machine / "bin" / "ldconfig"
    ldconfig.write_text(f"#!/usr/bin/env bash\necho '{libraries}'\n")
    ldconfig.chmod(0o755)
    command = ["bash", str(machine / ".ci" / "setup"), *arguments]
    environment = {"PATH": str(machine / "bin")}
    return subprocess.run(command, env=environment, check=False, capture_output=True, text=True, timeout=280)


def installed_libraries() -> str:
    """Lines as ldconfig -p prints them, of every library that the script names."""
    words = SETUP.read_text(encoding="utf-8").replace('"', " ").split()
    return "\n".join(f"\t{word} (libc6,x86-64) => /lib/{word}" for word in words if ".so." in word and "*" not in word)


def test_missing_libraries_are_named(poor_machine: Path) -> None:
    result = run_setup(poor_machine, libraries="")
    assert result.returncode == 1
    assert result.stdout == ""
    assert f"apt-get install {LIBRARIES}" in result.stderr
    assert result.stderr.count("\n") == 1
    assert "xvfb" not in result.stderr


def test_only_what_is_missing_is_named(poor_machine: Path) -> None:
    others = "\n".join(line for line in installed_libraries().splitlines() if "libEGL" not in line)
    result = run_setup(poor_machine, "--screen", libraries=others)
    assert result.returncode == 1
    assert "apt-get install libegl1 xvfb xauth (" in result.stderr


def test_a_missing_python_is_named(poor_machine: Path) -> None:
    result = run_setup(poor_machine, libraries=installed_libraries())
    assert result.returncode == 1
    assert result.stderr.startswith("setup: Slopegate needs Python 3.11 or newer")


@pytest.mark.parametrize(("version", "taken"), [("3, 10, 14", False), ("3, 11, 0", True)])
def test_only_a_new_enough_python_is_taken(poor_machine: Path, version: str, taken: bool) -> None:
    """The real interpreter answers as python3 and says that it is another version."""
    python = poor_machine / "bin" / "python3"
    python.write_text(
        f"#!/usr/bin/env bash\n'{sys.executable}' -c \"import sys; sys.version_info = ({version}); $2\"\n"
    )
    python.chmod(0o755)
    result = run_setup(poor_machine, libraries=installed_libraries())
    assert ("making .venv" in result.stdout) is taken
    assert ("Python 3.11 or newer" in result.stderr) is not taken


@pytest.mark.parametrize("plain", [True, False])
def test_the_plain_wheel_of_opencv_leaves_before_the_other_comes(poor_machine: Path, plain: bool) -> None:
    """A .venv from before: a Python that notes what it is asked to do, with or without the plain wheel in it."""
    (poor_machine / ".venv" / "bin").mkdir(parents=True)
    python = poor_machine / ".venv" / "bin" / "python"
    python.write_text(
        "#!/usr/bin/env bash\n"
        f'case "$*" in *importlib.metadata*) exit {0 if plain else 1} ;; *pip*) echo "$*" >>asked ;; esac\n'
    )
    python.chmod(0o755)
    result = run_setup(poor_machine, libraries=installed_libraries())
    assert result.returncode == 0, result.stderr
    asked = [line.split()[2] for line in (poor_machine / "asked").read_text().splitlines()]
    assert asked == ["--version", *(["uninstall"] if plain else []), "install", "install"]
