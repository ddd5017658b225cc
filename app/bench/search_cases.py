"""Seeded cases for the search: pictures posed before a wall, and planes of captures, with their truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np

from slopegate.core.render.render import Buffers, render
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.core.search.keypoints import Rectangle
from slopegate.drivers.files.picture_files import read_colour
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.plane_gates import PlaneFacts
from slopegate.drivers.scenes.scene_files import open_scene

CAPTURE_EVERY = 5
"""Every fifth case is a plane of a capture, where there are captures."""
SHARED_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Beside a checkout; without it the pictures and the capture that come with the program are used."""
TILT_DEG, YAW_DEG, ROLL_DEG = 75.0, 15.0, 10.0
DISTANCE_M = (0.4, 3.0)
WALL_BEHIND_M = (0.3, 1.5)
AMBIENT = (0.0, 0.02, 0.1)
_BINNING = 2


@dataclass(frozen=True, eq=False)
class Case:
    """A rig, what it sees, and what is to be found."""

    index: int
    kind: str
    name: str
    rig: Rig
    buffers: Buffers
    target: Rectangle
    truth: Bools
    """Pixels (H, W) that show the target, lit or not."""
    ignored: Bools
    """Pixels (H, W) that continue the target's plane beyond the rectangle: a gate may record them or not."""
    tilt_deg: float
    distance_m: float
    seed: int

    @cached_property
    def lit(self) -> Bools:
        """Pixels (H, W) that the projector lights."""
        return np.asarray(self.buffers.projector_row >= 0)


@dataclass(frozen=True)
class Material:
    """Where the pictures and captures are."""

    pictures: tuple[Path, ...]
    captures: tuple[Path, ...]


def material() -> Material:
    """The shared data where it is there, else what comes with the program."""
    own = Path(str(files("slopegate.resources") / "scenes"))
    pictures = tuple(sorted((SHARED_DATA / "targets").glob("*.png"))) or tuple(sorted(own.glob("*.png")))
    folders = sorted((SHARED_DATA / "scenes").glob("*/scene.json")) or sorted(own.glob("*/scene.json"))
    usable = [path.parent for path in folders if _planes(path.parent) and (path.parent / "color.png").exists()]
    return Material(pictures, tuple(usable))


def make_cases(count: int, seed: int) -> Iterator[Case]:
    """The cases of this seed, one after the other; the first ones of a longer list are the same."""
    found = material()
    rig = binned(load_rig(None), _BINNING)
    pictures = {path: read_colour(path, turn_upright=False) for path in found.pictures}
    for index in range(count):
        rng = np.random.default_rng((seed, index))
        if found.captures and index % CAPTURE_EVERY == CAPTURE_EVERY - 1:
            folder = found.captures[(index // CAPTURE_EVERY) % len(found.captures)]
            yield captured(index, folder, rng)
        else:
            yield posed(index, rig, pictures, rng)


def binned(rig: Rig, times: int) -> Rig:
    """The same rig with `times` x `times` pixels binned into one."""
    lens, shutter = rig.camera.lens, rig.camera.shutter
    fx, fy, cx, cy = (value / times for value in (lens.fx, lens.fy, lens.cx, lens.cy))
    small = Lens(lens.width // times, lens.height // times, fx, fy, cx, cy)
    line = shutter.line
    assert isinstance(line, PixelClocks)
    limits = replace(shutter, line=replace(line, clocks_per_line=line.clocks_per_line * times))
    return replace(rig, camera=replace(rig.camera, lens=small, shutter=limits), calibration=None)


def posed(index: int, rig: Rig, pictures: dict[Path, Singles], rng: np.random.Generator) -> Case:
    """A picture at a random pose in front of a wall with another picture on it."""
    paths = list(pictures)
    front, back = rng.choice(len(paths), 2, replace=False)
    distance = float(np.exp(rng.uniform(*np.log(DISTANCE_M))))
    tilt = float(rng.uniform(-TILT_DEG, TILT_DEG))
    rotation = turn(tilt, float(rng.uniform(-YAW_DEG, YAW_DEG)), float(rng.uniform(-ROLL_DEG, ROLL_DEG)))
    picture = pictures[paths[front]]
    lens, b = rig.camera.lens, rig.baseline_m
    width = float(rng.uniform(0.25, 0.55)) * distance * lens.width / lens.fx
    height = width * picture.shape[0] / picture.shape[1]
    # rows that the projector reaches at this distance: from the camera's upper rim down to the projector's lower one
    top, bottom = -lens.cy / lens.fy, (rig.projector.lens.height - rig.projector.lens.cy) / rig.projector.lens.fy
    slope = (top + bottom - b / distance) / 2 + rng.uniform(-0.04, 0.04)
    centre = (float(rng.uniform(-0.1, 0.1)) * distance, slope * distance + b / 2, distance)
    card = plane("target", centre, (width, height), rotation, Finish(texture=picture))
    farthest = float(card.vertices[:, 2].max())
    wall_z = farthest + float(rng.uniform(*WALL_BEHIND_M))
    wall = plane("wall", (0.0, 0.0, wall_z), (3 * wall_z, 2 * wall_z), turn(), Finish(texture=pictures[paths[back]]))
    ambient = float(rng.choice(AMBIENT))
    buffers = render(rig, Scene("case", objects=(card, wall), ambient=ambient))
    alone = render(rig, Scene("alone", objects=(card,))).inverse_depth
    truth = (alone > 0) & (alone == buffers.inverse_depth)
    name = f"{paths[front].stem} at {distance:.2f} m, {tilt:.0f} deg"
    nothing, noise = np.zeros_like(truth), int(rng.integers(1 << 31))
    return Case(index, "posed", name, rig, buffers, _around(truth), truth, nothing, tilt, distance, noise)


def captured(index: int, folder: Path, rng: np.random.Generator) -> Case:
    """A plane that a capture's calibration names, seen in a random rectangle that it mostly fills."""
    rig, scene = open_scene(folder, load_rig(None))
    buffers = render(rig, scene)
    planes = _planes(folder)
    facts = planes[int(rng.integers(len(planes)))]
    lens = rig.camera.lens
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = rig.camera_rays(columns, rows)
    w = buffers.inverse_depth.astype(np.float64)
    depth = np.divide(1.0, w, out=np.zeros_like(w), where=w > 0)
    normal = np.array(facts.normal)
    away = np.abs((rays @ normal) * depth + facts.distance_m)
    on = (w > 0) & (away < max(0.01, 3e-3 * facts.rms_mm))
    target = _mostly(on & (buffers.projector_row >= 0), rng)
    inside = np.zeros_like(on)
    inside[target[1] : target[3], target[0] : target[2]] = True
    truth = on & inside
    tilt = float(np.degrees(np.arctan2(normal[1], normal[2])))
    tilt = (tilt + 90) % 180 - 90
    distance = float(np.median(depth[truth])) if truth.any() else 0.0
    seed = int(rng.integers(1 << 31))
    return Case(
        index, "capture", f"{folder.name}, a plane", rig, buffers, target, truth, on & ~inside, tilt, distance, seed
    )


def _planes(folder: Path) -> list[PlaneFacts]:
    """The larger planes that a capture's calibration names."""
    planes = json.loads((folder / "scene.json").read_text(encoding="utf-8")).get("planes", [])
    return [facts for facts in map(PlaneFacts.model_validate, planes) if facts.inlier_fraction >= 0.1]


def _around(mask: Bools) -> Rectangle:
    """The rectangle around the target, as a user would draw it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size < 16 or columns.size < 16:
        return (0, 0, mask.shape[1], mask.shape[0])
    return (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _mostly(mask: Bools, rng: np.random.Generator, tries: int = 60) -> Rectangle:
    """Of so many random rectangles the one that the mask fills best."""
    height, width = mask.shape
    sums = np.zeros((height + 1, width + 1), np.int64)
    sums[1:, 1:] = mask.cumsum(axis=0).cumsum(axis=1)
    best, filled = (0, 0, width, height), 0.0
    for _ in range(tries):
        w, h = int(width * rng.uniform(0.25, 0.5)), int(height * rng.uniform(0.25, 0.5))
        x, y = int(rng.integers(width - w)), int(rng.integers(height - h))
        share = float(sums[y + h, x + w] - sums[y, x + w] - sums[y + h, x] + sums[y, x]) / (w * h)
        if share > filled:
            best, filled = (x, y, x + w, y + h), share
    return best
