"""`slopegate doctor`: what this computer has, what it lacks, and what to do."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from slopegate.app.commands.options import add_json, describe
from slopegate.app.commands.report import print_json
from slopegate.app.session.log import log_path
from slopegate.app.session.preferences import default_path
from slopegate.drivers.devices.survey import Survey, families, survey
from slopegate.drivers.sync.serial_port import list_ports, permission_advice

State = Literal["good", "optional", "bad"]
PROBE_TIMEOUT_S = 30.0
LOW_SPACE_BYTES = 2 * 10**9
_SIGNS: dict[State, str] = {"good": "ok", "optional": "--", "bad": "!!"}


@dataclass(frozen=True)
class Check:
    """One thing looked at."""

    name: str
    state: State
    """optional: missing, but the program goes without."""
    found: str
    advice: str = ""


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Checks display, OpenGL, screens, serial ports, USB, camera drivers and folders, and says what to\n"
        "do where something is missing. The exit code is 1 when something is broken that the program needs; what is\n"
        "optional and missing is 0.",
        epilog="example:\n  slopegate doctor",
    )
    add_json(parser)


def run(options: Namespace) -> int:
    """Check everything; 1 when something needed is broken."""
    checks = [*check_screens(probe_screens()), *check_ports(), *check_drivers(survey()), *check_folders()]
    checks += [check_compiled(), check_bakes(), check_log()]
    broken = any(check.state == "bad" for check in checks)
    if options.json:
        print_json({"healthy": not broken, "checks": [asdict(check) for check in checks]})
        return int(broken)
    width = max(len(check.name) for check in checks)
    for check in checks:
        print(f"  {_SIGNS[check.state]}  {check.name:<{width}}  {check.found}".rstrip())
        if check.advice:
            print(f"      {'':<{width}}  {check.advice}")
    return int(broken)


def probe_screens() -> dict[str, Any] | str:
    """Screens and OpenGL as another process sees them; a sentence when that process failed."""
    command = [sys.executable, "-m", "slopegate.app.devices.screen_probe"]
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=PROBE_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"Qt did not start within {PROBE_TIMEOUT_S:g} s"
    if done.returncode == 0:
        return dict(json.loads(done.stdout))
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[0].strip() if lines else f"Qt ended with code {done.returncode}"


def check_screens(facts: dict[str, Any] | str) -> Iterator[Check]:
    """Display, projector and OpenGL."""
    if isinstance(facts, str):
        advice = "start it on a desktop; without one, 'slopegate demo' draws on a virtual display"
        if sys.platform.startswith("linux") and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            advice = "install what Qt needs: sudo apt-get install libxcb-cursor0 libxkbcommon-x11-0 libegl1 libgl1"
        yield Check("display", "bad", facts, advice)
        return
    screens = facts["screens"]
    shown = "; ".join(
        f"{screen['name']} {screen['width_px']} x {screen['height_px']} at {screen['rate_hz']:.3g} Hz"
        for screen in screens
    )
    yield Check("display", "good" if screens else "bad", shown or "no screen", "" if screens else "connect a screen")
    yield _check_projector(screens)
    error = facts["opengl"].get("error", "")
    if error:
        advice = (
            "the view in 3D stays empty, the section beside it works; install the graphics driver or libgl1-mesa-dri"
        )
        yield Check("OpenGL", "optional", error, advice)
        return
    renderer = facts["opengl"]["renderer"]
    slow = any(word in renderer.lower() for word in ("llvmpipe", "softpipe", "swrast"))
    advice = "drawn in software: the view in 3D is slow without a graphics driver" if slow else ""
    yield Check("OpenGL", "good", f"{renderer}, {facts['opengl']['version']}", advice)


def _check_projector(screens: list[dict[str, Any]]) -> Check:
    if len(screens) < 2:
        advice = "to show patterns, connect the projector as a second screen that extends the first"
        return Check("projector screen", "optional", "one screen only", advice)
    if len({(screen["x"], screen["y"]) for screen in screens}) < len(screens):
        return Check("projector screen", "bad", "screens mirror each other", "let them extend each other instead")
    last = screens[-1]
    if last["scale"] != 1:
        advice = "set it to 100 %, so that a pattern's pixels are the projector's"
        return Check("projector screen", "bad", f"{last['name']} is scaled to {100 * last['scale']:g} %", advice)
    return Check("projector screen", "good", f"{last['name']} {last['width_px']} x {last['height_px']}")


def check_ports() -> Iterator[Check]:
    """Whether this user may open the serial ports."""
    for port in list_ports():
        if os.access(port.path, os.R_OK | os.W_OK) or sys.platform == "win32":
            yield Check("serial port", "good", f"{port.path} {port.name}".strip())
        else:
            yield Check("serial port", "bad", f"{port.path} may not be opened", permission_advice(port.path))


def check_drivers(seen: Survey) -> Iterator[Check]:
    """Every family of devices: here with so many devices, or missing with what to install."""
    missing = {entry.family: entry.sentence for entry in seen.missing}
    for family in families():
        devices = [device for device in seen.found if device.family == family.key]
        if family.key in missing:
            yield Check(family.title, "optional", "not available", missing[family.key])
        else:
            yield Check(family.title, "good", f"{len(devices)} found")
        for device in devices:
            if device.problem:
                yield Check(family.title, "bad", device.name, device.problem)


def check_folders() -> Iterator[Check]:
    """Where the program writes."""
    places: tuple[tuple[str, Callable[[], Path]], ...] = (
        ("settings folder", lambda: default_path().parent),
        ("current folder", Path.cwd),
        ("temporary folder", lambda: Path(tempfile.gettempdir())),
    )
    for name, place in places:
        where = ""
        try:
            folder = place()
            where = f"{folder} "
            free = _free_bytes(folder)
        except OSError as error:
            yield _unwritable(name, where, error, "bad" if name == "temporary folder" else "optional")
            continue
        low = free < LOW_SPACE_BYTES
        advice = "captures need room: a slice takes some 4 MB" if low else ""
        yield Check(name, "good", f"{folder}, {free / 1e9:.1f} GB free", advice)


def _free_bytes(folder: Path) -> int:
    """Room in a folder, which is made if need be. Raises OSError where nothing can be written into it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".slopegate-"):
        return shutil.disk_usage(folder).free


def _unwritable(name: str, where: str, error: OSError, state: State = "optional") -> Check:
    return Check(name, state, f"{where}cannot be written ({error.strerror})", "give this user the right, or make room")


def check_compiled() -> Check:
    """Whether compiled functions are kept between two runs, and whether what is kept can be used."""
    from slopegate.drivers.files.kept_functions import damaged_functions, kept_folders  # late: they bring numba

    name, folders = "compiled code", kept_folders()
    if not folders:
        advice = "every run compiles anew, which takes seconds: let NUMBA_CACHE_DIR name a folder that can be written"
        return Check(
            name, "optional", "is not kept: neither the program's nor the user's folder can be written", advice
        )
    where = os.path.commonpath(folders)
    return _kept(name, where, damaged_functions(folders))


def check_bakes() -> Check:
    """Whether the bakes of indirect light that are kept can be used."""
    from slopegate.drivers.files.kept_arrays import damaged_arrays  # late, as above
    from slopegate.drivers.scenes.bakes import bake_folder

    name, folder = "baked light", bake_folder()
    try:
        _free_bytes(folder)
    except OSError as error:
        return _unwritable(name, f"{folder} ", error)
    return _kept(name, str(folder), damaged_arrays(folder))


def _kept(name: str, where: str, damaged: Sequence[Path]) -> Check:
    if not damaged:
        return Check(name, "good", f"kept in {where}")
    files = "1 damaged file" if len(damaged) == 1 else f"{len(damaged)} damaged files"
    advice = f"the first is {damaged[0]}; nothing is to be done: each is made anew when it is needed"
    return Check(name, "optional", f"kept in {where}, with {files}", advice)


def check_log() -> Check:
    """Where bugs are logged, and whether there have been any."""
    path = log_path()
    try:
        _free_bytes(path.parent)
    except OSError as error:
        return _unwritable("log", f"{path} ", error)
    if not path.exists():
        return Check("log", "good", f"{path}, nothing has been logged yet")
    return Check("log", "good", f"{path}, last written {datetime.fromtimestamp(path.stat().st_mtime):%Y-%m-%d %H:%M}")
