"""glTF scenes: GLB files, the terrain mesh with baked materials, waters.

x east, y up, z south, metres from the sketch's south-west corner at height 0.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pygltflib
import shapely
from PIL import Image

from sketchterrain.array_types import Float64Array, UInt8Array
from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.mesh import (
    WATER,
    GridMesh,
    mesh_normals,
    mesh_positions,
    mesh_texcoords,
    scene_objects,
    texture_stride,
)
from sketchterrain.export.sampled import SampleGrid, TerrainSamples, row_bands, srgb_of
from sketchterrain.export.target import Export
from sketchterrain.io.files import atomic_file
from sketchterrain.look.texture_levels import (
    Levels,
    customized_levels,
    layer_tints,
    own_material_images,
    procedural_levels,
)
from sketchterrain.schema.colours import linear_from_hex
from sketchterrain.schema.geology import Strata

if TYPE_CHECKING:  # load OpenCL
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.generation.terrain import Terrain

AXES: Final = EngineAxes("east", "up", "south")
MAX_BYTES: Final = (1 << 32) - 1  # of a GLB

_COMPONENTS: Final = {
    "float32": pygltflib.FLOAT,
    "uint32": pygltflib.UNSIGNED_INT,
    "uint16": pygltflib.UNSIGNED_SHORT,
    "uint8": pygltflib.UNSIGNED_BYTE,
}
_SHAPES: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_WATER: Final = {
    "baseColorFactor": [0.035, 0.085, 0.095, 0.8],
    "metallicFactor": 0.0,
    "roughnessFactor": 0.06,
}
_PNG_LEVEL: Final = 3
_TEXELS = 256  # along a side of the textures that are averaged
_WHOLE = 255  # sum of weights
_STEPS = 65535
_RISE: Final = 0.1  # of a cell: draped lines above the ground, whose triangles are as large
_POINT, _LINE, _AREA = 0, 1, 3  # shapely's type ids


class GlbWriter:
    """A GLB file (glTF 2.0 specification, "Binary glTF Layout"): a scene as JSON, arrays in one chunk."""

    def __init__(self) -> None:
        asset = pygltflib.Asset(version="2.0", generator="sketchterrain")
        self.scene = pygltflib.GLTF2(asset=asset, scene=0, scenes=[pygltflib.Scene(nodes=[])])
        self._parts: list[UInt8Array] = []
        self._length = 0

    def attribute(
        self, values: npt.NDArray[Any], *, bounds: bool = False, normalized: bool = False, vertex: bool = True
    ) -> int:
        """Add an array of rows of a multiple of four bytes, and return its accessor.

        Positions need their `bounds`; if `normalized`, integers mean 0 … 1; only vertex attributes are in an
        array buffer.
        """
        rows = values.reshape(len(values), -1)
        ends = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()} if bounds else {}
        target = pygltflib.ARRAY_BUFFER if vertex else None
        return self._accessor(rows, target, normalized=normalized or None, **ends)

    def indices(self, triangles: npt.NDArray[np.uint32]) -> int:
        """Add triangles, (n, 3), or lines, (n, 2), and return their accessor."""
        return self._accessor(triangles.reshape(-1, 1), pygltflib.ELEMENT_ARRAY_BUFFER, normalized=None)

    def texture(self, pixels: UInt8Array, name: str) -> int:
        """Add an RGB image, clamped at its edges, and return its texture."""
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, format="PNG", compress_level=_PNG_LEVEL)
        view = self._view(np.frombuffer(stream.getbuffer(), np.uint8), None)
        filters = {"magFilter": pygltflib.LINEAR, "minFilter": pygltflib.LINEAR_MIPMAP_LINEAR}
        wraps = dict.fromkeys(("wrapS", "wrapT"), pygltflib.CLAMP_TO_EDGE)
        self.scene.samplers = [pygltflib.Sampler(**filters, **wraps)]
        image = pygltflib.Image(bufferView=view, mimeType="image/png", name=name)
        source = _added(self.scene.images, image)
        return _added(self.scene.textures, pygltflib.Texture(sampler=0, source=source))

    def node(self, name: str, *, in_scene: bool = True, **parts: Any) -> int:
        """Add a node, by default to the scene, and return its index."""
        number = _added(self.scene.nodes, pygltflib.Node(name=name, **parts))
        if in_scene:
            self.scene.scenes[0].nodes.append(number)
        return number

    def mesh(self, name: str, attributes: Mapping[str, int], **parts: Any) -> int:
        """Add a mesh of one primitive, and return its index."""
        primitive = pygltflib.Primitive(attributes=pygltflib.Attributes(**attributes), **parts)
        return _added(self.scene.meshes, pygltflib.Mesh(name=name, primitives=[primitive]))

    def material(self, name: str, **parts: Any) -> int:
        """Add a material, and return its index."""
        return _added(self.scene.materials, pygltflib.Material(name=name, **parts))

    def write(self, path: Path) -> Path:
        """Write the file chunk by chunk; pygltflib would hold three copies of all arrays."""
        self.scene.buffers = [pygltflib.Buffer(byteLength=self._length)]
        text = self.scene.gltf_to_json(separators=(",", ":"), indent=None).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + self._length
        if length > MAX_BYTES:
            raise InputError(f"{path.name}: a GLB holds 4 GiB, this one needs {length / (1 << 30):.1f} GiB")
        with atomic_file(path) as stream:
            stream.write(struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON") + text)
            stream.write(struct.pack("<I4s", self._length, b"BIN\0"))
            for part in self._parts:
                stream.write(part.data)
                stream.write(bytes(-part.size % 4))
        return path

    def _accessor(self, rows: npt.NDArray[Any], target: int | None, **parts: Any) -> int:
        rows = np.ascontiguousarray(rows, rows.dtype.newbyteorder("<"))
        accessor = pygltflib.Accessor(
            bufferView=self._view(rows.reshape(-1).view(np.uint8), target),
            byteOffset=0,
            componentType=_COMPONENTS[rows.dtype.name],
            count=len(rows),
            type=_SHAPES[rows.shape[1]],
            **parts,
        )
        return _added(self.scene.accessors, accessor)

    def _view(self, content: UInt8Array, target: int | None) -> int:
        view = pygltflib.BufferView(buffer=0, byteOffset=self._length, byteLength=content.size, target=target)
        self._parts.append(content)
        self._length += content.size + -content.size % 4
        return _added(self.scene.bufferViews, view)


def _added(entries: list[Any], entry: object) -> int:
    """Append to a list of the scene, and return the index of the new entry."""
    entries.append(entry)
    return len(entries) - 1


def grid_centre(grid: SampleGrid) -> npt.NDArray[np.float64]:
    """Return the centre of a grid at height 0, (3,), in the scene's coordinates.

    The origin of vertices and a node's float64 translation: float32 then resolves positions twice as finely,
    and heights exactly.
    """
    middle = np.array([0.5 * (grid.west + grid.east)]), np.array([0.5 * (grid.south + grid.north)])
    centre: npt.NDArray[np.float64] = AXES.points(*middle, np.zeros(1))[0] + 0.0
    return centre


def add_ground(glb: GlbWriter, mesh: GridMesh, export: Export) -> None:
    """Add the terrain mesh, its materials baked into two textures."""
    grid, samples = export.grid, export.samples
    stride = texture_stride(grid)
    appearance = material_appearance(export.terrain)
    colour = glb.texture(bake_colour(samples, stride, appearance), "ground colour")
    weights = samples.weights[::stride, ::stride]
    roughness = glb.texture(bake_roughness(weights, appearance), "ground roughness")
    material = glb.material(
        "ground",
        pbrMetallicRoughness={
            "baseColorTexture": {"index": colour},
            "metallicRoughnessTexture": {"index": roughness},
            "metallicFactor": 0.0,
        },
    )
    attributes = {
        "POSITION": glb.attribute(mesh_positions(mesh, samples, _centred_axes(grid)), bounds=True),
        "NORMAL": glb.attribute(mesh_normals(mesh, samples, AXES)),
        "TEXCOORD_0": glb.attribute(mesh_texcoords(mesh, grid)),
    }
    ground = glb.mesh("ground", attributes, indices=glb.indices(mesh.triangles), material=material)
    glb.node("ground", mesh=ground, translation=grid_centre(grid).tolist())


def add_objects(glb: GlbWriter, export: Export) -> None:
    """Add the waters, roads and what is built, a node for each material of each."""
    grid = export.grid
    axes, numbers = _centred_axes(grid), dict[str, int]()
    for each in scene_objects(export):
        if each.material not in numbers:
            look = {"alphaMode": "BLEND", "pbrMetallicRoughness": _WATER}
            if each.material != WATER:
                colour = [*object_colour(each.material, export.terrain), 1.0]
                look = {"pbrMetallicRoughness": {"baseColorFactor": colour, "metallicFactor": 0.0}}
            numbers[each.material] = glb.material(each.material, **look)
        attributes = {
            "POSITION": glb.attribute(axes.points(*each.position.T).astype(np.float32), bounds=True),
            "NORMAL": glb.attribute(axes.vectors(each.normal).astype(np.float32)),
        }
        indices, material = glb.indices(each.triangles), numbers[each.material]
        number = glb.mesh(each.name, attributes, indices=indices, material=material)
        glb.node(each.name, mesh=number, translation=grid_centre(grid).tolist())


def add_drapes(glb: GlbWriter, export: Export) -> None:
    """Add draped lines, outlines of areas and points, a node or two for each style of each layer."""
    rise = (0.0, 0.0, _RISE * min(export.grid.spacing))
    for name, style, shapes in (each for layer in export.drapes for each in layer.by_style()):
        colour = linear_from_hex(style["colour"] or style["fill"] or "#808080").tolist()
        look = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0}
        material = glb.material(name, pbrMetallicRoughness=look)
        parts = shapely.get_parts(shapes)
        kinds = shapely.get_type_id(parts)
        lines = np.concatenate([parts[kinds == _LINE], shapely.get_rings(parts[kinds == _AREA])])
        at, line = shapely.get_coordinates(lines, include_z=True, return_index=True)
        first = np.flatnonzero(line[1:] == line[:-1])
        pairs = np.stack([first, first + 1], axis=-1).astype(np.uint32)
        points = shapely.get_coordinates(parts[kinds == _POINT], include_z=True)
        for places, mode in ((at, pygltflib.LINES), (points, pygltflib.POINTS)):
            if len(places):
                positions = _centred_axes(export.grid).points(*np.add(places, rise).T).astype(np.float32)
                indices = glb.indices(pairs) if mode == pygltflib.LINES else None
                attributes = {"POSITION": glb.attribute(positions, bounds=True)}
                mesh = glb.mesh(name, attributes, indices=indices, material=material, mode=mode)
                glb.node(name, mesh=mesh, translation=grid_centre(export.grid).tolist())


def object_colour(material: str, terrain: Terrain) -> list[float]:
    """Return the linear mean albedo of a material of the ground or of what is built."""
    from sketchterrain.look.built_meshes import BUILT

    if material in BUILT:
        return list(BUILT[material].colour)
    return list(material_appearance(terrain).albedo[terrain.material_names.index(material)])


def _centred_axes(grid: SampleGrid) -> EngineAxes:
    east, _, south = grid_centre(grid).tolist()
    return EngineAxes("east", "up", "south", origin=(east, -south, 0.0))


class MaterialAppearance(NamedTuple):
    """Mean appearance of materials seen from afar."""

    albedo: npt.NDArray[np.float64]  # (materials, 3): linear, 0 … 1
    roughness: npt.NDArray[np.float64]  # (materials,): √α of the Trowbridge-Reitz distribution, as in glTF


def material_levels(terrain: Terrain, texels: int) -> Levels:
    """Return the textures of a terrain's materials as changed by its sketch, `texels` (2ⁿ) a side.

    The finest level is the first; the first layers are the materials, those seen from afar follow.
    """
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.device import Device

    device = terrain.context.device

    def open_context() -> ComputeContext:
        return ComputeContext(device if isinstance(device, Device) else None)

    own = own_material_images(terrain.sketch.materials, texels)
    painted = procedural_levels(texels, open_context)
    return customized_levels(painted, terrain.materials, terrain.sketch.looks, own, open_context)


def material_tints(terrain: Terrain) -> Float64Array:
    """Return the factors (layers, 3) of the textures' albedos by climate and rock, as pictures have them."""
    sketch = terrain.sketch
    rock = Strata.from_settings(sketch.geology).rock
    return layer_tints(terrain.materials, sketch.climate["aridity"], sketch.looks, rock)


def material_appearance(terrain: Terrain) -> MaterialAppearance:
    """Return the appearance of a terrain's materials, as changed by its sketch."""
    levels = material_levels(terrain, _TEXELS)
    colour, relief = (part.reshape(-1, 4)[: len(terrain.materials)] / 255.0 for part in levels[-1])
    return MaterialAppearance(colour[:, :3] ** 2, relief[:, 2])


def bake_colour(samples: TerrainSamples, stride: int, appearance: MaterialAppearance) -> UInt8Array:
    """Return colours of every so many samples in sRGB: materials mixed linearly, under what is painted."""
    steps = np.rint(_STEPS * appearance.albedo).astype(np.int64)
    linear = _weighted_mean(samples.weights[::stride, ::stride], steps)
    if samples.appearance is not None:
        painted = samples.appearance[::stride, ::stride]
        share = painted[..., 3:].astype(np.int64)
        root = painted[..., :3].astype(np.int64)
        colour = root * root * _STEPS // (255 * 255)
        linear = ((linear * (255 - share) + colour * share) // 255).astype(np.uint16)
    return srgb_of(np.arange(_STEPS + 1) / _STEPS)[linear]


def bake_roughness(weights: UInt8Array, appearance: MaterialAppearance) -> UInt8Array:
    """Return the terrain's roughness as glTF reads it: in green, with 0 for metalness in blue."""
    steps = np.rint(255.0 * appearance.roughness).astype(np.int64)[:, None]
    image = np.zeros((*weights.shape[:2], 3), np.uint8)
    image[..., 1] = _weighted_mean(weights, steps)[..., 0]
    return image


def _weighted_mean(weights: UInt8Array, values: npt.NDArray[np.int64]) -> npt.NDArray[np.uint16]:
    """Return weighted means in integers, equal on every machine."""
    result = np.empty((*weights.shape[:2], values.shape[1]), np.uint16)
    for rows in row_bands(len(weights)):
        for channel in range(values.shape[1]):
            total = np.full(weights[rows].shape[:2], _WHOLE // 2, np.int32)
            for material, value in enumerate(values[:, channel]):
                total += weights[rows, :, material] * np.int32(value)
            result[rows, :, channel] = total // _WHOLE
    return result
