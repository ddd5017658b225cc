import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import (
    read_colour,
    read_luminance,
    read_map,
    read_pattern,
    read_raw,
    read_region,
)

MAP = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
COLOUR = np.random.default_rng(1).integers(0, 256, (40, 50, 3), np.uint8)


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def huge_png(width: int, height: int) -> bytes:
    """A true PNG of one grey, a few kB long whatever its size."""
    packer = zlib.compressobj(9)
    row = bytes(width + 1)
    body = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def test_maps_keep_their_numbers_in_every_format(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "m.png"), MAP)
    tifffile.imwrite(tmp_path / "m.tif", MAP)
    np.save(tmp_path / "m.npy", MAP)
    floats = MAP.astype(np.float32)
    tifffile.imwrite(tmp_path / "f.tiff", floats)
    (tmp_path / "f.pfm").write_bytes(b"Pf\n4 3\n-1.0\n" + floats[::-1].astype("<f4").tobytes())
    (tmp_path / "g.pfm").write_bytes(b"Pf\n4 3\n1.0\n" + floats[::-1].astype(">f4").tobytes())
    with OpenEXR.File({}, {"Z": OpenEXR.Channel(floats)}) as file:
        file.write(str(tmp_path / "f.exr"))
    for path in sorted(tmp_path.iterdir()):
        values = read_map(path)
        np.testing.assert_array_equal(values, MAP, err_msg=path.name)
        assert values.dtype == (MAP.dtype if path.stem == "m" else np.float32)


def test_colour_of_16_bits_keeps_all_of_them(tmp_path: Path) -> None:
    deep = COLOUR.astype(np.uint16) * 17 + 3
    cv2.imwrite(str(tmp_path / "rgb.png"), deep[:, :, ::-1])
    alpha = np.full((40, 50, 1), 65535, np.uint16)
    alpha[:20] = 0
    cv2.imwrite(str(tmp_path / "rgba.png"), np.dstack([deep[:, :, ::-1], alpha]))
    for name in ("rgb.png", "rgba.png"):
        np.testing.assert_array_equal(read_raw(tmp_path / name), deep)
    np.testing.assert_array_equal(read_region(tmp_path / "rgba.png")[:20], False)
    cut = (tmp_path / "rgb.png").read_bytes()
    (tmp_path / "bad.png").write_bytes(cut[:60] + bytes(40) + cut[100:])
    with pytest.raises(SceneError, match="cannot be decoded"):
        read_raw(tmp_path / "bad.png")


def test_luminance_is_the_numbers_of_the_file(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), MAP)
    tifffile.imwrite(tmp_path / "grey.tif", MAP)
    np.save(tmp_path / "grey.npy", MAP)
    for path in sorted(tmp_path.iterdir()):
        found = read_luminance(path)
        np.testing.assert_array_equal(found, MAP, err_msg=path.name)
        assert found.dtype == MAP.dtype
    weighed = COLOUR @ np.array([0.2126, 0.7152, 0.0722])
    Image.fromarray(COLOUR).save(tmp_path / "rgb.png")
    np.save(tmp_path / "rgb.npy", COLOUR)
    with OpenEXR.File({}, {"RGB": COLOUR.astype(np.float32)}) as file:
        file.write(str(tmp_path / "rgb.exr"))
    for path in sorted(tmp_path.glob("rgb*")):
        np.testing.assert_allclose(read_luminance(path), weighed, rtol=1e-6, err_msg=path.name)


def test_a_region_is_white_in_every_kind_of_picture(tmp_path: Path) -> None:
    region = np.zeros((4, 6), bool)
    region[1:3, 2:5] = True
    white = region.astype(np.uint8) * 255
    Image.fromarray(region).convert("1").save(tmp_path / "bits.png")
    Image.fromarray(white).save(tmp_path / "grey.png")
    Image.fromarray(region.astype(np.uint8)).save(tmp_path / "ones.png")
    cv2.imwrite(str(tmp_path / "deep.png"), region.astype(np.uint16) * 65535)
    Image.fromarray(np.dstack([0 * white, white, 0 * white])).save(tmp_path / "green.png")
    Image.fromarray(white).convert("P").save(tmp_path / "palette.png")
    Image.fromarray(np.dstack([white, white, white])).save(tmp_path / "rgb.png")
    Image.fromarray(np.dstack([white] * 3)).save(tmp_path / "rgb.bmp")
    tifffile.imwrite(tmp_path / "deep.tif", np.dstack([white] * 3).astype(np.uint16) * 257)
    everywhere = np.full_like(white, 255)
    Image.fromarray(np.dstack([everywhere] * 3 + [white]), "RGBA").save(tmp_path / "cut_out.png")
    Image.fromarray(np.dstack([everywhere, white]), "LA").save(tmp_path / "cut_out_grey.png")
    Image.fromarray(np.dstack([white] * 3 + [everywhere]), "RGBA").save(tmp_path / "opaque.png")
    np.save(tmp_path / "array.npy", white.astype(np.float32))
    for path in sorted(tmp_path.iterdir()):
        np.testing.assert_array_equal(read_region(path), region, err_msg=path.name)


def test_colour_pictures_agree_whatever_their_depth(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), COLOUR[:, :, ::-1])
    tifffile.imwrite(tmp_path / "b.tif", COLOUR)
    tifffile.imwrite(tmp_path / "c.tif", COLOUR.astype(np.uint16) * 257)
    alpha = np.dstack([COLOUR[:, :, ::-1], np.full(COLOUR.shape[:2], 7, np.uint8)])
    cv2.imwrite(str(tmp_path / "d.png"), alpha)
    share = COLOUR / 255
    wanted = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    for path in sorted(tmp_path.iterdir()):
        np.testing.assert_allclose(read_colour(path), wanted, atol=1e-6, err_msg=path.name)


def test_grey_pictures_become_three_equal_channels(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "g8.png"), np.full((3, 4), 255, np.uint8))
    cv2.imwrite(str(tmp_path / "g16.png"), np.full((3, 4), 65535, np.uint16))
    for name in ("g8.png", "g16.png"):
        np.testing.assert_array_equal(read_colour(tmp_path / name), np.ones((3, 4, 3), np.float32))


def test_a_hundred_megapixels_are_refused_by_their_header(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    path.write_bytes(huge_png(10_000, 10_000))
    assert path.stat().st_size < 200_000
    for reader in (read_colour, read_map):
        with pytest.raises(SceneError, match=r"huge.png has 10000 x 10000 pixels \(100 megapixels\): at most 25"):
            reader(path)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (
            "a.npy",
            b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (90000, 90000), }" + b" " * 60,
        ),
        ("a.pfm", b"Pf\n90000 90000\n-1.0\n"),
    ],
)
def test_a_header_that_promises_too_much_is_not_believed(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SceneError, match=name):
        read_map(tmp_path / name)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.99])
@pytest.mark.parametrize("suffix", ["png", "jpg", "tif", "npy", "exr", "pfm"])
def test_cut_short_files_are_refused_without_a_word_on_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str, share: float
) -> None:
    path = tmp_path / f"cut.{suffix}"
    if suffix == "npy":
        np.save(path, COLOUR[:, :, 0])
    elif suffix == "pfm":
        path.write_bytes(b"Pf\n50 40\n-1.0\n" + COLOUR[:, :, 0].astype("<f4").tobytes())
    elif suffix == "exr":
        with OpenEXR.File({}, {"Z": OpenEXR.Channel(COLOUR[:, :, 0].astype(np.float32))}) as file:
            file.write(str(path))
    elif suffix == "tif":
        tifffile.imwrite(path, COLOUR)
    else:
        cv2.imwrite(str(path), COLOUR)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    reader = read_colour if suffix in {"png", "jpg", "tif"} else read_map
    with pytest.raises(SceneError, match=f"cut.{suffix}"):
        reader(path)
    if suffix != "exr":  # that library reports to the terminal by itself
        assert capfd.readouterr().err == ""


def test_what_is_no_single_plane_of_numbers_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "cube.npy", np.zeros((3, 4, 5)))
    np.save(tmp_path / "words.npy", np.array([["a", "b"]]))
    np.save(tmp_path / "objects.npy", np.array([[{}, {}]]), allow_pickle=True)
    np.save(tmp_path / "complex.npy", np.zeros((3, 4), complex))
    cv2.imwrite(str(tmp_path / "rgb.png"), COLOUR)
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(SceneError, match=path.name):
            read_map(path)


def test_a_float_picture_is_linear_and_stays_within_0_and_1(tmp_path: Path) -> None:
    good = (COLOUR / 255).astype(np.float32)
    tifffile.imwrite(tmp_path / "good.tif", good, photometric="rgb")
    np.testing.assert_array_equal(read_colour(tmp_path / "good.tif"), good)
    good[0, 0, 0] = np.nan
    tifffile.imwrite(tmp_path / "bad.tif", good, photometric="rgb")
    with pytest.raises(SceneError, match=r"bad.tif has values outside 0..1"):
        read_colour(tmp_path / "bad.tif")


RASTER = Raster(50, 40)


@pytest.mark.parametrize("shape", [(40, 50), (1, 1), (3, 7), (40, 7)])
def test_a_pattern_of_any_grid_is_spread_over_the_raster_linearly(tmp_path: Path, shape: tuple[int, int]) -> None:
    levels = np.random.default_rng(2).integers(0, 256, shape, np.uint8)
    cv2.imwrite(str(tmp_path / "p.png"), levels)
    found = read_pattern(tmp_path / "p.png", RASTER)
    assert (found.shape, found.dtype) == ((40, 50), np.float32)
    expected = BlockGrid(RASTER, shape[1], shape[0]).spread(levels)
    np.testing.assert_array_equal(np.rint(255 * found), expected)
    np.testing.assert_allclose(found, expected / 255, rtol=1e-7)


def test_patterns_of_a_bit_or_of_grey_colours_are_read(tmp_path: Path) -> None:
    bits = np.random.default_rng(2).random((40, 50)) < 0.5
    Image.fromarray(bits).save(tmp_path / "bits.png")
    Image.fromarray(np.repeat(255 * bits[..., None], 3, axis=2).astype(np.uint8)).save(tmp_path / "rgb.png")
    for name in ("bits.png", "rgb.png"):
        np.testing.assert_array_equal(read_pattern(tmp_path / name, RASTER), bits)


@pytest.mark.parametrize(
    ("name", "pixels", "why"),
    [
        ("p.png", MAP, "has 16 bits a channel: a pattern is a grey PNG of 8 bits"),
        ("p.png", COLOUR, "has colours: a pattern is a grey PNG of 8 bits"),
        ("p.png", COLOUR[:, :41, 0].T, "has 40 x 41 pixels: a pattern has at most the 50 x 40 pixels"),
        ("p.bmp", COLOUR[..., 0], "is no PNG: a pattern is a grey PNG of 8 bits"),
    ],
)
def test_patterns_that_cannot_be_shown_are_refused(tmp_path: Path, name: str, pixels: np.ndarray, why: str) -> None:
    cv2.imwrite(str(tmp_path / name), pixels)
    with pytest.raises(SceneError, match=why):
        read_pattern(tmp_path / name, RASTER)


@pytest.mark.parametrize(
    "header",
    [
        b"Pf\n4 3\n-1.0\n",
        b"Pf\n# by hand\n4 3\n# and more\n-1\n",
        b"Pf 4\n3\n-1.\n",
        b"Pf\r\n4 3\r\n-1e0\r\n",
        b"Pf\n4 3\n-.5\n",
        b"Pf\n4 3\n-1.000000E+00\n",
        b"Pf\n4 3\n-0.003922\n",
    ],
)
def test_headers_of_pfm_as_programs_write_them(tmp_path: Path, header: bytes) -> None:
    floats = MAP.astype(np.float32)
    (tmp_path / "m.pfm").write_bytes(header + floats[::-1].astype("<f4").tobytes())
    np.testing.assert_array_equal(read_map(tmp_path / "m.pfm"), MAP)
    (tmp_path / "b.pfm").write_bytes(header.replace(b"-1", b"1").replace(b"-.", b".").replace(b"-0", b"0"))
    with (tmp_path / "b.pfm").open("ab") as file:
        file.write(floats[::-1].astype(">f4").tobytes())
    np.testing.assert_array_equal(read_map(tmp_path / "b.pfm"), MAP)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"PF\n4 3\n-1\n" + bytes(144), "m.pfm is a PFM of three channels"),
        (b"Pf\n4 3\n-1\n" + bytes(40), "m.pfm has 40 bytes of pixels: 4 x 3 pixels need 48"),
        (b"Pf\n4 3\n-1\n" + bytes(49), "m.pfm has 49 bytes of pixels: 4 x 3 pixels need 48"),
        (b"Pf\n4 3\n0\n" + bytes(48), "m.pfm cannot be decoded"),
        (b"Pf\n4 3\nnan\n" + bytes(48), "m.pfm cannot be decoded"),
        (b"Pf\n# " + b"x" * 9000, "m.pfm cannot be decoded"),
    ],
)
def test_what_is_no_pfm_of_one_channel_is_refused(tmp_path: Path, data: bytes, sentence: str) -> None:
    (tmp_path / "m.pfm").write_bytes(data)
    with pytest.raises(SceneError, match=sentence):
        read_map(tmp_path / "m.pfm")


def test_an_array_that_promises_more_than_its_file_has_takes_no_memory(tmp_path: Path) -> None:
    np.save(tmp_path / "m.npy", np.zeros((30, 30)))
    data = (tmp_path / "m.npy").read_bytes()
    (tmp_path / "m.npy").write_bytes(
        data.replace(b"(30, 30), }", b"(30, 30, 99999999999), }").replace(b" " * 13, b"", 1)
    )
    with pytest.raises(SceneError, match=r"m.npy cannot be decoded"):
        read_map(tmp_path / "m.npy")


def test_the_cases_of_tiff_and_pfm(shared: Callable[[str], Path]) -> None:
    for name in ("comment", "scale_dot", "scale_exponent"):
        assert read_map(shared("cases/pfm_header") / name / "depth_m.pfm").max() == pytest.approx(1.636, abs=1e-3)
    depth = read_map(shared("cases/tiff_lzw") / "depth_by_opencv" / "depth_mm.tif")
    assert (depth[depth > 0].min(), depth.max()) == (1000, 1636)
    places = (slice(10, 111, 100), slice(10, 151, 140))
    plain = read_colour(shared("cases/tiff_lzw/depth_by_opencv") / "color.png")[places]
    for path in ("tiff_lzw/photo_by_opencv", "tiff_photometric/palette"):
        np.testing.assert_array_equal(read_colour(shared("cases") / path / "color.tif")[places], plain)
    grey = read_colour(shared("cases/tiff_photometric/miniswhite") / "color.tif")[places][..., 0]
    assert grey[1, 1] == pytest.approx(plain[1, 1, 0])
    assert (grey[0, 1] > grey[0, 0] > grey[1, 0]).all()  # green, red and blue as grey
