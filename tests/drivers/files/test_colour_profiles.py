"""Pictures that say themselves which colours their numbers mean."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_decoding import decode_colour
from slopegate.drivers.files.picture_files import read_raw

RGB = np.random.default_rng(5).integers(0, 256, (12, 20, 3), np.uint8)
ADOBE = imagecodecs.cms_profile("adobergb")
SRGB = imagecodecs.cms_profile("srgb")


def saved(pixels: Any, form: str, **options: Any) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, form, **options)
    return data.getvalue()


def with_chunk(png: bytes, kind: bytes, body: bytes) -> bytes:
    """The PNG with another chunk behind its header."""
    chunk = struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return png[:33] + chunk + png[33:]


def from_adobe(pixels: Any) -> Any:
    """Linear REC 709 of Adobe RGB (1998), by its published primaries and gamma."""
    light = (pixels / np.iinfo(pixels.dtype).max) ** (563 / 256)
    return np.clip(light @ np.array([[1.39836, -0.39836, 0.0], [0.0, 1.0, 0.0], [0.0, -0.04293, 1.04293]]).T, 0, 1)


def tiff(pixels: Any) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, pixels, photometric="rgb", planarconfig="contig", iccprofile=ADOBE)
    return data.getvalue()


def deep_png(pixels: Any) -> bytes:
    plain = cv2.imencode(".png", np.ascontiguousarray(pixels[:, :, ::-1]))[1].tobytes()
    return with_chunk(plain, b"iCCP", b"a\0\0" + zlib.compress(ADOBE))


DEEP = RGB.astype(np.uint16) * 257


@pytest.mark.parametrize(
    ("data", "pixels"),
    [
        (saved(RGB, "PNG", icc_profile=ADOBE), RGB),
        (saved(RGB, "WEBP", icc_profile=ADOBE, lossless=True), RGB),
        (tiff(RGB), RGB),
        (tiff(DEEP), DEEP),
        (deep_png(DEEP), DEEP),
        (saved(RGB[:, :, 0], "PNG", icc_profile=ADOBE), np.repeat(RGB[:, :, :1], 3, axis=2)),
    ],
)
def test_a_profile_is_applied(data: bytes, pixels: Any) -> None:
    off = np.abs(decode_colour(data, "x") - from_adobe(pixels))
    # of 16 bits a table is made, which is coarse where colours leave those of sRGB
    assert off.mean() < 3e-4
    assert off.max() < (3e-3 if pixels.dtype == np.uint8 else 0.02)


def test_a_photo_of_a_phone_is_read_by_its_profile() -> None:
    data = saved(np.full((16, 16, 3), (200, 100, 50), np.uint8), "JPEG", quality=100, icc_profile=ADOBE)
    wanted = from_adobe(np.array([[[200, 100, 50]]], np.uint8))
    np.testing.assert_allclose(decode_colour(data, "x")[8:9, 8:9], wanted, atol=0.02)


def test_what_says_srgb_stays_as_it_is() -> None:
    plain = decode_colour(saved(RGB, "PNG"), "x")
    for data in (
        saved(RGB, "PNG", icc_profile=SRGB),
        with_chunk(saved(RGB, "PNG"), b"gAMA", struct.pack(">I", 45455)),
        with_chunk(with_chunk(saved(RGB, "PNG"), b"gAMA", struct.pack(">I", 100_000)), b"sRGB", b"\0"),
        with_chunk(saved(RGB, "PNG", icc_profile=SRGB), b"gAMA", struct.pack(">I", 100_000)),
    ):
        np.testing.assert_array_equal(decode_colour(data, "x"), plain)


@pytest.mark.parametrize(("gamma", "power"), [(100_000, 1.0), (55_556, 1.8)])
def test_a_gamma_is_honoured_at_8_and_16_bits(gamma: int, power: float) -> None:
    deep = cv2.imencode(".png", np.ascontiguousarray(DEEP[:, :, ::-1]))[1].tobytes()
    for plain in (saved(RGB, "PNG"), deep):
        found = decode_colour(with_chunk(plain, b"gAMA", struct.pack(">I", gamma)), "x")
        np.testing.assert_allclose(found, (RGB / 255) ** power, atol=1e-4)


def test_numbers_and_textures_of_gltf_do_not_follow_it(tmp_path: Path) -> None:
    data = saved(RGB, "PNG", icc_profile=ADOBE)
    (tmp_path / "a.png").write_bytes(data)
    np.testing.assert_array_equal(read_raw(tmp_path / "a.png"), RGB)
    plain = decode_colour(saved(RGB, "PNG"), "x")
    np.testing.assert_array_equal(decode_colour(data, "x", always_srgb=True), plain)


@pytest.mark.parametrize("profile", [ADOBE[:300], b"a" * 400, ADOBE[:16] + b"CMYK" + ADOBE[20:]])
def test_one_that_cannot_be_applied_is_told(profile: bytes) -> None:
    with pytest.raises(SceneError, match="x has a colour profile that cannot be applied: it must be of RGB or grey"):
        decode_colour(saved(RGB, "PNG", icc_profile=profile), "x")
