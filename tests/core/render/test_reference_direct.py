"""Direct light against images that an independent renderer (Mitsuba 3) made of the same scenes, rig and gates.

Pixels are compared as means over their area. The references carry Monte-Carlo noise, whose standard error per 4 x 4
block comes with them (`se_map`); ours are means over 8 x 8 rays, whose own error adds to it at edges only.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from references import reference_mesh, reference_rig
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.integrate import integrate, pixel_positions
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene

CROPS = Path(__file__).resolve().parents[2] / "data" / "reference_direct.npz"
NAMES = ("three_planes_direct", "three_planes_direct_matched", "cornell_direct")
FLOAT16 = 2.0**-11


@dataclass(frozen=True, eq=False)
class Reference:
    rig: Rig
    scene: Scene
    gates: list[GateSettings]
    names: list[str]
    images: NDArray[np.float64]
    errors: NDArray[np.float64]  # standard error of every pixel, from its 4 x 4 block


def make_reference(images: Any, se_map: Any, meta: dict[str, Any], primitives: list[dict[str, Any]]) -> Reference:
    rig = reference_rig(meta["rig"])
    top, left = meta.get("top", 0), meta.get("left", 0)
    height, width = images.shape[1:]
    whole = rig.camera.lens
    lens = replace(whole, width=width, height=height, cx=whole.cx - left, cy=whole.cy - top)
    gates = []
    for item in meta["gates"]:
        line_us = meta["rig"]["clocks_per_line"] / item["clock_mhz"]
        # Row 0 of a crop is exposed when row `top` of the whole image is.
        gates.append(gate(line_us, item["t_d_us"] + top * line_us, item["t_e_us"]))
    gates.append(gate(1.0, 0.0, meta["rig"]["T_us"]))
    return Reference(
        replace(rig, camera=replace(rig.camera, lens=lens)),
        Scene("reference", objects=tuple(reference_mesh(item) for item in primitives)),
        gates,
        meta["images"],
        images.astype(np.float64),
        np.kron(se_map.astype(np.float64), np.ones((1, 4, 4))),
    )


def crop_reference(name: str) -> Reference:
    with np.load(CROPS) as stored:
        meta = json.loads(str(stored[f"{name}_meta"]))
        return make_reference(stored[f"{name}_images"], stored[f"{name}_se_map"], meta, meta["primitives"])


def full_reference(folder: Path, name: str) -> Reference:
    with np.load(folder / f"ref_{name}.npz") as stored:
        meta = json.loads(str(stored["meta"]))
        primitives = json.loads((folder / meta["scene"]).read_text())["primitives"]
        return make_reference(stored["images"], stored["se_map"], meta, primitives)


def gated_images(reference: Reference, samples: int) -> NDArray[np.float64]:
    """Mean over samples x samples rays of all gates at once: rendered once, gated by whole images, no bands."""
    windows = [row_windows(reference.rig, settings) for settings in reference.gates]
    total = np.zeros(reference.images.shape)
    positions = pixel_positions(samples)
    for column, row in positions:
        buffers = render(reference.rig, reference.scene, offset=(column, row))
        for index, window in enumerate(windows):
            total[index] += weights(window, buffers.projector_row) * buffers.direct[:, :, 1]
    return total / len(positions)


def assert_agrees(reference: Reference, ours: NDArray[np.float64]) -> None:
    difference = ours - reference.images
    for name, image, error, part in zip(reference.names, reference.images, reference.errors, difference, strict=True):
        noise = (error**2).mean() + (FLOAT16 * image).var()
        assert (part**2).mean() <= 3 * noise, name
        assert abs(part.mean()) < 1.5e-3 * image.mean() + 1e-6, name
        # Where the references themselves hardly vary nothing but their float16 rounding may remain. A block that an
        # edge just touches looks as quiet to the few rays that found it: one pixel in a thousand is left to those.
        quiet = error < 1e-5
        excess = np.abs(part[quiet]) > 2 * FLOAT16 * image[quiet] + 5e-5
        assert quiet.mean() > 0.1, name
        assert excess.mean() < 1e-3, name


@pytest.mark.parametrize("name", NAMES)
def test_crops_agree_with_the_independent_renderer(name: str) -> None:
    reference = crop_reference(name)
    assert_agrees(reference, gated_images(reference, 8))


@pytest.mark.parametrize("name", NAMES)
def test_whole_images_agree_with_the_independent_renderer(name: str, shared: Any) -> None:
    reference = full_reference(shared("reference"), name)
    assert_agrees(reference, gated_images(reference, 8))


def test_integrate_is_as_near_to_many_rays_as_one_grid_for_all_pixels() -> None:
    reference = crop_reference("cornell_direct")
    many, grid = gated_images(reference, 16), gated_images(reference, 3)

    def error(image: NDArray[np.float64]) -> float:
        """Root mean square over blocks of 4 x 4 pixels."""
        height, width = (size // 4 for size in image.shape)
        blocks = (image - many[index])[: 4 * height, : 4 * width].reshape(height, 4, width, 4).mean(axis=(1, 3))
        return float(np.sqrt((blocks**2).mean()))

    errors = []
    for index in range(len(reference.gates)):
        image = integrate(reference.rig, reference.scene, reference.gates[index], 3)[:, :, 1].astype(np.float64)
        assert error(image) < 0.01 * max(many[-1].mean(), 1e-9)
        errors.append((error(image), error(grid[index])))
    ours, one_grid = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ours < 1.02 * one_grid


def test_a_gate_moved_by_half_a_row_would_be_noticed() -> None:
    reference = crop_reference("three_planes_direct")
    moved = [replace(item, delay_us=item.delay_us + 0.5 * item.line_time_us) for item in reference.gates]
    with pytest.raises(AssertionError):
        assert_agrees(reference, gated_images(replace(reference, gates=moved), 8))
