"""Renders a subject with Mitsuba 3, band by band of projector rows; run by `peer` as a process of its own.

    python -m slopegate.app.bench.peer_child FOLDER VARIANT SAMPLES...

reads FOLDER/subject.pickle and leaves FOLDER/SAMPLES.npz for each number of samples.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.app.bench.measure import core_clock
from slopegate.app.bench.subject import Subject, to_counts
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import discrete_weights
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Lens, Vector3
from slopegate.core.scene.scene import Mesh, Sphere

PROJECTOR_LIGHT: Final = "light.irradiance.data"


class Peer:
    """A subject in Mitsuba's terms."""

    def __init__(self, subject: Subject, variant: str) -> None:
        self._mitsuba: Any = import_module("mitsuba")
        self._mitsuba.set_variant(variant)
        import_module("drjit").set_thread_count(1)
        self._subject = subject
        self._scene = self._mitsuba.load_dict(self._describe())
        self._parameters = self._mitsuba.traverse(self._scene)

    def render(self, rows: range, samples: int, seed: int) -> Singles:
        """Luminance (H, W) when only these projector rows are lit, by so many random rays a pixel."""
        lens = self._subject.rig.projector.lens
        raster = np.zeros((lens.height, lens.width, 3), np.float32)
        raster[rows.start : rows.stop] = 1
        self._parameters[PROJECTOR_LIGHT] = self._mitsuba.TensorXf(raster)
        self._parameters.update()
        image = self._mitsuba.render(self._scene, spp=samples, seed=seed)
        return mono(np.array(image, np.float32))

    def gated(self, samples: int, band: int) -> tuple[Doubles, float, float]:
        """Counts (gates, H, W) from one pass over all rows, `band` rows at a time, which count as their mean.

        Also its milliseconds, by the wall's clock and of a core. One gate alone takes as long.
        """
        subject, height = self._subject, self._subject.rig.projector.lens.height
        light = np.array([gate.periods * subject.sight.ambient for gate in subject.gates], np.float64)
        places = np.arange(subject.shape[0])[:, None], np.arange(height)
        weights = [discrete_weights(subject.rig, gate.settings, *places) for gate in subject.gates]
        self.render(range(band), samples, 0)
        wall_s = core_s = 0.0
        for row in range(0, height, band):
            rows = range(row, min(row + band, height))
            start_wall_s, start_core_s = time.perf_counter(), core_clock()
            image = self.render(rows, samples, 1 + row)
            wall_s, core_s = wall_s + time.perf_counter() - start_wall_s, core_s + core_clock() - start_core_s
            for index, weight in enumerate(weights):
                light[index] += weight[:, rows.start : rows.stop].mean(axis=1, keepdims=True) * image
        return to_counts(light, subject.sensor), 1e3 * wall_s, 1e3 * core_s

    def _integrator(self) -> dict[str, Any]:
        return {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}

    def _describe(self) -> dict[str, Any]:
        rig = self._subject.rig
        camera, projector = rig.camera.lens, rig.projector.lens
        lit = np.ones((projector.height, projector.width, 3), np.float32)
        film = {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        described: dict[str, Any] = {
            "type": "scene",
            "integrator": self._integrator(),
            "camera": {
                "type": "perspective",
                "near_clip": 1e-3,
                "film": film,
                "sampler": {"type": "independent"},
                **self._stand(rig.camera_centre_m, camera),
            },
            "light": {
                "type": "projector",
                "irradiance": self._picture(lit),
                **self._stand(rig.projector_centre_m, projector),
            },
        }
        for index, item in enumerate(self._subject.scene.objects):
            described[f"object {index}"] = self._mesh(item) if isinstance(item, Mesh) else self._sphere(item)
        return described

    def _stand(self, centre_m: Doubles, lens: Lens) -> dict[str, Any]:
        x, y, z = map(float, centre_m)
        place = self._mitsuba.ScalarTransform4f().look_at(origin=[x, y, z], target=[x, y, z + 1], up=[0, -1, 0])
        return {"to_world": place, "fov_axis": "x", "fov": float(np.degrees(2 * np.arctan(lens.width / 2 / lens.fx)))}

    def _picture(self, pixels: Singles) -> dict[str, Any]:
        bitmap = self._mitsuba.Bitmap(np.ascontiguousarray(pixels))
        return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}

    def _finish(self, albedo: Vector3, texture: Singles | None) -> dict[str, Any]:
        plain = {"type": "rgb", "value": list(albedo)}
        reflectance = plain if texture is None else self._picture(texture)
        return {"type": "twosided", "surface": {"type": "diffuse", "reflectance": reflectance}}

    def _mesh(self, item: Mesh) -> Any:
        properties = self._mitsuba.Properties()
        properties["bsdf"] = self._mitsuba.load_dict(self._finish(item.albedo, item.texture))
        vertices, textured = len(item.vertices), item.uv is not None
        mesh = self._mitsuba.Mesh(item.name, vertices, len(item.faces), has_vertex_texcoords=textured, props=properties)
        parameters = self._mitsuba.traverse(mesh)
        parameters["vertex_positions"] = item.vertices.astype(np.float32).ravel()
        parameters["faces"] = item.faces.astype(np.uint32).ravel()
        if item.uv is not None:
            parameters["vertex_texcoords"] = item.uv.astype(np.float32).ravel()
        parameters.update()
        return mesh

    def _sphere(self, item: Sphere) -> dict[str, Any]:
        centre = list(map(float, item.centre_m))
        return {"type": "sphere", "center": centre, "radius": item.radius_m, "bsdf": self._finish(item.albedo, None)}


def _memory_mb(field: str) -> float:
    """A field of this process's memory, in MB; 0 where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1e3 for line in lines if line.startswith(field)), 0.0)


def _forget_peak() -> None:
    """A process inherits the peak of the one that made it; where the system can, start anew."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def main(arguments: Sequence[str]) -> None:
    """Render every gate of the pickled subject, so many projector rows at a time, with each number of samples."""
    folder, variant, band = Path(arguments[0]), arguments[1], int(arguments[2])
    subject: Subject = pickle.loads((folder / "subject.pickle").read_bytes())
    _forget_peak()
    before_mb = _memory_mb("VmRSS")
    peer = Peer(subject, variant)
    for samples in map(int, arguments[3:]):
        counts, wall_ms, spent_ms = peer.gated(samples, band)
        peak_mb = _memory_mb("VmHWM") - before_mb
        np.savez(folder / f"{samples}.npz", counts=counts, wall_ms=wall_ms, spent_ms=spent_ms, peak_mb=peak_mb)


if __name__ == "__main__":
    main(sys.argv[1:])
