"""What is wrong with a text file is told in the program's words, not in a library's."""

from __future__ import annotations

import pytest

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.reading import json_value, toml_tables
from slopegate.drivers.files.rig_files import RigError


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"\xff{}", "a.json is not UTF-8 text: byte 0 cannot be read"),
        (b'{"a": ' + b"9" * 5000 + b"}", "a whole number in it has more than 4300 digits"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a"\n 1}', "is not valid JSON: expecting ':' delimiter (line 2, column 2)"),
    ],
)
def test_bad_json(data: bytes, why: str) -> None:
    with pytest.raises(SceneError) as caught:
        json_value(data, "a.json")
    assert why in str(caught.value)
    assert str(caught.value).startswith("a.json is not ")


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"a = '\xff'", "a.toml is not UTF-8 text: byte 5 cannot be read"),
        (b"a = " + b"9" * 5000, "a whole number in it has more than 4300 digits"),
        (b"a = " + b"[" * 100_000, "nested too deeply"),
        (b"a = ", "is not valid TOML"),
    ],
)
def test_bad_toml(data: bytes, why: str) -> None:
    with pytest.raises(RigError) as caught:
        toml_tables(data, "a.toml", RigError)
    assert why in str(caught.value)


def test_a_byte_order_mark_is_no_text() -> None:
    assert json_value(b"\xef\xbb\xbf[1]", "a", UserError) == [1]
    assert toml_tables(b"\xef\xbb\xbfa = 1", "a") == {"a": 1}
