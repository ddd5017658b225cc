"""The settings inside an image file, read as other programs read them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import OpenEXR
import tifffile
from PIL import Image


def read_settings(path: Path) -> dict[str, Any]:
    """The JSON object in a TIFF, PNG or EXR file."""
    return dict(json.loads(_text(path)))


def _text(path: Path) -> str:
    if path.suffix == ".exr":
        with OpenEXR.File(str(path), header_only=True) as image:
            return str(image.header()["slopegate"])
    if path.suffix == ".png":
        with Image.open(path) as picture:
            return str(picture.text["slopegate"])
    with tifffile.TiffFile(path) as tiff:
        return str(tiff.pages.first.description)
