"""Runs a notebook without Jupyter. `python tests/support/notebook.py` runs the shipped one and keeps what it showed."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).resolve().parents[2] / "resources" / "examples" / "light_transport.ipynb"


class Shown:
    """Stands in for IPython's Image: bytes of a JPEG."""

    def __init__(self, data: bytes) -> None:
        self.data = data


def run(path: Path, folder: Path) -> list[tuple[str, list[bytes]]]:
    """What each code cell prints and shows, run in this folder in one process."""
    pictures: list[bytes] = []
    display = types.ModuleType("IPython.display")
    display.Image = Shown  # type: ignore[attr-defined]
    display.display = lambda shown: pictures.append(shown.data)  # type: ignore[attr-defined]
    before, home = {name: sys.modules.get(name) for name in ("IPython", "IPython.display")}, Path.cwd()
    sys.modules |= {"IPython": types.ModuleType("IPython"), "IPython.display": display}
    names: dict[str, Any] = {"__name__": "__main__"}
    results = []
    try:
        os.chdir(folder)
        for code in (cell for cell in json.loads(path.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"):
            pictures.clear()
            with contextlib.redirect_stdout(io.StringIO()) as said:
                exec("".join(code["source"]), names)
            results.append((said.getvalue(), pictures.copy()))
    finally:
        os.chdir(home)
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
    return results


def outputs(printed: str, pictures: list[bytes]) -> list[dict[str, Any]]:
    """The same in the notebook format (nbformat 4.5)."""
    found: list[dict[str, Any]] = []
    if printed:
        found.append({"output_type": "stream", "name": "stdout", "text": printed.splitlines(keepends=True)})
    for picture in pictures:
        data = {"image/jpeg": base64.b64encode(picture).decode("ascii")}
        found.append({"output_type": "display_data", "data": data, "metadata": {}})
    return found


def main() -> None:
    """Run the shipped notebook, and write what its cells print and show into it."""
    notebook = json.loads(NOTEBOOK.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        results = run(NOTEBOOK, Path(folder))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, (cell, result) in enumerate(zip(code, results, strict=True), 1):
        cell |= {"execution_count": number, "outputs": outputs(*result)}
    NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    main()
