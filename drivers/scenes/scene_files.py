"""Opens scenes: TOML files, mesh files, RGB-D folders, and the scenes that come with the program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files
from os.path import exists, isdir
from pathlib import Path

import numpy as np

from slopegate.core.gating.plan import gate_before_wall
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.checks import plain_name
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.scene import Preset, Scene
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.mesh_files import SUFFIXES as MESH_SUFFIXES
from slopegate.drivers.scenes.mesh_files import Placement, read_mesh
from slopegate.drivers.scenes.plane_gates import plane_gates
from slopegate.drivers.scenes.plausible import check_distances
from slopegate.drivers.scenes.rgbd_files import CALIBRATION, CaptureFacts, read_capture, read_facts, rig_of_capture
from slopegate.drivers.scenes.scene_build import build_fog, build_gates, build_objects
from slopegate.drivers.scenes.scene_toml import SceneTable, read_gates, read_scene_table, read_toml

__all__ = ["SceneEntry", "SceneError", "offered_scenes", "open_scene", "shipped_scenes"]

BACKDROP_Z_M = 1.6
_SHIPPED = Path(str(files("slopegate.resources") / "scenes"))


@dataclass(frozen=True)
class SceneEntry:
    """A scene that comes with the program."""

    key: str
    title: str
    description: str
    path: Path


def shipped_scenes() -> list[SceneEntry]:
    """The scenes in resources/scenes, in the order of their index."""
    return [_entry(_SHIPPED / name) for name in read_toml(_SHIPPED / "index.toml")["scenes"]]


def offered_scenes() -> list[SceneEntry]:
    """The shipped scenes, and those ready-made for captures that do not come with the program but are at hand."""
    tables = [_SHIPPED / name for name in read_toml(_SHIPPED / "index.toml")["captures"]]
    return shipped_scenes() + [_entry(path) for path in tables if isdir(_capture_of(path))]


def _entry(path: Path) -> SceneEntry:
    if isdir(path):
        facts = read_facts(path)
        return SceneEntry(path.stem, plain_name(facts.label(path)), facts.content, path)
    table = read_scene_table(path)
    return SceneEntry(path.stem, plain_name(table.title or path.stem), table.description, path)


def _capture_of(path: Path) -> Path:
    return path.parent / (read_scene_table(path).capture or "")


def scene_path(name: str) -> Path:
    """The file or folder of this name, else the offered scene of this key. Raises SceneError for neither."""
    path = Path(name)
    if exists(path):
        return path
    offered = {entry.key: entry.path for entry in offered_scenes()}
    if name not in offered:
        raise SceneError(f"{name} is no file, no folder and none of the shipped scenes ({', '.join(offered)})")
    return offered[name]


def open_scene(path: Path, rig: Rig) -> tuple[Rig, Scene]:
    """Open a TOML scene, a mesh file (.obj .ply .stl .glb .gltf) or an RGB-D folder (or its scene.json).

    The rig that comes back is the one given, except for an RGB-D folder, which brings its own camera: then it has that
    camera's lens, and line times such that B = 1 stays at the same pixel clock. Raises SceneError.
    """
    suffix = path.suffix.lower()
    if isdir(path) or path.name.lower() == CALIBRATION:
        return _open_capture(path if isdir(path) else path.parent, rig)
    if not exists(path):
        raise SceneError(f"{path} is missing: there is no such file or folder")
    if suffix == ".toml":
        table = read_scene_table(path)
        if table.capture is not None:
            if not isdir(_capture_of(path)):
                raise SceneError(f"{path}: capture is {table.capture!r}: there is no such folder")
            return _open_capture(_capture_of(path), rig, table, path)
        gates, left_out = build_gates(table.gates, rig, path)
        objects, remarks = build_objects(table, path)
        return rig, Scene(
            name=plain_name(table.title or path.stem),
            description=table.description,
            objects=objects,
            ambient=table.ambient,
            gates=gates,
            fog=build_fog(table.fog, path),
            indirect=bool(table.indirect),
            remarks=remarks + left_out + check_distances(path, objects, rig),
        )
    if suffix in MESH_SUFFIXES:
        return rig, _open_mesh(path, rig)
    kinds = f"a .toml scene, a mesh ({', '.join(MESH_SUFFIXES)}) or a folder with a photo, depth and scene.json"
    raise SceneError(f"{path} is no scene: it must be {kinds}")


def _open_capture(
    folder: Path, rig: Rig, table: SceneTable | None = None, named: Path | None = None
) -> tuple[Rig, Scene]:
    """An RGB-D folder, or a scene file `named` that refers to it; what the file says overrides the folder."""
    facts, capture, left_out = read_capture(folder)
    adapted, own = _rig_of(folder, facts, rig, capture.lens)
    capture = replace(capture, lens=adapted.camera.lens)  # written with the centre of pixels moved, it may be a bit off
    if table is not None and table.gates:
        gates, remarks = build_gates(table.gates, adapted, named or folder)
    else:
        tables = read_gates(facts.gates, folder / CALIBRATION) if facts.gates else ()
        gates, remarks = build_gates(tables, adapted, folder / CALIBRATION)
        gates += plane_gates(facts.planes, adapted, capture)
    fog = None if table is None else build_fog(table.fog, named or folder)
    return adapted, Scene(
        name=plain_name((table and table.title) or facts.label(folder)),
        description=(table and table.description) or facts.content,
        capture=capture,
        ambient=(table and table.ambient) or facts.ambient,
        gates=gates,
        fog=fog or build_fog(facts.fog, folder / CALIBRATION),
        indirect=facts.indirect if table is None or table.indirect is None else table.indirect,
        remarks=(*left_out, *own, *remarks),
    )


def _rig_of(folder: Path, facts: CaptureFacts, rig: Rig, lens: Lens) -> tuple[Rig, tuple[str, ...]]:
    """The rig that measured the scene, where the folder has it, with a remark when another one was asked for."""
    if facts.rig is None:
        return rig_of_capture(rig, lens), ()
    own = load_rig(folder / Path(facts.rig).name)
    seen = own.camera.lens
    if (seen.width, seen.height) != (lens.width, lens.height):
        raise SceneError(
            f"{folder / facts.rig}: its camera has {seen.width} x {seen.height} pixels and the photo "
            f"{lens.width} x {lens.height}: both must be the same"
        )
    asked = rig not in {own, load_rig(None)}
    return own, (f"{folder.name} is looked at with the rig that measured it, {own.name}",) if asked else ()


def _open_mesh(path: Path, rig: Rig) -> Scene:
    """A mesh file before a wall; its first gate shows it whole and leaves the wall dark."""
    placement = Placement((0.0, 0.0, 1.05), fit_height_m=0.35, fit_extent_m=0.7)
    if path.suffix.lower() == ".stl":
        placement = replace(placement, up="z")
    backdrop = plane("backdrop", (0.0, 0.0, BACKDROP_Z_M), (2.4, 2.0), turn(), Finish((0.5, 0.5, 0.5)))
    meshes, remarks = read_mesh(path, placement)
    description = f"The mesh {path.name} before a grey wall."
    gates: tuple[Preset, ...] = ()
    if not no_slabs(rig):
        points = np.concatenate([mesh.vertices[np.unique(mesh.faces)] for mesh in meshes])
        gates = (Preset("The whole mesh", gate_before_wall(rig, points, BACKDROP_Z_M)),)
    return Scene(plain_name(path.stem), description, (*meshes, backdrop), gates=gates, remarks=remarks)
