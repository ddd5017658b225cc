"""Mesh files with bytes changed, lost or doubled: each is read, or refused in one sentence."""

import random
from pathlib import Path

import cv2
import numpy as np
import pytest

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.mesh_files import Placement, read_mesh

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
OBJ = f"mtllib thing.mtl\n{QUAD}usemtl m\nf 1/1 2/2 3/3\nusemtl n\nf 4 -4 3 2 1 # back\nl 1 2\n"
MTL = "newmtl m\nmap_Kd -s 2 2 -o 0.5 0 -clamp off flag.png\nd 0.5\nnewmtl n\nKd 1 0.5 0\n"
HEAD = "ply\nformat {} 1.0\ncomment TextureFile flag.png\nelement vertex 4\n"
FACES = "".join(
    f"property {kind}\n" for kind in ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
)
WEDGES = "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
ROWS = [((0, 1, 2), (0, 0, 1, 0, 1, 1)), ((0, 1, 2, 3), ())]
PARTS = [b"-1", b"0", b"1e400", b"nan", b"99999999999", b"//", b"\\\n", b"#", b"f ", b"\xff\xfe", b"\x00"]


def seeds() -> dict[str, bytes]:
    colours = "".join(f"{' '.join(map(str, point))} {k * 60} 0 9\n" for k, point in enumerate(POINTS))
    faces = "".join(" ".join(map(str, (len(a), *a, len(b), *b))) + "\n" for a, b in ROWS)
    binary = b"".join(np.array(p, ">f4").tobytes() + bytes([1, 2, 3]) for p in POINTS)
    for a, b in ROWS:
        binary += bytes([len(a)]) + np.array(a, ">i4").tobytes() + bytes([len(b)]) + np.array(b, ">f4").tobytes()
    corners = POINTS[[0, 1, 2, 0, 2, 3]].astype("<f4").reshape(2, 9)
    facets = b"".join(bytes(12) + row.tobytes() + bytes(2) for row in corners)
    loops = ""
    for row in corners.reshape(2, 3, 3):
        vertices = "".join(f"vertex {x} {y} {z}\n" for x, y, z in row)
        loops += f"facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n"
    return {
        "text.obj": OBJ.encode(),
        "text.ply": (HEAD.format("ascii") + FACES + WEDGES + colours + faces).encode(),
        "binary.ply": (HEAD.format("binary_big_endian") + FACES + WEDGES).encode() + binary,
        "binary.stl": bytes(80) + (2).to_bytes(4, "little") + facets,
        "text.stl": f"solid\n{loops}endsolid\n".encode(),
    }


def damaged(data: bytes, chance: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(len(changed) + 1)
        match chance.randrange(4):
            case 0:
                changed[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                changed[at:at] = chance.choice(PARTS)
            case 2:
                del changed[at : at + chance.randrange(1, 40)]
            case _:
                start = chance.randrange(len(changed) + 1)
                changed[at:at] = changed[start : start + chance.randrange(1, 60)]
    return bytes(changed)


def try_damaged(folder: Path, name: str, rounds: int, capfd: pytest.CaptureFixture[str]) -> None:
    whole = seeds()[name]
    (folder / "thing.mtl").write_text(MTL)
    cv2.imwrite(str(folder / "flag.png"), np.full((4, 4, 3), 200, np.uint8))
    path = folder / name
    chance = random.Random(name)
    read, refused = 0, 0
    path.write_bytes(whole)
    read_mesh(path, Placement((0, 0, 1)))
    for _ in range(rounds):
        path.write_bytes(damaged(whole, chance))
        try:
            _, remarks = read_mesh(path, Placement((0, 0, 1)))
            said = list(remarks)
            read += 1
        except SceneError as error:
            said = [str(error)]
            refused += 1
        for sentence in said:
            assert sentence.isprintable(), sentence
            assert len(sentence) < 1000
    assert read
    assert refused
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", seeds())
def test_damaged_meshes_are_read_or_refused(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    try_damaged(tmp_path, name, 100, capfd)


@pytest.mark.slow
@pytest.mark.parametrize("name", seeds())
def test_many_damaged_meshes(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    try_damaged(tmp_path, name, 5000, capfd)
