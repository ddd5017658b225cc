"""Mutated glTF files: each opens or is one sentence, in bounded time, and nothing is logged."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.mesh_files import Placement, read_mesh
from small_glb import UPRIGHT, SmallGlb

VALUES: list[Any] = [
    -1,
    0,
    1,
    3,
    255,
    65535,
    2**32 - 1,
    2**53,
    1e300,
    -1e30,
    1.5,
    "x",
    "",
    None,
    [],
    {},
    [0],
    [[]],
    True,
]
VALUES += ["x", "", "../x", "data:;base64,AAAA", "VEC3", "MAT4", "SCALAR", 5121, 5123, 5125, 5126, 6_000_000, 100_000]


def rich() -> SmallGlb:
    """A file with a little of all that is read."""
    glb = SmallGlb.square()
    attributes = glb.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"TEXCOORD_0": glb.array(UPRIGHT), "COLOR_0": glb.array(np.eye(4, 3))}
    attributes |= {"JOINTS_0": glb.array(np.zeros((4, 4)), "uint8"), "WEIGHTS_0": glb.array(np.eye(4)[[0] * 4])}
    transform = {"KHR_texture_transform": {"scale": [2, 2], "rotation": 1, "offset": [1, 2]}}
    texture = glb.texture(np.full((2, 2, 3), 9000), "uint16", {"wrapS": 33648}) | {"extensions": transform}
    glb.paint(baseColorTexture=texture)
    glb.mesh([0, 1, 2, 3], 5, POSITION=0)
    glb.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": glb.array(np.ones((4, 3)))}]
    glb.json["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": glb.view(b"\2"), "componentType": 5121},
        "values": {"bufferView": glb.view(np.ones(3, np.float32).tobytes())},
    }
    places = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": glb.array(np.eye(2, 3))}}}
    glb.json["skins"] = [{"joints": [2], "inverseBindMatrices": glb.array(np.eye(4)[None])}]
    glb.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2, 3]}, {"rotation": [0, 0, 1, 0]}]
    glb.json["nodes"].append({"mesh": 1, "extensions": places, "matrix": np.eye(4).ravel().tolist()})
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    return glb


def entries(value: Any) -> Iterator[tuple[Any, Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield value, key
        yield from entries(item)


def mutated(chance: random.Random) -> bytes:
    glb = rich()
    if chance.random() < 0.6:
        for _ in range(chance.choice([1, 1, 2, 4])):
            holder, key = chance.choice(list(entries(glb.json)))
            holder[key] = json.loads(json.dumps(chance.choice(VALUES)))
        return glb.packed()
    data = bytearray(glb.packed())
    for _ in range(chance.choice([1, 2, 10])):
        at = chance.randrange(len(data))
        match chance.randrange(3):
            case 0:
                data[at] = chance.randrange(256)
            case 1:
                del data[at : at + chance.randrange(1, 9)]
            case _:
                data[at : at + 4] = struct.pack("<I", chance.choice([0, 1, 2**31, 2**32 - 1, len(data)]))
    return bytes(data)


def run(path: Path, seed: int, caplog: pytest.LogCaptureFixture) -> bool:
    path.write_bytes(mutated(random.Random(seed)))
    message = ""
    try:
        read_mesh(path, Placement((0.0, 0.0, 1.0), fit_height_m=0.3))
    except SceneError as error:
        message = str(error)
    assert not message or message.startswith(str(path.parent)), seed
    assert "\n" not in message, seed
    assert len(message) < 600 + len(str(path)), seed
    assert caplog.records == [], seed
    return not message


def test_a_hundred_mutated_files(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rich().write(tmp_path / "whole.glb")
    meshes, remarks = read_mesh(tmp_path / "whole.glb", Placement((0.0, 0.0, 1.0), fit_height_m=0.3))
    assert (len(meshes), remarks) == (3, ())
    outcomes = {run(tmp_path / "thing.glb", seed, caplog) for seed in range(100)}
    assert outcomes == {True, False}


@pytest.mark.slow
def test_five_thousand_mutated_files(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for seed in range(100, 5_000):
        run(tmp_path / "thing.glb", seed, caplog)
