import io
import struct
import zlib
from typing import Any

import cv2
import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_decoding import decode_colour, decode_picture

NOISE = np.random.default_rng(3)
GREY16 = NOISE.integers(0, 65536, (5, 7), np.uint16)
RGB16 = NOISE.integers(0, 65536, (5, 7, 3), np.uint16)
RGB8 = NOISE.integers(0, 256, (5, 7, 3), np.uint8)
ALPHA8 = NOISE.integers(0, 256, (5, 7), np.uint8)


def by_opencv(pixels: np.ndarray, suffix: str, *options: int) -> bytes:
    return bytes(cv2.imencode(suffix, pixels[..., ::-1] if pixels.ndim == 3 else pixels, options)[1])


def by_pillow(image: Image.Image, kind: str, **options: Any) -> bytes:
    data = io.BytesIO()
    image.save(data, kind, **options)
    return data.getvalue()


def by_tifffile(pixels: np.ndarray, **options: Any) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, pixels, **options)
    return data.getvalue()


def linear(srgb: np.ndarray, white: float) -> np.ndarray:
    share = srgb / white
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (by_opencv(GREY16, ".png"), GREY16),
        (by_opencv(RGB16, ".png"), RGB16),
        (imagecodecs.png_encode(np.dstack([GREY16, GREY16])), GREY16),
        (by_pillow(Image.fromarray(GREY16), "PNG"), GREY16),
        (by_opencv(GREY16, ".tif"), GREY16),
        (by_opencv(RGB16, ".tif"), RGB16),
        (by_opencv(GREY16, ".pgm"), GREY16),
    ],
)
def test_no_bit_of_16_is_lost(data: bytes, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(decode_picture(data, "x").values, expected)
    colour = decode_colour(data, "x")
    wanted = linear(expected, 65535)
    np.testing.assert_allclose(colour, np.dstack([wanted] * 3) if wanted.ndim == 2 else wanted, atol=1e-6)


@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("grey", [False, True])
def test_alpha_comes_beside_the_colours(deep: bool, grey: bool) -> None:
    times = 257 if deep else 1
    rgb, alpha = RGB8.astype(np.uint16) * times, ALPHA8.astype(np.uint16) * times
    pixels = np.dstack([rgb[:, :, :1] if grey else rgb, alpha]).astype(np.uint16 if deep else np.uint8)
    picture = decode_picture(imagecodecs.png_encode(pixels), "x")
    np.testing.assert_array_equal(picture.values, rgb[:, :, 0] if grey else rgb)
    assert picture.opacity is not None
    np.testing.assert_allclose(picture.opacity, ALPHA8 / 255, atol=1e-6)
    assert decode_picture(by_pillow(Image.fromarray(RGB8), "PNG"), "x").opacity is None


def test_a_palette_becomes_its_colours_and_may_have_a_transparent_entry() -> None:
    image = Image.fromarray(np.array([[0, 1], [2, 1]], np.uint8), "P")
    image.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 255])
    for kind in ("PNG", "GIF", "BMP"):
        picture = decode_picture(by_pillow(image, kind), "x")
        np.testing.assert_array_equal(picture.values[1], [[0, 0, 255], [0, 255, 0]], err_msg=kind)
    for kind in ("PNG", "GIF"):
        picture = decode_picture(by_pillow(image, kind, transparency=1), "x")
        assert picture.opacity is not None
        np.testing.assert_array_equal(picture.opacity, [[1, 0], [1, 0]], err_msg=kind)
        np.testing.assert_array_equal(picture.values[0, 0], [255, 0, 0])


def test_photos_of_cmyk_and_with_an_orientation_come_as_they_are_seen() -> None:
    cmyk = Image.fromarray(RGB8).resize((64, 48)).convert("CMYK")
    data = by_pillow(cmyk, "JPEG", quality=95)
    seen = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    np.testing.assert_array_equal(decode_picture(data, "x").values, seen)
    assert abs(seen.mean() - np.asarray(cmyk.convert("RGB")).mean()) < 5
    exif = Image.Exif()
    exif[0x0112] = 6
    for kind, pixels in (("PNG", RGB8), ("PNG", GREY16), ("TIFF", RGB8)):
        data = by_pillow(Image.fromarray(pixels), kind, exif=exif)
        upright = decode_picture(data, "x", turn_upright=True).values
        np.testing.assert_array_equal(upright, np.rot90(pixels, -1), err_msg=kind)
        np.testing.assert_array_equal(decode_picture(data, "x").values, pixels)


@pytest.mark.parametrize("kind", ["GIF", "WEBP", "PNG"])
def test_an_animation_is_no_picture(kind: str) -> None:
    frames = [Image.fromarray(RGB8), Image.fromarray(255 - RGB8)]
    data = by_pillow(frames[0], kind, save_all=True, append_images=frames[1:])
    with pytest.raises(SceneError, match="x is an animation of 2 pictures: a single picture is needed"):
        decode_picture(data, "x")


def test_maps_are_whole_numbers_of_8_or_16_bits_without_loss() -> None:
    for data, sentence in (
        (by_pillow(Image.fromarray(RGB8[..., 0]).convert("1"), "PNG"), "x is a PNG of 1 bits: a map must have 8 or 16"),
        (by_pillow(Image.fromarray(RGB8[..., 0]), "JPEG"), "x cannot be decoded"),
    ):
        with pytest.raises(SceneError, match=sentence):
            decode_picture(data, "x", as_numbers=True)


def test_a_file_that_is_another_kind_than_it_says_is_read_by_its_bytes_or_refused() -> None:
    np.testing.assert_array_equal(decode_picture(by_pillow(Image.fromarray(RGB8), "TGA"), "x.png").values, RGB8)
    for data in (b"%!PS-Adobe-3.0 EPSF-3.0\n", b"hello", b"\x89PNG\r\n\x1a\n", b"II*\0", b"RIFF1234WEBP"):
        with pytest.raises(SceneError, match=r"^x.png cannot be decoded: it is damaged, cut short, or of a kind"):
            decode_picture(data, "x.png")


def test_a_damaged_deep_png_leaves_no_log_line(caplog: pytest.LogCaptureFixture) -> None:
    def chunk(kind: bytes, body: bytes, more: int = 0) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body) ^ more)

    packed = bytearray(zlib.compress((b"\0" + bytes(range(12))) * 3))
    packed[-5] ^= 0x55  # the end of the stream, of which the library would log a warning
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 3, 16, 2, 0, 0, 0))
    data = b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", bytes(packed), 1) + chunk(b"IEND", b"")
    with pytest.raises(SceneError, match=r"thing\.png cannot be decoded"):
        decode_colour(data, "thing.png")
    assert caplog.records == []


def test_a_jpeg_of_very_many_scans_is_refused_before_it_is_decoded() -> None:
    """A few kB that would keep the decoder busy for minutes."""
    whole = by_pillow(Image.fromarray(np.full((1000, 1000, 3), 128, np.uint8)), "JPEG", progressive=True)
    end, last = whole.rindex(b"\xff\xd9"), whole.rindex(b"\xff\xda")
    endless = whole[:end] + whole[last:end] * 1000 + whole[end:]
    assert len(endless) < 30_000
    scans = whole.count(b"\xff\xda") + 1000
    refused = f"x is a JPEG of {scans} scans over 1 megapixels: at most 1000 scans are allowed for its size"
    strip = io.BytesIO()
    with tifffile.TiffWriter(strip) as writer:
        options: Any = {"compression": "jpeg", "photometric": "ycbcr", "rowsperstrip": 1000}
        writer.write(iter([endless]), shape=(1000, 1000, 3), dtype=np.uint8, **options)
    for data in (endless, strip.getvalue()):
        with pytest.raises(SceneError) as error:
            decode_picture(data, "x")
        assert str(error.value) == refused
    assert decode_picture(whole, "x").values.shape == (1000, 1000, 3)
