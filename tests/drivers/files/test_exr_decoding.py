import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.exr_decoding import read_exr_depth, read_exr_picture
from slopegate.drivers.files.picture_files import read_luminance, read_map

DEPTH = np.arange(24, dtype=np.float32).reshape(4, 6) + 1
OTHER = np.random.default_rng(4).random((4, 6)).astype(np.float32)
ONES = np.ones_like(DEPTH)


def exr(channels: dict[str, np.ndarray], **header: Any) -> bytes:
    data = io.BytesIO()
    with OpenEXR.File(header, {name: OpenEXR.Channel(pixels) for name, pixels in channels.items()}) as file:
        file.write(data)
    return data.getvalue()


def colours(layer: str = "", depth: np.ndarray | None = None) -> dict[str, np.ndarray]:
    planes = dict.fromkeys("RGB", depth) if depth is not None else {"R": OTHER, "G": ONES, "B": 2 * OTHER}
    return {layer + name: plane for name, plane in planes.items() if plane is not None}


@pytest.mark.parametrize(
    "channels",
    [
        {"Z": DEPTH},
        {"depth": DEPTH},
        {"Y": DEPTH},
        {"whatever": DEPTH},
        {"R": DEPTH, "A": ONES},
        {**colours(depth=DEPTH), "A": ONES},
        {**colours(), "A": ONES, "Z": DEPTH},
        {"ViewLayer.Depth.Z": DEPTH, "ViewLayer.Mist.Z": OTHER},
        {**colours("ViewLayer.Combined."), "ViewLayer.Combined.A": ONES, "ViewLayer.Depth.Z": DEPTH},
        {**{f"ViewLayer.Normal.{name}": OTHER for name in "XYZ"}, "ViewLayer.Depth.Z": DEPTH},
        {**colours(), **colours("Depth.", DEPTH), "Depth.A": ONES},
        {**colours(), "Depth.V": DEPTH},
        {**colours(), "DepthLayer.depth_m": DEPTH, "Z": OTHER},
        {"left.Depth.Z": DEPTH, "right.Depth.Z": DEPTH},
    ],
)
def test_depth_is_what_the_names_say(channels: dict[str, np.ndarray]) -> None:
    np.testing.assert_array_equal(read_exr_depth(exr(channels), "x"), DEPTH)


@pytest.mark.parametrize(
    "channels",
    [
        {"A": ONES},
        {**colours(), "A": ONES},
        {"left.Depth.Z": DEPTH, "right.Depth.Z": OTHER},
        {f"Normal.{name}": OTHER for name in "XYZ"},
        {"Mist.Z": OTHER},
        {**colours(), "Index.X": ONES},
        {"R": DEPTH, "G": OTHER},
    ],
)
def test_what_may_not_be_depth_is_refused_with_the_names_that_there_are(channels: dict[str, np.ndarray]) -> None:
    with pytest.raises(SceneError, match=r"^x does not say which of its channels is depth: .* Z or depth") as refused:
        read_exr_depth(exr(channels), "x")
    assert all(repr(name) in str(refused.value) for name in channels)


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        (colours(), "RGB"),
        ({**colours(), "A": ONES, "Z": DEPTH}, "RGB"),
        ({**colours("ViewLayer.Combined."), "ViewLayer.Depth.Z": DEPTH}, "RGB"),
        ({**colours("ViewLayer.Combined."), **colours("ViewLayer.Albedo.", DEPTH)}, "RGB"),
        ({**colours(), **colours("albedo.", DEPTH)}, "RGB"),
        ({"Y": DEPTH, "A": ONES}, "Y"),
        ({"Z": DEPTH}, "Y"),
    ],
)
def test_a_picture_is_the_colours_of_the_main_layer(channels: dict[str, np.ndarray], expected: str) -> None:
    wanted = np.dstack([OTHER, ONES, 2 * OTHER]) if expected == "RGB" else DEPTH
    np.testing.assert_array_equal(read_exr_picture(exr(channels), "x"), wanted)


def test_several_layers_of_colours_without_a_main_one_are_refused() -> None:
    with pytest.raises(SceneError, match="which of its channels are the picture: R, G and B of one layer"):
        read_exr_picture(exr({**colours("a."), **colours("b.")}), "x")


def test_channels_of_all_parts_count_and_begin_with_the_parts_name() -> None:
    data = io.BytesIO()
    parts = [OpenEXR.Part({"name": "beauty"}, colours()), OpenEXR.Part({"name": "depth"}, {"Y": DEPTH})]
    with OpenEXR.File(parts) as file:
        file.write(data)
    np.testing.assert_array_equal(read_exr_depth(data.getvalue(), "x"), DEPTH)
    np.testing.assert_array_equal(read_exr_picture(data.getvalue(), "x")[..., 0], OTHER)


@pytest.mark.parametrize("dtype", ["float16", "float32", "uint32"])
@pytest.mark.parametrize("tiled", [False, True])
def test_every_type_of_number_in_lines_or_tiles(dtype: str, tiled: bool) -> None:
    header = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()} if tiled else {}
    found = read_exr_depth(exr({"Z": DEPTH.astype(dtype)}, **header), "x")
    np.testing.assert_array_equal(found, DEPTH)
    assert found.dtype == dtype


def test_pixels_lie_where_the_windows_put_them() -> None:
    data = exr({"Z": DEPTH}, dataWindow=((2, -1), (7, 2)), displayWindow=((0, 0), (5, 4)))
    expected = np.zeros((5, 6), np.float32)
    expected[:3, 2:] = DEPTH[1:, :4]
    np.testing.assert_array_equal(read_exr_depth(data, "x"), expected)
    beside = exr({"Z": DEPTH}, dataWindow=((20, 1), (25, 4)), displayWindow=((0, 0), (5, 3)))
    np.testing.assert_array_equal(read_exr_depth(beside, "x"), np.zeros((4, 6)))


def test_headers_that_ask_for_much_are_refused_before_anything_is_decoded() -> None:
    data = exr({"Z": DEPTH}, dataWindow=((0, 0), (5, 3)), displayWindow=((0, 0), (39999, 39999)))
    with pytest.raises(SceneError, match=r"x has 40000 x 40000 pixels \(1600 megapixels\): at most 25"):
        read_exr_depth(data, "x")
    many = exr({f"c{k:03}": np.zeros((400, 500), np.float16) for k in range(30)})
    wide = many.replace(np.array([499, 399], "<i4").tobytes(), np.array([4999, 4999], "<i4").tobytes())
    with pytest.raises(SceneError, match=r"x would take \d+ MB of memory: at most 1000 MB"):
        read_exr_depth(wide, "x")


@pytest.mark.parametrize("share", [0.5, 0.8, 0.99])
def test_a_part_that_cannot_be_read_is_damage_and_no_word_on_the_terminal(
    share: float, capsys: pytest.CaptureFixture[str]
) -> None:
    data = exr({"Z": np.random.default_rng(5).random((200, 60)).astype(np.float32)})
    with pytest.raises(SceneError, match=r"^x cannot be decoded: it is damaged"):
        read_exr_depth(data[: int(len(data) * share)], "x")
    assert capsys.readouterr() == ("", "")


def test_by_their_paths_maps_and_pictures_follow_the_names(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(exr({**colours(), "A": ONES, "Z": DEPTH}))
    np.testing.assert_array_equal(read_map(path), DEPTH)
    np.testing.assert_allclose(read_luminance(path), OTHER * (0.2126 + 2 * 0.0722) + 0.7152, rtol=1e-6)


def test_the_case_of_alpha_before_red(shared: Callable[[str], Path]) -> None:
    depth = read_map(shared("cases/exr_depth_alpha/folder") / "depth_m.exr")
    assert depth[depth > 0].min() == pytest.approx(1.0, abs=1e-3)
    assert depth.max() == pytest.approx(1.636, abs=1e-3)
