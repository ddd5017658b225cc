"""IDS' uEye library through pyueye: calls that raise sentences, and values instead of references."""

from __future__ import annotations

import ctypes
import importlib
from typing import Any, Final

from slopegate.drivers.contract.camera import CameraError, CameraGoneError

INSTALL_PACKAGE: Final = "uEye cameras need the Python package pyueye: pip install 'slopegate[ueye]'."
INSTALL_LIBRARY: Final = (
    "uEye cameras need IDS' own driver (IDS Software Suite), which is not installed here, "
    "or not where PYUEYE_DLL_PATH says."
)
SUCCESS: Final = 0
MEANINGS: Final = {
    1: "the camera is not there any more",
    2: "the camera does not answer",
    3: "the camera cannot be opened",
    17: "the driver does not answer",
    101: "the camera cannot be opened",
    120: "all cameras are in use",
    122: "it took too long",
    125: "a value is not allowed",
    140: "the camera is running",
    155: "the camera cannot do that",
    178: "the camera is in use",
}
GONE: Final = {1, 2, 17}


def load_ueye() -> Any:
    """The module pyueye.ueye. Raises CameraError saying which part is missing."""
    try:
        return importlib.import_module("pyueye.ueye")
    except ModuleNotFoundError:
        raise CameraError(INSTALL_PACKAGE) from None
    except (ImportError, OSError):
        raise CameraError(INSTALL_LIBRARY) from None


def raise_for(code: int, about: str) -> None:
    """Raise the error that a return code stands for, none for success."""
    if code != SUCCESS:
        kind = CameraGoneError if code in GONE else CameraError
        raise kind(f"{about}: {MEANINGS.get(code, 'it failed')} (uEye error {code})")


class Ueye:
    """One open camera's side of the library. `name` stands in errors."""

    def __init__(self, ueye: Any, handle: int, name: str) -> None:
        self.ueye, self.handle, self.name = ueye, handle, name

    def call(self, function: str, *arguments: Any, allowed: tuple[int, ...] = ()) -> int:
        """Call is_`function` for this camera. Raises CameraError unless it succeeds or gives an allowed code."""
        code = int(getattr(self.ueye, f"is_{function}")(self.handle, *arguments))
        if code not in allowed:
            raise_for(code, f"{self.name}: is_{function}")
        return code

    def ask(self, function: str, command: int, kind: Any, count: int = 1) -> list[Any]:
        """What is_`function`(command) says: `count` values of a ctypes number."""
        values = (kind * count)()
        self.call(function, command, values, ctypes.sizeof(values))
        return list(values)

    def tell(self, function: str, command: int, value: Any) -> Any:
        """Give is_`function`(command) a ctypes number or a structure, which it may change, and return that."""
        self.call(function, command, value, ctypes.sizeof(value))
        return value
