"""Soft edges: ramps, several rays a pixel kept from frame to frame, and rays cast for every frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slopegate.app.bench.kernels import RayStack, expose_subrows, expose_trapezoid
from slopegate.app.bench.number_types import FramePath, default_path, tile_table
from slopegate.app.bench.subject import Subject
from slopegate.app.bench.variant import Variant, array_bytes, fine_response, read_fine
from slopegate.core.exposure.kernels import Noise, Response
from slopegate.core.exposure.sensor import Plates, mono
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

Draw = Callable[[int, Response, Noise], None]


def variants(subject: Subject, sub_rows: tuple[int, ...], cast_rays: tuple[int, ...]) -> list[Variant]:
    """Every way to make soft edges: ramps, cached stacks of rays, and rays cast for every frame."""
    return [
        trapezoid(subject),
        *(stacked(subject, count) for count in sub_rows),
        *(cast_area(subject, count) for count in cast_rays),
    ]


def trapezoid(subject: Subject) -> Variant:
    """Edges as ramps: a pixel counts by the share of it that lies in the window, as if every surface were frontal."""
    path = default_path(subject)
    footprint = np.float32(subject.rig.projector.lens.fy / subject.rig.camera.lens.fy)

    def draw(index: int, response: Response, noise: Noise) -> None:
        expose_trapezoid(path.planes, footprint, path.windows[index], response, noise, path.out)

    return _variant("trapezoid", path, draw, path.kept_bytes())


def stacked(subject: Subject, count: int) -> Variant:
    """`count` rays a pixel, one below the other, each with a surface point, row and light of its own."""
    path, stack = default_path(subject), cast_stack(subject, count)
    lit = stack.rows >= 0
    some = np.asarray(lit.any(axis=1), np.bool_)
    low = tile_table(np.where(lit, stack.rows, np.float32(np.inf)).min(axis=1), some)[0]
    high = tile_table(stack.rows.max(axis=1), some)[1]
    planes = path.planes._replace(tile_low=low, tile_high=high)
    sums = np.zeros(subject.shape[1], np.float32)

    def draw(index: int, response: Response, noise: Noise) -> None:
        expose_subrows(planes, stack, path.windows[index], response, noise, sums, path.out)

    kept = array_bytes(stack, planes.ambient, low, high, sums, path.noise.pool, path.out)
    return _variant(f"{count} sub-rows, cached", path, draw, kept)


def cast_stack(subject: Subject, count: int) -> RayStack:
    """Cast `count` rays a pixel, evenly spaced from its top to its bottom."""
    height, width = subject.shape
    rows = np.empty((height, count, width), np.float32)
    direct = np.empty((height, count, width), np.uint16)
    for index in range(count):
        buffers = render(subject.rig, subject.scene, offset=(0.5, (index + 0.5) / count))
        rows[:, index] = buffers.projector_row
        plates = Plates(buffers.projector_row, mono(buffers.direct), mono(buffers.ambient), subject.sensor)
        direct[:, index] = plates.planes.direct
    return RayStack(rows, direct, np.rint(direct.mean(axis=1, dtype=np.float32)).astype(np.uint16))


def cast_area(subject: Subject, samples: int) -> Variant:
    """`core.render.integrate` and rounding for every frame; no noise. Timed on a frame of fewer camera rows."""
    every = samples**2
    rig, scene = thinned(subject.rig, subject.scene, every)

    def run(index: int) -> None:
        light = integrate(rig, scene, subject.gates[index].settings, samples)
        counts = mono(light) * subject.sensor.counts_per_unit + subject.sensor.black_count
        np.clip(np.floor(counts + 0.5), 0, subject.sensor.max_count).astype(np.uint16)

    known: dict[int, tuple[Doubles, ...]] = {}

    def at(index: int, pixels: Indices) -> Doubles:
        if len(pixels) not in known:
            known[len(pixels)] = subject.area_counts(pixels, samples).counts
        return known[len(pixels)][index]

    height, width = subject.shape
    share = rig.camera.lens.height / height
    name = f"cast every frame, {samples} x {samples} rays"
    return Variant("ray casting", name, run, None, at, None, height * width * 12, share, gates=1, slow=True)


def thinned(rig: Rig, scene: Scene, every: int) -> tuple[Rig, Scene]:
    """The same field of view by a camera of fewer and taller rows: rays spread over the whole scene, but fewer."""
    lens = rig.camera.lens
    height = max(1, lens.height // every)
    shrink = height / lens.height
    short = replace(lens, height=height, fy=lens.fy * shrink, cy=lens.cy * shrink)
    capture = scene.capture
    if capture is not None:
        kept = ((np.arange(height) + 0.5) / shrink).astype(np.int64)
        capture = replace(
            capture,
            lens=short,
            inverse_depth=capture.inverse_depth[kept],
            photo=np.ascontiguousarray(capture.photo[kept]),
        )
    return replace(rig, camera=replace(rig.camera, lens=short), calibration=None), replace(scene, capture=capture)


def _variant(name: str, path: FramePath, draw: Draw, kept_bytes: int) -> Variant:
    silent = path.noise._replace(step=np.float32(0))

    def counts(index: int) -> Doubles:
        draw(index, fine_response(path.responses[index]), silent)
        return read_fine(path.out, path.subject)

    def at(index: int, pixels: Indices) -> Doubles:
        return counts(index).reshape(-1)[pixels]

    def run(index: int) -> None:
        draw(index, path.responses[index], path.noise)

    return Variant("gate edges", name, run, None, at, None, kept_bytes)
