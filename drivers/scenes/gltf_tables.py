"""What the JSON of a glTF 2.0 file may contain, as types: only the keys that a matt surface is made from."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, FailFast
from pydantic.alias_generators import to_camel

from slopegate.drivers.scenes.scene_values import numeric, refuse

_MOST = 1 << 53


def _whole(value: Any) -> int:
    # The specification lets whole numbers be written as 5126.0.
    number = int(value) if isinstance(value, float) and value.is_integer() else value
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number <= _MOST:
        raise refuse(f"a whole number from 0 to {_MOST}")
    return number


def _numbers(count: int | None = None) -> BeforeValidator:
    def check(value: Any) -> list[float]:
        if not isinstance(value, list) or count not in {None, len(value)}:
            raise refuse(f"a list of {count or ''} numbers".replace("  ", " "))
        if not all(type(item) in {int, float} and -1e30 <= item <= 1e30 for item in value):
            raise refuse("a list of finite numbers")
        return [float(item) for item in value]

    return BeforeValidator(check)


Whole = Annotated[int, BeforeValidator(_whole)]
Real = Annotated[float, numeric(-1e30, 1e30, "a finite number")]
Pair = Annotated[list[float], _numbers(2)]
Triplet = Annotated[list[float], _numbers(3)]
Quad = Annotated[list[float], _numbers(4)]
Sixteen = Annotated[list[float], _numbers(16)]
Reals = Annotated[list[float], _numbers()]
Wholes = Annotated[list[Whole], FailFast()]
Names = Annotated[list[str], FailFast()]
Extensions = dict[str, Any]


class GltfPart(BaseModel):
    """A table of a glTF file: keys that are not known here are for others."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, alias_generator=to_camel)
    extensions: Extensions = {}


class GltfAsset(GltfPart):
    """Which glTF it is."""

    version: str
    min_version: str | None = None


class GltfScene(GltfPart):
    """The roots of what is shown together."""

    nodes: Wholes = []


class GltfNode(GltfPart):
    """A place in the scene graph."""

    children: Wholes = []
    mesh: Whole | None = None
    skin: Whole | None = None
    matrix: Sixteen | None = None
    translation: Triplet = [0.0, 0.0, 0.0]
    rotation: Quad = [0.0, 0.0, 0.0, 1.0]
    scale: Triplet = [1.0, 1.0, 1.0]
    weights: Reals | None = None


class GltfPrimitive(GltfPart):
    """Triangles, lines or points of one material."""

    attributes: dict[str, Whole]
    indices: Whole | None = None
    material: Whole | None = None
    mode: Whole = 4
    targets: Annotated[list[dict[str, Whole]], FailFast()] = []


class GltfMesh(GltfPart):
    """A shape of several materials."""

    primitives: Annotated[list[GltfPrimitive], FailFast()]
    weights: Reals = []


class GltfSparseIndices(GltfPart):
    """Which numbers are replaced."""

    buffer_view: Whole
    byte_offset: Whole = 0
    component_type: Whole


class GltfSparseValues(GltfPart):
    """What they are replaced by."""

    buffer_view: Whole
    byte_offset: Whole = 0


class GltfSparse(GltfPart):
    """Numbers that differ from those of the accessor's buffer view."""

    count: Whole
    indices: GltfSparseIndices
    values: GltfSparseValues


class GltfAccessor(GltfPart):
    """An array of numbers or vectors."""

    buffer_view: Whole | None = None
    byte_offset: Whole = 0
    component_type: Whole
    normalized: bool = False
    count: Whole
    type: str
    sparse: GltfSparse | None = None


class GltfView(GltfPart):
    """A stretch of a buffer."""

    buffer: Whole
    byte_offset: Whole = 0
    byte_length: Whole
    byte_stride: Whole | None = None


class GltfBuffer(GltfPart):
    """Bytes inside the file or beside it."""

    uri: str | None = None
    byte_length: Whole


class GltfTextureUse(GltfPart):
    """A texture and the coordinates that it goes by."""

    index: Whole
    tex_coord: Whole = 0


class GltfTextureTransform(GltfPart):
    """KHR_texture_transform of a texture's use."""

    offset: Pair = [0.0, 0.0]
    rotation: Real = 0.0
    scale: Pair = [1.0, 1.0]
    tex_coord: Whole | None = None


class GltfSurface(GltfPart):
    """The colour of a material; the keys of pbrMetallicRoughness."""

    base_color_factor: Quad = [1.0, 1.0, 1.0, 1.0]
    base_color_texture: GltfTextureUse | None = None


class GltfDiffuse(GltfPart):
    """The colour of a material as KHR_materials_pbrSpecularGlossiness has it."""

    diffuse_factor: Quad = [1.0, 1.0, 1.0, 1.0]
    diffuse_texture: GltfTextureUse | None = None


class GltfMaterial(GltfPart):
    """What a surface looks like."""

    pbr_metallic_roughness: GltfSurface = GltfSurface()
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"


class GltfSampler(GltfPart):
    """What lies beyond a texture's edges."""

    wrap_s: Whole = 10497
    wrap_t: Whole = 10497


class GltfTexture(GltfPart):
    """A picture and its sampler."""

    sampler: Whole | None = None
    source: Whole | None = None


class GltfImage(GltfPart):
    """A picture inside the file or beside it."""

    uri: str | None = None
    buffer_view: Whole | None = None


class GltfSkin(GltfPart):
    """The bones that a mesh hangs on."""

    joints: Wholes
    inverse_bind_matrices: Whole | None = None


class GltfInstances(GltfPart):
    """EXT_mesh_gpu_instancing of a node."""

    attributes: dict[str, Whole]


class GltfTable(GltfPart):
    """A whole file."""

    asset: GltfAsset
    extensions_used: Names = []
    extensions_required: Names = []
    scene: Whole | None = None
    scenes: Annotated[list[GltfScene], FailFast()] = []
    nodes: Annotated[list[GltfNode], FailFast()] = []
    meshes: Annotated[list[GltfMesh], FailFast()] = []
    accessors: Annotated[list[GltfAccessor], FailFast()] = []
    buffer_views: Annotated[list[GltfView], FailFast()] = []
    buffers: Annotated[list[GltfBuffer], FailFast()] = []
    materials: Annotated[list[GltfMaterial], FailFast()] = []
    textures: Annotated[list[GltfTexture], FailFast()] = []
    images: Annotated[list[GltfImage], FailFast()] = []
    samplers: Annotated[list[GltfSampler], FailFast()] = []
    skins: Annotated[list[GltfSkin], FailFast()] = []
    animations: list[Any] = []
