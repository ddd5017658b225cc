"""What is told to the user holds nothing that a terminal obeys, and no end of characters."""

from __future__ import annotations

import pytest

from slopegate.core.rig.checks import (
    LONGEST_NAME,
    LONGEST_SENTENCE,
    LONGEST_WORD,
    InputError,
    UserError,
    plain_name,
    printable,
    shown,
)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("delay_us is 3: it must be below 2", "delay_us is 3: it must be below 2"),
        ("caf\u00e9 \u2009 \u00b5s", "caf\u00e9 \u2009 \u00b5s"),
        ("key \x1b[31m\x07 of \x9b", "key \\x1b[31m\\x07 of \\x9b"),
        ("M\udcf6bel.ply \ud800", "M\\xf6bel.ply \\ud800"),
        ("right \u202eto left\u2028", "right \\u202eto left\\u2028"),
        ("two\nlines", "two\nlines"),
    ],
)
def test_nothing_in_a_sentence_is_obeyed(text: str, told: str) -> None:
    assert printable(text) == told
    assert printable(told) == told
    assert str(UserError(text)) == told
    assert f"{InputError(text)}" == told


def test_endless_keys_and_numbers_are_cut_in_the_middle() -> None:
    told = printable(f"key {'9' * 5000}end is not allowed: it must be below 2")
    assert len(told) < LONGEST_WORD + 60
    assert told.startswith("key 999")
    assert told.endswith("end is not allowed: it must be below 2")
    assert len(printable("many words " * 10_000)) <= LONGEST_SENTENCE


def test_a_value_is_quoted_in_short() -> None:
    assert shown("\x1b[2J") == r"'\x1b[2J'"
    assert len(shown("x" * 100_000)) == 60


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Card and wall", "Card and wall"),
        ("Pasted\x0btitle", "Pasted title"),
        ("two\nlines\x1b[31m\x00", "two lines[31m"),
        ("cut off \x7f", "cut off"),
        ("M\udcf6bel", "M\\xf6bel"),
        ("right \u202eto left \ufffe", "right \\u202eto left \\ufffe"),
    ],
)
def test_a_name_can_be_written_anywhere(text: str, name: str) -> None:
    assert plain_name(text) == name == plain_name(name)
    assert len(plain_name("x" * 10_000)) == LONGEST_NAME
