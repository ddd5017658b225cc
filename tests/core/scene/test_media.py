"""Fog and materials: what they refuse, and how visibility and extinction belong together."""

from __future__ import annotations

import math

import pytest

from slopegate.core.rig.checks import InputError
from slopegate.core.scene.materials import Gloss, Skin, SkinLobe
from slopegate.core.scene.media import Fog, extinction_of


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"scattering_per_m": -1.0}, "scattering_per_m is -1.0"),
        ({"scattering_per_m": 2000.0}, "mean free path"),
        ({"scattering_per_m": math.nan}, "scattering_per_m is nan"),
        ({"scattering_per_m": 1.0, "absorption_per_m": 1e4}, "absorption_per_m is 10000.0"),
        ({"scattering_per_m": 1.0, "g": 1.0}, "g is 1.0"),
        ({"scattering_per_m": 1.0, "lo_m": (0.0, 0.0, 2.0), "hi_m": (1.0, 1.0, 1.0)}, "along z"),
    ],
)
def test_fog_refuses_what_has_no_meaning_by_name(values: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=named):
        Fog(**values)  # type: ignore[arg-type]


def test_at_the_visibility_two_percent_are_left() -> None:
    fog = Fog(scattering_per_m=0.5, absorption_per_m=0.25)
    assert math.exp(-fog.extinction_per_m * fog.visibility_m) == pytest.approx(0.02)
    assert extinction_of(fog.visibility_m) == pytest.approx(0.75)
    assert Fog(0.0).visibility_m == math.inf


def test_skin_sends_back_no_more_than_it_gets() -> None:
    with pytest.raises(InputError, match="at most 1 per colour"):
        Skin((SkinLobe(1.0, (0.6, 0.2, 0.1)), SkinLobe(2.0, (0.5, 0.1, 0.1))))


def test_gloss_is_a_share() -> None:
    with pytest.raises(InputError, match=r"gloss is 1\.5"):
        Gloss(1.5)
