"""Files of every kind, damaged at random, through the functions that read them; run as a process with little memory.

    python fuzzed.py KIND SEED COUNT FOLDER

prints one line of JSON for every finding, and at the end how many inputs were read, refused and tried.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import random
import re
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fuzzed_pictures import SEEDS
from slopegate.core.rig.checks import LONGEST_SENTENCE, UserError

LONGEST_S = 30.0
MEMORY_BYTES = 6_000_000_000
"""Of address space: what is loaded takes more than two of them."""

FOREIGN = re.compile(
    r"Traceback|\[Errno|codec can't|Field required|Input should|Exceeds the limit|requested and \d|could not broadcast"
    r"|object has no|NoneType|validation error|must be str|unsupported operand|object is not|list index|KeyError"
    r"|0x[0-9a-f]{6}|type=|slopegate\.|numpy\.|OpenCV\(|cv2\."
)
"""What a library, the operating system or Python would say, and the program would not."""

NASTY = (
    *(b"", b"\x00", b"\x1b[31m", b"\xff\xfe", b"9" * 5000, b"-1", b"1e400", b"nan", b"[" * 3000, b"\n", b'"', b"/"),
    *(b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x00\x00\x00\x80", b"2147483648", b"x" * 5000, b"../", b"\t", b"{}"),
)
NUMBERS = (b"0", b"-1", b"1e9", b"1e-9", b"nan", b"1e400", b"99999999999", b"true", b'"a"', b"[]", b"0.5", b"20000")


def told_well(sentence: str) -> str:
    """What is wrong with a sentence for the user; empty when nothing is."""
    if not sentence.strip():
        return "says nothing"
    if not sentence.isprintable():
        return "holds what a terminal would obey"
    if len(sentence) > LONGEST_SENTENCE:
        return f"has {len(sentence)} characters"
    found = FOREIGN.search(sentence)
    return f"holds {found[0]!r}, which is not the program's word" if found else ""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to four things wrong in them."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at, way = rng.randrange(len(out) + 1), rng.randrange(11)
        length = rng.choice((1, 2, 4, 8, 30, 300))
        if way == 0:
            del out[at:]
        elif way == 1:
            del out[at : at + length]
        elif way == 2:
            out[at:at] = out[at : at + length]
        elif way == 3:
            out[at:at] = rng.choice(NASTY)
        elif way == 4:
            out[at : at + length] = rng.choice(NASTY)
        elif way in (5, 6, 7):
            _exchange_number(out, rng)
        elif out:
            for _ in range(rng.choice((1, 1, 4, 32))):
                out[rng.randrange(len(out))] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return bytes(out)


def _exchange_number(out: bytearray, rng: random.Random) -> None:
    """Put another value in the place of one of the numbers that stand there as text."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", bytes(out[:20_000])))
    if numbers:
        chosen = rng.choice(numbers)
        out[chosen.start() : chosen.end()] = rng.choice(NUMBERS)


@dataclass(frozen=True)
class Kind:
    """One kind of input."""

    make: Callable[[Path], Path]
    """Makes a good one in an empty folder; which file is damaged."""
    read: Callable[[Path], object]
    """Reads what is in the folder, given that file."""


def _text(name: str, text: str) -> Callable[[Path], Path]:
    return lambda folder: _written(folder / name, text.encode())


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def _open_scene(path: Path) -> object:
    from slopegate.drivers.files.rig_files import load_rig
    from slopegate.drivers.scenes.scene_files import open_scene

    return open_scene(path, load_rig(None))


def _load_rig(path: Path) -> object:
    from slopegate.drivers.files.rig_files import load_rig

    return load_rig(path)


def _shipped(place: str) -> Callable[[Path], Path]:
    from importlib.resources import files

    source = Path(str(files("slopegate.resources") / place))
    return lambda folder: _written(folder / source.name, source.read_bytes())


SCENE = """
title = "All of it"
ambient = 0.02
indirect = true
[fog]
visibility_m = 20.0
[[objects]]
name = "wall"
type = "plane"
centre_m = [0, 0, 2.5]
width_m = 6.0
height_m = 4.0
tilt_deg = 3.0
albedo = [0.8, 0.7, 0.6]
[[objects]]
type = "sphere"
centre_m = [0.1, 0, 1.0]
radius_m = 0.15
[[objects]]
type = "box"
centre_m = [0.1, 0, 1.0]
size_m = [0.15, 0.1, 0.2]
"""
OBJ = """mtllib a.mtl
o thing
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
vt 0 0
vt 1 0
vt 1 1
vn 0 0 -1
usemtl red
f 1/1/1 2/2/1 3/3/1 4/1/1
"""
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face 2
property list uchar int vertex_indices
end_header
0 0 1 255 0 0
1 0 1 255 0 0
1 1 1 255 0 0
0 1 1 255 0 0
3 0 1 2
3 0 2 3
"""
GATES = """
[[gates]]
name = "the card"
line_time_us = 12.8
delay_us = 2028.0
exposure_us = 400.0
rig = "check"
[[gates]]
name = "a sheet"
tilt_deg = 15.0
distance_m = 1.0
thickness_m = 0.1
complement = true
"""
STL = """solid a
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 1 1 0
endloop
endfacet
endsolid a
"""


def _obj(folder: Path) -> Path:
    _written(folder / "a.mtl", b"newmtl red\nKd 0.8 0.1 0.1\nmap_Kd a.png\n")
    cv2.imwrite(str(folder / "a.png"), np.full((4, 4, 3), 128, np.uint8))
    return _written(folder / "a.obj", OBJ.encode())


def _mtl(folder: Path) -> Path:
    _obj(folder)
    return folder / "a.mtl"


def _open_obj(path: Path) -> object:
    return _open_scene(path.with_name("a.obj"))


def _binary_ply(folder: Path) -> Path:
    header = PLY[: PLY.index("end_header")].replace("ascii", "binary_little_endian") + "end_header\n"
    corners = np.zeros(4, [("p", "<f4", 3), ("c", "u1", 3)])
    corners["p"] = [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    faces = np.zeros(2, [("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, [(0, 1, 2), (0, 2, 3)]
    return _written(folder / "a.ply", header.encode() + corners.tobytes() + faces.tobytes())


def _binary_stl(folder: Path) -> Path:
    facets = np.zeros(2, [("v", "<f4", (4, 3)), ("a", "<u2")])
    facets["v"][:, 1:] = [[(0, 0, 1), (1, 0, 1), (1, 1, 1)], [(0, 0, 1), (1, 1, 1), (0, 1, 1)]]
    return _written(folder / "a.stl", b"\0" * 80 + np.uint32(2).tobytes() + facets.tobytes())


def _glb(folder: Path) -> Path:
    from small_glb import SmallGlb

    SmallGlb.square().write(folder / "a.glb")
    return folder / "a.glb"


def _photo_and_depth(folder: Path) -> None:
    cv2.imwrite(str(folder / "color.png"), np.full((24, 32, 3), 128, np.uint8))
    cv2.imwrite(str(folder / "depth_mm.png"), np.full((24, 32), 1500, np.uint16))
    facts = {"title": "a", "width": 32, "height": 24, "intrinsics": {"fx": 30, "fy": 30, "cx": 16, "cy": 12}}
    (folder / "scene.json").write_text(json.dumps(facts), "utf-8")


def _rgbd(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        _photo_and_depth(folder)
        return folder / name

    return make


def _open_folder(path: Path) -> object:
    return _open_scene(path.parent)


def _picture(suffix: str, pixels: Any) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from slopegate.drivers.files.images import write_image

        write_image(folder / f"a{suffix}", suffix, pixels)
        return folder / f"a{suffix}"

    return make


def _pfm(folder: Path) -> Path:
    return _written(folder / "a.pfm", b"Pf\n8 6\n-1.0\n" + np.full((6, 8), 1.5, np.float32).tobytes())


def _read_map(path: Path) -> object:
    from slopegate.drivers.files.picture_files import read_map

    return read_map(path)


def _read_colour(path: Path) -> object:
    from slopegate.drivers.files.picture_files import read_colour

    return read_colour(path)


def _capture(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from small_capture import record

        record(folder / "c", dark=True)
        return folder / "c" / name

    return make


def _open_capture(path: Path) -> object:
    from slopegate.drivers.captures.storage import open_capture

    opened = open_capture(path.parent)
    return [opened.mean(index) for index in opened.records()], opened.dark_mean(), opened.sidecar.model_dump_json()


def _transport(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from made_transports import made_transport

        made_transport(folder / "t")
        return folder / "t" / name

    return make


def _open_transport(path: Path) -> object:
    from slopegate.drivers.transports.storage import open_transport

    opened = open_transport(path.parent)
    return [opened.slice(index) for index in opened.records()]


def _kept_settings(path: Path) -> object:
    from slopegate.app.session.preferences import Preferences, load

    _, why = load(path, Preferences, "the window")
    if why:
        raise UserError(why)
    return None


def _read_gates(path: Path) -> object:
    from slopegate.drivers.files.rig_files import load_rig
    from slopegate.drivers.scenes.gate_files import presets_of, read_gate_file

    return presets_of(read_gate_file(path), load_rig(None), path)


def _session(folder: Path) -> Path:
    from slopegate.app.session.session_file import SavedSession, write_session
    from slopegate.drivers.files.rig_files import load_rig, rig_to_toml

    _written(folder / "a.toml", SCENE.encode())
    gate = {"line_time_us": 12.8, "delay_us": 2000.0, "exposure_us": 400.0}
    facts = {"scene": "a.toml", "rig_toml": rig_to_toml(load_rig(None)), "gate": gate, "slab": (15.0, 1.0, 0.1)}
    layouts, panels = {"gate": "AAAA/wAAAAD9"}, {"alarm": {"level": 3.5, "on": True, "name": "a"}}
    saved = SavedSession(**facts, rate_hz=20.0, layouts=layouts, panels=panels)  # type: ignore[arg-type]
    return write_session(folder / "a.slopegate", saved)


def _open_session(path: Path) -> object:
    from slopegate.app.session.session_file import read_session, scene_in
    from slopegate.drivers.contract.families import read_address
    from slopegate.drivers.files.rig_files import parse_rig

    saved = read_session(path)
    where = read_address(saved.camera) if saved.camera is not None else scene_in(saved, path)
    return parse_rig(saved.rig_toml, f"the rig of {path}"), where


def _gltf(name: str) -> Callable[[Path], Path]:
    """A file of text with its numbers and its picture beside it."""

    def make(folder: Path) -> Path:
        from small_glb import UPRIGHT, SmallGlb

        glb = SmallGlb.square()
        glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = glb.array(UPRIGHT)
        glb.paint(baseColorTexture={"index": 0}, baseColorFactor=[1, 0.5, 0.5, 1])
        cv2.imwrite(str(folder / "a.png"), np.full((4, 4, 3), 128, np.uint8))
        buffers = [{"uri": "a.bin", "byteLength": len(glb.data)}]
        beside = {"buffers": buffers, "images": [{"uri": "a.png"}], "textures": [{"source": 0}]}
        _written(folder / "a.bin", glb.data)
        _written(folder / "a.gltf", json.dumps(glb.json | beside).encode())
        return folder / name

    return make


def _open_gltf(path: Path) -> object:
    return _open_scene(path.with_name("a.gltf"))


def _exported(kind: str, out: str, damaged_part: str = "") -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from slopegate.drivers.captures.export import export_capture
        from small_capture import record

        capture, _ = record(folder / "c", dark=True, frames=2)
        export_capture(capture, kind, folder / out)
        return folder / out / damaged_part

    return make


def _open_exported(path: Path) -> object:
    from slopegate.drivers.captures.exported import is_exported, open_any

    whole = next(place for place in (path, *path.parents) if ".ome." in place.name)
    is_exported(whole)
    opened = open_any(whole)
    known = list(opened.records())
    return [opened.mean(index) for index in known], opened.dark_mean(), opened.pixel_means(known, 3, 4)


def _film(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from slopegate.core.gating.gate import upright_line_time
        from slopegate.core.rig.settings import gate
        from slopegate.drivers.captures.film import END, FilmWriter, create_film, make_film_manifest
        from slopegate.drivers.captures.model import FilmFrame, Gate
        from small_capture import RIG, camera

        info, settings = camera().info, gate(upright_line_time(RIG), 2000.0, 400.0)
        film = create_film(folder / "r", make_film_manifest("a", RIG, info, settings))
        writer, asked = FilmWriter(film), Gate.of(settings)
        for number in range(3):
            image = np.full((info.height, info.width), 100 * number, np.uint16)
            frame = {"number": number, "sequence": number, "time_s": 0.05 * number, "taken": "2026-01-01T00:00:00"}
            writer.add(image, FilmFrame(**frame, asked=asked, applied=asked))  # type: ignore[arg-type]
        writer.close()
        film.look_again()
        _written(film.path / END, film.counted().model_dump_json().encode())
        return film.path / name

    return make


def _open_film(path: Path) -> object:
    from slopegate.drivers.captures.film import open_film
    from slopegate.drivers.captures.film_camera import FilmCamera

    film = open_film(path.parent)
    frames = [(film.frame(number), film.record(number)) for number in range(len(film))]
    return frames, film.counted(), film.rate_hz, FilmCamera(film).info


def _twin(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        from slopegate.core.measure.twin import Twin
        from slopegate.core.rig.settings import gate
        from slopegate.core.scene.scene import Preset
        from slopegate.drivers.scenes.twin_files import save_twin
        from small_capture import RIG

        shape = RIG.camera.lens.height, RIG.camera.lens.width
        twin = Twin(np.full((*shape, 3), 0.5, np.float32), np.full(shape, 0.7, np.float32), 0.01, 900.0)
        save_twin(folder / "t", RIG, twin, "a", "what was swept", [Preset("one", gate(12.8, 2000.0, 400.0))])
        return folder / "t" / name

    return make


def _read_all_ways(path: Path) -> None:
    """As photo, numbers and mask, as far as its suffix lets; refused where none of these can be read."""
    from slopegate.drivers.files import picture_files as files

    ways: list[Callable[[Path], object]] = [files.read_region]
    ways += [files.read_colour] if path.suffix in files.COLOUR_SUFFIXES else []
    ways += [files.read_luminance] if path.suffix != ".pfm" else []
    ways += [files.read_map] if path.suffix in files.MAP_SUFFIXES else []
    refusals = []
    for way in ways:
        try:
            way(path)
        except UserError as error:
            refusals.append(error)
    badly = [error for error in refusals if told_well(str(error))]
    if badly or len(refusals) == len(ways):
        raise (badly or refusals)[0]


def _seed(suffix: str, data: Callable[[], bytes]) -> Kind:
    return Kind(lambda folder: _written(folder / f"a{suffix}", data()), _read_all_ways)


COUNTS = np.arange(48, dtype=np.uint16).reshape(6, 8)
LIGHT = COUNTS.astype(np.float32)
KINDS: dict[str, Kind] = {
    "scene toml": Kind(_text("a.toml", SCENE), _open_scene),
    "rig toml": Kind(_shipped("rigs/check.toml"), _load_rig),
    "obj": Kind(_obj, _open_scene),
    "mtl": Kind(_mtl, _open_obj),
    "ply text": Kind(_text("a.ply", PLY), _open_scene),
    "ply binary": Kind(_binary_ply, _open_scene),
    "stl text": Kind(_text("a.stl", STL), _open_scene),
    "stl binary": Kind(_binary_stl, _open_scene),
    "glb": Kind(_glb, _open_scene),
    "scene.json": Kind(_rgbd("scene.json"), _open_folder),
    "depth png": Kind(_rgbd("depth_mm.png"), _open_folder),
    "photo png": Kind(_rgbd("color.png"), _open_folder),
    "png": Kind(_picture(".png", COUNTS.astype(np.uint8)), _read_colour),
    "tiff": Kind(_picture(".tif", COUNTS), _read_colour),
    "tiff map": Kind(_picture(".tif", COUNTS), _read_map),
    "exr": Kind(_picture(".exr", LIGHT), _read_map),
    "npy": Kind(_picture(".npy", LIGHT), _read_map),
    "pfm": Kind(_pfm, _read_map),
    "capture manifest": Kind(_capture("capture.json"), _open_capture),
    "slice": Kind(_capture("slice_0001.tif"), _open_capture),
    "dark frame": Kind(_capture("dark.tif"), _open_capture),
    "transport manifest": Kind(_transport("transport.json"), _open_transport),
    "transport slice": Kind(_transport("slice_0000.npz"), _open_transport),
    "gates": Kind(_text("a.toml", GATES), _read_gates),
    "session": Kind(_session, _open_session),
    "gltf": Kind(_gltf("a.gltf"), _open_gltf),
    "gltf buffer": Kind(_gltf("a.bin"), _open_gltf),
    "gltf picture": Kind(_gltf("a.png"), _open_gltf),
    "ome-tiff": Kind(_exported("ome-tiff", "a.ome.tif"), _open_exported),
    "ome-zarr group": Kind(_exported("zarr", "a.ome.zarr", "zarr.json"), _open_exported),
    "ome-zarr array": Kind(_exported("zarr", "a.ome.zarr", "0/zarr.json"), _open_exported),
    "ome-zarr chunk": Kind(_exported("zarr", "a.ome.zarr", "0/c/1/0/0"), _open_exported),
    "ome-zarr dark": Kind(_exported("zarr", "a.ome.zarr", "dark/zarr.json"), _open_exported),
    "film manifest": Kind(_film("recording.json"), _open_film),
    "film frames": Kind(_film("frames_0000.tif"), _open_film),
    "film end": Kind(_film("ended.json"), _open_film),
    "twin scene.json": Kind(_twin("scene.json"), _open_folder),
    "twin rig": Kind(_twin("rig.toml"), _open_folder),
    "twin depth": Kind(_twin("depth_m.exr"), _open_folder),
    "twin photo": Kind(_twin("color.png"), _open_folder),
    **{f"picture {name}": _seed(suffix, data) for name, (suffix, data) in SEEDS.items()},
    "window.json": Kind(_text("window.json", '{"gate": null, "theme": "dark", "rate_hz": 20.0}'), _kept_settings),
}


class _Logged(logging.Handler):
    """While it lasts, notes the first line that anybody logs or warns of."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.first = ""

    def emit(self, record: logging.LogRecord) -> None:
        """One line."""
        self.first = self.first or f"{record.name} logged: {record.getMessage()[:300]}"

    def __enter__(self) -> None:
        logging.captureWarnings(True)
        logging.getLogger().addHandler(self)

    def __exit__(self, *error: object) -> None:
        logging.getLogger().removeHandler(self)
        logging.captureWarnings(False)


def fault_of(read: Callable[[Path], object], path: Path) -> tuple[str, str]:
    """How a reading went: "read", "refused", or "finding" with what is wrong."""
    begun = time.monotonic()
    logged = _Logged()
    try:
        with logged:
            read(path)
        how, what = "read", ""
    except UserError as error:
        why = told_well(str(error))
        how, what = "refused", f"{why}: {error}" if why else ""
    except BaseException:
        how, what = "refused", traceback.format_exc()[-1500:]
    seconds = time.monotonic() - begun
    what = what or logged.first
    if not what and seconds > LONGEST_S:
        what = f"took {seconds:.0f} s"
    return ("finding", what) if what else (how, "")


def run(kind: str, seed: int, count: int, keep: Path) -> None:
    """Try `count` inputs of a kind; those with a finding are kept in the folder."""
    import resource

    chosen, rng, told = KINDS[kind], random.Random(f"{kind} {seed}"), Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = chosen.make(folder)
        for library in logging.root.manager.loggerDict:  # nothing is quiet because a good one was made
            logging.getLogger(library).setLevel(logging.NOTSET)
        good = path.read_bytes()
        how, what = fault_of(chosen.read, path)
        assert how == "read", f"the good one is refused: {what}"
        for number in range(count):
            path.write_bytes(damaged(good, rng))
            print(json.dumps({"begun": number}), flush=True)
            how, what = fault_of(chosen.read, path)
            told[how] += 1
            if how == "finding":
                kept = keep / f"{kind.replace(' ', '-')}-{seed}-{number}{path.suffix}"
                shutil.copy(path, kept)
                print(json.dumps({"kind": kind, "number": number, "file": str(kept), "what": what}), flush=True)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps({"told": told, "peak_mb": round(peak_mb)}), flush=True)


def main() -> None:
    """See above."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    with contextlib.suppress(BrokenPipeError):
        run(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
