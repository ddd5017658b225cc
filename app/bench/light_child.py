"""Renders all light of a subject with Mitsuba 3, each camera row alone with its exact window; run by `light_peer`.

    python -m slopegate.app.bench.light_child FOLDER VARIANT ORDER SAMPLES...

reads FOLDER/subject.pickle and leaves FOLDER/SAMPLES.npz for each number of samples: light (gates, H, W) of its gates,
without ambient light, and the milliseconds of one gate by the wall's clock and of a core.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.app.bench.measure import core_clock
from slopegate.app.bench.peer_child import PROJECTOR_LIGHT, Peer
from slopegate.app.bench.subject import Subject
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import discrete_weights
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.media import Fog

CROP: Final = ("camera.film.crop_size", "camera.film.crop_offset")


class LightPeer(Peer):
    """A subject with its fog in Mitsuba's terms, for paths of any length."""

    def __init__(self, subject: Subject, variant: str, order: int) -> None:
        """order: how often light may change its direction."""
        self._order = order
        super().__init__(subject, variant)

    def light(self, settings: GateSettings, samples: int, seed: int) -> Singles:
        """Luminance (H, W) of one gate: every camera row rendered by itself, lit by what its window records."""
        rig = self._subject.rig
        camera, projector = rig.camera.lens, rig.projector.lens
        windows = discrete_weights(rig, settings, np.arange(camera.height)[:, None], np.arange(projector.height))
        out = np.zeros((camera.height, camera.width), np.float32)
        for row in np.flatnonzero(windows.any(axis=1)):
            raster = np.repeat(windows[row].astype(np.float32), projector.width * 3)
            shaped = raster.reshape(projector.height, projector.width, 3)
            self._parameters[PROJECTOR_LIGHT] = self._mitsuba.TensorXf(shaped)
            self._parameters[CROP[0]] = [camera.width, 1]
            self._parameters[CROP[1]] = [0, int(row)]
            self._parameters.update()
            image = self._mitsuba.render(self._scene, spp=samples, seed=seed * camera.height + int(row))
            out[row] = mono(np.array(image, np.float32))[0]
        return out

    def _integrator(self) -> dict[str, Any]:
        kind = "path" if self._subject.scene.fog is None else "volpath"
        return {"type": kind, "max_depth": self._order + 1, "rr_depth": 1000, "hide_emitters": True}

    def _describe(self) -> dict[str, Any]:
        described = super()._describe()
        fog = self._subject.scene.fog
        if fog is None:
            return described
        medium = {
            "type": "homogeneous",
            "sigma_t": fog.extinction_per_m,
            "albedo": {"type": "rgb", "value": [fog.scattering_per_m / fog.extinction_per_m] * 3},
            "phase": {"type": "hg", "g": fog.g},
        }
        described["fog"] = {
            "type": "cube",
            "to_world": self._box(fog),
            "bsdf": {"type": "null"},
            "interior": medium,
        }
        return described

    def _box(self, fog: Fog) -> Any:
        low, high = np.array(fog.lo_m), np.array(fog.hi_m)
        transform = self._mitsuba.ScalarTransform4f()
        return transform.translate(((low + high) / 2).tolist()).scale(((high - low) / 2).tolist())


def main(arguments: Sequence[str]) -> None:
    """Render the gates of the pickled subject with each number of samples."""
    folder, variant, order = Path(arguments[0]), arguments[1], int(arguments[2])
    subject: Subject = pickle.loads((folder / "subject.pickle").read_bytes())
    peer = LightPeer(subject, variant, order)
    for samples in map(int, arguments[3:]):
        peer.light(subject.gates[0].settings, samples, 0)  # compiles
        wall_s, core_s = time.perf_counter(), core_clock()
        light = [peer.light(gate.settings, samples, 1 + index) for index, gate in enumerate(subject.gates)]
        wall_ms = 1e3 * (time.perf_counter() - wall_s) / len(light)
        core_ms = 1e3 * (core_clock() - core_s) / len(light)
        np.savez(folder / f"{samples}.npz", light=np.stack(light), wall_ms=wall_ms, core_ms=core_ms)


if __name__ == "__main__":
    main(sys.argv[1:])
