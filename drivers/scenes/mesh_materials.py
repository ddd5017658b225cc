"""What a mesh file says of its surfaces -> linear albedo or a texture, with v downwards."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from slopegate.core.scene.scene import Image
from slopegate.core.scene.shapes import Finish, Floats
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import MAX_PIXELS, check_pixels, linear_rgb


def file_material(path: Path, part: Any) -> tuple[Finish, Floats | None]:
    """The surface of a trimesh part, and texture coordinates (F, 3, 2) of its faces' corners, v down, or None.

    Colour factors of materials (Kd, baseColorFactor) are linear, pictures and PLY's vertex colours sRGB. Faces whose
    vertices have colours take their mean colour.
    """
    visual = part.visual
    faces = np.asarray(part.faces)
    if visual.kind == "texture":
        uv = getattr(visual, "uv", None)
        places = None
        if uv is not None and len(uv) == len(part.vertices):
            places = np.asarray(uv, np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
        image = _image(visual.material)
        factor = _factor(visual.material)
        if image is None or places is None:
            return Finish((float(factor[0]), float(factor[1]), float(factor[2]))), places
        check_pixels(path, *image.size)
        try:
            pixels = np.asarray(image.convert("RGB"))
        except Exception as error:  # decoders of damaged pictures raise whatever they stumble over
            raise SceneError(f"{path} has a texture that cannot be decoded: it is damaged or cut short") from error
        return Finish(Finish.albedo, linear_rgb(path, pixels) * factor), places
    if visual.kind in {"vertex", "face"}:
        return _coloured(path, visual, faces)
    return Finish(), None


def tiled(path: Path, uv: Floats, texture: Image | None) -> tuple[Floats, Image | None]:
    """The same look-ups in a texture that does not repeat: tiled as often as one face needs; uv (F, 3, 2) follow."""
    if texture is None or (uv.min() >= -1e-6 and uv.max() <= 1 + 1e-6):
        return uv, texture
    if not np.isfinite(uv).all():
        raise SceneError(f"{path} has a texture coordinate that is not finite: every one must be a finite number")
    shifted = uv - np.floor(uv.min(axis=1, keepdims=True))
    across, down = (max(math.ceil(float(shifted[..., k].max()) - 1e-6), 1) for k in (0, 1))
    height, width = texture.shape[:2]
    if across * down * height * width > MAX_PIXELS:
        raise SceneError(f"{path} repeats its texture {across} x {down} times on one face: that is too large a picture")
    return shifted / (across, down), np.tile(texture, (down, across, 1))


def _image(material: Any) -> Any:
    found = getattr(material, "image", None)
    return found if found is not None else getattr(material, "baseColorTexture", None)


def _factor(material: Any) -> NDArray[np.float32]:
    """The linear colour that multiplies the picture, or stands alone."""
    colour = getattr(material, "baseColorFactor", None)
    if colour is None:
        colour = getattr(material, "diffuse", None)
        if colour is not None and _image(material) is not None:
            colour = None  # a picture replaces Kd, as most programs that write OBJ expect
    if colour is None:
        return np.ones(3, np.float32) if _image(material) is not None else np.array(Finish.albedo, np.float32)
    values = np.asarray(colour)
    return (values[:3] / (255 if values.dtype.kind in "ui" else 1)).astype(np.float32).clip(0, 1)


def _coloured(path: Path, visual: Any, faces: NDArray[np.int64]) -> tuple[Finish, Floats | None]:
    """One texel for every face, so that no triangle needs a colour of its own elsewhere."""
    if visual.kind == "vertex":
        codes = np.asarray(visual.vertex_colors)[:, :3][faces]
    else:
        codes = np.asarray(visual.face_colors)[:, None, :3]
    linear = codes / np.float32(255) if path.suffix.lower() == ".glb" else linear_rgb(path, codes.astype(np.uint8))
    colours = linear.mean(axis=1, dtype=np.float32)
    if (colours == colours[0]).all():
        red, green, blue = (float(value) for value in colours[0])
        return Finish((red, green, blue)), None
    width = math.ceil(math.sqrt(len(faces)))
    height = math.ceil(len(faces) / width)
    texture = np.zeros((height * width, 3), np.float32)
    texture[: len(faces)] = colours
    index = np.arange(len(faces))
    places = np.stack([(index % width + 0.5) / width, (index // width + 0.5) / height], axis=-1)
    return Finish(Finish.albedo, texture.reshape(height, width, 3)), np.repeat(places[:, None], 3, axis=1)
