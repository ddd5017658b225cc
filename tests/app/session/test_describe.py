"""What is said in words."""

from __future__ import annotations

import pytest

from slopegate.app.session.describe import as_sentence
from slopegate.core.rig.checks import InputError


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ("the picture is dark", "The picture is dark."),
        (InputError("no folder is named: poses are kept in one"), "No folder is named: poses are kept in one."),
        ("pose_02 does not fit", "pose_02 does not fit."),
        ("poses/pose_01 is no folder", "poses/pose_01 is no folder."),
        ("Looking at the plane ...", "Looking at the plane ..."),
        ("Done.", "Done."),
        ("", ""),
    ],
)
def test_a_sentence_has_a_capital_and_one_full_stop(said: object, sentence: str) -> None:
    assert as_sentence(said) == sentence
