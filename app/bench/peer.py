"""An independent renderer as peer: Mitsuba 3, one band of projector rows at a time (optional extra `peer`).

The same surfaces, lit by Mitsuba's own projector emitter with one band of rows switched on, rendered by its own direct
integrator, and added up over the bands with the share of each band that a camera row records. Its pixels are means over
their area by so many random rays, so it is compared with the exact area. Its time is that of all bands, one thread.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from slopegate.app.bench.subject import Doubles, Subject, to_counts
from slopegate.core.gate import discrete_weights
from slopegate.core.rig import Lens, Vector3
from slopegate.core.scene import Mesh, Sphere
from slopegate.core.sensor import mono

BAND_ROWS: Final = 4
VARIANT: Final = "llvm_ad_rgb"
PROJECTOR_LIGHT: Final = "light.irradiance.data"


@dataclass(frozen=True, eq=False)
class PeerImage:
    """Counts of every gate, (H, W) each, how long all bands took, and the peak memory of the process meanwhile."""

    counts: tuple[Doubles, ...]
    bands_ms: float
    peak_mb: float | None


def why_not(subject: Subject | None = None) -> str | None:
    """Why there is no peer, in one sentence; None where there is one (for this subject, if given)."""
    if find_spec("mitsuba") is None:
        return "no peer: Mitsuba 3 is not installed (pip install 'slopegate[peer]' brings it)"
    if subject is None:
        return None
    if subject.scene.capture is not None:
        return "no peer for this scene: a capture has no surfaces that another renderer could see"
    if not (subject.rig.is_ideal and _centred(subject.rig.camera.lens) and _centred(subject.rig.projector.lens)):
        return "no peer for this rig: its lenses and poses are beyond the peer's pinholes"
    return None


def _centred(lens: Lens) -> bool:
    return lens.cx == lens.width / 2 and lens.cy == lens.height / 2 and lens.fx == lens.fy


class Peer:
    """A subject in Mitsuba's terms."""

    def __init__(self, subject: Subject) -> None:
        self._mitsuba: Any = import_module("mitsuba")
        self._mitsuba.set_variant(VARIANT)
        import_module("drjit").set_thread_count(1)
        self._subject = subject
        self._scene = self._mitsuba.load_dict(self._describe())
        self._parameters = self._mitsuba.traverse(self._scene)

    def render(self, rows: range, samples: int, seed: int) -> NDArray[np.float32]:
        """Luminance (H, W) when only these projector rows are lit, by so many random rays a pixel."""
        lens = self._subject.rig.projector.lens
        raster = np.zeros((lens.height, lens.width, 3), np.float32)
        raster[rows.start : rows.stop] = 1
        self._parameters[PROJECTOR_LIGHT] = self._mitsuba.TensorXf(raster)
        self._parameters.update()
        image = self._mitsuba.render(self._scene, spp=samples, seed=seed)
        return mono(np.array(image, np.float32))

    def gated(self, samples: int) -> PeerImage:
        """All gates, from one pass over the bands; its time is that of the pass, which one gate takes as well."""
        subject, rows = self._subject, self._subject.rig.projector.lens.height
        ambient = subject.sight.ambient.astype(np.float64)
        light = [gate.periods * ambient for gate in subject.gates]
        camera_rows = np.arange(subject.shape[0])
        self.render(range(BAND_ROWS), samples, 0)
        spent_s = 0.0
        can_reset = _reset_peak()
        for first in range(0, rows, BAND_ROWS):
            band = range(first, min(first + BAND_ROWS, rows))
            start_s = time.perf_counter()
            image = self.render(band, samples, 1 + first)
            spent_s += time.perf_counter() - start_s
            for index, gate in enumerate(subject.gates):
                shares = discrete_weights(subject.rig, gate.settings, camera_rows[:, None], np.array(band))
                light[index] += shares.mean(axis=1)[:, None] * image
        counts = tuple(to_counts(item, subject.sensor) for item in light)
        return PeerImage(counts, 1e3 * spent_s, _peak_mb() if can_reset else None)

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
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
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

    def _picture(self, pixels: NDArray[np.float32]) -> dict[str, Any]:
        bitmap = self._mitsuba.Bitmap(np.ascontiguousarray(pixels))
        return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}

    def _finish(self, albedo: Vector3, texture: NDArray[np.float32] | None) -> dict[str, Any]:
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


def _reset_peak() -> bool:
    """Forget the process's peak memory so far; only Linux can."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return False
    return True


def _peak_mb() -> float:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1e3
    return 0.0
