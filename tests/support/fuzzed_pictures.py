"""Small pictures and maps of every format that is read, and of every way to write one, to be damaged."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import imagecodecs
import numpy as np
import OpenEXR
import tifffile
from PIL import Image, PngImagePlugin

RGB = cv2.resize(np.random.default_rng(3).integers(0, 256, (6, 9, 3), np.uint8), (40, 30))
GREY = RGB[:, :, 0]
DEEP = GREY.astype(np.uint16) * 200
LIGHT = GREY.astype(np.float32) / 255
RGBA = np.dstack([RGB, GREY])
ADOBE = imagecodecs.cms_profile("adobergb")
CONTIG: Any = {"photometric": "rgb", "planarconfig": "contig"}


def _pillow(pixels: Any, form: str, mode: str = "", **options: Any) -> bytes:
    data = io.BytesIO()
    image = Image.fromarray(pixels)
    (image.convert(mode) if mode else image).save(data, form, **options)
    return data.getvalue()


def _tiff(pixels: Any, **options: Any) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, pixels, **({"photometric": "minisblack"} | options))
    return data.getvalue()


def _exr(channels: dict[str, Any], **header: Any) -> bytes:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        with OpenEXR.File(header, channels) as file:
            file.write(str(path))
        return path.read_bytes()


def _npy(array: Any) -> bytes:
    data = io.BytesIO()
    np.save(data, array)
    return data.getvalue()


def _commented() -> bytes:
    notes = PngImagePlugin.PngInfo()
    notes.add_text("title", "a" * 50, zip=True)
    return _pillow(RGB, "PNG", pnginfo=notes)


def _pfm(order: str) -> bytes:
    return b"Pf\n# made\n40 30\n%s\n" % (b"-1.0" if order == "<" else b"1.0") + LIGHT.astype(f"{order}f4").tobytes()


SEEDS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "png grey": (".png", lambda: _pillow(GREY, "PNG")),
    "png bits": (".png", lambda: _pillow(GREY, "PNG", "1")),
    "png palette": (".png", lambda: _pillow(RGB, "PNG", "P", transparency=3)),
    "png alpha": (".png", lambda: _pillow(RGBA, "PNG")),
    "png deep": (".png", cv2.imencode(".png", np.dstack([DEEP] * 3))[1].tobytes),
    "png text": (".png", _commented),
    "png profile": (".png", lambda: _pillow(RGB, "PNG", icc_profile=ADOBE)),
    "tiff profile": (".tif", lambda: _tiff(RGB, iccprofile=ADOBE, **CONTIG)),
    "jpeg profile": (".jpg", lambda: _pillow(RGB, "JPEG", icc_profile=ADOBE)),
    "jpeg": (".jpg", lambda: _pillow(RGB, "JPEG")),
    "jpeg progressive": (".jpg", lambda: _pillow(RGB, "JPEG", progressive=True)),
    "jpeg cmyk": (".jpg", lambda: _pillow(RGB, "JPEG", "CMYK")),
    "webp": (".webp", lambda: _pillow(RGB, "WEBP")),
    "webp lossless": (".webp", lambda: _pillow(RGBA, "WEBP", lossless=True)),
    "bmp": (".bmp", lambda: _pillow(RGB, "BMP")),
    "gif": (".bmp", lambda: _pillow(RGB, "GIF")),
    "tga": (".bmp", lambda: _pillow(RGB, "TGA", compression="tga_rle")),
    "ppm": (".bmp", lambda: _pillow(RGB, "PPM")),
    "jpeg 2000": (".bmp", lambda: _pillow(RGB, "JPEG2000")),
    "dds": (".bmp", lambda: _pillow(RGB, "DDS")),
    "tiff deep": (".tif", lambda: _tiff(DEEP)),
    "tiff float": (".tif", lambda: _tiff(LIGHT, compression="zlib", predictor=True)),
    "tiff big": (".tif", lambda: _tiff(RGB, bigtiff=True, **CONTIG)),
    "tiff swapped": (".tif", lambda: _tiff(DEEP, byteorder=">")),
    "tiff tiles": (".tif", lambda: _tiff(RGB, tile=(16, 16), compression="lzw", **CONTIG)),
    "tiff planes": (".tif", lambda: _tiff(RGB.transpose(2, 0, 1), photometric="rgb", planarconfig="separate")),
    "tiff palette": (".tif", lambda: _pillow(RGB, "TIFF", "P")),
    "tiff cmyk": (".tif", lambda: _pillow(RGB, "TIFF", "CMYK")),
    "tiff fax": (".tif", lambda: _pillow(GREY, "TIFF", "1", compression="group4")),
    **{
        f"tiff {name}": (".tif", lambda name=name: _tiff(RGB, compression=name, **CONTIG))  # type: ignore[misc]
        for name in ("jpeg", "packbits", "lzma", "zstd", "lerc", "png", "webp")
    },
    "exr colours": (".exr", lambda: _exr({name: LIGHT for name in "RGB"})),
    "exr deep layers": (".exr", lambda: _exr({"depth.Z": LIGHT, "R": LIGHT, "A": LIGHT})),
    **{
        f"exr {name}": (".exr", lambda code=code: _exr({"Z": LIGHT}, compression=code))  # type: ignore[misc]
        for name, code in (
            ("none", OpenEXR.NO_COMPRESSION),
            ("rle", OpenEXR.RLE_COMPRESSION),
            ("piz", OpenEXR.PIZ_COMPRESSION),
            ("pxr24", OpenEXR.PXR24_COMPRESSION),
            ("b44", OpenEXR.B44_COMPRESSION),
            ("dwaa", OpenEXR.DWAA_COMPRESSION),
        )
    },
    "pfm little": (".pfm", lambda: _pfm("<")),
    "pfm big": (".pfm", lambda: _pfm(">")),
    "npy": (".npy", lambda: _npy(LIGHT)),
    "npy whole": (".npy", lambda: _npy(np.asfortranarray(DEEP))),
}
"""By name: the suffix it is read with, and what makes its bytes."""
