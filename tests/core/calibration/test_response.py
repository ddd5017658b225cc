"""The projector's response to grey levels, from numbers and from a practice rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from slopegate.core.calibration.chart_scene import held
from slopegate.core.calibration.response import LEVELS, response
from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.checks import InputError
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.calibrations.taking import PoseAttendance, open_gate, take_response
from slopegate.drivers.contract.projector import Projector, ProjectorInfo, Showing
from small_practice import small_chart, small_rig


def pictures(gamma: float, seed: int = 0, noise: float = 8.0, most: float = 30_000.0) -> Counts:
    """A textured wall under the levels, with ambient light and noise."""
    draw = np.random.default_rng(seed)
    wall, ambient = draw.uniform(0.2, 1.0, (60, 80)), 0.05
    light = np.array([(level / 255) ** gamma for level in LEVELS])[:, None, None]
    found = most * wall * (light + ambient) + draw.normal(0, noise, (len(LEVELS), 60, 80))
    return np.asarray(np.clip(np.rint(found), 0, 65_535), np.uint16)


@pytest.mark.parametrize("gamma", [0.6, 1.0, 1.8, 2.2, 2.8])
def test_the_exponent_is_found_within_its_error(gamma: float) -> None:
    off = []
    for seed in range(20):
        found = response(LEVELS, pictures(gamma, seed), 65_535)
        assert found.gamma == pytest.approx(gamma, abs=5e-3)
        assert found.dark_share == pytest.approx(0.05 / 1.05, abs=1e-3)
        off.append(abs(found.gamma - gamma) / found.standard_error)
    assert np.median(off) < 1.5
    assert found.linear == (gamma == 1.0)


class PowerProjector:
    """A projector that shows levels as a screen does, by a power law."""

    def __init__(self, inner: Projector, gamma: float) -> None:
        self._inner, self._gamma = inner, gamma

    @property
    def info(self) -> ProjectorInfo:
        return self._inner.info

    def load(self, patterns: Sequence[Bytes]) -> None:
        self._inner.load([np.rint(255 * (np.float64(one) / 255) ** self._gamma).astype(np.uint8) for one in patterns])

    def show(self, index: int) -> Showing:
        return self._inner.show(index)

    def black(self) -> Showing:
        return self._inner.black()

    def white(self) -> Showing:
        return self._inner.white()

    def stop(self) -> None:
        self._inner.stop()


@pytest.fixture(scope="module")
def practice() -> PracticeRig:
    rig = PracticeRig(small_rig(), small_chart(), 1)
    rig.move(held(small_chart(), (0.0, 0.02, 0.9), 15.0, -10.0))
    rig.camera.start()
    return rig


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_projector_is_asked_for_its_response(practice: PracticeRig, gamma: float) -> None:
    told: list[tuple[int, int]] = []
    attend = PoseAttendance(lambda done, count: told.append((done, count)))
    gate = open_gate(practice.believed, practice.camera.info)
    found = take_response(PowerProjector(practice.projector, gamma), practice.shots(), gate, attend)
    assert found is not None
    assert found.gamma == pytest.approx(gamma, abs=0.01)
    assert found.linear == (gamma == 1.0)
    assert told[-1] == (len(LEVELS), len(LEVELS))


def test_giving_up_tells_nothing(practice: PracticeRig) -> None:
    gate = open_gate(practice.believed, practice.camera.info)
    attend = PoseAttendance(given_up=lambda: True)
    assert take_response(practice.projector, practice.shots(), gate, attend) is None


def test_what_tells_no_response_is_refused() -> None:
    good = pictures(2.2)
    with pytest.raises(InputError, match="white saturates"):
        response(LEVELS, pictures(2.2, most=200_000), 65_535)
    with pytest.raises(InputError, match="hardly brighter than black"):
        response(LEVELS, np.repeat(good[:1], len(LEVELS), axis=0), 65_535)
    with pytest.raises(InputError, match="levels is"):
        response((0, 255), good[[0, -1]], 65_535)
    with pytest.raises(InputError, match="number of pictures"):
        response(LEVELS, good[:-1], 65_535)
