"""The lines of OBJ and MTL files, whatever program, system and language wrote them."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_COMMENT = re.compile(r"(^|\s)#.*")


def text_of(data: bytes) -> str:
    """The text of a file: as its byte order mark says, else UTF-8, else Latin-1, in which every byte is a letter."""
    encoding = next((name for mark, name in _MARKS.items() if data.startswith(mark)), "utf-8")
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return data.decode("latin-1")


def lines_of(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are neither empty nor comments, with the number of each; a backslash at the end joins the next."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    joined, first, number, start = "", 0, 0, 0
    while start < len(text):
        end = text.find("\n", start)
        end = end if end >= 0 else len(text)
        line, start, number = text[start:end], end + 1, number + 1
        if not joined and line.lstrip()[:1] in {"", "#"}:
            continue
        first = first if joined else number
        if line.endswith("\\"):
            joined += line[:-1] + " "
            continue
        if whole := (joined + line).strip():
            yield first, whole
        joined = ""
    if joined.strip():
        yield first, joined


def keyword(line: str) -> tuple[str, str]:
    """The line's first word, and what follows it; a number sign within stays, since names may hold one."""
    word, *rest = line.split(None, 1)
    return word, rest[0].rstrip() if rest else ""


def uncommented(text: str) -> str:
    """The text without a comment at its end: a number sign after a blank, and what follows."""
    return _COMMENT.sub("", text) if "#" in text else text
