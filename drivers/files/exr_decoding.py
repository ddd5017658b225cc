"""Reads OpenEXR files: which of their channels is depth, and which are a picture's colours, is decided by their names.

Several parts are one file whose channels begin with the part's name. Alpha is never either. What is not clear is
refused with the names that there are.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_checks import check_decoded, check_pixels, damaged
from slopegate.drivers.files.reading import decoding

Planes = dict[str, NDArray[Any]]

MAX_EXR_BYTES: Final = 1_000_000_000
"""Of all channels together: renderers put dozens into one file."""
_MAGIC: Final = b"v/1\x01"
_ALPHA: Final = {"a", "alpha", "ar", "ag", "ab"}
_MAIN_LAYERS: Final = ("combined", "beauty", "rgba", "rgb")
_SHOWN: Final = 12
_NAMED, _CALLED_Z, _ALONE = 2, 1, 0
"""How clear it is that a channel is depth: by the word, by Z, or because there is nothing else."""


def read_exr_depth(data: bytes, source: Path | str) -> NDArray[Any]:
    """The depth in a file (h, w): the channel Z or depth, of a layer depth, or the only one that is there.

    Red, green and blue that agree everywhere count as one. Raises SceneError, also for what is not clear.
    """
    planes = _planes(data, source)
    layers = _layers(planes)
    found: dict[str, int] = {}
    for layer, names in layers.items():
        name, clear = _depth_of(layer, names, planes)
        if name and (clear > _ALONE or len(layers) == 1):
            found[name] = clear
    best = [name for name, clear in found.items() if clear == max(found.values())]
    if not best or any(not np.array_equal(planes[best[0]], planes[name], equal_nan=True) for name in best[1:]):
        raise SceneError(
            f"{source} does not say which of its channels is depth: one must be called Z or depth, and it has"
            f" {_listed(planes)}"
        )
    return planes[best[0]]


def read_exr_picture(data: bytes, source: Path | str) -> NDArray[Any]:
    """The picture in a file: (h, w, 3) red, green and blue, or (h, w) where it has only one channel or luminance.

    Of several layers the one without a name, or that is called combined, beauty, RGB or RGBA. Raises SceneError, also
    for what is not clear.
    """
    planes = _planes(data, source)
    layers = _layers(planes)
    coloured = {layer: names for layer, names in layers.items() if {"r", "g", "b"} <= names.keys()}
    if len(coloured) > 1 and "" not in coloured:
        coloured = {layer: names for layer, names in coloured.items() if _last(layer).lower() in _MAIN_LAYERS}
    chosen = coloured.get("") or (next(iter(coloured.values())) if len(coloured) == 1 else None)
    if chosen is not None:
        return np.stack([planes[chosen[name]] for name in "rgb"], axis=2)
    bright = [names["y"] for names in layers.values() if "y" in names and "x" not in names]
    alone = [name for names in layers.values() for name in names.values()]
    if len(bright) == 1 or len(alone) == 1:
        return planes[(bright if len(bright) == 1 else alone)[0]]
    raise SceneError(
        f"{source} does not say which of its channels are the picture: R, G and B of one layer are needed, and it has"
        f" {_listed(planes)}"
    )


def _planes(data: bytes, source: Path | str) -> Planes:
    """Every channel by its full name, (h, w) of the file's display window, 0 where there are no data."""
    import OpenEXR

    if not data.startswith(_MAGIC):
        raise damaged(source)
    with decoding(damaged(source)), redirect_stdout(io.StringIO()):  # where it tells of what it cannot read
        with OpenEXR.File(io.BytesIO(data), separate_channels=True, header_only=True) as file:
            _check(file, source)
            promised = len(file.parts)
        planes: Planes = {}
        with OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            if len(file.parts) != promised:  # a part that cannot be read is left out
                raise damaged(source)
            for part in file.parts:
                prefix = f"{part.name()}." if len(file.parts) > 1 else ""
                window, display = part.header["dataWindow"], part.header["displayWindow"]
                for name, channel in part.channels.items():
                    full = name if name.startswith(prefix) else prefix + name
                    planes[full] = _placed(np.asarray(channel.pixels), window, display)
    return planes


def _check(file: Any, source: Path | str) -> None:
    """Refuse by the headers what cannot be read, or would take too much memory."""
    size_bytes = 0
    for part in file.parts:
        header = part.header
        kind = str(header["type"]).rpartition(".")[2]
        if kind not in {"scanlineimage", "tiledimage"}:
            raise SceneError(f"{source} is an OpenEXR file of kind {kind}: it must be of scan lines or tiles")
        for window in (header["dataWindow"], header["displayWindow"]):
            width, height = (int(high) - int(low) + 1 for low, high in zip(*window, strict=True))
            check_pixels(source, width, height)
            size_bytes += 4 * width * height * len(header["channels"])
        for channel in header["channels"]:
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise SceneError(
                    f"{source} has the channel {shown(channel.name)} only at every {channel.xSampling} x"
                    f" {channel.ySampling} pixels: every pixel must have its own value"
                )
    check_decoded(source, size_bytes, MAX_EXR_BYTES)


def _placed(pixels: NDArray[Any], window: Any, display: Any) -> NDArray[Any]:
    """The pixels of the data window where they lie in the display window."""
    if all((own == wanted).all() for own, wanted in zip(window, display, strict=True)):
        return pixels
    (left, top), (right, bottom) = ((int(x), int(y)) for x, y in display)
    whole = np.zeros((bottom - top + 1, right - left + 1), pixels.dtype)
    shift_x, shift_y = int(window[0][0]) - left, int(window[0][1]) - top
    height, width = pixels.shape
    rows = slice(max(shift_y, 0), max(min(shift_y + height, whole.shape[0]), 0))
    columns = slice(max(shift_x, 0), max(min(shift_x + width, whole.shape[1]), 0))
    target = whole[rows, columns]
    if target.size:
        from_row, from_column = rows.start - shift_y, columns.start - shift_x
        target[:] = pixels[from_row : from_row + target.shape[0], from_column : from_column + target.shape[1]]
    return whole


def _layers(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """For each layer the full names of its channels, by their own name in small letters; alpha is left out."""
    layers: dict[str, dict[str, str]] = {}
    for full in sorted(names):
        layer, _, name = full.rpartition(".")
        if name.lower() not in _ALPHA:
            layers.setdefault(layer, {})[name.lower()] = full
    return layers


def _depth_of(layer: str, names: dict[str, str], planes: Planes) -> tuple[str, int]:
    """The channel of a layer that is depth, empty for none, and how clear that is."""
    if _last(layer).lower() == "mist":  # which is no distance, though called Z
        return "", _ALONE
    called = [full for name, full in names.items() if name.startswith(("depth", "zdepth"))]
    if len(called) == 1:
        return called[0], _NAMED
    about_depth = "depth" in layer.lower()
    if "z" in names and "x" not in names:  # else they are a vector's
        return names["z"], _NAMED if about_depth else _CALLED_Z
    alike = set(names) == {"r", "g", "b"} and all(
        np.array_equal(planes[names["r"]], planes[names[name]], equal_nan=True) for name in "gb"
    )
    if len(names) == 1 or alike:
        return names["r"] if alike else min(names.values()), _NAMED if about_depth else _ALONE
    return "", _ALONE


def _last(layer: str) -> str:
    return layer.rpartition(".")[2]


def _listed(names: Iterable[str]) -> str:
    known = [shown(name) for name in sorted(names)]
    more = f" and {len(known) - _SHOWN} more" if len(known) > _SHOWN else ""
    return ", ".join(known[:_SHOWN]) + more
