"""The shape of the project: who may import whom, how long things get, what no file may hold.

Every rule is a function from text to complaints, so that each is tried on a sample that breaks it.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
OWNERS = packages_distributions()
LAYERS = ("app", "core", "drivers")
FUNCTION_LINES = 60
PLAIN_FIELDS = {"QSpinBox", "QDoubleSpinBox", "QComboBox", "QSlider", "QDial", "getDouble", "getInt"}
COMPILERS = {"jit", "njit", "cfunc", "guvectorize", "stencil", "vectorize"}

# Vendors' packages: not everybody has them, and a machine without them must run everything else.
SDKS = {
    "genicam",
    "gi",
    "harvesters",
    "ids_peak",
    "ids_peak_ipl",
    "pypylon",
    "pyueye",
    "vmbpy",
}
# These too wait until somebody looks for devices, though every installation has them.
LATE = {*SDKS, "libusb_package", "serial", "usb"}
FILE_CALLS = {"open", "imread", "imwrite", "fromfile", "tofile", "save", "savez", "savetxt", "loadtxt", "genfromtxt"}
FILE_CALLS_OF_NUMPY = {"load", "memmap"}

# Spelled so that this file does not hold what it looks for.
UNWANTED = {
    "an unfinished note": re.compile("|".join(rf"\b{word}\b" for word in ("TO" + "DO", "FIX" + "ME", "X" + "XX"))),
    "a path of one machine": re.compile(
        r"(?<![\w.~}*])/(?:work|farm|root|tmp|home|Users)" + r"/[\w.]|\b[A-Z]:\\\\?Users"
    ),
    "a package registry's host": re.compile(
        "python" + r"hosted|pypi" + r"\.org|registry\.npm" + "js|deb" + r"\.debian"
    ),
}
BINARY = {".bmp", ".exr", ".glb", ".ico", ".jpg", ".jpeg", ".npy", ".npz", ".ply", ".png", ".stl", ".tif", ".webp"}


def tracked_files() -> list[Path]:
    """What belongs to the project: what git would commit, or without git the whole tree but for hidden folders."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
        found = [ROOT / name for name in names if name]
    except (OSError, subprocess.CalledProcessError):
        found = [path for path in ROOT.rglob("*") if not any(part.startswith(".") for part in path.parts)]
    return [path for path in found if path.is_file() and not path.is_symlink()]


def layer_modules(*layers: str) -> list[Path]:
    return [path for layer in layers for path in sorted((ROOT / layer).rglob("*.py"))]


@cache
def parsed(source: str) -> ast.Module:
    """A file's tree, made once for all rules."""
    return ast.parse(source)


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Full names of what is imported anywhere below."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module


def bare_imports(source: str) -> list[str]:
    """Imports of this project's layers by their folder names, which would load them a second time."""
    return [name for name in imported_names(parsed(source)) if name.split(".")[0] in LAYERS]


def early_sdk_imports(source: str) -> list[str]:
    """Imports of SDKs and of ways to devices that run when the module is imported: those outside functions."""
    tree = parsed(source)
    inside = {id(child) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) for child in ast.walk(node)}
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.stmt) and id(node) not in inside]
    simple = [node for node in statements if isinstance(node, ast.Import | ast.ImportFrom)]
    return [name for node in simple for name in imported_names(node) if name.split(".")[0] in LATE]


def distribution_name(text: str) -> str:
    """The normalised name that a requirement or a distribution starts with."""
    return re.sub(r"[-_.]+", "-", re.split(r"[^\w.-]", text, maxsplit=1)[0]).lower()


def undeclared_imports(source: str) -> list[str]:
    """Imports that neither Python brings nor pyproject.toml asks for: a clean machine lacks them."""
    names = {name.split(".")[0] for name in imported_names(parsed(source))}
    declared = {distribution_name(line) for line in PROJECT["project"]["dependencies"]}
    foreign = sorted(names - sys.stdlib_module_names - SDKS - {"slopegate"})
    return [name for name in foreign if declared.isdisjoint(map(distribution_name, OWNERS.get(name, [name])))]


def impure_code(source: str) -> list[str]:
    """File access and writable module state, by name."""
    complaints = []
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Global):
            complaints.append(f"line {node.lineno}: global {', '.join(node.names)}")
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            owner, _, last = name.rpartition(".")
            if last in FILE_CALLS or (owner in ("np", "numpy") and last in FILE_CALLS_OF_NUMPY):
                complaints.append(f"line {node.lineno}: {name}(...)")
    return complaints


def long_code(source: str) -> list[str]:
    """Functions beyond the limit. A file is as long as its subject."""
    complaints = []
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
            length = node.end_lineno - node.lineno + 1
            if length > FUNCTION_LINES:
                complaints.append(f"{node.name} has {length} lines, allowed are {FUNCTION_LINES}")
    return complaints


def busy_package(source: str) -> list[str]:
    """Anything but a docstring in an __init__.py: names have one home."""
    body = parsed(source).body
    return [
        ast.unparse(node) for node in body if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    ]


def unwanted_text(source: str) -> list[str]:
    return [
        f"line {number}: {what}"
        for number, line in enumerate(source.splitlines(), 1)
        for what, pattern in UNWANTED.items()
        if pattern.search(line)
    ]


def bare_modules(modules: dict[str, ModuleType]) -> list[str]:
    """Loaded modules of this project that go by a folder's name."""
    own = [
        name for name, module in modules.items() if str(getattr(module, "__file__", None) or "").startswith(str(ROOT))
    ]
    return [name for name in own if name.split(".")[0] in LAYERS]


def plain_fields(source: str) -> list[str]:
    """Fields for numbers and choices of Qt's own: they read what is typed as the desktop does, and follow the wheel."""
    calls = (node for node in ast.walk(parsed(source)) if isinstance(node, ast.Call))
    return [name for name in (ast.unparse(call.func) for call in calls) if name.rpartition(".")[2] in PLAIN_FIELDS]


def own_compilers(source: str) -> list[str]:
    """What numba compiles with, taken from numba itself: it stops where its files are damaged or cannot be written."""
    tree = parsed(source)
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == "numba"]
    taken = [alias.name for node in imports for alias in node.names if alias.name in COMPILERS]
    used = [ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return taken + [name for name in used if name in {f"numba.{compiler}" for compiler in COMPILERS}]


def complaints(rule: Callable[[str], list[str]], paths: list[Path]) -> list[str]:
    assert paths
    return [f"{path.relative_to(ROOT)}: {text}" for path in paths for text in rule(path.read_text(encoding="utf-8"))]


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """The import contracts of pyproject.toml, tried on the packages of a folder."""
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run()"]
    command += ["--no-logo", "--no-cache", "--config", str(ROOT / "pyproject.toml")]
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run(command, cwd=folder, env=environment, check=False, capture_output=True, text=True)


def test_imports_keep_their_direction() -> None:
    result = lint_imports(ROOT / ".typing")
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("core/rig/bad.py", "from slopegate.drivers.contract import frame", "Imports go"),
        ("drivers/files/bad.py", "from slopegate.app.window import window", "Imports go"),
        ("core/rig/bad.py", "from slopegate.core.gating import gate", "Rooms of core"),
        ("drivers/contract/bad.py", "from slopegate.drivers.cameras import virtual", "Rooms of drivers"),
        ("app/widgets/bad.py", "def f():\n    from slopegate.app.session import session", "Rooms of app"),
        ("core/attic/__init__.py", "", "Rooms of core"),
        ("core/rig/bad.py", "import time", "core computes"),
        ("core/rig/bad.py", "def f():\n    from pathlib import Path", "core computes"),
        ("core/rig/bad.py", "from PySide6.QtCore import QObject", "core computes"),
        ("drivers/files/bad.py", "import pyqtgraph.opengl", "drivers know"),
    ],
)
def test_a_forbidden_import_is_seen(tmp_path: Path, module: str, line: str, contract: str) -> None:
    for module_path in layer_modules(*LAYERS):
        path = tmp_path / "slopegate" / module_path.relative_to(ROOT)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    bad = tmp_path / "slopegate" / module
    bad.parent.mkdir(exist_ok=True)
    bad.write_text(line)
    result = lint_imports(tmp_path)
    assert result.returncode == 1, result.stdout + result.stderr
    assert re.search(rf"{contract}.* BROKEN", result.stdout)


def test_the_tests_mirror_the_rooms() -> None:
    for layer in LAYERS:
        rooms = {path.parent.relative_to(ROOT) for path in (ROOT / layer).glob("*/__init__.py")}
        tested = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests" / layer).glob("*/test_*.py")}
        assert rooms == tested


def test_core_touches_no_file_and_keeps_no_state() -> None:
    assert complaints(impure_code, layer_modules("core")) == []


def test_functions_are_short() -> None:
    assert complaints(long_code, layer_modules(*LAYERS)) == []


def test_one_class_name_stands_for_one_thing() -> None:
    homes: dict[str, list[str]] = {}
    for path in layer_modules(*LAYERS):
        for node in ast.walk(parsed(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in homes.items() if len(paths) > 1} == {}


def test_fields_are_those_of_the_widgets() -> None:
    assert complaints(plain_fields, layer_modules("app")) == []


def test_kernels_are_compiled_in_one_way() -> None:
    others = [path for path in layer_modules(*LAYERS) if path.parent != ROOT / "core" / "compiled"]
    assert complaints(own_compilers, others) == []


def test_packages_hold_nothing_but_their_docstring() -> None:
    assert complaints(busy_package, [path for path in layer_modules(*LAYERS) if path.name == "__init__.py"]) == []


def test_sdks_are_imported_late() -> None:
    assert complaints(early_sdk_imports, layer_modules(*LAYERS)) == []


def test_imported_packages_are_asked_for() -> None:
    assert complaints(undeclared_imports, layer_modules(*LAYERS)) == []


def test_the_layers_are_never_imported_bare() -> None:
    assert complaints(bare_imports, [path for path in tracked_files() if path.suffix == ".py"]) == []
    assert bare_modules(dict(sys.modules)) == []


def test_files_hold_nothing_unwanted() -> None:
    texts = [path for path in tracked_files() if path.suffix.lower() not in BINARY]
    assert complaints(unwanted_text, texts) == []


def test_every_package_is_installed() -> None:
    """A folder with modules that pyproject.toml does not list works in a checkout and is missing from a wheel."""
    setuptools = PROJECT["tool"]["setuptools"]
    folders = {path.parent.relative_to(ROOT).as_posix() for path in layer_modules(*LAYERS, "resources")}
    assert {"slopegate." + folder.replace("/", ".") for folder in folders} == set(setuptools["packages"])
    assert {folder.split("/")[0] for folder in folders} == set(setuptools["package-dir"].values())


@pytest.mark.parametrize(
    ("rule", "bad", "good"),
    [
        (bare_imports, "from core.rig import Rig", "from slopegate.core.rig.rig import Rig"),
        (bare_imports, "def f():\n    import drivers", "import core_tools"),
        (
            early_sdk_imports,
            "try:\n    import harvesters.core\nexcept ImportError: pass",
            "def f():\n    import usb.core",
        ),
        (early_sdk_imports, "class A:\n    from pyueye import ueye", "import used"),
        (undeclared_imports, "import pytest", "import cv2, os.path, PySide6.QtCore, slopegate.core, usb.core"),
        (undeclared_imports, "def f():\n    from hypothesis import given", "from OpenEXR import File"),
        (impure_code, "with open('x') as f: pass", "reopen('x')"),
        (impure_code, "numpy.load('x')", "beam.load('x')"),
        (impure_code, "cv2.imread('x')", "cv2.remap(x)"),
        (impure_code, "def f():\n    global COUNT", "COUNT = 3"),
        (plain_fields, "box = QSpinBox()", "box = CountBox()"),
        (plain_fields, "QtWidgets.QInputDialog.getDouble(window)", "class ChoiceBox(QComboBox): pass"),
        (own_compilers, "from numba import njit, prange", "from slopegate.core.compiled.kept import njit"),
        (own_compilers, "import numba\n@numba.njit(cache=True)\ndef f(): pass", "numba.__version__"),
        (long_code, "def f():\n" + " x\n" * FUNCTION_LINES, "def f():\n" + " x\n" * (FUNCTION_LINES - 1)),
        (busy_package, "'''Doc.'''\nfrom a import b", "'''Doc.'''"),
        (unwanted_text, "# TO" + "DO: later", "mastodon"),
        (unwanted_text, "see /ro" + "ot/x", "see ./root/x"),
        (unwanted_text, "'/ho" + "me/someone/x'", "~/home/x"),
        (unwanted_text, "https://pypi" + ".org/simple", "https://semver.org"),
    ],
)
def test_each_rule_tells_bad_from_good(rule: Callable[[str], list[str]], bad: str, good: str) -> None:
    assert rule(bad) != []
    assert rule(good) == []


def test_a_bare_module_is_seen() -> None:
    module = ModuleType("core.rig")
    module.__file__ = str(ROOT / "core" / "rig.py")
    assert bare_modules({"core.rig": module}) == ["core.rig"]
    assert bare_modules({"slopegate.core.rig.rig": module, "core": ModuleType("core")}) == []
