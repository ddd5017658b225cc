import io
import struct
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_decoding import decode_colour, decode_picture

RGB = cv2.resize(np.random.default_rng(3).integers(0, 256, (6, 9, 3), np.uint8), (63, 47))
GREY = RGB[:, :, 0]
LOSSLESS = ["lzw", "zlib", "packbits", "lzma", "zstd", "lerc", "png", "webp"]
BY_TAGS: Any = {"photometric": "minisblack"}
RGB_BY_PIXEL: Any = {"photometric": "rgb", "planarconfig": "contig"}


def tiff(pixels: np.ndarray, **options: Any) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, pixels, **options)
    return data.getvalue()


def by_pillow(image: Image.Image, **options: Any) -> bytes:
    data = io.BytesIO()
    image.save(data, "TIFF", **options)
    return data.getvalue()


def with_tag(data: bytes, code: int, value: int) -> bytes:
    """The bytes of a small-endian classic TIFF with another number in a tag of one number."""
    out = bytearray(data)
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        tag = file.pages.first.tags[code]
    kind = {1: "<B", 3: "<H", 4: "<I"}[int(tag.dtype)]
    struct.pack_into(kind, out, tag.valueoffset, value)
    return bytes(out)


@pytest.mark.parametrize(
    "options", [{}, {"tile": (16, 16)}, {"rowsperstrip": 5}, {"byteorder": ">"}, {"bigtiff": True}]
)
@pytest.mark.parametrize("compression", [None, *LOSSLESS])
@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32", "rgb"])
def test_no_number_changes_in_any_layout(kind: str, compression: str, options: dict[str, Any]) -> None:
    if compression == "webp" and kind != "rgb":
        compression = "lzw"
    swapped = options.get("byteorder") == ">" and kind in {"uint16", "float32"}
    if compression in {"png", "lerc"} and (swapped or kind == "float32"):  # which their encoders do not take
        compression = "zlib"
    pixels = RGB if kind == "rgb" else GREY.astype(kind) * (200 if kind == "uint16" else 1)
    exact = {"compressionargs": {"level": -1}} if compression == "webp" else {}
    meant = {"photometric": "rgb" if kind == "rgb" else "minisblack"}
    found = decode_picture(tiff(pixels, compression=compression, **meant, **options, **exact), "x").values
    np.testing.assert_array_equal(found, pixels)
    assert found.dtype == pixels.dtype


@pytest.mark.parametrize("kind", ["uint16", "float32", "float64"])
@pytest.mark.parametrize("compression", ["lzw", "zlib", "zstd"])
def test_predictors_are_undone(kind: str, compression: str) -> None:
    data = tiff(GREY.astype(kind), compression=compression, predictor=True, **BY_TAGS)
    np.testing.assert_array_equal(decode_picture(data, "x", as_numbers=True).values, GREY)


@pytest.mark.parametrize("compression", [1, 5, 8, 32773, 32946])
def test_what_opencv_writes(compression: int) -> None:
    for pixels in (GREY, RGB[..., ::-1], GREY.astype(np.uint16) * 99, GREY.astype(np.float32) / 255):
        data = bytes(cv2.imencode(".tif", pixels, (cv2.IMWRITE_TIFF_COMPRESSION, compression))[1])
        expected = pixels if pixels.ndim == 2 else pixels[..., ::-1]
        np.testing.assert_array_equal(decode_picture(data, "x").values, expected)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_deflate", "packbits", "jpeg", "group4"])
@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "CMYK"])
def test_colours_are_those_that_pillow_sees(mode: str, compression: str) -> None:
    if (compression == "jpeg" and mode in {"1", "P"}) or (compression == "group4" and mode != "1"):
        compression = "tiff_lzw"
    data = by_pillow(Image.fromarray(RGB).convert(mode), compression=compression)
    seen = np.asarray(Image.open(io.BytesIO(data)).convert("L" if mode in {"1", "L"} else "RGB"))
    np.testing.assert_array_equal(decode_picture(data, "x").values, seen)


def test_white_as_0_is_turned_round() -> None:
    data = tiff(255 - GREY, photometric="miniswhite")
    np.testing.assert_array_equal(decode_picture(data, "x").values, GREY)
    deep = tiff(65535 - GREY.astype(np.uint16), photometric="miniswhite")
    np.testing.assert_array_equal(decode_picture(deep, "x").values, GREY)


def test_few_bits_are_spread_over_all_but_not_in_maps() -> None:
    levels = (GREY // 16).astype(np.uint8)
    data = tiff(levels, bitspersample=4, **BY_TAGS)
    np.testing.assert_array_equal(decode_picture(data, "x").values, levels * 17)
    np.testing.assert_array_equal(decode_picture(data, "x", as_numbers=True).values, levels)
    twelve = tiff(GREY.astype(np.uint16) * 16, bitspersample=12, **BY_TAGS)
    np.testing.assert_array_equal(decode_picture(twelve, "x", as_numbers=True).values, GREY * np.uint16(16))
    np.testing.assert_allclose(decode_picture(twelve, "x").values, GREY * (16 * 65535 / 4095), atol=0.5)


def test_planes_one_after_the_other_and_half_floats() -> None:
    data = tiff(np.moveaxis(RGB, 2, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(decode_picture(data, "x").values, RGB)
    half = (GREY / 255).astype(np.float16)
    np.testing.assert_array_equal(decode_picture(tiff(half, **BY_TAGS), "x").values, half)
    np.testing.assert_array_equal(decode_picture(tiff(GREY.astype(np.int16) - 99, **BY_TAGS), "x").values, GREY - 99.0)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_photos_are_turned_as_the_tag_says_and_only_if_asked(orientation: int) -> None:
    data = tiff(RGB, photometric="rgb", extratags=[(274, "H", 1, orientation, True)])
    turns = Image.Transpose
    steps = {2: turns.FLIP_LEFT_RIGHT, 3: turns.ROTATE_180, 4: turns.FLIP_TOP_BOTTOM, 5: turns.TRANSPOSE}
    steps |= {6: turns.ROTATE_270, 7: turns.TRANSVERSE, 8: turns.ROTATE_90}
    image = Image.fromarray(RGB)
    upright = image if orientation == 1 else image.transpose(steps[orientation])
    np.testing.assert_array_equal(decode_picture(data, "x", turn_upright=True).values, np.asarray(upright))
    np.testing.assert_array_equal(decode_picture(data, "x").values, RGB)


def test_alpha_is_kept_apart_and_divided_out_where_it_was_multiplied_in() -> None:
    alpha = np.full_like(GREY, 128)
    for extra, stored in (("unassalpha", RGB), ("assocalpha", np.rint(RGB * (128 / 255)).astype(np.uint8))):
        data = tiff(np.dstack([stored, alpha]), photometric="rgb", extrasamples=[extra])
        picture = decode_picture(data, "x")
        assert picture.alpha is not None
        np.testing.assert_array_equal(picture.alpha, alpha)
        np.testing.assert_allclose(picture.values, RGB, atol=1)


def test_a_preview_beside_the_picture_is_no_second_picture() -> None:
    data = io.BytesIO()
    with tifffile.TiffWriter(data) as file:
        file.write(RGB, photometric="rgb")
        file.write(RGB[::4, ::4], photometric="rgb", subfiletype=1)
    np.testing.assert_array_equal(decode_picture(data.getvalue(), "x").values, RGB)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (tiff(np.stack([GREY, GREY]), **BY_TAGS), "x is a stack of pictures: a TIFF with a single picture"),
        (tiff(np.stack([GREY, GREY]), imagej=True), "x is a stack of pictures"),
        (by_pillow(Image.fromarray(RGB).convert("LAB")), "x is a TIFF of the colours CIELAB: they must be grey, RGB"),
        (by_pillow(Image.fromarray(RGB).convert("YCbCr")), "x is a TIFF of the colours YCBCR: they must be"),
        (tiff(GREY, compression="jpegxl", **BY_TAGS), "x is a TIFF with the compression JPEGXL: it must be none"),
        (with_tag(tiff(GREY, **BY_TAGS), 259, 4711), "x is a TIFF with the compression 4711: it must be none, CCITT"),
        (with_tag(tiff(GREY, **BY_TAGS), 262, 32803), "x is a TIFF of the colours CFA: they must be"),
        (tiff(GREY.astype(np.complex64), **BY_TAGS), "x is a TIFF of 64 bits and sample format COMPLEXIEEEFP"),
        (tiff(np.zeros((5, 7, 4), np.uint8), photometric="minisblack", planarconfig="contig"), "4 channels that are"),
    ],
)
def test_what_is_not_done_is_refused_by_its_name(data: bytes, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        decode_picture(data, "x")


def test_maps_are_no_palettes_and_white_is_no_0_there() -> None:
    for data in (by_pillow(Image.fromarray(GREY).convert("P")), tiff(GREY, photometric="miniswhite")):
        with pytest.raises(SceneError, match=r"x is a TIFF of (PALETTE|MINISWHITE): a map must hold plain numbers"):
            decode_picture(data, "x", as_numbers=True)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (with_tag(with_tag(tiff(GREY, **BY_TAGS), 256, 60000), 257, 60000), "x has 60000 x 60000 pixels"),
        (with_tag(tiff(GREY, **BY_TAGS), 256, 0), "x has 0 x 47 pixels: at least one is needed"),
        (
            with_tag(with_tag(tiff(np.zeros((4, 4, 300), np.uint8), **RGB_BY_PIXEL), 256, 5000), 257, 5000),
            "x would take 7500 MB of memory: at most 400 MB",
        ),
        (
            with_tag(with_tag(tiff(GREY, tile=(16, 16), compression="zlib"), 322, 65520), 323, 65520),
            "x would take 4293 MB of memory",
        ),
        (tiff(np.zeros((200_000, 1), np.uint8), rowsperstrip=1, **BY_TAGS), "x is a TIFF in 200000 pieces"),
    ],
)
def test_small_files_cannot_ask_for_much(data: bytes, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        decode_picture(data, "x")


@pytest.mark.parametrize("compression", ["jpeg", "lerc", "png"])
def test_a_piece_that_says_it_is_larger_than_its_place_is_not_decoded(compression: str) -> None:
    small, large = (
        tiff(np.zeros((side, side), np.uint8), compression=compression, rowsperstrip=side, **BY_TAGS)
        for side in (16, 8000)
    )
    with tifffile.TiffFile(io.BytesIO(small)) as one, tifffile.TiffFile(io.BytesIO(large)) as other:
        place, count = one.pages.first.tags[273].valueoffset, one.pages.first.tags[279].valueoffset
        piece = large[other.pages.first.dataoffsets[0] :][: other.pages.first.databytecounts[0]]
    out = bytearray(small) + piece
    struct.pack_into("<I", out, place, len(small))
    kind = "<I" if struct.unpack_from("<H", small, count - 6)[0] == 4 else "<H"
    struct.pack_into(kind, out, count, len(piece) if kind == "<I" else min(len(piece), 65535))
    with pytest.raises(SceneError, match="x has a piece of 8000 x 8000 pixels where 16 x 16 belong"):
        decode_picture(bytes(out), "x")


def test_floats_are_linear_light() -> None:
    share = (RGB / 255).astype(np.float32)
    np.testing.assert_array_equal(decode_colour(tiff(share, photometric="rgb"), "x"), share)
    with pytest.raises(SceneError, match="x holds int16 numbers"):
        decode_colour(tiff(GREY.astype(np.int16), **BY_TAGS), "x")
    with pytest.raises(SceneError, match="x holds uint32 numbers"):
        decode_colour(tiff(GREY.astype(np.uint32), **BY_TAGS), "x")


def test_the_channels_that_a_piece_of_lerc_says_it_has_count() -> None:
    data = bytearray(tiff(GREY, compression="lerc", **BY_TAGS))
    at = data.index(b"Lerc2 ")
    struct.pack_into("<i", data, at + 14 + 8, 184549379)
    with pytest.raises(SceneError, match="x has a piece of 11626610877 x 47 pixels where 63 x 47 belong"):
        decode_picture(bytes(data), "x")
