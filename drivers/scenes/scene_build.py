"""Builds the objects and gates that a scene file describes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig, Vector3
from slopegate.core.rig.settings import LineTimes, gate, quantise
from slopegate.core.scene.materials import SKIN_LOBES, Glass, Gloss, Material, Skin, SkinLobe
from slopegate.core.scene.media import Fog, extinction_of
from slopegate.core.scene.scene import KeyFrames, Mesh, Preset, Sphere
from slopegate.core.scene.shapes import Finish, box, plane, quad, turn
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import read_colour, read_shares
from slopegate.drivers.scenes.light_toml import FogTable, GlassTable, GlossyTable, MaterialTable, SkinTable
from slopegate.drivers.scenes.mesh_files import MeshReader, Placement
from slopegate.drivers.scenes.scene_toml import (
    BoxTable,
    GateTable,
    MeshTable,
    MotionTable,
    ObjectTable,
    PlaneTable,
    QuadTable,
    SceneTable,
    SphereTable,
    Turned,
)

CLEAR = (1.0, 1.0, 1.0)

_SAME = 1e-5
"""Relative difference of two line times that are the same but for rounding when they were printed."""


def build_objects(table: SceneTable, path: Path) -> tuple[tuple[Mesh | Sphere, ...], tuple[str, ...]]:
    """Every object of the scene file at `path`, and a remark for each thing of its meshes that is left out.

    SceneError names the object that cannot be built.
    """
    objects: list[Mesh | Sphere] = []
    remarks: list[str] = []
    files = _SceneFiles(path.parent)
    for index, entry in enumerate(table.objects):
        material = _material(entry.material, f"{path}: objects[{index}].material", path.parent)
        try:
            motion = _motion(entry, table.motions)
            items, said = _shapes(entry, entry.name or f"{entry.type} {index}", material, files)
        except UserError as error:
            raise SceneError(f"{path}: objects[{index}]: {error}") from error
        objects.extend(replace(item, motion=motion) for item in items)
        remarks.extend(said)
    return tuple(objects), tuple(dict.fromkeys(remarks))


def build_fog(table: FogTable | None, path: Path) -> Fog | None:
    """The fog that the file at `path` asks for. Raises SceneError, one sentence, for values without a meaning."""
    if table is None:
        return None
    scattering = table.scattering_per_m if table.visibility_m is None else extinction_of(table.visibility_m)
    try:
        return Fog(
            scattering or 0.0,
            table.absorption_per_m or 0.0,
            table.g,
            Fog.lo_m if table.lo_m is None else table.lo_m,
            Fog.hi_m if table.hi_m is None else table.hi_m,
        )
    except InputError as error:
        raise SceneError(f"{path}: fog.{error}") from error


def build_gates(tables: tuple[GateTable, ...], rig: Rig, path: Path) -> tuple[tuple[Preset, ...], tuple[str, ...]]:
    """The named gates for this rig, and a remark for each that it cannot make exactly.

    A gate given as a slab is rounded to what the camera accepts, without a remark. A clock, line time or exposure that
    the camera does not have becomes the nearest that it has. A gate that the rig cannot make at all is left out; where
    gates are no slabs, those given as slabs share one remark.
    """
    presets, remarks = [], []
    reason = no_slabs(rig)
    slabs = [table for table in tables if table.tilt_deg is not None]
    if reason and slabs:
        names = ", ".join(repr(table.name) for table in slabs)
        remarks.append(f"{path}: gates that are given as slabs ({names}) are left out: {reason}")
    for index, table in enumerate(tables):
        if reason and table in slabs:
            continue
        where = f"{path}: gates[{index}] ({table.name!r})"
        try:
            preset = _preset(table, rig)
            real = quantise(rig.camera.shutter, preset.settings, rig.projector.period_us)
        except InputError as error:
            remarks.append(f"{where} is left out, for this rig cannot make it: {error}")
            continue
        asked = preset.settings
        if not math.isclose(real.line_time_us, asked.line_time_us, rel_tol=_SAME):
            remarks.append(f"{where}: {_line_remark(rig, asked.line_time_us, real.line_time_us)}")
            preset = replace(preset, settings=replace(preset.settings, line_time_us=real.line_time_us))
        lengths = rig.camera.shutter.exposure_us
        if not lengths.min <= asked.exposure_us <= lengths.max:
            remarks.append(
                f"{where}: its camera has exposures of {lengths.min:g} to {lengths.max:g} us, not "
                f"{asked.exposure_us:g} us: it is made with {real.exposure_us:g} us"
            )
            preset = replace(preset, settings=replace(preset.settings, exposure_us=real.exposure_us))
        presets.append(preset)
    return tuple(presets), tuple(remarks)


def _line_remark(rig: Rig, asked_us: float, real_us: float) -> str:
    line = rig.camera.shutter.line
    if isinstance(line, LineTimes):
        return f"its camera has no line time of {asked_us:g} us: it is made with the nearest, {real_us:g} us"
    asked, real = line.clock_mhz(asked_us), line.clock_mhz(real_us)
    return f"its camera has no pixel clock of {asked:g} MHz: it is made with the nearest, {real:g} MHz"


def _preset(table: GateTable, rig: Rig) -> Preset:
    if table.tilt_deg is not None and table.distance_m is not None and table.thickness_m is not None:
        asked = table.tilt_deg, table.distance_m, table.thickness_m
        return Preset(table.name, plan_on_hardware(rig, *asked).applied, table.complement, asked)
    line_time_us = table.line_time_us
    if line_time_us is None:
        line = rig.camera.shutter.line
        if isinstance(line, LineTimes):
            raise InputError("clock_mhz is given, but its camera has line times: it must be line_time_us instead")
        line_time_us = line.line_time_us(table.clock_mhz or 0.0)
    return Preset(table.name, gate(line_time_us, table.delay_us or 0.0, table.exposure_us or 0.0), table.complement)


class _SceneFiles:
    """The files that a scene's objects name, each read once however many of them do."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.meshes = MeshReader()
        self._pictures: dict[str, Singles] = {}

    def texture(self, name: str | None) -> Singles | None:
        if name is not None and name not in self._pictures:
            self._pictures[name] = read_colour(self.folder / name)
        return None if name is None else self._pictures[name]


def _shapes(
    entry: ObjectTable, name: str, material: Material | None, files: _SceneFiles
) -> tuple[Sequence[Mesh | Sphere], tuple[str, ...]]:
    """What the entry describes, and remarks about what of its file was left out."""
    if isinstance(entry, SphereTable):
        return [Sphere(name, entry.centre_m, entry.radius_m, _albedo(entry), material=material)], ()
    finish = Finish(_albedo(entry), files.texture(entry.texture), material)
    match entry:
        case MeshTable():
            placement = Placement(
                position_m=entry.position_m,
                rotation=_turn(entry),
                up=entry.up,
                anchor=entry.anchor,
                scale=entry.scale or 1.0,
                fit_height_m=entry.fit_height_m,
            )
            own = entry.albedo is None and entry.texture is None and not isinstance(material, Glass)
            meshes, remarks = files.meshes.read(files.folder / entry.file, placement, finish, own_colour=own)
            return meshes if entry.name is None else [replace(mesh, name=entry.name) for mesh in meshes], remarks
        case QuadTable():
            return [quad(name, entry.corner_m, entry.edge_u_m, entry.edge_v_m, finish)], ()
        case BoxTable():
            return [box(name, entry.centre_m, entry.size_m, _turn(entry), finish)], ()
        case PlaneTable():
            return [plane(name, entry.centre_m, (entry.width_m, entry.height_m), _turn(entry), finish)], ()


def _material(table: MaterialTable | None, where: str, folder: Path) -> Material | None:
    """What the object is made of; None for matt. Raises SceneError, one sentence that begins with `where`."""
    try:
        match table:
            case GlossyTable():
                return Gloss(table.gloss, table.exponent)
            case GlassTable():
                return Glass(table.index)
            case SkinTable():
                return _skin(table, folder)
    except InputError as error:
        raise SceneError(f"{where}.{error}") from error
    except SceneError as error:
        raise SceneError(f"{where}.veins: {error}") from error
    return None


def _skin(table: SkinTable, folder: Path) -> Skin:
    lobes = SKIN_LOBES
    if table.lobes is not None:
        lobes = tuple(SkinLobe(lobe.sigma_mm, lobe.weight) for lobe in table.lobes)
    veins = None if table.veins is None else read_shares(folder / table.veins)
    return Skin(lobes, veins, table.depth_mm, table.absorbed)


def _albedo(entry: ObjectTable) -> Vector3:
    """The object's colour. Glass is clear, what gives no colour else is light grey."""
    return entry.albedo or (CLEAR if isinstance(entry.material, GlassTable) else Finish.albedo)


def _turn(table: Turned) -> Doubles:
    return turn(table.tilt_deg, table.yaw_deg, table.roll_deg)


def _motion(entry: ObjectTable, motions: dict[str, MotionTable]) -> KeyFrames | None:
    if entry.motion is None:
        return None
    table = motions.get(entry.motion)
    if table is None:
        known = ", ".join(sorted(motions)) or "none is defined"
        raise SceneError(f"motion is {entry.motion!r}: it must be the name of a [motions] table ({known})")
    return KeyFrames(
        times_s=np.array([key.time_s for key in table.keys]),
        positions_m=np.array([key.offset_m for key in table.keys]),
        rotations=np.stack([_turn(key) for key in table.keys]),
        pivot_m=_centre(entry) if table.pivot_m is None else table.pivot_m,
        loop=table.loop,
    )


def _centre(entry: ObjectTable) -> Vector3:
    if isinstance(entry, MeshTable):
        return entry.position_m
    if isinstance(entry, QuadTable):
        x, y, z = (
            corner + (right + down) / 2
            for corner, right, down in zip(entry.corner_m, entry.edge_u_m, entry.edge_v_m, strict=True)
        )
        return x, y, z
    return entry.centre_m
