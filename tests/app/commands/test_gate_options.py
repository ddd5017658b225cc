"""A gate by its settings, its slab or its name: the same in every command, and what contradicts is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cli_calls import refusal, report
from scene_texts import CARD_AND_WALL, GATE_OF_CARD, card_home
from slopegate.app.rig_gates import OpenRig
from small_window import small_rig

Capture = pytest.CaptureFixture[str]

SCENE = f"""{CARD_AND_WALL}{GATE_OF_CARD}
[[gates]]
name = "All but the card"
tilt_deg = 0
distance_m = 1.0
thickness_m = 0.1
complement = true
"""
SLAB = ("--tilt-deg", "0", "--distance-m", "1", "--thickness-m", "0.1")
SETTINGS = ("--clock-mhz", "78", "--delay-us", "2028", "--exposure-us", "400")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return card_home(tmp_path, SCENE)


def words(home: Path, command: str, *more: str) -> list[str]:
    return [command, str(home / "card.toml"), "--rig", str(home / "rig.toml"), *more]


def rendered(capsys: Capture, home: Path, *gate: str) -> dict[str, object]:
    """What `render` says of the settings."""
    told = report(capsys, *words(home, "render", "--out", str(home / "o.npy"), "--overwrite", *gate))
    settings = told["settings"]
    assert isinstance(settings, dict)
    return settings


def test_slab_name_and_settings_make_the_same_picture(capsys: Capture, home: Path) -> None:
    by_slab = rendered(capsys, home, *SLAB)
    image = np.load(home / "o.npy")
    assert rendered(capsys, home, "--gate", "the CARD") == by_slab
    np.testing.assert_array_equal(np.load(home / "o.npy"), image)
    clock, delay, exposure = (str(by_slab[name]) for name in ("line_time_us", "delay_us", "exposure_us"))
    typed = ("--line-time-us", clock, "--delay-us", delay, "--exposure-us", exposure)
    assert rendered(capsys, home, *typed) == by_slab
    np.testing.assert_array_equal(np.load(home / "o.npy"), image)
    planned = OpenRig(small_rig()).plan(0, 1, 0.1).applied
    assert by_slab["delay_us"] == planned.delay_us
    assert 0 < (image > 0.5 * image.max()).mean() < 0.5, "the card and not the wall"


def test_a_plane_is_the_slab_that_plan_says(capsys: Capture, home: Path) -> None:
    plane = ("--plane", "0,-0.3,1,-1", "--thickness-m", "0.1")
    planned = report(capsys, "plan", "--rig", str(home / "rig.toml"), *plane)
    found = rendered(capsys, home, *plane)
    assert all(planned[name] == found[name] for name in ("line_time_us", "delay_us", "exposure_us"))


def test_a_named_complement_and_the_complement_of_a_name(capsys: Capture, home: Path) -> None:
    but_card = rendered(capsys, home, "--gate", "All but the card")
    image = np.load(home / "o.npy")
    assert but_card["complement"]
    assert rendered(capsys, home, "--gate", "The card", "--complement") == but_card
    np.testing.assert_array_equal(np.load(home / "o.npy"), image)
    assert not rendered(capsys, home, "--gate", "All but the card", "--complement")["complement"]
    assert not rendered(capsys, home, "--gate", "Everything lit")["complement"]


REFUSED = {
    "two ways": ((*SLAB, *SETTINGS), "--clock-mhz and --tilt-deg contradict each other"),
    "name and settings": (("--gate", "The card", "--delay-us", "3"), "--delay-us and --gate contradict each other"),
    "name and slab": (("--gate", "The card", "--tilt-deg", "3"), "--tilt-deg and --gate contradict each other"),
    "no gate": ((), "give --clock-mhz, --delay-us and --exposure-us, or instead --tilt-deg"),
    "half of the settings": (("--clock-mhz", "78"), "--clock-mhz alone is no gate"),
    "half of a slab": (("--distance-m", "1", "--thickness-m", "0.1"), "--tilt-deg and --distance-m must both be given"),
    "no thickness": (("--tilt-deg", "1", "--distance-m", "1"), "--tilt-deg needs --thickness-m"),
    "plane and tilt": (
        ("--plane", "0,0,1,-1", "--tilt-deg", "1", "--thickness-m", "1"),
        "--plane stands instead of --tilt-deg",
    ),
    "unknown": (
        ("--gate", "The cart"),
        "--gate: there is no gate 'The cart', only 'The card', 'All but the card', 'Everything lit'",
    ),
}


@pytest.mark.parametrize(("gate", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_gate_is_one_sentence(capsys: Capture, home: Path, gate: tuple[str, ...], sentence: str) -> None:
    assert sentence in refusal(capsys, *words(home, "render", "--out", str(home / "o.npy"), "--overwrite", *gate))
    assert not (home / "o.npy").exists()


def test_fog_takes_a_slab_or_a_name_without_a_thickness(capsys: Capture, home: Path) -> None:
    quick = ("--count", "2", "--frames", "2")
    by_slab = report(capsys, *words(home, "fog", "--tilt-deg", "0", "--distance-m", "1", *quick))
    by_name = report(capsys, *words(home, "fog", "--gate", "The card", *quick))
    assert by_slab["settings"] == by_name["settings"]
    told = refusal(capsys, *words(home, "fog", "--delay-us", "3"))
    assert "--delay-us alone is no gate: give --clock-mhz and --delay-us, or instead" in told
    assert "contradict" in refusal(capsys, *words(home, "fog", "--delay-us", "3", "--gate", "The card"))


def test_slices_have_the_gates_tilt_and_thickness(capsys: Capture, home: Path) -> None:
    planned = OpenRig(small_rig()).plan(-20, 1, 0.1).applied
    slab = ("--tilt-deg=-20", "--distance-m", "1", "--thickness-m", "0.1")
    told = report(capsys, *words(home, "capture", "--out", str(home / "a"), *slab))
    exposures = {item["applied"]["exposure_us"] for item in told["slices"]}
    assert {item["applied"]["line_time_us"] for item in told["slices"]} == {planned.line_time_us}
    assert planned.exposure_us * 0.5 < max(exposures) <= planned.exposure_us
    assert told["share_edges"]
    assert told["planned"] > 1
    tilted = report(capsys, *words(home, "capture", "--out", str(home / "b"), *slab, "--count", "2"))
    assert tilted["planned"] == 2
    assert tilted["slices"][0]["applied"]["line_time_us"] == planned.line_time_us
    listed = report(
        capsys, *words(home, "capture", "--out", str(home / "c"), "--gate", "The card", "--delays-us", "1000,2000")
    )
    card = OpenRig(small_rig()).plan(0, 1, 0.1).applied
    assert [item["applied"]["exposure_us"] for item in listed["slices"]] == [card.exposure_us] * 2


def test_what_a_sweep_cannot_follow_is_one_sentence(capsys: Capture, home: Path) -> None:
    def refused(*more: str) -> str:
        return refusal(capsys, *words(home, "capture", "--out", str(home / "c"), *more))

    assert "--clock-mhz and --gate contradict" in refused("--clock-mhz", "78", "--gate", "The card")
    assert "--exposure-us and --gate contradict" in refused(
        "--gate", "The card", "--delays-us", "3", "--exposure-us", "9"
    )
    assert "must both be given" in refused("--tilt-deg", "3")
    deep = ("--near-m", "1", "--far-m", "2", "--spacing", "depth")
    assert "--spacing depth needs --count beside a gate" in refused(*deep, "--gate", "The card")
    assert not (home / "c").exists()


def test_light_transport_of_a_named_gate_is_one_slice(capsys: Capture, home: Path) -> None:
    told = report(capsys, "transport", "plan", *words(home, "")[1:], "--grid", "4x2", "--count", "1")
    one = report(capsys, "transport", "plan", *words(home, "")[1:], "--grid", "4x2", "--gate", "The card")
    assert one["frames"] == told["frames"]
    two = report(
        capsys, "transport", "plan", *words(home, "")[1:], "--grid", "4x2", "--gate", "The card", "--count", "2"
    )
    assert two["frames"] > one["frames"]
    wrong = ("--gate", "The card", "--clock-mhz", "78")
    assert "contradict" in refusal(capsys, "transport", "plan", *words(home, "")[1:], *wrong)
