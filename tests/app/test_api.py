"""What notebooks rely on: the names, signatures and results of `slopegate.app.api`, and that README tells the truth."""

from __future__ import annotations

import inspect
import math
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.app import api
from slopegate.core.exposure.sensor import mono
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import LineTimes
from slopegate.drivers.files.rig_files import rig_to_toml
from small_window import small_rig

README = Path(__file__).resolve().parents[2] / "README.md"
GATE = {"clock_mhz": 76.0, "delay_us": 1853.0, "exposure_us": 400.0}
SCENE = """
title = "Card and wall"
ambient = 0.02
[[objects]]
type = "plane"
name = "wall"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 6.0
[[objects]]
type = "plane"
name = "card"
centre_m = [0.0, 0.0, 1.05]
width_m = 0.3
height_m = 0.3
[[gates]]
name = "Card"
tilt_deg = 0.0
distance_m = 1.05
thickness_m = 0.2
[[gates]]
name = "All but the card"
tilt_deg = 0.0
distance_m = 1.05
thickness_m = 0.2
complement = true
"""

# A change here is a change of what scripts rely on: CHANGELOG says so.
SURFACE = {
    "list_scenes": "()",
    "open_capture": "(folder)",
    "open_film": "(folder)",
    "open_rig": "(file=None)",
    "open_transport": "(folder)",
    "open_scene": "(scene, rig=None, *, time_s=0.0, skip=True)",
    "OpenRig.clock_mhz": "(self, gate)",
    "OpenRig.complement": "(self, gate)",
    "OpenRig.gate": "(self, *, delay_us, exposure_us, clock_mhz=None, line_time_us=None)",
    "OpenRig.plan": "(self, tilt_deg, distance_m, thickness_m)",
    "OpenRig.plan_plane": "(self, plane, thickness_m)",
    "OpenRig.plan_slices": (
        "(self, near_m, far_m, count=None, spacing='delay', *, clock_mhz=None, line_time_us=None, exposure_us=None)"
    ),
    "OpenRig.rounded": "(self, gate)",
    "OpenRig.slab": "(self, gate)",
    "OpenRig.slab_if_any": "(self, gate)",
    "OpenRig.slices_at": "(self, delays_us, exposure_us, *, clock_mhz=None, line_time_us=None)",
    "OpenScene.acquire_transport": (
        "(self, folder, slices, *, grid='32x32', codes='hadamard', frames=1, parts=None, noise=True, seed=0, "
        "pixel_format='mono12', keep_raw=False, say=None)"
    ),
    "OpenScene.bake": "(self, *, paths=None, error_percent=None, max_order=None, patterns=False, progress=None)",
    "OpenScene.film": (
        "(self, folder, gate, *, frames=None, seconds=None, every_s=None, noise=True, seed=0, overwrite=False, "
        "watch=None)"
    ),
    "OpenScene.expose": "(self, light, *, noise=True, seed=0, colour=False)",
    "OpenScene.frame": (
        "(self, gate, *, noise=True, seed=0, colour=False, samples=1, parts=None, max_order=None, pattern=None, "
        "progress=None)"
    ),
    "OpenScene.light": (
        "(self, gate, *, colour=False, samples=1, parts=None, max_order=None, pattern=None, progress=None)"
    ),
    "OpenScene.light_by_part": (
        "(self, gate, *, colour=False, samples=1, parts=None, max_order=None, pattern=None, progress=None)"
    ),
    "OpenScene.shown_parts": "(self, parts, max_order=None, pattern=None)",
    "OpenScene.mask": "(self, region, *, hide=False, depth=None, noise=True, seed=0)",
    "OpenScene.measure_depth": (
        "(self, *, nearest_m=0.3, finest_rows=1.0, average=1, noise=True, seed=0, progress=None)"
    ),
    "OpenScene.needs_bake": "(self, parts=None, max_order=None)",
    "OpenScene.plan_lit_slices": (
        "(self, count=None, *, clock_mhz=None, line_time_us=None, exposure_us=None, scattered=False)"
    ),
    "OpenScene.plan_transport": ("(self, slices, *, grid='32x32', codes='hadamard', frames=1, pixel_format='mono12')"),
    "OpenScene.record": (
        "(self, folder, slices, *, frames=1, dark=False, skip_empty=False, noise=True, seed=0, say=None)"
    ),
    "OpenScene.recorded": "(self, gate)",
    "OpenScene.resume": "(self, folder, *, noise=None, seed=None, say=None)",
    "OpenScene.resume_transport": "(self, folder, *, keep_raw=False, say=None)",
    "OpenScene.search": "(self, target=None, *, method='fast', max_frames=None, noise=True, seed=0, watch=None)",
    "OpenScene.sensor": "(self, *, colour=False)",
    "OpenScene.sweep_exposure": (
        "(self, *, delay_us, clock_mhz=None, line_time_us=None, region=None, count=40, frames=5, seed=0, "
        "parts=None, max_order=None, progress=None)"
    ),
    "OpenCapture.light": "(self, place)",
    "OpenFilm.frame": "(self, number)",
    "OpenFilm.time_s": "(self, number)",
    "OpenTransport.agreement": "(self, weighting='tiling')",
    "OpenTransport.camera_image": "(self, place, column, row)",
    "OpenTransport.composite": "(self, foreground, background, *, relit=False)",
    "OpenTransport.dual_image": "(self, place, lamps=None)",
    "OpenTransport.export": "(self, kind, out, progress=None)",
    "OpenTransport.floodlit": "(self, weighting='tiling')",
    "OpenTransport.matte": "(self, foreground)",
    "OpenTransport.picture": "(self, file)",
    "OpenTransport.projector_image": "(self, place, column, row)",
    "OpenTransport.relight": "(self, lights=None, *, weighting='tiling')",
    "OpenTransport.viewer_ready": "(self, light)",
    "OpenTransport.weights": "(self, weighting='tiling')",
}
ATTRIBUTES = {
    "Agreement": "psnr_db ssim",
    "BakeReport": "seconds paths error_percent memory_bytes cached",
    "Buffers": "projector_row projector_column inverse_depth direct ambient",
    "Composite": "image matte foreground",
    "DepthError": "known_share median_mm rms_mm p95_mm wrong_share",
    "DepthErrors": "rig_m sweep_m total_m medians_m",
    "DepthMap": "projector_row inverse_depth disparity_rows frames plain_frames resolution_rows lit_counts "
    "ambient_counts depth_m known",
    "Entries": "grid starts block value",
    "ExposureSweep": "exposures_us measured expected regular best_us predicted_us",
    "FilmProgress": "state doing frames lost_by_camera lost_by_disk seconds bytes share remark lost",
    "Likeness": "ncc contrast cnr",
    "GateSettings": "line_time_us delay_us exposure_us start_us end_us",
    "MaskGate": "gate complement sent iou hit_pixels missed_pixels extra_pixels line_times good",
    "MaskResult": "best achieved_iou told_share",
    "MeasuredDepth": "map error standard_errors",
    "OpenCapture": "rig folder name shape period_us everything_lit epipolar scene_name missing gates stack depth_m",
    "OpenFilm": (
        "rig folder name shape period_us everything_lit epipolar scene_name applied frames lost seconds bytes ended"
    ),
    "OpenRig": "rig name shape period_us everything_lit epipolar",
    "OpenScene": (
        "rig scene time_s skip name shape period_us everything_lit epipolar scene_name remarks moving gates "
        "buffers depth_m parts"
    ),
    "OpenTransport": (
        "rig folder name shape period_us everything_lit epipolar scene_name grid gates missing linear_unit slices white"
    ),
    "Outcome": "cause reason settings slab target kept keypoints frames found",
    "Plane": "A normal offset_m",
    "Planned": "exact applied slab residual_tilt_deg residual_distance_m residual_thickness_m",
    "Recording": "capture frames_used frames_lost frames_duplicated frames_discarded",
    "SceneEntry": "key title description path",
    "SearchResult": "outcome history target max_frames",
    "SearchStep": "doing settings seen",
    "SensorModel": "counts_per_unit electrons_per_count read_noise_e black_count max_count",
    "Slab": (
        "line_time_us B tilt_deg distance_m near_m far_m thickness_m hinge_y_m near centre far windows_us frame "
        "warnings inverse_near_per_m inverse_distance_per_m inverse_far_per_m hinge_curvature_per_m errors turn_deg"
    ),
    "SlabErrors": "tilt_deg turn_deg distance_m near_m far_m thickness_m",
    "SlabOrWhy": "slab why warnings",
    "SliceLight": "colour picture gain visible strength",
    "SliceTransport": "total layers bytes",
    "StackSummary": "total overlay projector_row inverse_depth",
    "TransportPlan": "frames seconds bytes noise_gain paper_seconds",
}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return small_rig()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, rig: Rig) -> Path:
    made = tmp_path_factory.mktemp("api")
    (made / "rig.toml").write_text(rig_to_toml(rig), "utf-8")
    (made / "card.toml").write_text(SCENE, "utf-8")
    return made


@pytest.fixture(scope="module")
def scene(folder: Path) -> api.OpenScene:
    return api.open_scene(folder / "card.toml", folder / "rig.toml")


def signature(function: Callable[..., Any]) -> str:
    """Names, order and defaults, without the types."""
    bare = [one.replace(annotation=inspect.Parameter.empty) for one in inspect.signature(function).parameters.values()]
    return str(inspect.Signature(bare))


def own_attributes(kind: type) -> list[str]:
    """Fields, then properties, of the class and those it builds on."""
    found = [field.name for field in fields(kind)]
    for base in reversed(kind.__mro__):
        for name, value in vars(base).items():
            cached = type(value).__name__ == "cached_property"
            if (cached or isinstance(value, property)) and not name.startswith("_"):
                found.append(name)
    return found


def test_the_surface_is_what_scripts_rely_on() -> None:
    found: dict[str, str] = {}
    for name in api.__all__:
        item = getattr(api, name)
        if inspect.isfunction(item):
            found[name] = signature(item)
        elif name.startswith("Open"):
            methods = {key: value for key, value in vars(item).items() if inspect.isfunction(value)}
            found |= {f"{name}.{key}": signature(value) for key, value in methods.items() if not key.startswith("_")}
    assert found == SURFACE


def test_results_are_frozen_and_have_the_attributes_promised() -> None:
    kinds = {name: getattr(api, name) for name in api.__all__ if inspect.isclass(getattr(api, name))}
    del kinds["UserError"]
    for name, kind in kinds.items():
        assert is_dataclass(kind), name
        assert kind.__dataclass_params__.frozen, name  # type: ignore[attr-defined]
    assert {name: " ".join(own_attributes(kind)) for name, kind in kinds.items()} == ATTRIBUTES


def test_everything_public_says_what_it_is() -> None:
    for name in api.__all__:
        item = getattr(api, name)
        members = [getattr(item, key) for key in vars(item) if not key.startswith("_")] if name[:4] == "Open" else []
        for one in (item, *members):
            assert not (inspect.isfunction(one) or inspect.isclass(one)) or inspect.getdoc(one), (name, one)


def test_a_notebook_shows_a_line_and_not_the_arrays(scene: api.OpenScene, tmp_path: Path) -> None:
    assert repr(scene) == "<OpenScene: Card and wall, 320 x 240 pixels>"
    assert repr(api.open_rig()) == "<OpenRig: Check rig, 1600 x 1200 pixels>"
    made = scene.record(tmp_path / "c", scene.plan_lit_slices(2), noise=False)
    assert repr(made.capture) == "<OpenCapture: Card and wall, 320 x 240 pixels>"


def test_it_needs_no_window() -> None:
    code = "import sys; from slopegate.app import api; print('PySide6' in sys.modules, 'pyqtgraph' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=280)
    assert done.stdout.split() == ["False", "False"]


def test_the_ten_lines_of_the_readme_run(tmp_path: Path) -> None:
    section = README.read_text("utf-8").split("## In Python", 1)[1].split("\n## ", 1)[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) == 10
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=280, cwd=tmp_path
    )
    assert "Only the 0 target" in done.stdout
    image = cv2.imread(str(tmp_path / "gated.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.dtype == np.uint16
    assert image.max() > 16000


def test_light_and_frames_have_the_shapes_types_and_units_told(scene: api.OpenScene) -> None:
    lit, gate = scene.everything_lit, scene.gates["Card"]
    light = scene.light(lit)
    assert (light.shape, light.dtype) == (scene.shape, np.float32)
    assert light[120, 160] == pytest.approx(0.8 / 1.05**2 + 0.8 * 0.02, rel=0.03)  # albedo 0.8, almost frontal
    colour = scene.light(lit, colour=True)
    assert (colour.shape, colour.dtype) == ((*scene.shape, 3), np.float32)
    np.testing.assert_array_equal(mono(colour), light)
    counts = scene.frame(gate, seed=3)
    assert (counts.shape, counts.dtype) == (scene.shape, np.uint16)
    np.testing.assert_array_equal(counts, scene.frame(gate, seed=3))
    assert (counts != scene.frame(gate, seed=4)).any()
    exact, sensor = scene.frame(gate, noise=False), scene.sensor()
    np.testing.assert_allclose(exact, scene.light(gate) * sensor.counts_per_unit + sensor.black_count, atol=0.501)
    shares: list[float] = []
    soft = scene.light(gate, samples=2, progress=shares.append)
    assert shares
    assert np.abs(soft - scene.light(gate)).mean() < 0.01


def test_light_under_a_pattern(scene: api.OpenScene) -> None:
    gate, grid = scene.everything_lit, np.random.default_rng(1).random((3, 5)).astype(np.float32)
    direct = scene.light(gate, parts=("direct",))
    lit = scene.light(gate, pattern=grid)
    assert set(scene.light_by_part(gate, pattern=grid)) == {"direct"}
    share = np.divide(lit, direct, out=np.zeros_like(lit), where=direct > 0)[direct > 0]
    nearest = abs(share[:, None] - grid.ravel()).min(axis=1)
    assert nearest.max() < 1e-6
    np.testing.assert_array_equal(scene.light(gate, pattern=np.ones((1, 1), np.float32)), direct)
    assert scene.frame(gate, noise=False, pattern=0 * grid).max() == round(scene.sensor().black_count)
    for wrong, why in ((2 * grid + 1, "from 0 to 1"), (grid[0], "rows x columns"), (np.ones((721, 1)), "grid rows")):
        with pytest.raises(api.UserError, match=why):
            scene.light(gate, pattern=wrong)


def test_gates_by_settings_by_plane_and_by_name(scene: api.OpenScene, rig: Rig) -> None:
    gate = scene.gate(**GATE)
    assert scene.gate(line_time_us=gate.line_time_us, delay_us=1853.0, exposure_us=400.0) == gate
    planned = scene.plan(tilt_deg=0.0, distance_m=1.05, thickness_m=0.2)
    assert planned.applied == scene.rounded(planned.exact) == scene.gates["Card"]
    y = rig.baseline_m / 2  # the camera is half a baseline below the origin, along y: a frontal plane is the same
    assert y > 0
    by_plane = scene.plan_plane((0.0, 0.0, 2.0, -2.1), 0.2).applied
    assert by_plane.line_time_us == planned.applied.line_time_us
    assert by_plane.delay_us == pytest.approx(planned.applied.delay_us, abs=2)
    slab = scene.slab(planned.applied)
    assert slab.distance_m == pytest.approx(1.05, abs=0.01)
    kept, rest = (scene.light(scene.gates[name]) for name in ("Card", "All but the card"))
    assert scene.gates["All but the card"] == scene.complement(scene.gates["Card"])
    whole = scene.light(scene.everything_lit)
    np.testing.assert_allclose(kept + rest, whole, rtol=1e-5)
    assert scene.recorded(scene.gates["Card"]).mean() == pytest.approx((scene.depth_m < 1.1).mean(), abs=0.02)


def test_depth_masks_and_searches(scene: api.OpenScene) -> None:
    shares: list[float] = []
    measured = scene.measure_depth(progress=shares.append)
    assert shares[-1] == 1.0
    assert measured.error is not None
    assert measured.error.p95_mm < 25
    near = np.nan_to_num(scene.depth_m, nan=9.0) < 1.1
    for region in (near, (112, 72, 208, 168)):
        mask = scene.mask(region)
        assert mask.best.good
        assert mask.achieved_iou == pytest.approx(mask.best.iou, abs=0.1)
    hidden = scene.mask(near, hide=True, depth=measured.map)
    assert hidden.best.complement
    assert scene.recorded(hidden.best.sent)[near].mean() < 0.02
    seen: list[int] = []
    search = scene.search((112, 72, 208, 168), watch=lambda history: seen.append(len(history)))
    assert (search.outcome.found, search.outcome.cause) == (False, "too few keypoints")  # the card is plain white
    assert seen == list(range(1, len(search.history) + 1))


def test_a_target_with_texture_is_found() -> None:
    found = api.open_scene("three_targets").search((120, 220, 530, 820))
    assert found.outcome.found
    assert found.target == (120, 220, 530, 820)
    assert found.outcome.frames == len(found.history) <= found.max_frames


def test_slices_are_recorded_resumed_and_read(scene: api.OpenScene, tmp_path: Path) -> None:
    gates, said = scene.plan_lit_slices(), []
    made = scene.record(tmp_path / "c", gates, frames=2, dark=True, noise=False, say=said.append)
    assert made.frames_used == 2 * (len(gates) + 1)
    assert made.frames_lost == 0
    opened = api.open_capture(tmp_path / "c")
    assert opened.scene_name == "Card and wall"
    assert set(opened.gates) == set(gates)
    assert [gate.delay_us for gate in opened.gates] == sorted(gate.delay_us for gate in gates)
    total = sum(opened.light(place) for place in range(len(gates)))
    np.testing.assert_allclose(opened.stack.total, total, atol=0.01)
    lit = scene.recorded(scene.everything_lit)  # elsewhere there is only ambient light, which tells no depth
    assert np.isfinite(opened.depth_m[lit]).all()
    thickest = opened.slab(opened.gates[0]).thickness_m
    assert thickest is not None
    assert 0.05 < thickest < 0.2
    assert np.quantile(np.abs(opened.depth_m - scene.depth_m)[lit], 0.99) < thickest
    (tmp_path / "c" / "slice_0002.tif").unlink()
    assert api.open_capture(tmp_path / "c").missing == 1
    again = scene.resume(tmp_path / "c", noise=False)
    assert (again.capture.missing, again.frames_used) == (0, 2)
    assert len(scene.plan_slices(0.9, math.inf)) <= 16
    assert len(scene.plan_slices(0.9, 2.1, 4, "depth", line_time_us=63.0)) == 4
    assert [gate.delay_us for gate in scene.slices_at((-100.0, 2028.4), 400.0)] == [-100.0, 2028.0]


BAD: dict[str, tuple[Callable[[api.OpenScene, Path], object], str]] = {
    "no scene": (lambda scene, folder: api.open_scene("nowhere"), "nowhere is no file"),
    "no rig": (lambda scene, folder: api.open_rig(folder / "none.toml"), "none.toml"),
    "no capture": (lambda scene, folder: api.open_capture(folder), "is no capture"),
    "text as rig": (lambda scene, folder: api.open_rig(folder / "card.toml"), "card.toml"),
    "NaN": (lambda scene, folder: scene.gate(**GATE | {"delay_us": math.nan}), "delay_us is nan"),
    "two speeds": (lambda scene, folder: scene.gate(**GATE, line_time_us=9.0), "left out where clock_mhz is given"),
    "no speed": (lambda scene, folder: scene.gate(delay_us=1.0, exposure_us=1.0), "line_time_us is None"),
    "slow clock": (lambda scene, folder: scene.gate(**GATE | {"clock_mhz": 1e-6}), "clock_mhz 1e-06"),
    "no direction": (
        lambda scene, folder: scene.plan_plane((0.0, 0.0, 0.0, 1.0), 0.1),
        "plane is (0.0, 0.0, 0.0, 1.0)",
    ),
    "infinite plane": (lambda scene, folder: scene.plan_plane((0.0, 0.0, math.inf, 1.0), 0.1), "plane is"),
    "plane behind": (
        lambda scene, folder: scene.plan_plane((0.0, 0.0, 1.0, 1.05), 0.1),
        "plane is (0.0, 0.0, 1.0, 1.05): it must be A, B, C, D of a plane that the camera sees in front of it",
    ),
    "tilt": (lambda scene, folder: scene.plan(91, 1, 0.1), "tilt_deg is 91"),
    "nothing left": (lambda scene, folder: scene.complement(scene.everything_lit), "exposure_us is"),
    "a part": (lambda scene, folder: scene.light(scene.everything_lit, parts=("mist",)), "parts is ['mist']"),  # type: ignore[arg-type]
    "order": (lambda scene, folder: scene.light(scene.everything_lit, max_order=0), "max_order is 0"),
    "no rays": (lambda scene, folder: scene.light(scene.everything_lit, samples=0), "samples is 0"),
    "seed": (lambda scene, folder: scene.frame(scene.everything_lit, seed=-1), "seed is -1"),
    "seed of a camera": (lambda scene, folder: scene.mask((112, 72, 208, 168), seed=-1), "seed is -1"),
    "rows": (lambda scene, folder: scene.measure_depth(finest_rows=0.0), "finest_rows is 0.0"),
    "region": (lambda scene, folder: scene.mask((5, 5, 5, 9)), "region is (5, 5, 5, 9)"),
    "other image": (lambda scene, folder: scene.mask(np.ones((3, 4), bool)), "region is (3, 4)"),
    "target": (lambda scene, folder: scene.search((0, 0, 5, 5)), "target is (0, 0, 5, 5)"),
    "no slices": (lambda scene, folder: scene.record(folder / "new", ()), "slices is 0"),
    "taken": (lambda scene, folder: scene.record(folder, scene.plan_lit_slices(2)), "is not empty"),
    "count": (lambda scene, folder: scene.plan_lit_slices(0), "count is 0"),
    "resume nothing": (lambda scene, folder: scene.resume(folder), "is no capture"),
}


def test_frames_at_one_gate_are_recorded_and_read(scene: api.OpenScene, tmp_path: Path) -> None:
    gate, told = scene.gates["Card"], list[api.FilmProgress]()
    made = scene.film(tmp_path / "f", gate, frames=3, seed=4, watch=told.append)
    assert (made.frames, made.lost, made.applied) == (3, 0, gate)
    assert [made.time_s(number) for number in range(3)] == pytest.approx([0.0, 0.05, 0.1])
    assert made.seconds == pytest.approx(0.1)
    again = scene.film(tmp_path / "g", gate, seconds=0.15, seed=4)
    opened = api.open_film(tmp_path / "g")
    assert (again.frames, opened.frames) == (3, 3)
    for number in range(3):
        np.testing.assert_array_equal(opened.frame(number), made.frame(number))
    quiet = scene.film(tmp_path / "g", gate, frames=1, noise=False, overwrite=True)
    np.testing.assert_array_equal(quiet.frame(0), scene.frame(gate, noise=False))
    lapse = scene.film(tmp_path / "l", gate, frames=3, every_s=60.0)
    assert lapse.time_s(2) == pytest.approx(120.0)
    with pytest.raises(api.UserError, match="holds a recording already"):
        scene.film(tmp_path / "g", gate, frames=1)
    with pytest.raises(api.UserError, match="is a recording at one gate: it is no scene"):
        api.open_scene(tmp_path / "g")


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_in_one_sentence(scene: api.OpenScene, folder: Path, name: str) -> None:
    call, sentence = BAD[name]
    with pytest.raises(api.UserError) as caught:
        call(scene, folder)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (folder / "new").exists()


def test_what_does_not_fit_a_capture_is_refused(scene: api.OpenScene, folder: Path, tmp_path: Path) -> None:
    scene.record(tmp_path / "c", scene.plan_lit_slices(2), noise=False)
    with pytest.raises(api.UserError, match="is a recorded capture of slices"):
        api.open_scene(tmp_path / "c")
    with pytest.raises(api.UserError, match="was begun with another scene, camera or rig"):
        api.open_scene(folder / "card.toml").resume(tmp_path / "c")
    with pytest.raises(api.UserError, match="place is 2: it must be a whole number from 0 to 1"):
        api.open_capture(tmp_path / "c").light(2)


def test_a_camera_without_clocks(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "lines.toml").write_text(rig_to_toml(small_rig(LineTimes(1.0, 500.0, 0.25))), "utf-8")
    opened = api.open_rig(tmp_path / "lines.toml")
    assert opened.clock_mhz(opened.everything_lit) is None
    with pytest.raises(api.UserError, match="this camera has no pixel clock, give line_time_us"):
        opened.gate(**GATE)
    scene = api.open_scene(folder / "card.toml", opened)
    assert scene.rig == opened.rig


def test_a_moving_scene_shows_the_instant_asked_for(folder: Path) -> None:
    keys = "[motions.aside]\nkeys = [{ time_s = 0.0 }, { time_s = 10.0, offset_m = [0.4, 0.0, 0.0] }]\n"
    text = SCENE.replace('name = "card"\n', 'name = "card"\nmotion = "aside"\n') + keys
    (folder / "moving.toml").write_text(text, "utf-8")
    first, later = (api.open_scene(folder / "moving.toml", folder / "rig.toml", time_s=time_s) for time_s in (0.0, 5.0))
    assert first.moving

    def middle(scene: api.OpenScene) -> float:
        near: NDArray[np.intp] = np.nonzero(np.nan_to_num(scene.depth_m, nan=9.0) < 1.1)[1]
        return float(near.mean())

    start = middle(first)
    assert middle(later) > start + 10
    first.measure_depth(noise=False)
    assert middle(first) == start


def test_light_transport_is_acquired_looked_at_and_relit(folder: Path, tmp_path: Path) -> None:
    scene = api.open_scene(folder / "card.toml", folder / "rig.toml")
    gates, said = scene.plan_lit_slices(2), list[str]()
    made = scene.acquire_transport(tmp_path / "t", gates, grid="4x2", noise=False, say=said.append)
    assert said[0].startswith("Preparing the light: ")
    assert repr(made) == "<OpenTransport: Card and wall, 320 x 240 pixels>"
    assert (made.gates, made.missing, made.grid, made.linear_unit) == (gates, (), "4x2", "linear, E = 1")
    found = api.open_transport(tmp_path / "t")
    lit, direct = found.relight(), scene.light(scene.everything_lit, parts=("direct",))
    np.testing.assert_allclose(lit, direct, atol=0.001)
    agreement = found.agreement()
    assert agreement is not None
    assert agreement.psnr_db > 60
    assert found.weights() == (1.0, 1.0)
    row, column = np.argwhere(direct > 0)[len(np.argwhere(direct > 0)) // 2]
    for place in range(2):
        reach = found.projector_image(place, int(column), int(row))
        assert reach.sum() == pytest.approx(found.slices[place].total[row, column], abs=1e-4)
        seen, dual = found.camera_image(place, 640, 360), found.dual_image(place)
        assert (seen.shape, dual.shape) == (found.shape, (720, 1280))
        assert dual.sum(dtype=np.float64) == pytest.approx(found.slices[place].total.sum(dtype=np.float64), rel=1e-3)
    hidden = [api.SliceLight(visible=False), api.SliceLight(gain=2.0)]
    np.testing.assert_allclose(found.relight(hidden), 2 * found.slices[1].total, atol=1e-6)
    coloured = found.relight([api.SliceLight(colour=(1.0, 0.0, 0.0)), api.SliceLight()])
    assert coloured.shape == (*found.shape, 3)
    assert found.viewer_ready(coloured).dtype == np.uint8
    with pytest.raises(api.UserError, match="one light a slice, 2"):
        found.relight([api.SliceLight()])
    with pytest.raises(api.UserError, match="from 0 to 1"):
        found.camera_image(2, 0, 0)
