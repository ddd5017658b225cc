"""What is told of a failure that the system, a library or the program itself did not put into a sentence."""

from __future__ import annotations

import errno
import os
import re
from typing import Final

from slopegate.core.rig.checks import escaped, shortened

_LONGEST: Final = 160
_NUMBERED: Final = re.compile(r"^(\[Errno [^\]]*\] *)+")
_PLACES: Final = re.compile(r" : | \(file '|: \(\d+, '")
"""Behind these GenApi tells its own files and lines, and pyserial quotes another error."""


def words_of(error: BaseException) -> str:
    """What the system or a library says of its failure, as a sentence quotes it: the system's words where it has any.

    Else the first part of what the library says, on one line, without its own places, number and full stop.
    """
    number = getattr(error, "errno", None)
    if isinstance(number, int) and number in errno.errorcode:
        return os.strerror(number)
    line = " ".join(str(getattr(error, "message", error)).split())  # GLib's words are in the message
    said = _PLACES.split(_NUMBERED.sub("", line))[0].rstrip(" .:")
    return shortened(escaped(said), _LONGEST) or type(error).__name__


def fault_inside(error: Exception) -> str:
    """The end of a sentence on what failed through no fault of the user's; the caller logs it with its traceback."""
    if isinstance(error, MemoryError):
        return "failed: there is not enough memory for it"
    return f"failed inside the program ({type(error).__name__}): the log has the details"
