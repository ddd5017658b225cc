"""Acquired light transport: the part of `slopegate.app.api` that looks at it, relights it and composes with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from slopegate.app.rig_gates import OpenRig
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.composite import composite, covering, surrounding_light
from slopegate.core.transport.matte import slice_light, soft_matte
from slopegate.core.transport.plan import TransportPlan
from slopegate.core.transport.relight import SliceLight, relight
from slopegate.core.transport.sliced import SliceTransport, camera_image, dual_image, projector_image
from slopegate.core.transport.weights import Agreement, Weighting, agreement, floodlit, slice_weights
from slopegate.drivers.captures.export import Step
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.files.images import srgb8
from slopegate.drivers.files.picture_files import read_pattern
from slopegate.drivers.transports.export import export_transport
from slopegate.drivers.transports.storage import TransportFolder
from slopegate.drivers.transports.storage import open_transport as open_folder

KEEP_S, DECODE_S = 6e-9, 8e-7
"""Seconds a pixel to keep each frame of the bench, and to decode each slice, as measured with two cores."""
WHITE_PERCENTILE = 99.9
"""Of the fully lit image: the light that a picture to look at shows as white."""


@dataclass(frozen=True, eq=False)
class Composite:
    """A foreground before another background."""

    image: Singles
    """(H, W, 3) RGB, linear."""
    matte: Singles
    """Which share of each pixel is foreground (H, W), 0..1."""
    foreground: Singles
    """Its light alone (H, W, 3)."""


@dataclass(frozen=True, eq=False, repr=False)
class OpenTransport(OpenRig):
    """Light transport on the disk: the rig it was acquired with, and its slices in the order of acquisition.

    Light is linear: of a scene in the unit of `OpenScene.light`, of a camera in counts above the dark. Slices that are
    missing hold no light. Columns and rows are pixels, from 0.
    """

    folder: TransportFolder
    """The program's own view of the folder, which may change."""

    @property
    def scene_name(self) -> str:
        """What was looked at."""
        return self.folder.manifest.scene

    @property
    def _title(self) -> str:
        return self.scene_name

    @property
    def grid(self) -> str:
        """Columns x rows of blocks that were asked for, such as 32x32."""
        return str(self.folder.grid)

    @property
    def gates(self) -> tuple[GateSettings | None, ...]:
        """The gate of every slice, taken or not; None for a camera without a gate."""
        return tuple(None if gate is None else gate.settings() for gate in self.folder.manifest.slices)

    @property
    def missing(self) -> tuple[int, ...]:
        """Numbers of the slices that have not been taken."""
        return tuple(self.folder.missing())

    @property
    def linear_unit(self) -> str:
        """The unit of light, as `slopegate render` names it."""
        return "counts" if self.folder.manifest.counts_per_unit is None else "linear, E = 1"

    @cached_property
    def slices(self) -> tuple[SliceTransport, ...]:
        """The transport of every slice: `total` (H, W) is its light under a fully lit projector."""
        dark, missing = SliceTransport(np.zeros(self.shape, np.float32), ()), self.missing
        return tuple(dark if place in missing else self.folder.slice(place) for place in range(len(self.gates)))

    @cached_property
    def white(self) -> Singles | None:
        """The fully lit image (H, W) that was captured beside the slices; None where there is none."""
        return self.folder.white()

    def weights(self, weighting: Weighting = "tiling") -> tuple[float, ...]:
        """The factor of every slice when they are added up.

        tiling: 1, exact where slices tile; least-squares: as even as can be over all that is lit, for gates that leave
        gaps or overlap; paper: |dz/dt_d| of the paper's equation 15.
        """
        return tuple(float(one) for one in slice_weights(weighting, self.rig, self.slices, self.gates))

    def relight(self, lights: Sequence[SliceLight] | None = None, *, weighting: Weighting = "tiling") -> Singles:
        """The scene with every slice lit by a light of its own, float32; None: all white.

        (H, W), or (H, W, 3) RGB where a light has a colour, or the camera does.
        """
        wanted = (SliceLight(),) * len(self.gates) if lights is None else tuple(lights)
        allowed = f"one light a slice, {len(self.gates)}"
        require(len(wanted) == len(self.gates), "lights", f"{len(wanted)} lights", allowed)
        image = relight(self.slices, wanted, self.weights(weighting), self._mosaic)
        coloured = self._mosaic or any(_coloured(light) for light in wanted)
        return image if coloured else np.ascontiguousarray(image[:, :, 0])

    def agreement(self, weighting: Weighting = "tiling") -> Agreement | None:
        """How like `white` the slices are, all lit in white and added up; None without `white`."""
        return None if self.white is None else agreement(self.floodlit(weighting), self.white)

    def floodlit(self, weighting: Weighting = "tiling") -> Singles:
        """All slices lit in white and added up (H, W) float32; of a camera in colour behind its filters, as `white`."""
        return floodlit(self.slices, self.weights(weighting))

    def matte(self, foreground: Sequence[int]) -> Singles:
        """Which share of each pixel (H, W), 0..1, lies in these slices, softly along edges; float32."""
        front, back = self._light_of(foreground), self._light_of(self._others(foreground))
        return soft_matte(front, back)

    def composite(self, foreground: Sequence[int], background: Singles, *, relit: bool = False) -> Composite:
        """What lies in these slices before another background, a linear picture (h, w, 3) whose white is 1.

        It is cut and scaled to the camera's image, and its white is as bright as the fully lit image's. `relit`: the
        foreground is lit by its own transport with the background's colours.
        """
        alpha, height, width = self.matte(foreground), *self.shape
        behind = covering(background, width, height)
        picture = surrounding_light(behind, self._raster) if relit else None
        front = SliceLight(picture=picture)
        hidden = set(self._others(foreground))
        lights = [replace(front, visible=place not in hidden) for place in range(len(self.gates))]
        light = relight(self.slices, lights, mosaic=self._mosaic)
        return Composite(composite(light, alpha, behind * np.float32(self._white_level)), alpha, light)

    def projector_image(self, place: int, column: int, row: int) -> Singles:
        """What each pixel of the projector brings to one pixel of the camera in a slice: a picture of its raster."""
        return projector_image(self._slice(place), self._raster, column, row)

    def camera_image(self, place: int, column: int, row: int) -> Singles:
        """What the camera sees of a slice (H, W) when only the block around one pixel of the projector is lit."""
        return camera_image(self._slice(place), self._raster, column, row)

    def dual_image(self, place: int, lamps: Singles | None = None) -> Singles:
        """A slice as the projector would see it if the camera's pixels were lamps of these strengths (H, W).

        (height, width) of the projector's raster; `lamps` None: all 1.
        """
        strengths = np.ones(self.shape, np.float32) if lamps is None else lamps
        return dual_image(self._slice(place), self._raster, strengths)

    def picture(self, file: str | Path) -> Singles:
        """A picture to light slices with, from an 8-bit PNG: v means v/255 of the light, linear.

        (height, width) of the projector's raster, or (height, width, 3), float32; the file may have any size up to it.
        """
        return read_pattern(Path(file), self._raster, colours=True)

    def viewer_ready(self, light: Singles) -> Bytes:
        """Light (H, W) or (H, W, 3) as 8 bits to look at (sRGB); white is what is brightest in the fully lit image."""
        return srgb8(light / np.float32(self._white_level))

    def export(self, kind: str, out: str | Path, progress: Step | None = None) -> int:
        """Write the slices taken so far as exr, zarr or png; returns how many there are."""
        return export_transport(self.folder, kind, Path(out), progress)

    @property
    def _raster(self) -> Raster:
        return self.folder.grid.raster

    @property
    def _mosaic(self) -> str:
        return filters(self.folder.manifest.camera.pixel_format)

    @cached_property
    def _white_level(self) -> float:
        lit = self.floodlit() if self.white is None else self.white
        return float(np.percentile(lit, WHITE_PERCENTILE)) or 1.0

    def _others(self, foreground: Sequence[int]) -> list[int]:
        """The slices that are not of the foreground, which must be some, but not all, of them."""
        count, wanted = len(self.gates), set(foreground)
        wrong = sorted(wanted - set(range(count)))
        require(not wrong, "foreground", wrong, f"slices from 0 to {count - 1}")
        require(
            0 < len(wanted) < count, "foreground", sorted(wanted), f"some of the {count} slices, and not all of them"
        )
        return [place for place in range(count) if place not in wanted]

    def _light_of(self, places: Sequence[int]) -> Singles:
        return slice_light(self.slices, places, self._mosaic)

    def _slice(self, place: int) -> SliceTransport:
        require(0 <= place < len(self.gates), "place", place, f"a whole number from 0 to {len(self.gates) - 1}")
        return self.slices[place]


def open_transport(folder: str | Path) -> OpenTransport:
    """Light transport that `OpenScene.acquire_transport`, the window or `slopegate transport acquire` has acquired."""
    found = open_folder(Path(folder))
    return OpenTransport(found.rig, found)


def _coloured(light: SliceLight) -> bool:
    in_colour = light.picture is not None and light.picture.ndim == 3
    return light.visible and (in_colour or len(set(light.colour)) > 1)


def with_decoding(plan: TransportPlan, slices: int, shape: tuple[int, int]) -> TransportPlan:
    """The plan for so many slices with the time that decoding takes."""
    return replace(plan, seconds=plan.seconds + slices * DECODE_S * math.prod(shape))
