"""A swept scene, saved and opened again, looks as the camera saw it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rigs import FINE_LINES, calibrated, check_rig
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.measure.sweep import DepthMap, DepthSweep, SweepSettings
from slopegate.core.measure.twin import Twin, make_twin
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Preset, Scene
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.scene_files import open_scene
from slopegate.drivers.scenes.twin_files import save_twin
from slopegate.drivers.stream.depth_run import frames_of, run_sweep

RIG = check_rig(160, FINE_LINES)
SENSOR = SensorModel(counts_per_unit=1500.0)
REAL = Scene(
    "A card before a wall",
    objects=(
        plane("wall", (0.0, 0.0, 1.6), (8.0, 6.0), turn(20.0), Finish((0.5, 0.5, 0.5))),
        plane("card", (0.0, 0.0, 0.8), (0.3, 0.3), turn(-10.0), Finish((0.9, 0.9, 0.9))),
    ),
    ambient=0.05,
)
GATE = gate(upright_line_time(RIG), 0.0, 600.0)
GATES = (Preset("The card", gate(GATE.line_time_us, 2000.0, 600.0)), Preset("All but it", GATE, complement=True))


def camera(rig: Rig, scene: Scene, sensor: SensorModel = SENSOR) -> VirtualCamera:
    made = VirtualCamera(rig, scene, sensor, rate_hz=float("inf"), noise=False)
    made.prepare(lambda _: True)
    made.start()
    return made


def frame(source: VirtualCamera, settings: GateSettings) -> Counts:
    got = frames_of(source)(settings)
    assert got is not None
    return got[0].copy()


@pytest.fixture(scope="module")
def swept() -> DepthMap:
    source = camera(RIG, REAL)
    found = run_sweep(frames_of(source), DepthSweep(RIG, SENSOR.black_count, SweepSettings(0.5)))
    source.close()
    assert found is not None
    return found


@pytest.fixture(scope="module")
def twin(swept: DepthMap) -> Twin:
    return make_twin(RIG, swept, swept.lit_counts)


@pytest.fixture(scope="module")
def folder(twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_twin(tmp_path_factory.mktemp("twin") / "card", RIG, twin, "My bench", "swept", GATES)


def test_it_opens_with_its_rig_and_gates(folder: Path, twin: Twin) -> None:
    rig, scene = open_scene(folder, load_rig(None))
    assert rig == RIG
    assert (scene.name, scene.description, scene.remarks) == ("My bench", "swept", ())
    assert scene.gates == GATES
    assert scene.ambient == pytest.approx(twin.ambient)
    assert twin.ambient == pytest.approx(REAL.ambient, rel=0.1)


def test_it_keeps_how_well_its_rig_is_known(twin: Twin, tmp_path: Path) -> None:
    known = calibrated(RIG)
    rig, _ = open_scene(save_twin(tmp_path / "card", known, twin, "My bench", ""), load_rig(None))
    assert rig.calibration == known.calibration


def test_its_frames_are_those_of_the_scene(folder: Path, twin: Twin, swept: DepthMap) -> None:
    """Within 2 % of full light and a few counts: 16-bit colour and the sweep's steps of a projector row."""
    rig, scene = open_scene(folder, load_rig(None))
    real, copy = camera(RIG, REAL), camera(rig, scene, SensorModel(counts_per_unit=twin.counts_per_unit))
    everything = gate(GATE.line_time_us, 0.0, RIG.projector.period_us)
    lit = frame(real, everything).astype(float)
    known = swept.known & (swept.lit_counts > 20)
    assert known.mean() > 0.5
    off = np.abs(frame(copy, everything) - lit)[known]
    assert np.percentile(off, 99) <= 0.02 * lit[known].max()
    for delay_us in np.linspace(0.0, 16000.0, 9):
        one = gate(GATE.line_time_us, float(delay_us), 1500.0)
        off = np.abs(frame(copy, one).astype(float) - frame(real, one))[known]
        assert (off > 0.1 * lit[known]).mean() < 0.03, "only where the gate's edge is"
    real.close()
    copy.close()


def test_another_rig_is_remarked(folder: Path) -> None:
    _, scene = open_scene(folder, load_rig("beside"))
    assert scene.remarks == (f"card is looked at with the rig that measured it, {RIG.name}",)


def test_nothing_is_overwritten_unasked(folder: Path, twin: Twin, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="exists already"):
        save_twin(folder, RIG, twin, "Other", "")
    save_twin(tmp_path / "own", RIG, twin, "One", "")
    save_twin(tmp_path / "own", RIG, twin, "Two", "", overwrite=True)
    assert open_scene(tmp_path / "own", RIG)[1].name == "Two"
    (tmp_path / "thesis").mkdir()
    with pytest.raises(StorageError, match="holds no scene: it is not overwritten"):
        save_twin(tmp_path / "thesis", RIG, twin, "Three", "", overwrite=True)
    with pytest.raises(StorageError, match="there is no folder"):
        save_twin(tmp_path / "no" / "where", RIG, twin, "Four", "")


def test_a_rig_that_does_not_fit_is_refused(twin: Twin, tmp_path: Path) -> None:
    made = save_twin(tmp_path / "own", RIG, twin, "One", "")
    facts = json.loads((made / "scene.json").read_text("utf-8"))
    (made / "scene.json").write_text(json.dumps(facts | {"rig": "../../etc/other.toml"}), "utf-8")
    with pytest.raises(Exception, match=r"other\.toml"):
        open_scene(made, RIG)
    text = (made / "rig.toml").read_text("utf-8").replace("width = 160", "width = 320", 1)
    (made / "rig.toml").write_text(text, "utf-8")
    (made / "scene.json").write_text(json.dumps(facts), "utf-8")
    with pytest.raises(SceneError, match="its camera has 320 x 120 pixels and the photo 160 x 120"):
        open_scene(made, RIG)


def test_a_sweep_that_saw_nothing_makes_no_scene(swept: DepthMap) -> None:
    from dataclasses import replace

    dark = replace(swept, inverse_depth=np.zeros_like(swept.inverse_depth))
    with pytest.raises(InputError, match="the sweep found no depth"):
        make_twin(RIG, dark, dark.lit_counts)
    with pytest.raises(InputError, match="saw no light where it found depth"):
        make_twin(RIG, swept, np.zeros_like(swept.lit_counts))
    with pytest.raises(InputError, match="colour is"):
        make_twin(RIG, swept, swept.lit_counts[:-1])


def test_colours_of_a_mosaic_stay(swept: DepthMap) -> None:
    colour = swept.lit_counts[:, :, None] * np.array([1.0, 0.5, 0.25], np.float32)
    made = make_twin(RIG, swept, colour)
    seen = made.photo[..., 0] > 0.1
    np.testing.assert_allclose(made.photo[seen][:, 1] / made.photo[seen][:, 0], 0.5, rtol=1e-5)
    assert made.photo.max() == pytest.approx(1.0)
