"""Reads glTF 2.0 files (.glb, .gltf): the triangles of their default scene, as parts with one surface each.

What a file requires and is not done here is refused by name; what it merely uses and is not done is remarked. Surfaces
are matt and seen from both sides, so metal, roughness, normal maps, occlusion, emission and lights change nothing.
Everything stands in its rest pose: skins hang on the bones as the nodes place them, morph targets have the weights that
the file gives them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.picture_decoding import decode_colour
from slopegate.drivers.scenes.gltf_data import GltfData
from slopegate.drivers.scenes.gltf_tables import (
    GltfDiffuse,
    GltfInstances,
    GltfMaterial,
    GltfMesh,
    GltfNode,
    GltfPrimitive,
    GltfTexture,
    GltfTextureTransform,
    GltfTextureUse,
)
from slopegate.drivers.scenes.mesh_parts import MAX_TRIANGLES, MeshFile, MeshPart, Wrap
from slopegate.drivers.scenes.mesh_surfaces import MAX_TEXELS
from slopegate.drivers.scenes.scene_toml import Table, checked

MAX_PARTS: Final = 20_000
MAX_NODES: Final = 100_000
MAX_MOVES: Final = 100_000_000
"""Of vertices by morph targets."""

_DONE = {
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}
# Not done, but where a file only uses them it brings what stands in for them, or they change nothing of a matt surface.
_NOT_MISSED = {
    "EXT_mesh_features",
    "EXT_meshopt_compression",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_texture_dds",
}
_INSTEAD = {
    "KHR_draco_mesh_compression": "save it without compression",
    "EXT_meshopt_compression": "save it without compression",
    "KHR_meshopt_compression": "save it without compression",
    "KHR_texture_basisu": "save it with PNG or JPEG textures",
}
_WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_PICTURES = (b"\x89PNG", b"\xff\xd8\xff", b"RIFF")


def read_gltf(path: Path, data: bytes) -> MeshFile:
    """The parts of the default scene in the file's own axes, y up; nodes that show the same mesh share its arrays.

    Raises SceneError, one sentence, for a file that is damaged, asks for too much, or requires what is not done here.
    """
    gltf = GltfData(path, data)
    missing = [name for name in gltf.table.extensions_required if name not in _DONE]
    if missing:
        advice = next((f": {_INSTEAD[name]}" for name in missing if name in _INSTEAD), "")
        raise gltf.refusal(f"it requires the glTF extension {_names(missing)}, which is not read{advice}")
    # Numbers of any size may come out of a file; those that are not finite are refused where meshes are made.
    with np.errstate(all="ignore"):
        return _SceneParts(gltf).file()


def _names(extensions: list[str]) -> str:
    """The first few, fit to be shown."""
    return ", ".join(shown(name)[1:-1] for name in dict.fromkeys(extensions[:5]))


class _SceneParts:
    """The parts of one file; primitives and pictures are read once, however many nodes show them."""

    def __init__(self, gltf: GltfData) -> None:
        self._gltf, self._table = gltf, gltf.table
        self._remarks: dict[str, None] = {}
        self._worlds: dict[int, Doubles] = {}
        self._parts: dict[tuple[int, int], MeshPart] = {}
        self._pictures: dict[int, Singles] = {}
        self._bones: dict[int, list[Doubles]] = {}
        self._texels = self._moves = 0

    def file(self) -> MeshFile:
        used = [name for name in self._table.extensions_used if name not in _DONE | _NOT_MISSED]
        if used:
            self._remark(f"what the glTF extension {_names(used)} adds is left out")
        if self._table.animations:
            self._remark("its animations are left out: it stands in its rest pose")
        shown_nodes = self._shown_nodes()
        self._check_count(shown_nodes)
        parts = [part for node, world in shown_nodes for part in self._of_node(node, world)]
        return MeshFile(tuple(parts), tuple(self._remarks))

    def _remark(self, clause: str) -> None:
        self._remarks[clause] = None

    # The scene graph.

    def _shown_nodes(self) -> list[tuple[int, Doubles]]:
        """Every node of the default scene that shows a mesh, with its place (4, 4)."""
        nodes = self._table.nodes
        if len(nodes) > MAX_NODES:
            raise self._gltf.refusal(f"it has {len(nodes)} nodes: at most {MAX_NODES} are allowed")
        parents: dict[int, int] = {}
        for index, node in enumerate(nodes):
            for child in node.children:
                self._gltf.entry(nodes, child, "nodes", f"nodes[{index}].children")
                if child in parents:
                    raise self._gltf.refusal(f"nodes[{child}] is a child of two nodes: each may have one parent")
                parents[child] = index
        found: list[tuple[int, Doubles]] = []
        seen: set[int] = set()
        waiting = [(root, np.eye(4)) for root in reversed(self._roots(parents))]
        while waiting:  # no recursion: a file may nest its nodes as deep as it likes
            index, parent = waiting.pop()
            if index in seen:
                raise self._gltf.refusal(f"nodes[{index}] is shown twice, or within itself: nodes must form a tree")
            seen.add(index)
            node = nodes[index]
            world = self._worlds[index] = parent @ _local(node)
            waiting += [(child, world) for child in reversed(node.children)]
            if node.mesh is not None:
                self._gltf.entry(self._table.meshes, node.mesh, "meshes", f"nodes[{index}].mesh")
                found.append((index, world))
        return found

    def _roots(self, parents: dict[int, int]) -> list[int]:
        scenes, chosen = self._table.scenes, self._table.scene or 0
        if not scenes:
            return [index for index in range(len(self._table.nodes)) if index not in parents]
        scene = self._gltf.entry(scenes, chosen, "scenes", "scene")
        if len(scenes) > 1:
            self._remark(f"of its {len(scenes)} scenes only scenes[{chosen}] is shown")
        for root in scene.nodes:
            self._gltf.entry(self._table.nodes, root, "nodes", f"scenes[{chosen}].nodes")
        return scene.nodes

    def _check_count(self, shown_nodes: list[tuple[int, Doubles]]) -> None:
        """Refuse too many parts or triangles before any array is read."""
        parts = triangles = 0
        counts: dict[int, int] = {}
        for index, _ in shown_nodes:
            mesh = self._mesh_of(index)
            number = self._table.nodes[index].mesh or 0
            if number not in counts:
                counts[number] = sum(
                    self._count(primitive, f"meshes[{number}].primitives[{k}]")
                    for k, primitive in enumerate(mesh.primitives)
                )
            copies = self._copies(index)
            parts += copies * len(mesh.primitives)
            triangles += copies * counts[number]
        if triangles > MAX_TRIANGLES:
            raise self._gltf.refusal(f"it has {triangles} triangles: at most {MAX_TRIANGLES} are allowed")
        if parts > MAX_PARTS:
            raise self._gltf.refusal(f"it has {parts} parts: at most {MAX_PARTS} are allowed")

    def _count(self, primitive: GltfPrimitive, where: str) -> int:
        if primitive.mode < _TRIANGLES:
            return 0
        index, name, kind = primitive.indices, "indices", "SCALAR"
        if index is None:
            index, name, kind = primitive.attributes.get("POSITION"), "attributes.POSITION", "VEC3"
        if index is None:
            return 0
        count = self._gltf.accessor(index, f"{where}.{name}", (kind,)).count
        return count // 3 if primitive.mode == _TRIANGLES else max(count - 2, 0)

    def _mesh_of(self, node: int) -> GltfMesh:
        return self._table.meshes[self._table.nodes[node].mesh or 0]

    # Copies.

    def _instances(self, node: int) -> dict[str, int] | None:
        given = self._table.nodes[node].extensions.get("EXT_mesh_gpu_instancing")
        if given is None:
            return None
        where = f"nodes[{node}].extensions.EXT_mesh_gpu_instancing"
        attributes = self._extension(GltfInstances, given, where).attributes
        return {name: index for name, index in attributes.items() if not name.startswith("_")}

    def _copies(self, node: int) -> int:
        attributes = self._instances(node)
        if not attributes:
            return 1
        where = f"nodes[{node}].extensions.EXT_mesh_gpu_instancing.attributes"
        counts = {
            name: self._gltf.accessor(index, f"{where}.{name}", ("VEC3", "VEC4")).count
            for name, index in attributes.items()
        }
        if len(set(counts.values())) > 1:
            raise self._gltf.refusal(f"{where} have {shown(counts)} entries: all must have equally many")
        return next(iter(counts.values()))

    def _places(self, node: int, world: Doubles) -> Iterator[Doubles]:
        attributes = self._instances(node)
        if not attributes:
            yield world
            return
        where, count = f"nodes[{node}].extensions.EXT_mesh_gpu_instancing.attributes", self._copies(node)
        columns = []
        for name, rest in (("TRANSLATION", (0, 0, 0)), ("ROTATION", (0, 0, 0, 1)), ("SCALE", (1, 1, 1))):
            if name in attributes:
                kind = "VEC4" if name == "ROTATION" else "VEC3"
                columns.append(self._gltf.array(attributes[name], f"{where}.{name}", (kind,)).astype(np.float64))
            else:
                columns.append(np.tile(np.array(rest, np.float64), (count, 1)))
        for translation, rotation, scale in zip(*(column.tolist() for column in columns), strict=True):
            yield world @ _placed(translation, rotation, scale)

    # What a node shows.

    def _of_node(self, index: int, world: Doubles) -> Iterator[MeshPart]:
        node = self._table.nodes[index]
        number = node.mesh or 0
        placed: list[Doubles] | None = None
        for k, primitive in enumerate(self._mesh_of(index).primitives):
            where = f"meshes[{number}].primitives[{k}]"
            if primitive.mode not in {_TRIANGLES, _STRIP, _FAN}:
                if primitive.mode > _FAN:
                    raise self._gltf.refusal(f"{where}.mode is {primitive.mode}: it must be 0 to 6")
                self._remark("its points and lines are left out")
                continue
            if "POSITION" not in primitive.attributes:
                self._remark(f"{where} is left out: it has no POSITION")
                continue
            skinned = node.skin is not None and "JOINTS_0" in primitive.attributes
            own = skinned or (primitive.targets and node.weights is not None)
            key = None if own else (number, k)
            part = None if key is None else self._parts.get(key)
            if part is None:
                part = self._part(primitive, where, node)
                if key is not None:
                    self._parts[key] = part
            if skinned:
                yield part
                continue
            if placed is None:
                placed = list(self._places(index, world))
            yield from (replace(part, transform=place, shared=key) for place in placed)

    def _part(self, primitive: GltfPrimitive, where: str, node: GltfNode) -> MeshPart:
        """The primitive with its surface, in the node's axes, or in the file's if it is skinned."""
        if "KHR_draco_mesh_compression" in primitive.extensions:
            index = primitive.attributes["POSITION"]
            if self._gltf.accessor(index, f"{where}.attributes.POSITION", ("VEC3",)).buffer_view is None:
                raise self._gltf.refusal(f"{where} is compressed by KHR_draco_mesh_compression, which is not read")
        points = self._gltf.array(primitive.attributes["POSITION"], f"{where}.attributes.POSITION", ("VEC3",))
        faces = self._faces(primitive, where, len(points))
        # Many primitives may share one long array of vertices: each takes those that it uses.
        used, corners = np.unique(faces, return_inverse=True)
        corners = corners.reshape(-1, 3)
        vertices = points[used].astype(np.float64)
        mesh = self._table.meshes[node.mesh or 0]
        weights = mesh.weights if node.weights is None else node.weights
        for k, (target, weight) in enumerate(zip(primitive.targets, weights, strict=False)):
            if weight and "POSITION" in target:
                self._moves += len(used)
                if self._moves > MAX_MOVES:
                    raise self._gltf.refusal(f"its morph targets move more than {MAX_MOVES} vertices: that is too much")
                name = f"{where}.targets[{k}].POSITION"
                vertices += weight * self._per_vertex(target["POSITION"], name, ("VEC3",), len(points))[used]
            if weight and any(key.startswith(("TEXCOORD", "COLOR")) for key in target):
                self._remark("colours and texture coordinates of its morph targets are left out")
        if node.skin is not None and "JOINTS_0" in primitive.attributes:
            vertices = self._skinned(primitive, where, node.skin, vertices, used, len(points))
        part = MeshPart(vertices, corners)
        colours = primitive.attributes.get("COLOR_0")
        if colours is not None:
            values = self._per_vertex(colours, f"{where}.attributes.COLOR_0", ("VEC3", "VEC4"), len(points))
            part = replace(part, colours=values[used, :3].astype(np.float32)[corners])
        return self._painted(part, primitive, where, used, len(points))

    def _per_vertex(self, index: int, where: str, types: tuple[str, ...], count: int) -> Any:
        values = self._gltf.array(index, where, types)
        if len(values) != count:
            raise self._gltf.refusal(f"{where} has {len(values)} entries: POSITION has {count}")
        return values

    def _faces(self, primitive: GltfPrimitive, where: str, vertices: int) -> Indices:
        if primitive.indices is None:
            corners = np.arange(vertices)
        else:
            found = self._gltf.array(primitive.indices, f"{where}.indices", ("SCALAR",))
            if found.dtype.kind != "u":
                raise self._gltf.refusal(f"{where}.indices are no whole numbers of at least 0: they must be")
            corners = found.ravel().astype(np.int64)
            if len(corners) and corners.max() >= vertices:
                raise self._gltf.refusal(f"{where}.indices has {corners.max()}: it has {vertices} vertices")
        if primitive.mode == _TRIANGLES:
            if len(corners) % 3:
                raise self._gltf.refusal(f"{where} has {len(corners)} corners of triangles: it must be a multiple of 3")
            return corners.reshape(-1, 3)
        at = np.arange(max(len(corners) - 2, 0))
        odd = at % 2
        places = [at, at + 1 + odd, at + 2 - odd] if primitive.mode == _STRIP else [at + 1, at + 2, np.zeros_like(at)]
        return corners[np.stack(places, axis=1)] if len(at) else np.zeros((0, 3), np.int64)

    def _skinned(
        self, primitive: GltfPrimitive, where: str, skin: int, vertices: Doubles, used: Indices, count: int
    ) -> Doubles:
        """Vertices in the file's axes, each moved as its bones are; the node's own place does not matter then."""
        bones = self._bones_of(skin)
        moved, total = np.zeros_like(vertices), np.zeros((len(vertices), 1))
        for k in range(len(primitive.attributes)):
            if f"JOINTS_{k}" not in primitive.attributes:
                break
            if f"WEIGHTS_{k}" not in primitive.attributes:
                raise self._gltf.refusal(f"{where} has JOINTS_{k} without WEIGHTS_{k}")
            joints, weights = (
                self._per_vertex(
                    primitive.attributes[f"{name}_{k}"], f"{where}.attributes.{name}_{k}", ("VEC4",), count
                )
                for name in ("JOINTS", "WEIGHTS")
            )
            for joint, weight in zip(joints[used].T.astype(np.int64), weights[used].T.astype(np.float64), strict=True):
                asked = np.flatnonzero(weight)
                if len(asked) and not 0 <= joint[asked].min() <= joint[asked].max() < len(bones):
                    raise self._gltf.refusal(f"{where}.attributes.JOINTS_{k} names a joint that skins[{skin}] lacks")
                for bone in np.unique(joint[asked]):
                    which = asked[joint[asked] == bone]
                    place = vertices[which] @ bones[bone][:3, :3].T + bones[bone][:3, 3]
                    moved[which] += weight[which, None] * place
                    total[which] += weight[which, None]
        return np.asarray(moved / total)

    def _bones_of(self, index: int) -> list[Doubles]:
        if index not in self._bones:
            self._bones[index] = self._read_bones(index)
        return self._bones[index]

    def _read_bones(self, index: int) -> list[Doubles]:
        skin = self._gltf.entry(self._table.skins, index, "skins", "nodes.skin")
        inverse = None
        if skin.inverse_bind_matrices is not None:
            name = f"skins[{index}].inverseBindMatrices"
            inverse = self._gltf.array(skin.inverse_bind_matrices, name, ("MAT4",)).astype(np.float64)
            if len(inverse) < len(skin.joints):
                raise self._gltf.refusal(f"{name} has {len(inverse)} entries: it has {len(skin.joints)} joints")
        bones = []
        for k, joint in enumerate(skin.joints):
            if joint not in self._worlds:
                raise self._gltf.refusal(f"skins[{index}].joints has {joint}: it must be a node of the scene shown")
            bind = np.eye(4) if inverse is None else inverse[k].reshape(4, 4).T
            bones.append(self._worlds[joint] @ bind)
        return bones

    # Surfaces.

    def _painted(self, part: MeshPart, primitive: GltfPrimitive, where: str, used: Indices, count: int) -> MeshPart:
        use, wrap, texture = None, None, None
        if primitive.material is not None:
            name = f"{where}.material"
            material = self._gltf.entry(self._table.materials, primitive.material, "materials", name)
            if material.alpha_mode != "OPAQUE":
                self._remark("its cut-outs and transparency (alphaMode) are left out: those surfaces are whole")
            if "KHR_materials_unlit" in material.extensions:
                self._remark("its surfaces without shading (KHR_materials_unlit) are matt ones")
            factor, use = self._colour(material, f"materials[{primitive.material}]")
            part = replace(part, factor=(factor[0], factor[1], factor[2]))
        transform = self._transform(use)
        coordinates = 0
        if use is not None:
            texture, wrap = self._texture(use.index)
            coordinates = use.tex_coord if transform.tex_coord is None else transform.tex_coord
        places = primitive.attributes.get(f"TEXCOORD_{coordinates}")
        if places is None:
            if texture is not None:
                self._remark(f"a texture is left out: {where} has no TEXCOORD_{coordinates}")
            return part
        values = self._per_vertex(places, f"{where}.attributes.TEXCOORD_{coordinates}", ("VEC2",), count)
        uv = _turned(values[used].astype(np.float64), transform)[part.faces]
        return replace(part, uv=uv, texture=texture, wrap=wrap or part.wrap)

    def _colour(self, material: GltfMaterial, where: str) -> tuple[list[float], GltfTextureUse | None]:
        older = material.extensions.get("KHR_materials_pbrSpecularGlossiness")
        if older is not None:
            name = f"{where}.extensions.KHR_materials_pbrSpecularGlossiness"
            diffuse = self._extension(GltfDiffuse, older, name)
            return diffuse.diffuse_factor, diffuse.diffuse_texture
        surface = material.pbr_metallic_roughness
        return surface.base_color_factor, surface.base_color_texture

    def _transform(self, use: GltfTextureUse | None) -> GltfTextureTransform:
        given = None if use is None else use.extensions.get("KHR_texture_transform")
        if given is None:
            return GltfTextureTransform()
        return self._extension(GltfTextureTransform, given, "KHR_texture_transform")

    def _extension(self, model: type[Table], given: Any, where: str) -> Table:
        return checked(model, given, Path(f"{self._gltf.path}: {where}"))

    def _texture(self, index: int) -> tuple[Singles, tuple[Wrap, Wrap]]:
        texture = self._gltf.entry(self._table.textures, index, "textures", "a texture's index")
        wrap: list[Wrap] = ["repeat", "repeat"]
        if texture.sampler is not None:
            name = f"textures[{index}].sampler"
            sampler = self._gltf.entry(self._table.samplers, texture.sampler, "samplers", name)
            for k, code in enumerate((sampler.wrap_s, sampler.wrap_t)):
                if code not in _WRAPS:
                    allowed = ", ".join(map(str, _WRAPS))
                    raise self._gltf.refusal(
                        f"samplers[{texture.sampler}] wraps by {code}: it must be one of {allowed}"
                    )
                wrap[k] = _WRAPS[code]
        source = self._source(texture, f"textures[{index}]")
        if source not in self._pictures:
            picture = self._pictures[source] = self._picture(source, f"textures[{index}].source")
            self._texels += picture.shape[0] * picture.shape[1]
            if self._texels > MAX_TEXELS:
                raise self._gltf.refusal(
                    f"its textures have more than the {MAX_TEXELS / 1e6:.0f} megapixels together that are allowed"
                )
        return self._pictures[source], (wrap[0], wrap[1])

    def _source(self, texture: GltfTexture, where: str) -> int:
        webp = texture.extensions.get("EXT_texture_webp")
        if webp is not None:
            found = self._extension(GltfTexture, webp, f"{where}.extensions.EXT_texture_webp").source
        else:
            found = texture.source
        if found is None:
            names = ", ".join(shown(name)[1:-1] for name in texture.extensions) or "none"
            raise self._gltf.refusal(f"{where} has no picture that can be read: it must have a source (it has {names})")
        return int(found)

    def _picture(self, index: int, where: str) -> Singles:
        image = self._gltf.entry(self._table.images, index, "images", where)
        name = f"images[{index}]"
        if image.uri is not None:
            data = self._gltf.bytes_of(image.uri, f"{name}.uri")
        elif image.buffer_view is not None:
            data = bytes(self._gltf.view(image.buffer_view, f"{name}.bufferView"))
        else:
            raise self._gltf.refusal(f"{name} has neither a uri nor a bufferView: it must have one")
        if not data.startswith(_PICTURES):
            raise self._gltf.refusal(f"{name} is no picture that can be read: it must be PNG, JPEG or WebP")
        return decode_colour(data, f"{self._gltf.path}: {name}", always_srgb=True)


def _local(node: GltfNode) -> Doubles:
    if node.matrix is not None:
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    return _placed(node.translation, node.rotation, node.scale)


def _placed(translation: Sequence[float], rotation: Sequence[float], scale: Sequence[float]) -> Doubles:
    """(4, 4) that scales, turns by the quaternion (x, y, z, w) and moves."""
    length = math.hypot(*rotation)
    x, y, z, w = (value / length for value in rotation) if length > 0 else (0.0, 0.0, 0.0, 1.0)
    a, b, c = scale
    return np.array(
        [
            [a * (1 - 2 * (y * y + z * z)), b * 2 * (x * y - z * w), c * 2 * (x * z + y * w), translation[0]],
            [a * 2 * (x * y + z * w), b * (1 - 2 * (x * x + z * z)), c * 2 * (y * z - x * w), translation[1]],
            [a * 2 * (x * z - y * w), b * 2 * (y * z + x * w), c * (1 - 2 * (x * x + y * y)), translation[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _turned(uv: Doubles, transform: GltfTextureTransform) -> Doubles:
    """Texture coordinates (V, 2) as KHR_texture_transform asks: scaled, turned counter-clockwise, moved."""
    cos, sin = math.cos(transform.rotation), math.sin(transform.rotation)
    turn = np.array([[cos, sin], [-sin, cos]])  # v points down
    return np.asarray(uv * transform.scale @ turn.T + transform.offset)
