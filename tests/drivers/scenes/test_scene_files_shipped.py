import json
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import draw_scenes
from slopegate.core.gating.gate import row_windows
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Glass, Gloss
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh, Preset, Scene, Sphere
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import SceneEntry, offered_scenes, open_scene, shipped_scenes

RIG = load_rig(None)
ENTRIES = {entry.key: entry for entry in shipped_scenes()}
RNG = np.random.default_rng(3)


def scene_of(key: str) -> Scene:
    return open_scene(ENTRIES[key].path, RIG)[1]


def points_on(items: Iterable[Mesh | Sphere], time_s: float = 0.0, count: int = 4000) -> NDArray[np.float64]:
    """Random points of the surfaces, some on every triangle, where they are at this time."""
    clouds = []
    for item in items:
        if isinstance(item, Sphere):
            directions = RNG.normal(size=(count, 3))
            cloud = np.array(item.centre_m) + item.radius_m * directions / np.linalg.norm(directions, axis=1)[:, None]
        else:
            each = max(count // len(item.faces), 1)
            shares = RNG.dirichlet((1, 1, 1), (len(item.faces), each))
            cloud = np.einsum("fnk,fkx->fnx", shares, item.vertices[item.faces]).reshape(-1, 3)
        if item.motion is not None:
            rotation, shift = item.motion.pose(time_s)
            cloud = cloud @ rotation.T + shift
        clouds.append(cloud)
    return np.concatenate(clouds)


def recorded(rig: Rig, preset: Preset, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Times the gate records each point that both the camera and the projector have in their frames."""
    windows = row_windows(rig, preset.settings)
    column, row, _ = rig.to_camera(points)
    beam_column, beam, _ = rig.to_projector(points)
    lens, projector = rig.camera.lens, rig.projector.lens
    seen = (column >= 0) & (column < lens.width) & (row >= 0) & (row < lens.height)
    seen &= (beam_column >= 0) & (beam_column < projector.width) & (beam >= 0) & (beam < projector.height)
    k, beam = row[seen].astype(int), beam[seen]
    lit = (windows.low[k] <= beam) & (beam < windows.high[k])
    return np.where(lit, windows.inside[k], windows.outside[k]).astype(np.int64)


def named(scene: Scene, *words: str) -> list[Mesh | Sphere]:
    found = [item for item in scene.objects if item.name in words]
    assert {item.name for item in found} == set(words)
    return found


@pytest.mark.parametrize("entry", ENTRIES.values(), ids=ENTRIES)
def test_every_shipped_scene_opens_with_gates_and_a_sentence(entry: SceneEntry) -> None:
    rig, scene = open_scene(entry.path, RIG)
    assert scene.name == entry.title
    assert scene.description == entry.description
    assert entry.description.endswith(".")
    assert len(scene.gates) >= 2
    assert scene.ambient > 0 or entry.title.startswith("Cornell box")
    for preset in scene.gates:
        assert preset.settings.exposure_us >= rig.camera.shutter.exposure_us.min


def test_the_papers_figures_a_mesh_and_a_real_capture_are_there() -> None:
    keys = ["three_targets", "three_parallel", "table", "door", "alarm", "hill", "spot", "aloe"]
    keys += ["cornell", "cornell_fog", "fog_road", "foggy_room", "bottle"]
    assert [key for key in ENTRIES if key in keys] == keys
    assert scene_of("door").moving
    assert scene_of("aloe").capture is not None


@pytest.mark.parametrize("key", ["three_targets", "three_parallel"])
def test_each_targets_gate_records_all_of_it_once_and_nothing_of_the_others(key: str) -> None:
    scene = scene_of(key)
    *targets, wall = scene.objects
    for index, preset in enumerate(scene.gates[:3]):
        for other, target in enumerate([*targets, wall]):
            times = recorded(RIG, preset, points_on([target]))
            assert len(times) > 1000
            assert (times == (other == index)).all(), (preset.name, target.name)


def test_targets_are_15_cm_apart_and_side_by_side_in_the_picture() -> None:
    for key in ("three_targets", "three_parallel"):
        *targets, _ = scene_of(key).objects
        clouds = [points_on([target]) for target in targets]
        np.testing.assert_allclose([np.mean(cloud[:, 2]) for cloud in clouds], [0.9, 1.05, 1.2], atol=2e-3)
        columns = [RIG.to_camera(cloud)[0] for cloud in clouds]
        assert columns[0].max() < columns[1].min() < columns[1].max() < columns[2].min()


def test_the_tables_gate_sees_table_and_papers_but_nothing_of_the_cup_above_its_foot() -> None:
    scene = scene_of("table")
    only, rest = scene.gates
    assert rest.complement
    assert rest.settings == only.settings
    assert (recorded(RIG, only, points_on(named(scene, "table", "report", "notes"))) == 1).mean() > 0.99
    cup = points_on(named(scene, "cup"))
    high = cup @ (0, -np.sin(np.radians(65)), -np.cos(np.radians(65)))
    assert (recorded(RIG, only, cup[high > high.min() + 0.025]) == 0).all()


def test_the_key_pad_is_masked_and_the_person_is_not_wherever_they_stand() -> None:
    scene = scene_of("door")
    mask = scene.gates[0]
    assert mask.complement
    assert (recorded(RIG, mask, points_on(named(scene, "key pad", "wall"))) == 1).all()
    person = [item for item in scene.objects if item.motion is not None]
    for time_s in (1.0, 2.5, 4.0, 7.0):
        assert (recorded(RIG, mask, points_on(person, time_s)) == 0).all()


def test_the_hand_reaches_the_key_pad_without_going_through_it() -> None:
    scene = scene_of("door")
    (hand,), pad = named(scene, "right hand"), points_on(named(scene, "key pad"))
    reach = points_on([hand], 4.0)
    assert reach[:, 2].max() < pad[:, 2].min()
    assert np.abs(reach.mean(axis=0) - pad.mean(axis=0)).max() < 0.25


def test_the_sheet_of_the_alarm_is_empty_until_the_hand_reaches_through_it() -> None:
    scene = scene_of("alarm")
    sheet, rest = scene.gates
    assert rest.complement
    assert rest.settings == sheet.settings
    hand = [item for item in scene.objects if item.motion is not None]
    still = [item for item in scene.objects if item.motion is None]
    assert recorded(RIG, sheet, points_on(still)).max() == 0
    for time_s, reaches in ((0.0, False), (3.0, False), (5.5, True), (8.0, False)):
        assert (recorded(RIG, sheet, points_on(hand, time_s)).max() > 0) == reaches, time_s


@pytest.mark.parametrize("time_s", [0.0, 2.5, 4.0, 5.0, 7.5, 9.0])
def test_the_car_is_in_its_slab_wherever_it_drives_and_nothing_else_is(time_s: float) -> None:
    scene = scene_of("hill")
    only, rest = scene.gates
    assert rest.complement
    body, wheels = named(scene, "car", "cabin"), [item for item in scene.objects if item.name.endswith("wheel")]
    still = [item for item in scene.objects if item.motion is None]
    assert (recorded(RIG, only, points_on(body, time_s)) == 1).all()
    # the lowest millimetres of the wheels are nearer to the hill than the slab
    assert (recorded(RIG, only, points_on(wheels, time_s)) == 1).mean() > 0.85
    assert recorded(RIG, only, points_on(still)).max() == 0


def test_the_aloes_cloth_is_recorded_and_its_pot_is_not() -> None:
    rig, scene = open_scene(ENTRIES["aloe"].path, RIG)
    assert scene.capture is not None
    v, u = np.nonzero(scene.capture.inverse_depth)
    depth = 1 / scene.capture.inverse_depth[v, u].astype(float)
    points = rig.camera_rays(u + 0.5, v + 0.5) * depth[:, None] + rig.camera_centre_m
    times = recorded(rig, scene.gates[0], points)
    visible = np.isfinite(rig.to_projector(points)[1])
    assert len(times) <= visible.sum()
    assert 0.3 < times.mean() < 0.8
    assert recorded(rig, scene.gates[0], points[depth < 1.6]).max() == 0


CORNELL = Path(__file__).parents[4] / "shared" / "reference"


@pytest.mark.skipif(not CORNELL.is_dir(), reason="the shared reference scenes are not here")
@pytest.mark.parametrize(("key", "name"), [("cornell", "cornell"), ("cornell_fog", "cornell_fog_slab")])
def test_the_cornell_boxes_are_those_of_the_references(key: str, name: str) -> None:
    scene, reference = scene_of(key), json.loads((CORNELL / f"{name}.json").read_text())
    assert scene.ambient == 0
    assert scene.indirect or scene.fog is not None
    for item, given in zip(scene.objects, reference["primitives"], strict=True):
        assert isinstance(item, Mesh)
        corners = np.array(given.get("vertices", 0))
        if given["type"] == "quad":
            steps = np.array([[u, v] for u in (0, 1) for v in (0, 1)])
            corners = np.array(given["p0"]) + steps @ np.array([given["e1"], given["e2"]])
        apart = np.abs(item.vertices[:, None] - corners).max(axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-6
        assert (item.name, item.albedo) == (given["name"], (given["albedo"],) * 3)
    fog = reference.get("fog")
    expected = fog and Fog(fog["sigma_s"], fog["sigma_a"], fog["g"], tuple(fog["lo"]), tuple(fog["hi"]))
    assert scene.fog == expected


@pytest.mark.parametrize("key", ["cornell", "cornell_fog"])
def test_a_cornell_blocks_gate_shows_all_of_it(key: str) -> None:
    scene = scene_of(key)
    gates = {preset.name: preset for preset in scene.gates}
    for name in ("short", "tall"):
        assert (recorded(RIG, gates[f"Only the {name} box"], points_on(named(scene, name))) == 1).mean() > 0.99
    assert (recorded(RIG, gates["Only the back wall"], points_on(named(scene, "back"))) == 1).all()


def test_each_box_of_the_foggy_room_has_a_gate_without_the_others() -> None:
    scene = scene_of("foggy_room")
    assert scene.fog is not None
    assert scene.fog.visibility_m == pytest.approx(3)
    names = ["near", "middle", "far"]
    for name, preset in zip(names, scene.gates[:3], strict=True):
        for other in names:
            times = recorded(RIG, preset, points_on(named(scene, f"{other} box")))
            assert (times == (name == other)).all(), (name, other)


def road_gates() -> dict[str, Preset]:
    return {preset.name: preset for preset in scene_of("fog_road").gates}


def test_what_stands_on_the_fog_road_is_square_to_it() -> None:
    scene = scene_of("fog_road")
    assert scene.fog is not None

    def normal(name: str) -> NDArray[np.float64]:
        (mesh,) = named(scene, name)
        assert isinstance(mesh, Mesh)
        a, b, c = mesh.vertices[mesh.faces[0]]
        cross = np.cross(b - a, c - a)
        return np.asarray(cross / np.linalg.norm(cross))

    assert normal("road") @ normal("stop sign") == pytest.approx(0, abs=1e-6)
    assert abs(normal("road") @ (0, 0.8, 0.6)) == pytest.approx(1, abs=1e-6)
    for part in ("red", "blue", "yellow"):
        (wheels,) = named(scene, f"{part} car's trim")
        assert isinstance(wheels, Mesh)
        height = (np.array([0, 0, 0.8]) - wheels.vertices) @ (0, 0.8, 0.6)
        assert height.min() == pytest.approx(0, abs=2e-4)


def test_the_roads_gates_show_what_they_are_named_for() -> None:
    scene, gates = scene_of("fog_road"), road_gates()
    road, sign = points_on(named(scene, "road")), points_on(named(scene, "stop sign"))
    standing = points_on([item for item in scene.objects if item.name.endswith("car")])
    assert (recorded(RIG, gates["The arrow on the road"], road) == 1).all()
    assert recorded(RIG, gates["The arrow on the road"], sign).max() == 0
    high = (np.array([0, 0, 0.8]) - standing) @ (0, 0.8, 0.6) > 0.02
    assert recorded(RIG, gates["The arrow on the road"], standing[high]).max() == 0
    assert (recorded(RIG, gates["The stop sign"], sign) == 1).all()
    longer = gates["The stop sign, longer exposure: more of the road"]
    assert (recorded(RIG, longer, sign) == 1).all()
    assert recorded(RIG, longer, road).mean() > 4 * recorded(RIG, gates["The stop sign"], road).mean()
    for name, points in (("arrow", road), ("stop sign", sign)):
        strip = recorded(RIG, gates[f"An upright gate: a strip of the {name}"], points)
        assert 0 < strip.mean() < 0.6
    assert recorded(RIG, gates["An upright gate: the car in front"], points_on(named(scene, "red car"))).mean() > 0.5


def test_the_bottle_is_closed_glass_and_the_peppers_shine() -> None:
    scene = scene_of("bottle")
    assert scene.indirect
    (bottle,) = named(scene, "bottle")
    assert isinstance(bottle, Mesh)
    assert isinstance(bottle.material, Glass)
    edges = np.sort(bottle.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    peppers = [item for item in scene.objects if item.name.endswith("pepper")]
    assert [type(item.material) for item in peppers] == [Gloss] * 3
    front, behind, wall, rest = scene.gates
    assert rest.complement
    for gate, seen in ((front, peppers[:2]), (behind, peppers[2:]), (wall, named(scene, "wall"))):
        for item in (*peppers, *named(scene, "wall")):
            assert (recorded(RIG, gate, points_on([item])) == (item in seen)).all(), (gate.name, item.name)


@pytest.mark.parametrize(
    ("key", "gates"),
    [
        (
            "four_materials",
            {
                "Only the pepper": ("pepper", "stem", "pepper's post"),
                "Only the card box": ("card box",),
                "Only the ball": ("ball", "ball's post"),
                "Only the board": ("board",),
            },
        ),
        ("logo_wall", {"Only the bottle": ("bottle", "foil", "label", "stand"), "Only the wall": ("wall",)}),
        ("fog_targets", {"The near target": ("near target",), "The far target": ("far target",)}),
        (
            "green_wall",
            {
                "What stands in front": ("grass", "green pepper", "red pepper", "second green pepper", "bench"),
                "Only the wall": ("wall",),
            },
        ),
    ],
)
def test_each_thing_to_relight_has_a_slice_without_the_others(key: str, gates: dict[str, tuple[str, ...]]) -> None:
    scene = scene_of(key)
    assert [preset.name for preset in scene.gates] == list(gates)
    for preset in scene.gates:
        for other, names in gates.items():
            times = recorded(RIG, preset, points_on(named(scene, *names)))
            assert (times == (other == preset.name)).all(), (preset.name, other)


def test_foil_and_label_are_outside_the_glass_of_the_bottle() -> None:
    (bottle,) = (item for item in scene_of("logo_wall").objects if item.name == "bottle")
    assert isinstance(bottle, Mesh)
    assert isinstance(bottle.material, Glass)
    heights, radii = np.array(draw_scenes.BOTTLE)[:, 1], np.array(draw_scenes.BOTTLE)[:, 0]
    foil = np.array([(r, y) for r, y in draw_scenes.CAPSULE if r > 0])
    assert (foil[:, 0] > np.interp(foil[:, 1], heights, radii) + 1e-4).all()


def test_half_of_the_grass_is_thinner_than_a_pixel() -> None:
    (grass,) = named(scene_of("green_wall"), "grass")
    assert isinstance(grass, Mesh)
    corners = grass.vertices[grass.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    width = sides.min(axis=1) * RIG.camera.lens.fx / corners[:, 0, 2]
    assert np.quantile(width, 0.5) < 1


def test_drawn_pictures_and_meshes_are_those_that_the_script_draws() -> None:
    folder = ENTRIES["aloe"].path.parent
    for name, draw in draw_scenes.PICTURES.items():
        shipped = cv2.imread(str(folder / name)).astype(float)
        assert np.abs(shipped - draw()).mean() < 1, name  # letters differ a little between versions of OpenCV
    for name, write in draw_scenes.MESHES.items():
        assert (folder / name).read_text(encoding="utf-8") == write(), name


def test_captures_beside_the_checkout_are_offered_where_they_are() -> None:
    people = [entry for entry in offered_scenes() if entry.key not in ENTRIES]
    if not people:
        pytest.skip("no capture lies beside this checkout")
    (entry,) = people
    rig, scene = open_scene(entry.path, RIG)
    assert (scene.name, scene.description) == (entry.title, entry.description)
    assert scene.capture is not None
    v, u = np.nonzero(scene.capture.inverse_depth)
    depth = 1 / scene.capture.inverse_depth[v, u].astype(float)
    points = rig.camera_rays(u + 0.5, v + 0.5) * depth[:, None] + rig.camera_centre_m
    right, person = u > 455, (depth > 1.72) & (depth < 1.92)
    assert scene.gates[1].complement
    assert scene.gates[1].settings == scene.gates[0].settings
    assert recorded(rig, scene.gates[0], points[right & person]).mean() > 0.99
    assert recorded(rig, scene.gates[0], points[depth > 2.1]).max() == 0
    assert recorded(rig, scene.gates[0], points[~right]).mean() < 0.05


def test_what_is_shipped_is_small_and_says_where_it_is_from() -> None:
    folder = ENTRIES["aloe"].path.parent
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    assert sum(sizes) < 2_000_000
    facts = json.loads((Path(ENTRIES["aloe"].path) / "scene.json").read_text())
    assert "permission" in facts["licence"]
    assert "Scharstein" in facts["citation"]


def test_the_documented_example_opens(tmp_path: Path) -> None:
    text = (ENTRIES["aloe"].path.parent / "FORMAT.md").read_text(encoding="utf-8")
    examples = [part.split("```")[0].replace('texture = "card.png"\n', "") for part in text.split("```toml\n")[1:]]
    (tmp_path / "example.toml").write_text("".join(examples), encoding="utf-8")
    _, scene = open_scene(tmp_path / "example.toml", RIG)
    assert scene.moving
    assert scene.gates[0].name == "Only the card"
    assert scene.fog == Fog(0.55, 0.03, 0.0, (-1.5, -1.5, 0.3), (1.5, 1.5, 2.5))
    assert scene.objects[-1].material == Gloss(0.1, 200)
