"""What is told to the user in one sentence, and the checks of single values."""

from __future__ import annotations

import math
import re
import unicodedata
from typing import Final

LONGEST_NAME: Final = 200
LONGEST_WORD: Final = 400
LONGEST_SENTENCE: Final = 2000
"""In characters, of what the user is told: a file may hold a key or a number of any length."""


def escaped(text: str, allowed: str = "") -> str:
    """The text with \\x1b and the like for every character that a terminal would obey instead of showing it."""
    if text.isprintable():
        return text
    return "".join(one if one in allowed or _is_shown(one) else _escape(one) for one in text)


def _is_shown(one: str) -> bool:
    return one.isprintable() or unicodedata.category(one) == "Zs"


def _escape(one: str) -> str:
    if "\udc80" <= one <= "\udcff":  # a byte of a file's name that is not UTF-8, as Python keeps it
        return f"\\x{ord(one) - 0xDC00:02x}"
    return one.encode("unicode_escape").decode("ascii")


def shortened(text: str, longest: int) -> str:
    """The text, or where it is longer than that its beginning and its end."""
    tail = longest // 3
    return text if len(text) <= longest else f"{text[: longest - tail - 3]}...{text[-tail:]}"


def printable(text: str) -> str:
    """The text as a sentence may quote it: nothing that a terminal would obey, no endless word, no endless text."""
    if len(text) <= LONGEST_WORD and text.isprintable():
        return text
    words = re.split(r"([ \n]+)", escaped(text, allowed="\n"))
    return shortened("".join(shortened(word, LONGEST_WORD) for word in words), LONGEST_SENTENCE)


def plain_name(text: str, longest: int = LONGEST_NAME) -> str:
    """A name that can be shown and written anywhere, in XML too: of one line, without control characters, and short."""
    kept = "".join(one for one in text if one.isspace() or unicodedata.category(one) != "Cc")
    return shortened(escaped(" ".join(kept.split())), longest)


class UserError(Exception):
    """What the user can mend, told in one sentence. Every other exception is a bug of the program: it is logged.

    The sentence may quote whatever a file holds: `str` gives it `printable`.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class InputError(UserError, ValueError):
    """A value that is not allowed: the sentence names the field, the value and what is allowed.

    For values that come from outside. Parts of the program that hand each other arrays which do not fit raise a plain
    ValueError or RuntimeError: those are bugs.
    """


def shown(value: object) -> str:
    """The value as a sentence quotes it: at most 60 characters."""
    try:
        text = repr(value)
    except RecursionError:
        return "nested too deeply"
    return text if len(text) <= 60 else text[:57] + "..."


def require(ok: bool, field: str, value: object, allowed: str) -> None:
    """Raise InputError with one sentence unless `ok`."""
    if not ok:
        raise InputError(f"{field} is {value!r}: it must be {allowed}")


def require_finite(field: str, value: float) -> None:
    """Raise InputError unless the value is a finite number."""
    require(math.isfinite(value), field, value, "a finite number")


def require_positive(field: str, value: float) -> None:
    """Raise InputError unless the value is a finite number above zero."""
    require(math.isfinite(value) and value > 0, field, value, "a finite number above 0")


def require_rectangle(field: str, region: tuple[int, int, int, int], width: int, height: int) -> None:
    """Raise InputError unless x0, y0, x1, y1 in pixels, without x1 and y1 themselves, lie inside the image."""
    x0, y0, x1, y1 = region
    allowed = f"x0, y0, x1, y1 with x0 < x1 and y0 < y1, inside the image of {width} x {height} pixels"
    require(0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height, field, tuple(region), allowed)
