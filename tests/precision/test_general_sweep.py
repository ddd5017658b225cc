"""Turned, shifted and distorted rigs against their own equations at 50 digits: read-outs, bounds, inverse design."""

import math

import cv2
import mpmath
import numpy as np
import pytest

from inverse_depth_bounds import inverse_depth_bounds
from slopegate.core.gating.gate import exact_upright_line_time, slab
from slopegate.core.gating.plan import plan
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
mpf = mpmath.mpf


def random_rig(rng, distorted):
    """Up to 0.3 rad of turn, a third of the baseline of sideways and forward shift, barrel to pincushion lenses."""
    scale = rng.uniform(0.3, 3)

    def lens(width, height):
        bend = rng.uniform([-0.2, -0.05, -2e-3, -2e-3, -0.01], [0.2, 0.05, 2e-3, 2e-3, 0.01]).tolist()
        centre = rng.uniform(0.3, 0.7, 2) * (width, height)
        focal = rng.uniform(0.8, 2, 2) * height
        return Lens(width, height, *focal.tolist(), *centre.tolist(), tuple(bend) if distorted else ())

    camera = RigCamera(lens(6, int(rng.integers(30, 1200))), CHECK.camera.shutter)
    projector = RigProjector(
        lens(1280, int(rng.integers(300, 2160))), float(rng.uniform(2e3, 1e5)), rng.uniform(0.5, 1)
    )
    offset = scale * np.array([rng.uniform(-0.3, 0.3), -1, rng.uniform(-0.3, 0.3)])
    turn = rng.normal(size=3)
    turn *= rng.uniform(0, 0.3) / np.linalg.norm(turn)
    rotation = tuple(map(tuple, cv2.Rodrigues(turn)[0].tolist()))
    return Rig(camera, projector, tuple(offset.tolist()), rotation)


class Exact:
    """u(X) = r_p / v_p - L r_c at 50 digits, with OpenCV's distortion spelled out."""

    def __init__(self, rig, line_time_us):
        self.rig, self.line = rig, mpf(line_time_us)
        projector = rig.projector
        self.v = projector.lens.height / (mpf(projector.active_fraction) * mpf(projector.period_us))
        self.rotation = [[mpf(float(value)) for value in row] for row in rig.rotation]
        self.offset = [mpf(value) for value in rig.projector_offset_m]

    @staticmethod
    def row(lens, point):
        x, y = point[0] / point[2], point[1] / point[2]
        k1, k2, p1, p2, k3 = (mpf(value) for value in lens.distortion or [0] * 5)
        r2 = x * x + y * y
        bent = y * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return bent * mpf(lens.fy) + mpf(lens.cy)

    def projector_row(self, scaled, w):
        """Of the point scaled / w, `scaled` and w as seen from the camera's centre."""
        seen = [part - w * shift for part, shift in zip(scaled, self.offset, strict=True)]
        turned = [sum(a * b for a, b in zip(row, seen, strict=True)) for row in self.rotation]
        return self.row(self.rig.projector.lens, turned)

    def u(self, scaled, w):
        """At the world point scaled / w."""
        camera = [part + w * shift / 2 for part, shift in zip(scaled, self.offset, strict=True)]
        return self.projector_row(camera, w) / self.v - self.line * self.row(self.rig.camera.lens, camera)

    def root(self, time, near):
        """The inverse distance on the axis at which u is `time`, next to `near`."""
        step = mpf(10) ** -12
        return mpmath.findroot(lambda w: self.u([mpf(0), mpf(0), mpf(1)], w) - time, (near, near + step), tol=1e-70)

    def normal(self, w):
        axis = [mpf(0), mpf(0), mpf(1)]
        step = mpf(10) ** -17

        def slope(index):
            moved = [[part + sign * step * (k == index) for k, part in enumerate(axis)] for sign in (-1, 1)]
            return self.u(moved[1], w) - self.u(moved[0], w)

        gradient = [slope(0), slope(1), slope(2)]
        length = mpmath.sqrt(sum(part * part for part in gradient))
        return [-part / length for part in gradient]


def random_case(rng, rig):
    """A gate whose centre lies at least a baseline away, at infinity for one in four."""
    B = rng.uniform(0.3, 3)
    line_time = B * exact_upright_line_time(rig.camera.lens, rig.projector)
    exact = Exact(rig, line_time)
    w = rng.choice([rng.uniform(0, 1), 10 ** -rng.uniform(0, 12), -(10 ** -rng.uniform(0, 12)), 0.0]) / rig.baseline_m
    delay = float(exact.u([mpf(0), mpf(0), mpf(1)], mpf(w)))
    return gate(line_time, delay, float(10 ** rng.uniform(-3, 0) * 200 / rig.projector.rows_per_us)), exact


def see_slab(worst, rng, rig, distorted):
    settings, exact = random_case(rng, rig)
    found = slab(rig, settings)
    inverses = []
    for name, sign in (("far", -1), ("distance", 0), ("near", 1)):
        got = getattr(found, f"inverse_{name}_per_m")
        time = (
            mpf(settings.delay_us) + sign * mpf(settings.exposure_us) / 2 - found.frame * mpf(rig.projector.period_us)
        )
        w = exact.root(time, mpf(got))
        inverses.append(w)
        if distorted:
            worst.see("inverse distance, distorted, times b", abs(got - w) * mpf(rig.baseline_m), 1e-13)
        else:
            worst.see("inverse distance", abs(got / w - 1) if got != w else mpf(0), 1e-12)
    normal = exact.normal(inverses[1])
    off = max(abs(a - b) for a, b in zip(found.centre.normal, normal, strict=True))
    worst.see("normal, distorted" if distorted else "normal", off, 1e-12)
    if found.thickness_m is not None and not distorted:
        worst.see("thickness", abs(found.thickness_m / (1 / inverses[0] - 1 / inverses[2]) - 1), 1e-12)
    return settings, exact, found.frame


def see_plan(worst, rng, rig, distorted):
    distance = rig.baseline_m * 10 ** rng.uniform(0.3, 2)
    tilt = math.degrees(math.atan(rng.uniform(-0.8, 0.8) * distance / rig.baseline_m))
    thickness = distance * 10 ** -rng.uniform(0.5, 5)
    settings = plan(rig, tilt, distance, thickness)
    exact = Exact(rig, settings.line_time_us)
    w = 1 / mpf(distance)
    normal = exact.normal(w)
    off = abs(mpmath.degrees(mpmath.atan2(normal[1], normal[2])) - mpf(tilt))
    worst.see("plan: tilt, degrees", off, 1e-11)
    missed = abs(exact.u([mpf(0), mpf(0), mpf(1)], w) - mpf(settings.delay_us))
    worst.see("plan: delay, us", missed, 1e-10)
    near, far = (exact.root(mpf(settings.delay_us) + sign * mpf(settings.exposure_us) / 2, w) for sign in (1, -1))
    wrong = abs((1 / far - 1 / near) / mpf(thickness) - 1) * mpf(settings.exposure_us)
    worst.see("plan: thickness, distorted, us" if distorted else "plan: thickness, us", wrong, 1e-10)


def see_bounds(worst, rng, settings, exact, frame, distorted):
    """The row that lights the point of each bound is the window's edge, in 50 digits from the camera's ray on."""
    rig = exact.rig
    low, high = inverse_depth_bounds(rig, settings, frame)
    row, column = int(rng.integers(rig.camera.lens.height)), int(rng.integers(6))
    start, end = float(low[row, column]), float(high[row, column])
    ray = [mpf(float(part)) for part in rig.camera_rays(column + 0.5, row + 0.5)]
    centre = mpf(settings.delay_us) - frame * mpf(rig.projector.period_us) + (row + mpf(0.5)) * exact.line
    for bound, sign in ((start, -1), (end, 1)):
        edge = exact.v * (centre + sign * mpf(settings.exposure_us) / 2)
        if 0 < start < end and 0 < edge < rig.projector.lens.height:
            name, allowed = ("bound, distorted, in rows", 2e-9) if distorted else ("bound, in rows", 1e-10)
            worst.see(name, abs(exact.projector_row(ray, mpf(bound)) - edge), allowed)


class Worst(dict):
    def see(self, name, error, allowed):
        assert error <= allowed, (name, float(error))
        self[name] = max(self.get(name, 0.0), float(error))


def sweep(seed, count, distorted):
    mpmath.mp.dps = 50
    rng, worst = np.random.default_rng(seed), Worst()
    for _ in range(count):
        rig = random_rig(rng, distorted)
        settings, exact, frame = see_slab(worst, rng, rig, distorted)
        see_plan(worst, rng, rig, distorted)
        see_bounds(worst, rng, settings, exact, frame, distorted)
    return worst


@pytest.mark.parametrize("distorted", [False, True], ids=["pinholes", "distorted"])
def test_general_rigs_agree_with_50_digits(distorted):
    sweep(3, 25, distorted)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("distorted", [False, True], ids=["pinholes", "distorted"])
def test_general_rigs_agree_with_50_digits_many_times(distorted):
    count = 5000
    print(f"\n{count} random general rigs and settings: largest error")
    for name, error in sweep(4, count, distorted).items():
        print(f"{name:40} {error:10.1e}")
