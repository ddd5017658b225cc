"""Direct light and airlight together against an independent renderer's images of one scattering event, gate by gate."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from references import reference_mesh, reference_rig
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.light.airlight import prepare_airlight
from slopegate.core.render.integrate import pixel_positions
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene

CROP = Path(__file__).resolve().parents[2] / "data" / "reference_fog_single.npz"


@dataclass(frozen=True, eq=False)
class FogReference:
    """Images (G, H, W) of G gates, the last of them ungated, and the standard error of each pixel."""

    rig: Rig
    scene: Scene
    gates: list[GateSettings]
    names: list[str]
    images: NDArray[np.float64]
    errors: NDArray[np.float64]


def fog_reference(images: Any, se_map: Any, meta: dict[str, Any], described: dict[str, Any]) -> FogReference:
    rig, top, left = reference_rig(meta["rig"]), meta.get("top", 0), meta.get("left", 0)
    whole = rig.camera.lens
    lens = replace(whole, width=images.shape[2], height=images.shape[1], cx=whole.cx - left, cy=whole.cy - top)
    gates = []
    for item in meta["gates"]:
        line_us = meta["rig"]["clocks_per_line"] / item["clock_mhz"]
        # Row 0 of a crop is exposed when row `top` of the whole image is.
        gates.append(gate(line_us, item["t_d_us"] + top * line_us, item["t_e_us"]))
    gates.append(gate(1.0, 0.0, meta["rig"]["T_us"]))
    fog = described["fog"]
    air = Fog(fog["sigma_s"], fog["sigma_a"], fog["g"], tuple(fog["lo"]), tuple(fog["hi"]))
    objects = tuple(reference_mesh(item) for item in described["primitives"])
    errors = np.kron(se_map.astype(np.float64), np.ones((1, 4, 4)))
    scene = Scene("reference", objects=objects, fog=air)
    return FogReference(
        replace(rig, camera=replace(rig.camera, lens=lens)), scene, gates, meta["images"], images.astype(float), errors
    )


def edges(inverse_depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels within two of a depth edge."""
    found = np.zeros(inverse_depth.shape, np.uint8)
    found[1:-1] |= np.abs(np.diff(inverse_depth, 2, axis=0)) > 1e-3
    found[:, 1:-1] |= np.abs(np.diff(inverse_depth, 2, axis=1)) > 1e-3
    return np.asarray(maximum_filter(found, 5) > 0)


def assert_agrees(reference: FogReference, samples: int, within: float) -> None:
    rig, scene = reference.rig, reference.scene
    windows = [row_windows(rig, settings) for settings in reference.gates]
    direct = np.zeros(reference.images.shape)
    for column, row in pixel_positions(samples):
        buffers = render(rig, scene, offset=(column, row))
        for number, recorded in enumerate(windows):
            direct[number] += weights(recorded, buffers.projector_row) * buffers.direct[:, :, 1] / samples**2
    centres = render(rig, scene)
    part = prepare_airlight(rig, scene, centres, "mono", samples=4)
    compared = 0
    for number, (recorded, image, error) in enumerate(zip(windows, reference.images, reference.errors, strict=True)):
        airlight = np.zeros(image.shape, np.float32)
        part.add(recorded, airlight)
        difference = direct[number] + airlight - image
        name, noise = reference.names[number], np.sqrt((error**2).mean() / image.size)
        assert abs(difference.mean()) <= within * image.mean() + 4 * noise, name
        ungated = number == len(windows) - 1
        smooth = ~edges(centres.inverse_depth) if ungated else maximum_filter(direct[number], 3) == 0
        # Where direct light is everywhere, as in gates of a period and more, there is nothing to compare.
        if (error[smooth] ** 2).sum() > 0 and smooth.mean() > 0.05 and image[smooth].any():
            assert (difference[smooth] ** 2).mean() <= 1.5 * (error[smooth] ** 2).mean(), name
            compared += 1
    assert compared >= 9


def test_a_crop_agrees_with_the_independent_renderer() -> None:
    with np.load(CROP) as stored:
        meta = json.loads(str(stored["meta"]))
        reference = fog_reference(stored["images"], stored["se_map"], meta, meta)
    assert_agrees(reference, 8, 2e-3)


def test_whole_images_agree_with_the_independent_renderer(shared: Any) -> None:
    folder = shared("reference")
    with np.load(folder / "ref_cornell_fog_slab_fog_single.npz") as stored:
        meta = json.loads(str(stored["meta"]))
        described = json.loads((folder / meta["scene"]).read_text())
        reference = fog_reference(stored["images"], stored["se_map"], meta, described)
    assert_agrees(reference, 8, 2e-3)


def test_thicker_fog_would_be_noticed() -> None:
    with np.load(CROP) as stored:
        meta = json.loads(str(stored["meta"]))
        reference = fog_reference(stored["images"], stored["se_map"], meta, meta)
    fog = reference.scene.fog
    assert fog is not None
    thicker = replace(reference.scene, fog=replace(fog, scattering_per_m=1.02 * fog.scattering_per_m))
    with pytest.raises(AssertionError):
        assert_agrees(replace(reference, scene=thicker), 2, 2e-3)
