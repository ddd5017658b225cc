"""Random rigs, fogs and gates for airlight, and the light along a ray by adaptive quadrature of its definition."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from rigs import CAMERA_BARREL, FINE_LINES, PROJECTOR_BARREL, shutter
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector
from slopegate.core.scene.media import Fog

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    rig: Rig
    fog: Fog
    direction: Floats
    depth_m: float
    low: float
    high: float
    inside: int
    outside: int


def random_rig(random: np.random.Generator, kind: str) -> Rig:
    """ideal, general, bent (distorted lenses), beside (rows nearly along the baseline), ahead (seen by the camera)."""
    width, height = 64, 48
    focal = random.uniform(40, 120)
    barrel = CAMERA_BARREL if kind == "bent" else ()
    camera = Lens(width, height, focal, focal * 1.01, width / 2 + random.normal(), height / 2 + random.normal(), barrel)
    f = random.uniform(500, 1500)
    lens = Lens(1280, 720, f, f, 640 + random.normal(0, 20), 360.0, PROJECTOR_BARREL if kind == "bent" else ())
    offset = (0.0, -random.uniform(0.02, 0.5), 0.0)
    turn = np.zeros(3)
    if kind in ("general", "bent"):
        offset = tuple(random.normal(0, (0.05, 0.1, 0.03)))
        turn = random.normal(0, 0.06, 3)
    elif kind == "beside":
        offset = (random.choice([-1, 1]) * random.uniform(0.05, 0.3), random.choice([0.0, -1e-6, 1e-4]), 0.0)
    elif kind == "ahead":
        offset = (random.normal(0, 0.1), random.normal(0, 0.1), random.uniform(0.1, 0.6) * random.choice([-1, 1]))
        turn = random.normal(0, 0.2, 3) + random.choice([0, np.pi]) * np.array([0, 1.0, 0])
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    return Rig(
        RigCamera(camera, shutter(FINE_LINES)),
        RigProjector(lens, 16666.7, 0.92),
        tuple(float(v) for v in offset),  # type: ignore[arg-type]
        tuple(tuple(map(float, row)) for row in rotation),  # type: ignore[arg-type]
    )


def random_fog(random: np.random.Generator, rig: Rig) -> Fog:
    density = float(random.choice([random.uniform(0, 2), 10 ** random.uniform(-6, 3), 1000.0]))
    share = float(random.choice([1.0, random.uniform(0, 1), 0.0], p=[0.45, 0.5, 0.05]))
    g = float(random.choice([0.0, random.uniform(-0.95, 0.95), 0.999, -0.999, random.uniform(0.7, 0.99)]))
    eye, light = rig.camera_centre_m, rig.projector_centre_m
    lo, hi = np.full(3, -np.inf), np.full(3, np.inf)
    match random.integers(5):
        case 0:
            lo[2] = 0.0  # the default: everything before the rig, which stands on its border
        case 1:
            lo, hi = random.uniform(-1, 0, 3), random.uniform(0.2, 2, 3)
            lo[2], hi[2] = sorted(random.uniform(0.1, 3, 2))
        case 2:
            middle = random.uniform(-0.3, 0.3, 3) + np.array([0, 0, 0.5])
            lo, hi = middle - random.uniform(0.1, 1, 3), middle + random.uniform(0.1, 1, 3)
        case 3:
            k = random.integers(3)
            lo[k] = eye[k] if random.random() < 0.5 else light[k]
            hi[k] = lo[k] + random.uniform(0.5, 3)
    scattering = min(density * share, 1000.0)
    return Fog(scattering, min(density - scattering, 1000.0), g, tuple(map(float, lo)), tuple(map(float, hi)))  # type: ignore[arg-type]


def random_case(random: np.random.Generator, kind: str) -> Case:
    rig = random_rig(random, kind)
    fog = random_fog(random, rig)
    lens = rig.camera.lens
    direction = rig.camera_rays(random.uniform(0, lens.width), random.uniform(0, lens.height))
    if random.random() < 0.1:
        direction[: random.integers(1, 3)] = 0.0  # along the box's faces
    depth = math.inf if random.random() < 0.3 else float(10 ** random.uniform(-0.7, 1))
    low, high = sorted(random.uniform(-100, 1000, 2))
    if random.random() < 0.3:
        high = low + 10 ** random.uniform(-2, 1.5)
    inside, outside = [(1, 0), (0, 1), (2, 1), (1, 2)][random.integers(4)]
    return Case(rig, fog, direction, depth, float(low), float(high), inside, outside)


class Definition:
    """The light along one ray as `../light.md` and the references define it: by distance, point by point, in metres."""

    def __init__(self, case: Case) -> None:
        self.case, rig = case, case.rig
        self.eye, self.centre = rig.camera_centre_m, rig.projector_centre_m
        self.along = case.direction
        self.length = float(np.linalg.norm(self.along))
        self.turn = np.array(rig.projector_rotation)

    def inside(self, start: Floats, end: Floats) -> float:
        """Metres of a segment within the fog, by clipping one side after the other."""
        a, b = 0.0, 1.0
        step = end - start
        for k in range(3):
            for side, sign in ((self.case.fog.lo_m[k], 1.0), (self.case.fog.hi_m[k], -1.0)):
                if not math.isfinite(side):
                    continue
                at, after = sign * (start[k] - side), sign * (end[k] - side)
                if at < 0 and after < 0:
                    return 0.0
                if at < 0:
                    a = max(a, at / (at - after))
                elif after < 0:
                    b = min(b, at / (at - after))
        return max(b - a, 0.0) * float(np.linalg.norm(step))

    def per_metre(self, z: float) -> float:
        """Light scattered per metre of depth at depth z, where it is lit."""
        fog, point = self.case.fog, self.eye + z * self.along
        beam = point - self.centre
        own = self.turn @ beam
        distance = float(np.linalg.norm(beam))
        if own[2] <= 0:
            return 0.0
        cosine = own[2] / distance
        mu = float(-(beam @ self.along) / (distance * self.length))
        phase = (1 - fog.g**2) / (4 * math.pi) / (1 + fog.g**2 - 2 * fog.g * mu) ** 1.5
        way = self.inside(self.centre, point) + self.inside(self.eye, point)
        return (
            fog.scattering_per_m
            * phase
            * math.pi
            / (own[2] ** 2 * cosine)
            * math.exp(-fog.extinction_per_m * way)
            * self.length
        )

    def borders(self) -> list[Callable[[Any], Any]]:
        """Functions of depths that change sign where something begins or ends: box, raster, window."""
        rig, case = self.case.rig, self.case
        lens = rig.projector.lens

        def place(index: int, of: float) -> Callable[[Any], Any]:
            return lambda z: rig.to_projector(self.eye + np.multiply.outer(z, self.along))[index] - of

        found = [place(0, 0), place(0, lens.width), place(1, 0), place(1, lens.height)]
        found += [place(1, case.low), place(1, case.high)]
        for k in range(3):
            for side in (case.fog.lo_m[k], case.fog.hi_m[k]):
                if math.isfinite(side):
                    found.append(lambda z, k=k, side=side: self.eye[k] + z * self.along[k] - side)
        return found

    def counts(self, z: float) -> tuple[int, int]:
        """How often the place at depth z is recorded, and by a camera without a gate."""
        rig, case, fog = self.case.rig, self.case, self.case.fog
        point = self.eye + z * self.along
        if any(not lo <= p <= hi for lo, p, hi in zip(fog.lo_m, point, fog.hi_m, strict=True)):
            return 0, 0
        column, row, _ = (float(v) for v in rig.to_projector(point))
        lens = rig.projector.lens
        own = self.turn @ (point - self.centre)
        near = own[2] > 0 and abs(own[0] / own[2]) < 2 and abs(own[1] / own[2]) < 2  # not a fold of the distorted lens
        if not (near and 0 <= column < lens.width and 0 <= row < lens.height):
            return 0, 0
        return (case.inside if case.low <= row < case.high else case.outside), 1

    def pieces(self) -> list[float]:
        """Depths between which nothing begins or ends, from the camera to the surface or very far."""
        end = min(self.case.depth_m, 1e7)
        scan = np.concatenate([[1e-13], np.geomspace(1e-6, 1e7, 400)])
        towards = float(self.turn[2] @ self.along)
        plane = float(self.turn[2] @ (self.centre - self.eye)) / towards if towards else -1.0
        if plane > 0:
            # Near the plane through the projector rows and columns run through all numbers within a short way.
            near = np.geomspace(1e-13, 1, 400)
            scan = np.concatenate([scan, plane * (1 + near), plane * (1 - near)])
        scan = np.unique(scan)
        scan = np.append(scan[(scan >= 1e-13) & (scan < end)], end)
        cuts = [scan[0], end]
        for border in self.borders():
            values = border(scan)
            for i in np.flatnonzero(values[:-1] * values[1:] < 0):
                cuts.append(brentq(border, scan[i], scan[i + 1], xtol=1e-16, rtol=1e-15))
        return sorted(cuts)

    def light(self) -> tuple[float, float]:
        """What is recorded, and what without a gate: adaptive quadrature, finer towards the near end of each piece."""
        gated = whole = 0.0
        for near, far in pairwise(self.pieces()):
            times, lit = self.counts(math.sqrt(near * far))
            if not lit or far <= near:
                continue
            part = sum(self.quadrature(a, b) for a, b in pairwise(self.steps(near, far)))
            gated, whole = gated + times * part, whole + part
        return gated, whole

    def steps(self, near: float, far: float) -> Sequence[float]:
        """Steps that grow from the near end, the smallest as long as dense fog reaches."""
        first = min(far - near, 0.01 / max(self.case.fog.extinction_per_m, 0.01))
        steps = [near]
        while steps[-1] < far:
            steps.append(min(steps[-1] + first, far))
            first *= 3
        return steps

    def quadrature(self, a: float, b: float) -> float:
        # full_output: no warning where rounding keeps it from 1e-9; what the comparison asks for is 1e-6.
        return float(quad(self.per_metre, a, b, epsabs=0, epsrel=1e-9, limit=200, full_output=1)[0])
