"""Reads material libraries (MTL) of OBJ files: colours and textures, and by name what else a material asks for."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from slopegate.core.rig.checks import shown
from slopegate.core.rig.rig import Vector3
from slopegate.drivers.files.reading import read_plain
from slopegate.drivers.scenes.obj_text import keyword, lines_of, text_of, uncommented

# How many values an option of a map takes, at most: those of -o, -s and -t may be fewer.
_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2, "-o": 3,
    "-s": 3, "-t": 3, "-texres": 1, "-type": 1, "-colorspace": 1,
}  # fmt: skip
# Options that change nothing here: how a texture is filtered, and how bumps and single channels are taken.
_IDLE = {"-blendu", "-blendv", "-bm", "-boost", "-imfchan", "-texres", "-type"}
_NEUTRAL = {"-mm": (0.0, 1.0), "-t": (0.0, 0.0, 0.0)}
_FINISH_MAPS = {
    "map_ka", "map_ks", "map_ns", "map_ke", "map_pr", "map_pm", "map_ps", "bump", "map_bump", "norm", "map_kn", "disp",
    "map_disp", "refl", "map_refl", "decal",
}  # fmt: skip
_SEE_THROUGH = "lets light through (d or Tr): it is shown opaque"


@dataclass
class ObjMaterial:
    """What a library says of one material; `notes` are clauses about what of it is not shown."""

    library: Path
    colour: Vector3 | None = None
    texture: str | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    """u and v (up) are multiplied by this, then `offset` is added."""
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False
    notes: list[str] = field(default_factory=list)


def read_library(path: Path) -> dict[str, ObjMaterial]:
    """The materials of a library by name. Raises SceneError where the file cannot be read."""
    materials: dict[str, ObjMaterial] = {}
    current = ObjMaterial(path)
    opacity: dict[str, float] = {}
    for _, line in lines_of(text_of(read_plain(path))):
        word, rest = keyword(line)
        if word.lower() == "newmtl":
            current, opacity = ObjMaterial(path), {}
            materials.setdefault(rest, current)
            continue
        _statement(current, opacity, word.lower(), rest)
    return materials


def _statement(material: ObjMaterial, opacity: dict[str, float], word: str, rest: str) -> None:
    if word == "kd":
        _colour(material, uncommented(rest).split())
    elif word in {"map_kd", "map_d"}:
        options, name = _options(rest)
        if word == "map_d":
            material.notes.append("has a map_d: what it cuts out is shown whole")
        elif name:
            material.texture = name
            _apply(material, options)
    elif word in {"d", "tr"}:
        value = _numbers([part for part in uncommented(rest).split() if part != "-halo"])[:1]
        if value and math.isfinite(value[0]):
            opacity.setdefault(word, value[0])
        _note_opacity(material, opacity)
    elif word == "ke" and any(value > 0 for value in _numbers(uncommented(rest).split())):
        material.notes.append("shines by itself (Ke), which is left out")
    elif word in _FINISH_MAPS and rest:
        material.notes.append(f"has a {word}, which is left out: surfaces are smooth and matt")


def _colour(material: ObjMaterial, words: list[str]) -> None:
    values = _numbers(words)[:3]
    if len(values) == len(words[:3]) and len(values) in {1, 3}:
        red, green, blue = values * 3 if len(values) == 1 else values
        material.colour = red, green, blue
    else:
        material.notes.append(f"has no red, green and blue as colour (Kd {shown(' '.join(words))}): it is light grey")


def _note_opacity(material: ObjMaterial, opacity: dict[str, float]) -> None:
    """Of d, where 1 is opaque, and Tr, where 0 is, the first counts: writers differ in what Tr means."""
    material.notes = [note for note in material.notes if note != _SEE_THROUGH]
    if (1 - opacity["d"] if "d" in opacity else opacity.get("tr", 0.0)) > 1e-3:
        material.notes.append(_SEE_THROUGH)


def _numbers(words: list[str]) -> list[float]:
    """The words as numbers, up to the first that is none."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            break
    return values


def _options(rest: str) -> tuple[list[tuple[str, list[str]]], str]:
    """The options of a map and the name of its file, which may hold blanks."""
    options: list[tuple[str, list[str]]] = []
    while rest.startswith("-"):
        option, *tail = rest.split(None, 1)
        most = _OPTIONS.get(option.lower())
        if most is None:
            break
        rest = tail[0] if tail else ""
        values: list[str] = []
        while len(values) < most and rest:
            word, *tail = rest.split(None, 1)
            if values and option.lower() in {"-o", "-s", "-t"} and not _numbers([word]):
                break
            values.append(word)
            rest = tail[0] if tail else ""
        options.append((option.lower(), values))
    return options, rest.strip()


def _apply(material: ObjMaterial, options: list[tuple[str, list[str]]]) -> None:
    for option, words in options:
        values = _numbers(words)
        if option in _IDLE:
            continue
        if option == "-clamp":
            material.clamp = words == ["on"]
        elif option in {"-s", "-o"} and values and all(math.isfinite(value) for value in values):
            default = 1.0 if option == "-s" else 0.0
            pair = (values[0], values[1] if len(values) > 1 else default)
            material.scale, material.offset = (pair, material.offset) if option == "-s" else (material.scale, pair)
        elif tuple(values) != _NEUTRAL.get(option, ()) and words not in (["off"], ["sRGB"]):
            material.notes.append(f"has a texture with {shown(' '.join([option, *words]))}, which is left out")


def library_names(rest: str) -> list[list[str]]:
    """What `mtllib` may mean: one name with blanks, or several, each ending in .mtl or of one word."""
    several = re.findall(r"\S.*?\.mtl(?=\s|$)", rest, flags=re.IGNORECASE)
    return [[rest], several, rest.split()]
