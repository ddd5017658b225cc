import math
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import calibrated
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS, Calibration, as_rows
from slopegate.core.rig.checks import plain_name
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector
from slopegate.core.rig.settings import LineTimes, PixelClocks, ShutterLimits, Steps
from slopegate.core.rig.uncertainty import spread
from slopegate.drivers.files.rig_files import MAX_FILE_BYTES, RigError, load_rig, parse_rig, rig_to_toml

RIGS = files("slopegate.resources").joinpath("rigs")
CHECK = RIGS.joinpath("check.toml").read_text("utf-8")


def test_the_default_rig_is_the_check_rig() -> None:
    rig = load_rig(None)
    camera, projector = rig.camera.lens, rig.projector
    assert rig.is_ideal
    assert rig.baseline_m == 0.1
    assert (camera.width, camera.height, camera.cx, camera.cy) == (1600, 1200, 800, 600)
    assert camera.fx == camera.fy == 5000 / 3
    assert (projector.lens.width, projector.lens.height, projector.lens.fy) == (1280, 720, 1000)
    assert (projector.period_us, projector.active_fraction) == (16666.7, 0.92)
    line = rig.camera.shutter.line
    assert isinstance(line, PixelClocks)
    assert line.clocks_per_line == pytest.approx(996.66866, abs=5e-6)
    ladder = [*range(10, 51), *range(52, 101, 2), *range(104, 129, 4)]
    assert list(line.ladder_mhz) == ladder
    assert rig.camera.shutter.delay_us == Steps(-16667, 33334, 1)
    assert rig.camera.shutter.exposure_us == Steps(100, 50000, 1)


def test_b1_clock_counts_both_focal_lengths() -> None:
    text = CHECK.replace("fy = 1000.0", "fy = 800.0").replace("b1_clock_mhz = 78.0", "b1_clock_mhz = 52.0")
    rig = parse_rig(text, "x")
    line = rig.camera.shutter.line
    assert isinstance(line, PixelClocks)
    ratio = rig.projector.rows_per_us * line.line_time_us(52.0) * rig.camera.lens.fy / rig.projector.lens.fy
    assert ratio == pytest.approx(1.0, abs=1e-15)


def test_the_example_of_the_format_page_loads() -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", RIGS.joinpath("FORMAT.md").read_text("utf-8"), re.DOTALL)
    rig = parse_rig(example, "FORMAT.md")
    assert not rig.is_ideal
    assert rig.camera.shutter.line == LineTimes(8.0, 100.0, 0.1)
    assert rig.projector_offset_m == (0.002, -0.12, 0.004)
    # The rotation vector points along the axis, and its length is the angle.
    angle = math.degrees(math.acos((np.trace(rig.rotation) - 1) / 2))
    assert angle == pytest.approx(math.hypot(1.5, 0.1, 0.2))
    axis = np.array([1.5, 0.1, -0.2])
    assert rig.rotation @ axis == pytest.approx(axis)


def test_a_positive_rotation_about_x_takes_y_towards_z() -> None:
    text = CHECK.replace("baseline_m = 0.1", "offset_m = [0, -0.1, 0]\nrotation_deg = [90, 0, 0]")
    assert parse_rig(text, "x").rotation @ [0, 1, 0] == pytest.approx([0, 0, 1])


def test_rows_that_go_up_are_the_rig_turned_by_half_a_turn() -> None:
    camera_up = CHECK.replace("[camera]", '[camera]\nrows = "up"')
    both_up = camera_up.replace("[projector]", '[projector]\nrows = "up"')
    projector_up = parse_rig(CHECK.replace("[projector]", '[projector]\nrows = "up"'), "x")
    turned = CHECK.replace("baseline_m = 0.1", "offset_m = [0, -0.1, 0]\nrotation_deg = [0, 0, 180]")
    upside_down = parse_rig(turned, "x")
    np.testing.assert_allclose(projector_up.rotation, upside_down.rotation, atol=1e-15)
    assert projector_up.projector.lens == upside_down.projector.lens, "its principal point is the middle"
    assert projector_up.is_opposed
    assert parse_rig(camera_up, "x").is_opposed
    hanging = parse_rig(both_up, "x")
    assert not hanging.is_opposed
    assert hanging.projector_offset_m == (0.0, 0.1, 0.0)
    assert parse_rig(rig_to_toml(hanging), "x") == hanging
    with pytest.raises(RigError, match=r"camera\.rows is 'left': it must be 'down' or 'up'$"):
        parse_rig(CHECK.replace("[camera]", '[camera]\nrows = "left"'), "x")


numbers = st.floats(-1e3, 1e3)
positive = st.floats(1e-3, 1e5)


@st.composite
def lenses(draw: st.DrawFn) -> Lens:
    size = draw(st.tuples(*[st.integers(1, 5000)] * 2))
    focal_px = max(size) * draw(st.floats(0.2, 100.0))
    focal = draw(st.tuples(st.just(focal_px), st.floats(focal_px / 2, focal_px * 2)))
    centre = draw(st.tuples(*[st.floats(-max(size), side + max(size)) for side in size]))
    count = draw(st.sampled_from([0, 4, 5, 8, 12, 14]))
    distortion = draw(st.lists(st.floats(-0.1, 0.1), min_size=count, max_size=count))
    return Lens(*size, *focal, *centre, tuple(distortion))


@st.composite
def rigs(draw: st.DrawFn) -> Rig:
    ladder = tuple(sorted(draw(st.sets(positive, min_size=1, max_size=9))))
    low, high = sorted(draw(st.tuples(positive, positive)))
    line = draw(st.sampled_from([PixelClocks(draw(positive), ladder), LineTimes(low, high, draw(positive))]))
    delays = Steps(*sorted(draw(st.tuples(numbers, numbers))), draw(positive))
    exposures = Steps(*sorted(draw(st.tuples(positive, positive))), draw(positive))
    blur = st.floats(0.0, 20.0)
    projector = RigProjector(draw(lenses()), draw(st.floats(100.0, 1e6)), draw(st.floats(0.01, 1.0)), draw(blur))
    turn = np.array(draw(st.tuples(*[st.floats(-2.0, 2.0)] * 3)))
    rotation = tuple(tuple(row) for row in cv2.Rodrigues(turn)[0].tolist())
    offset = draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda offset: max(map(abs, offset)) > 1e-6))
    camera = RigCamera(draw(lenses()), ShutterLimits(line, delays, exposures, draw(numbers)), draw(blur))
    return Rig(camera, projector, offset, rotation, draw(st.text("aé\"\\\n\t#=[]'1", max_size=8).map(plain_name)))


@given(rigs())
@settings(max_examples=60, deadline=None)
def test_a_rig_survives_its_file(rig: Rig) -> None:
    assert parse_rig(rig_to_toml(rig), "x") == rig


@st.composite
def calibrations(draw: st.DrawFn, told: tuple[str, ...] = NUMBERS) -> Calibration:
    """Any covariance, of full rank or not, with numbers that are known exactly and ones that hang together."""
    names = tuple(draw(st.permutations(told))[: draw(st.integers(1, len(told)))])
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    factor = rng.normal(size=(len(names), draw(st.integers(1, 30))))
    errors = 10.0 ** rng.uniform(-8, 2, len(names)) * (rng.random(len(names)) > 0.1)
    factor *= errors[:, None]
    text = st.text("aé±\"\\\n\t#=[]'1\x7f\x1b", max_size=8)
    facts = {plain_name(key): plain_name(fact) for key, fact in draw(st.dictionaries(text, text, max_size=4)).items()}
    return Calibration(names, as_rows(factor @ factor.T), tuple(facts.items()))


@given(rigs(), st.data())
@settings(max_examples=60, deadline=None)
def test_a_calibration_survives_its_file(rig: Rig, data: st.DataObject) -> None:
    clocks = isinstance(rig.camera.shutter.line, PixelClocks)
    known = data.draw(calibrations(NUMBERS if clocks else tuple(name for name in NUMBERS if name != "clocks_per_line")))
    read = parse_rig(rig_to_toml(replace(rig, calibration=known)), "x")
    assert read == rig
    assert read.calibration == known, "to the last bit"


TABLE = """
[calibration]
names = ["camera.fy", "offset_y_m"]
covariance = [[0.25, -1e-5], [-1e-5, 1e-8]]
facts = { pictures = "42", chart = "board" }
"""


def test_standard_errors_and_facts_are_read_and_written_for_people() -> None:
    rig = parse_rig(CHECK + TABLE, "x")
    assert rig.calibration is not None
    assert rig.calibration.standard_errors == pytest.approx({"camera.fy": 0.5, "offset_y_m": 1e-4})
    assert dict(rig.calibration.facts) == {"pictures": "42", "chart": "board"}
    text = rig_to_toml(rig)
    assert '"camera.fy",  # 1666.67 +- 0.50 px\n' in text
    assert '"offset_y_m",  # -0.10000 +- 0.00010 m\n' in text
    assert parse_rig(CHECK, "x").calibration is None


@pytest.mark.parametrize("ups", [(True, False), (False, True), (True, True)])
def test_a_calibration_is_of_the_numbers_in_the_file_and_turns_with_the_rig(ups: tuple[bool, bool]) -> None:
    """Points that the described rig scatters by its covariance scatter as much on the rig in scan order."""
    described = as_described()
    text = rig_to_toml(described)
    if ups[0]:
        text = text.replace("[camera]", '[camera]\nrows = "up"')
    if ups[1]:
        text = text.replace("[projector]", '[projector]\nrows = "up"')
    read = parse_rig(text, "x")
    signs = np.array([-1.0, -1.0, 1.0]) if ups[0] else np.ones(3)
    point = np.array([0.1, -0.05, 1.2])

    def seen(rig: Rig, turned: bool) -> Doubles:
        # from the camera's centre, which stays where it is
        place = (signs * point if turned else point) + rig.camera_centre_m
        (column, row, _), (lit_column, lit_row, _) = rig.to_camera(place), rig.to_projector(place)
        return np.array([column, row, lit_column, lit_row]).ravel()

    upright = spread(described, lambda rig, _late: seen(rig, False))
    turned = spread(read, lambda rig, _late: seen(rig, True))
    assert upright is not None
    np.testing.assert_allclose(turned, upright, rtol=1e-6)
    assert read.calibration is not None
    assert read.calibration != described.calibration
    again = parse_rig(rig_to_toml(read), "x")
    assert again.calibration == read.calibration, "written in scan order, it is read as it is"


def as_described() -> Rig:
    """A bent rig with a covariance that ties all its numbers, the delay offset for one."""
    bent = CHECK.replace("baseline_m = 0.1", "offset_m = [0.004, -0.1, 0.003]\nrotation_deg = [2.0, -0.7, 0.3]")
    return calibrated(
        parse_rig(bent.replace("cx = 800.0", "cx = 780.0\ndistortion = [-0.1, 0.05, 0.002, -0.003, 0.01]"), "x")
    )


FAULTS = {
    "misspelt key": ("fx = 1000.0", "fz = 1000.0", "projector.fz is not a key that is known there (allowed here:"),
    "unknown key": ("cx = 800.0", "cx = 800.0\nfocal = 3", "camera.focal is not a key"),
    "unknown section": ("[pose]", "[poses]\nz = 1\n[pose]", "poses is not a key"),
    "unknown key of a span": ("max = 33334, step = 1 }", "max = 33334, step = 1, unit = 1 }", "shutter.delay_us.unit"),
    "text for a number": ("fx = 1000.0", "fx = 'wide'", "projector.fx is 'wide'"),
    "true for a number": ("fx = 1000.0", "fx = true", "projector.fx is True"),
    "NaN": ("cx = 800.0", "cx = nan", "camera.cx is nan"),
    "infinity": ("period_us = 16666.7", "period_us = inf", "projector.period_us is inf"),
    "zero": ("fx = 1000.0", "fx = 0", "projector.fx is 0"),
    "blur below 0": ("cx = 800.0", "cx = 800.0\nblur_px = -0.1", "camera.blur_px is -0.1"),
    "blur of half a picture": ("cx = 640.0", "cx = 640.0\nblur_px = 300.0", "projector.blur_px is 300.0"),
    "negative": ("baseline_m = 0.1", "baseline_m = -0.1", "pose.baseline_m is -0.1"),
    "half a pixel": ("width = 1600", "width = 1600.5", "camera.width is 1600.5"),
    "no pixels": ("height = 720", "height = 0", "projector.height is 0"),
    "too many pixels": ("width = 1600", "width = 1000000", "camera.width is 1000000"),
    "fraction above 1": ("active_fraction = 0.92", "active_fraction = 1.2", "projector.active_fraction is 1.2"),
    "three distortion numbers": ("cx = 800.0", "cx = 800.0\ndistortion = [0.1, 0, 0]", "camera.distortion is [0.1"),
    "two speeds": ("b1_clock_mhz = 78.0", "b1_clock_mhz = 78.0\nclocks_per_line = 900", "exactly one of"),
    "no speed": ("b1_clock_mhz = 78.0", "", "exactly one of"),
    "ladder with line times": ("b1_clock_mhz = 78.0", "line_time_us = { min = 1, max = 2, step = 1 }", "ladder_mhz"),
    "falling ladder": ("{ min = 52, max = 100, step = 2 },", "20,", "ladder_mhz"),
    "endless ladder": ("max = 50, step = 1 }", "max = 50, step = 1e-9 }", "ladder_mhz"),
    "reversed range": ("min = 100, max = 50000", "min = 100, max = 50", "shutter.exposure_us"),
    "zero step": ("max = 50000, step = 1", "max = 50000, step = 0", "shutter.exposure_us.step is 0"),
    "endless offset": ("[pose]", "delay_offset_us = 2e6\n[pose]", "delay_offset_us is 2000000.0"),
    "two poses": ("baseline_m = 0.1", "baseline_m = 0.1\noffset_m = [0, -0.1, 0]", "pose"),
    "no offset": ("baseline_m = 0.1", "offset_m = [0, 0, 0]", "not all 0"),
    "two numbers of offset": ("baseline_m = 0.1", "offset_m = [0, 0.1]", "pose.offset_m is [0, 0.1]"),
    "rotated ideal rig": ("baseline_m = 0.1", "baseline_m = 0.1\nrotation_deg = [1, 0, 0]", "belongs to offset_m"),
    "no rotation matrix": (
        "baseline_m = 0.1",
        "offset_m = [0, -0.1, 0]\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, 2]]",
        "rotation matrix",
    ),
    "mirror": (
        "baseline_m = 0.1",
        "offset_m = [0, -0.1, 0]\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]",
        "rotation matrix",
    ),
    "not TOML": ("[camera]", "[camera", "not valid TOML"),
    "missing section": ("[pose]\nbaseline_m = 0.1", "", "pose is missing"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_broken_rig_file_gets_one_sentence(fault: str, tmp_path: Path) -> None:
    old, new, named = FAULTS[fault]
    assert old in CHECK
    path = tmp_path / "mine.toml"
    path.write_text(CHECK.replace(old, new, 1), "utf-8")
    with pytest.raises(RigError) as refusal:
        load_rig(path)
    sentence = str(refusal.value)
    assert sentence.startswith(str(path))
    assert named in sentence
    assert "\n" not in sentence
    assert len(sentence) < 300 + len(str(path))


@pytest.mark.parametrize("length", range(0, len(CHECK) - 25, 37))
def test_a_truncated_rig_file_is_refused(length: int) -> None:
    with pytest.raises(RigError, match=r"^cut\.toml"):
        parse_rig(CHECK[:length], "cut.toml")


def test_what_is_no_text_file_is_refused(tmp_path: Path) -> None:
    folder, missing, binary, large = (tmp_path / name for name in ("folder", "missing", "binary", "large"))
    folder.mkdir()
    binary.write_bytes(b"\xff\xfe\x00\x81")
    large.write_bytes(b"#" * (MAX_FILE_BYTES + 1))
    for path, why in (
        (folder, "not an ordinary file"),
        (missing, "is missing"),
        (tmp_path / ("a" * 300), "is missing"),
        (binary, "UTF-8"),
        (large, "at most 1 MB"),
    ):
        with pytest.raises(RigError, match=why) as refusal:
            load_rig(path)
        assert str(path) in str(refusal.value)


CALIBRATION_FAULTS = {
    "unknown number": (
        "offset_y_m",
        "offset_y",
        "calibration.names is 'offset_y': it must be of camera.fx to k3, proj",
    ),
    "twice the same": (
        "offset_y_m",
        "camera.fy",
        "calibration.names is ['camera.fy', 'camera.fy']: it must be names that",
    ),
    "no number": (TABLE[TABLE.index('["') : TABLE.index("facts")], "[]\ncovariance = []\n", "calibration.names is []"),
    "names that are numbers": ('"offset_y_m"', "3", "calibration.names.1 is 3: it must be a valid string"),
    "no covariance": (TABLE[TABLE.index("cov") : TABLE.index("facts")], "", "calibration.covariance is missing"),
    "a row too few": (
        ", [-1e-5, 1e-8]",
        "",
        "calibration.covariance has 1 rows of 2 to 2 numbers: it must have 2 rows",
    ),
    "a number too many": ("1e-8]]", "1e-8, 0]]", "calibration.covariance has 2 rows of 2 to 3 numbers: it must have 2"),
    "text for a number": ("1e-8]]", "'small']]", "calibration.covariance.1.1 is 'small'"),
    "true for a number": ("1e-8]]", "true]]", "calibration.covariance.1.1 is True"),
    "NaN": ("1e-8]]", "nan]]", "calibration.covariance.1.1 is nan"),
    "infinity": ("1e-8]]", "inf]]", "calibration.covariance.1.1 is inf"),
    "beyond all measure": ("1e-8]]", "1e300]]", "offset_y_m with itself is 1e+300: it must be from 0 to 1e+12"),
    "negative variance": ("1e-8]]", "-1e-8]]", "offset_y_m with itself is -1e-08: it must be from 0 to 1e+12"),
    "not symmetric": ("[-1e-5, ", "[-2e-5, ", "it must be the same both ways"),
    "correlated beyond 1": ("-1e-5", "-1e-4", "it must be at most the product of both standard errors"),
    "tied to what is exact": ("1e-8]]", "0]]", "it must be at most the product of both standard errors"),
    "impossible": (
        TABLE[TABLE.index('["') : TABLE.index("facts")],
        '["camera.fx", "camera.fy", "camera.cx"]\ncovariance = [[1, 0.9, 0.9], [0.9, 1, -0.9], [0.9, -0.9, 1]]\n',
        "calibration.covariance is 'not possible': it must be positive semidefinite",
    ),
    "unknown key": ("facts", "fact", "calibration.fact is not a key that is known there (allowed here: names, cov"),
    "a fact that is no text": ('"42"', "42", "calibration.facts.pictures is 42: it must be a valid string"),
    "a table that is none": (TABLE, "[[calibration]]\nnames = []", "calibration is [{'names': []}]: it must"),
}


@pytest.mark.parametrize("fault", CALIBRATION_FAULTS)
def test_a_broken_calibration_gets_one_sentence(fault: str, tmp_path: Path) -> None:
    old, new, named = CALIBRATION_FAULTS[fault]
    assert old in TABLE
    path = tmp_path / "mine.toml"
    path.write_text(CHECK + TABLE.replace(old, new), "utf-8")
    with pytest.raises(RigError) as refusal:
        load_rig(path)
    sentence = str(refusal.value)
    assert sentence.startswith(str(path))
    assert named in sentence
    assert "\n" not in sentence
    assert len(sentence) < 400 + len(str(path))


def test_clocks_of_a_camera_without_clocks_are_refused() -> None:
    lines = CHECK[: CHECK.index("b1_clock_mhz")] + "line_time_us = { min = 8, max = 100, step = 0.1 }\n"
    lines += CHECK[CHECK.index("delay_us") :]
    with pytest.raises(RigError, match=r"^x: calibration\.names has clocks_per_line, which a camera with line_time_us"):
        parse_rig(lines + TABLE.replace("camera.fy", "clocks_per_line"), "x")


def test_deeply_nested_brackets_are_refused() -> None:
    with pytest.raises(RigError, match="not valid TOML"):
        parse_rig("a = " + "[" * 100_000, "deep.toml")
    with pytest.raises(RigError, match="name is nested too deeply"):
        parse_rig(CHECK.replace('name = "Check rig"', "[" + ".".join(["name", *"a" * 5000]) + "]\nx = 1"), "deep.toml")


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + CHECK.replace("\n", "\r\n").encode())
    assert load_rig(path) == load_rig(None)


def test_an_offset_of_nothing_is_refused_under_its_name_in_the_file() -> None:
    text = re.sub(r"offset_m = .*", "offset_m = [0.0, 0.0, 0.0]", rig_to_toml(load_rig(None)))
    with pytest.raises(RigError, match=r"^it: pose\.offset_m is \(0\.0, 0\.0, 0\.0\)"):
        parse_rig(text, "it")


@pytest.mark.parametrize(
    ("table", "key", "value", "sentence"),
    [
        (
            "camera",
            "fx",
            "0.035",
            r"camera.fx is 0.035: it must be a focal length in pixels, from 160 to 320000 for 1600 x",
        ),
        (
            "projector",
            "fy",
            "9e9",
            r"projector.fy is 9e\+09|projector.fy is 9000000000.0: it must be a focal length in",
        ),
        ("camera", "fy", "200.0", r"camera.fy is 200.0: it must be within a factor of 4 of camera.fx, which is "),
        (
            "camera",
            "cx",
            "50000",
            r"camera.cx is 50000.0: it must be within -1600..3200: in the picture, or at most 1600",
        ),
    ],
)
def test_lenses_that_no_camera_has_are_told(table: str, key: str, value: str, sentence: str) -> None:
    head, mark, tail = CHECK.partition(f"[{table}]")
    changed = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", tail, count=1)
    with pytest.raises(RigError, match="^x: " + sentence):
        parse_rig(head + mark + changed, "x")


def test_a_small_file_cannot_ask_for_a_picture_of_gigabytes() -> None:
    changed = re.sub(r"(?m)^(width|height) = .*$", r"\1 = 20000", CHECK)
    with pytest.raises(
        RigError, match=r"^x: camera has 20000 x 20000 pixels \(400 megapixels\): at most 25 megapixels"
    ):
        parse_rig(changed, "x")
