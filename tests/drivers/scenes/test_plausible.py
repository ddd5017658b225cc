from pathlib import Path

import pytest

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import offered_scenes, open_scene

RIG = load_rig(None)
CASE = Path(__file__).parents[4] / "shared" / "cases" / "capture_out_of_view" / "scene_in_mm.toml"
CARD = '[[objects]]\ntype = "plane"\ncentre_m = [{}]\nwidth_m = {}\nheight_m = {}\n'


def remarks(folder: Path, centre: str, size: float = 0.2) -> tuple[str, ...]:
    path = folder / "scene.toml"
    path.write_text(CARD.format(centre, size, size))
    return open_scene(path, RIG)[1].remarks


def test_a_scene_in_millimetres_is_told_its_distance_and_unit(tmp_path: Path) -> None:
    (remark,) = remarks(tmp_path, "0, 0, 1050", 400)
    assert remark.startswith(f"{tmp_path / 'scene.toml'}: the nearest surface is at 1050 m")
    assert "millimetres must be a thousandth" in remark
    assert remarks(tmp_path, "0, 0, 1.05") == ()
    assert remarks(tmp_path, "0, 0, 99") == ()


@pytest.mark.skipif(not CASE.is_file(), reason="the shared cases are not here")
def test_the_case_in_millimetres() -> None:
    (remark,) = open_scene(CASE, RIG)[1].remarks
    assert "the nearest surface is at 1050 m" in remark


@pytest.mark.parametrize(
    ("centre", "size", "words"),
    [
        ("0, 0, 0.0005", 1, "a surface is 0.5 mm from the camera: it must be at least 1 mm away"),
        (", ".join(str(float(x)) for x in RIG.projector_centre_m), 0.05, "a surface is 0 mm from the projector"),
        ("10000, 10000, 10000", 1, "the nearest surface is at 17319.9 m: it must be within 10000 m"),
    ],
)
def test_surfaces_where_none_can_be_seen_are_refused(tmp_path: Path, centre: str, size: float, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        remarks(tmp_path, centre, size)
    assert words in str(caught.value)


@pytest.mark.parametrize("centre", ["0, 0, -1", "5, 0, 1", "0, 3, 1"])
def test_a_scene_that_nobody_sees_says_so(tmp_path: Path, centre: str) -> None:
    (remark,) = remarks(tmp_path, centre)
    assert "no object is in the camera's view" in remark


def test_no_shipped_scene_is_remarked() -> None:
    for entry in offered_scenes():
        assert not [text for text in open_scene(entry.path, RIG)[1].remarks if "nearest" in text or "view" in text]
