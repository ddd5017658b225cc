"""Tables of text with a heading, as commands and the bench print them."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table: the first column to the left, the others to the right; nothing without rows."""
    if not rows:
        return ""
    table = [list(headings), *map(list, rows)]
    widths = [max(len(cells[column]) for cells in table) for column in range(len(headings))]
    lines = [
        "  ".join(
            [cells[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True))]
        )
        for cells in table
    ]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
