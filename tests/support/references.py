"""Images of an independent renderer, kept as means over 4 x 4 pixels: the rig, scene and gates that they are of."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.core.gating.gate import RowWindows, row_windows, weights
from slopegate.core.render.integrate import pixel_positions
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import PixelClocks, ShutterLimits, Steps, gate
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh, Scene

BLOCKS = Path(__file__).resolve().parents[1] / "data" / "reference_indirect.npz"


@dataclass(frozen=True, eq=False)
class BlockReference:
    """Means (G, H/4, W/4) of G gates, the last of them everything once, and the standard error of each gate's means."""

    rig: Rig
    scene: Scene
    windows: list[RowWindows]
    names: list[str]
    means: NDArray[np.float64]
    errors: NDArray[np.float64]
    max_order: int

    def misses(self, ours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Per gate: by which share the mean differs, and the error as a share of the fully lit mean, (G, 2)."""
        blocks = four_by_four(ours)
        mean = blocks.mean((1, 2)) / self.means.mean((1, 2)) - 1
        square = ((blocks - self.means) ** 2).mean((1, 2)) - self.errors**2
        return np.stack([mean, np.sqrt(np.maximum(square, 0)) / self.means[-1].mean()], axis=1)


def four_by_four(images: NDArray[Any]) -> NDArray[np.float64]:
    """Means over 4 x 4 pixels of the last two axes."""
    height, width = images.shape[-2:]
    shaped = images.reshape(*images.shape[:-2], height // 4, 4, width // 4, 4)
    return np.asarray(shaped.mean((-3, -1)), np.float64)


def block_reference(name: str) -> BlockReference:
    """The reference of this name in tests/data."""
    with np.load(BLOCKS) as stored:
        meta = json.loads(str(stored[f"{name}_meta"]))
        means, errors = stored[f"{name}_means"].astype(np.float64), stored[f"{name}_se"].astype(np.float64)
    rig = reference_rig(meta["rig"])
    fog = meta["fog"]
    air = fog and Fog(fog["sigma_s"], fog["sigma_a"], fog["g"], tuple(fog["lo"]), tuple(fog["hi"]))
    scene = Scene("reference", objects=tuple(reference_mesh(item) for item in meta["primitives"]), fog=air)
    gates = [gate(meta["rig"]["clocks_per_line"] / g["clock_mhz"], g["t_d_us"], g["t_e_us"]) for g in meta["gates"]]
    gates.append(gate(1.0, 0.0, meta["rig"]["T_us"]))
    windows = [row_windows(rig, settings) for settings in gates]
    return BlockReference(rig, scene, windows, meta["images"], means, errors, meta["max_depth"] - 1)


def reference_rig(description: dict[str, Any]) -> Rig:
    """The ideal rig that a reference was made with."""
    c, p = description["cam"], description["proj"]
    clocks = PixelClocks(description["clocks_per_line"], (78.0,))
    camera = RigCamera(
        Lens(c["w"], c["h"], c["f"], c["f"], c["cx"], c["cy"]),
        ShutterLimits(clocks, Steps(-16667, 33334, 1), Steps(100, 50000, 1)),
    )
    lens = Lens(p["w"], p["h"], p["f"], p["f"], p["cx"], p["cy"])
    return ideal_rig(camera, RigProjector(lens, description["T_us"], description["active_fraction"]), description["b"])


def reference_mesh(primitive: dict[str, Any]) -> Mesh:
    """One surface of a reference's scene."""
    grey = (primitive["albedo"],) * 3
    if primitive["type"] == "mesh":
        return Mesh(primitive["name"], np.array(primitive["vertices"]), np.array(primitive["faces"], np.int32), grey)
    start, across, down = (np.array(primitive[key]) for key in ("p0", "e1", "e2"))
    corners = np.array([start, start + across, start + across + down, start + down])
    return Mesh(primitive["name"], corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), grey)


def direct_images(reference: BlockReference, samples: int) -> NDArray[np.float64]:
    """The direct part of all gates (G, H, W), means over samples x samples rays a pixel."""
    lens = reference.rig.camera.lens
    total = np.zeros((len(reference.windows), lens.height, lens.width))
    positions = pixel_positions(samples)
    for column, row in positions:
        buffers = render(reference.rig, reference.scene, offset=(column, row))
        for index, window in enumerate(reference.windows):
            total[index] += weights(window, buffers.projector_row) * buffers.direct[:, :, 1]
    return total / len(positions)
