"""How cost grows: with pixels, with objects, with threads, and what skipping tiles saves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np

from slopegate.app.bench.measure import core_clock
from slopegate.app.bench.number_types import FramePath, default_path
from slopegate.app.bench.subject import Sight, Subject, make_subject
from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import make_planes
from slopegate.core.render.render import make_tracer
from slopegate.core.render.tracing import RAYS_PER_BAND
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Mesh, Scene, Sphere
from slopegate.core.scene.shapes import Finish, box, plane, turn

WALL_M = 1.9


def clutter(count: int, seed: int = 0) -> Scene:
    """`count` boxes and spheres before a wall, spread over the view, the smaller the more there are.

    Together they hide about the same part of the wall, whatever their number.
    """
    rng = np.random.default_rng(seed)
    across = math.ceil(math.sqrt(count * 4 / 3))
    down = math.ceil(count / across)
    objects: list[Mesh | Sphere] = [plane("wall", (0.0, 0.0, WALL_M), (2.4, 2.0), turn(), Finish((0.5, 0.5, 0.5)))]
    for index in range(count):
        row, column = divmod(index, across)
        z = float(rng.uniform(0.8, 1.5))
        x = ((column + float(rng.uniform(0.4, 0.6))) / across - 0.5) * 0.9 * z
        y = ((row + float(rng.uniform(0.4, 0.6))) / down - 0.5) * 0.65 * z
        size = 0.55 * z * min(0.9 / across, 0.65 / down)
        albedo = (float(rng.uniform(0.3, 0.9)),) * 3
        if index % 2:
            objects.append(Sphere(f"sphere {index}", (x, y, z), size / 2, albedo))
        else:
            turned = turn(*rng.uniform(-40, 40, 3))
            objects.append(box(f"box {index}", (x, y, z), (size, size, size), turned, Finish(albedo)))
    return Scene(f"{count} objects", objects=tuple(objects), ambient=0.02)


def sparse() -> Scene:
    """A scene of one small ball: most of the frame is dark whatever the gate."""
    return Scene("one ball", objects=(Sphere("ball", (0.0, 0.0, 1.05), 0.08),))


def timed_subject(name: str, rig: Rig, scene: Scene) -> tuple[Subject, float]:
    """The subject, and how many milliseconds of a core casting its rays took."""
    start_s = core_clock()
    subject = make_subject(name, rig, scene)
    return subject, 1e3 * (core_clock() - start_s)


def gate_only(subject: Subject, skip: bool) -> Callable[[int], object]:
    """`core.exposure.kernels.gate` on linear float32 light, with tiles or without; no sensor."""
    sight = subject.sight
    planes = make_planes(sight.row.astype(np.float32), sight.direct, sight.ambient)
    if not skip:
        low, high = np.full_like(planes.tile_low, -np.inf), np.full_like(planes.tile_high, np.inf)
        planes = planes._replace(tile_low=low, tile_high=high)
    out = np.empty(subject.shape, np.float32)
    windows = default_path(subject).windows
    return lambda index: kernels.gate(planes, windows[index], np.float32(0), out)


def split(path: FramePath, parts: int) -> list[FramePath]:
    """The same frame as bands of camera rows, each to be made by a thread of its own, equal to the last bit."""
    bounds = np.linspace(0, path.out.shape[0], parts + 1).astype(int)
    found = []
    for first, last in pairwise(bounds):
        rows = slice(int(first), int(last))
        sight = Sight._make(array[rows] for array in path.subject.sight)
        found.append(
            replace(
                path,
                subject=replace(path.subject, sight=sight),
                planes=kernels.Planes._make(array[rows] for array in path.planes),
                windows=tuple(kernels.Windows._make(array[rows] for array in item) for item in path.windows),
                noise=path.noise._replace(seed=np.uint64(int(path.noise.seed) + int(first))),
                out=path.out[rows],
            )
        )
    return found


def threaded(path: FramePath, threads: ThreadPoolExecutor, count: int) -> Callable[[int], object]:
    """Frames by `count` threads."""
    parts = split(path, count)
    return lambda index: list(threads.map(lambda part: part.run(index), parts))


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """The power of size that cost grows with: slope of the least-squares line through their logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def cast_bands(rig: Rig, scene: Scene, threads: ThreadPoolExecutor | None) -> None:
    """Cast one ray per pixel, in bands that the threads share; without threads one after the other."""
    tracer = make_tracer(rig, scene)
    bodies = tracer.still() + tracer.moving(0.0)
    width, count = rig.camera.lens.width, rig.camera.lens.width * rig.camera.lens.height

    def cast(start: int) -> None:
        rows, columns = np.divmod(np.arange(start, min(start + RAYS_PER_BAND, count)), width)
        tracer.trace(columns + 0.5, rows + 0.5, bodies)

    starts = range(0, count, RAYS_PER_BAND)
    list(map(cast, starts) if threads is None else threads.map(cast, starts))
