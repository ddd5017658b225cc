"""Airlight of single rays against adaptive quadrature of its definition, for rigs and fogs of every kind."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from airlight_cases import Case, Definition, random_case
from rigs import check_rig, turned
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.airlight_exact import exact_airlight
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.media import Fog

KINDS = ("ideal", "general", "bent", "beside", "ahead")
DENORMAL = 1e-300
RIG = check_rig(64)


def window(low: float, high: float, inside: int = 1, outside: int = 0) -> RowWindows:
    counts = (np.array([count], np.int32) for count in (inside, outside))
    return RowWindows(np.array([low]), np.array([high]), *counts)


def ours(case: Case) -> float:
    one = np.zeros(1, np.int64)
    recorded = window(case.low, case.high, case.inside, case.outside)
    return float(exact_airlight(case.rig, case.fog, case.direction[None], np.array([case.depth_m]), recorded, one)[0])


def compare(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    lit = 0
    for number in range(count):
        case = random_case(random, KINDS[number % len(KINDS)])
        light = ours(case)
        recorded, whole = Definition(case).light()
        assert math.isfinite(light)
        assert light >= 0
        assert abs(light - recorded) <= 1e-6 * recorded + 1e-12 * whole + DENORMAL, (number, case)
        lit += recorded > 0
    assert lit > count / 8


def test_random_rigs_fogs_and_gates_agree_with_quadrature() -> None:
    compare(1, 200)


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_ten_thousand_random_rigs_fogs_and_gates_agree_with_quadrature() -> None:
    compare(2, 10000)


def simple_case(fog: Fog, rig: Rig = RIG, low: float = 0.0, high: float = 720.0, depth_m: float = math.inf) -> Case:
    return Case(rig, fog, rig.camera_rays(30.3, 20.7), depth_m, low, high, 1, 0)


def precise(case: Case) -> float:
    """The integral over inverse depth with 40 digits: fog everywhere before an ideal rig, between projector rows."""
    with mpmath.workdps(40):
        mp, b = mpmath.mpf, mpmath.mpf(case.rig.baseline_m)
        x, y = mp(float(case.direction[0])), mp(float(case.direction[1]))
        lens, fog = case.rig.projector.lens, case.fog
        edges = [((mp(row) - lens.cy) / lens.fy - y) / b for row in (max(case.low, 0), min(case.high, lens.height))]
        first = max(edges[0], mp(0), 1 / mp(case.depth_m) if case.depth_m < math.inf else mp(0))
        seen, extinction, g = mpmath.sqrt(x * x + y * y + 1), mp(fog.extinction_per_m), mp(fog.g)

        def light(w: mpmath.mpf) -> mpmath.mpf:
            if w == 0:
                return mp(0)
            lit = mpmath.sqrt(x * x + (y + w * b) ** 2 + 1)
            mu = -(x * x + (y + w * b) * y + 1) / (seen * lit)
            phase = (1 - g * g) / (4 * mpmath.pi * (1 + g * g - 2 * g * mu) ** mp(1.5))
            way = (seen + lit) / w
            return mp(fog.scattering_per_m) * phase * mpmath.pi * seen * lit * mpmath.exp(-extinction * way)

        return float(mpmath.quad(light, mpmath.linspace(first, max(first, edges[1]), 9)))


@pytest.mark.parametrize(
    "fog",
    [Fog(0.5), Fog(2.0, 0.3, 0.85), Fog(1e-6), Fog(100.0, 0.0, -0.7), Fog(0.3, 0.0, -0.999), Fog(1.0, 2.0, 0.999)],
)
@pytest.mark.parametrize(("low", "high", "depth_m"), [(0, 720, math.inf), (200, 260, 1.1), (250, 250.01, 3.0)])
def test_forty_digits_agree(fog: Fog, low: float, high: float, depth_m: float) -> None:
    case = simple_case(fog, low=low, high=high, depth_m=depth_m)
    assert ours(case) == pytest.approx(precise(case), rel=1e-9, abs=DENORMAL)


def test_surfaces_in_front_of_the_gate_leave_nothing() -> None:
    case = simple_case(Fog(0.5), low=200, high=260)
    whole = ours(case)
    behind, before = (ours(replace(case, depth_m=depth)) for depth in (1e4, 0.2))
    assert behind == whole
    assert before == 0


@pytest.mark.parametrize("g", [-0.999, 0.0, 0.999])
@pytest.mark.parametrize("density", [0.0, 1e-9, 1.0, 1000.0])
@pytest.mark.parametrize("offset", [(0.0, -0.1, 0.0), (0.0, 0.0, 0.3), (-0.1, 0.0, 0.0), (0.05, 0.05, -0.2)])
def test_no_bad_number_wherever_the_rig_stands(density: float, g: float, offset: tuple[float, float, float]) -> None:
    """Rays along the axis, which may pass through the projector itself, and along the faces and edges of the fog."""
    rig = turned(RIG, (0.0, 0.0, 0.0), offset)
    eye = rig.camera_centre_m
    directions = np.array([[0, 0, 1], [0.3, 0, 1], [0, -0.2, 1], offset if offset[2] > 0 else (0.1, 0.1, 1)], float)
    directions /= directions[:, 2:]
    count = len(directions)
    boxes = [
        ((-math.inf,) * 3, (math.inf,) * 3),
        (tuple(eye), tuple(eye + 1)),
        (tuple(eye - 1), tuple(eye)),
        ((-1.0, -1.0, 0.5), (1.0, 1.0, 0.5 + 1e-12)),
        ((eye[0], -1.0, -1.0), (2.0, 1.0, 2.0)),
    ]
    for lo, hi in boxes:
        fog = Fog(density, 0.0, g, tuple(map(float, lo)), tuple(map(float, hi)))
        for low, high, inside, outside in ((0, 720, 1, 0), (300, 300, 1, 0), (100, 700, 0, 1), (-50, -10, 3, 2)):
            rows = np.zeros(count, np.int64)
            light = exact_airlight(
                rig, fog, directions, np.full(count, np.inf), window(low, high, inside, outside), rows
            )
            assert np.isfinite(light).all()
            assert (light >= 0).all()
            if density == 0:
                assert (light == 0).all()


def test_fog_that_only_absorbs_scatters_nothing() -> None:
    assert ours(simple_case(Fog(0.0, 1.0))) == 0
