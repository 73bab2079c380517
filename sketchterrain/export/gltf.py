"""Terrains as glTF scenes: the GLB file, the ground in its baked materials, rivers and lakes.

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
from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.mesh import Mesh
from sketchterrain.export.mesh_vertices import mesh_normals, mesh_places, mesh_texels, texel_step, waters
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import Export
from sketchterrain.look.texture_levels import customized_levels, procedural_levels
from sketchterrain.whole_files import atomic_file

if TYPE_CHECKING:  # load OpenCL
    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import TerrainSource

Bytes = npt.NDArray[np.uint8]
AXES: Final = EngineAxes("east", "up", "south")
"""Of glTF; the origin is the sketch's south-west corner at height 0."""

LARGEST: Final = (1 << 32) - 1
"""Bytes of a GLB at most."""

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
_TEXELS = 256  # of the textures whose means are taken
_ROWS_AT_ONCE = 256
_WHOLE = 255  # what weights sum to
_STEPS = 65535


class Glb:
    """A GLB file (glTF 2.0 specification, "Binary glTF Layout"): a scene as JSON, its arrays in one chunk."""

    def __init__(self) -> None:
        asset = pygltflib.Asset(version="2.0", generator="sketchterrain")
        self.scene = pygltflib.GLTF2(asset=asset, scene=0, scenes=[pygltflib.Scene(nodes=[])])
        self._parts: list[Bytes] = []
        self._length = 0

    def attribute(
        self, values: npt.NDArray[Any], *, bounds: bool = False, normalized: bool = False, vertex: bool = True
    ) -> int:
        """Add an array, a row of a multiple of four bytes a vertex, plant or point; return its accessor.

        With `bounds` its least and greatest values are stated, as positions need it. If `normalized`,
        integers stand for 0 … 1. Only the attributes of vertices are in an array buffer.
        """
        rows = values.reshape(len(values), -1)
        ends = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()} if bounds else {}
        target = pygltflib.ARRAY_BUFFER if vertex else None
        return self._accessor(rows, target, normalized=normalized or None, **ends)

    def indices(self, triangles: npt.NDArray[np.uint32]) -> int:
        """Add triangles, (n, 3), and return their accessor."""
        return self._accessor(triangles.reshape(-1, 1), pygltflib.ELEMENT_ARRAY_BUFFER, normalized=None)

    def texture(self, pixels: Bytes, name: str) -> int:
        """Add an RGB image that is clamped to its edges, and return its texture."""
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, format="PNG", compress_level=_PNG_LEVEL)
        view = self._view(np.frombuffer(stream.getbuffer(), np.uint8), None)
        filters = {"magFilter": pygltflib.LINEAR, "minFilter": pygltflib.LINEAR_MIPMAP_LINEAR}
        wraps = dict.fromkeys(("wrapS", "wrapT"), pygltflib.CLAMP_TO_EDGE)
        self.scene.samplers = [pygltflib.Sampler(**filters, **wraps)]
        image = pygltflib.Image(bufferView=view, mimeType="image/png", name=name)
        source = _added(self.scene.images, image)
        return _added(self.scene.textures, pygltflib.Texture(sampler=0, source=source))

    def node(self, name: str, **parts: Any) -> None:
        """Add a node to the scene."""
        number = _added(self.scene.nodes, pygltflib.Node(name=name, **parts))
        self.scene.scenes[0].nodes.append(number)

    def mesh(self, name: str, attributes: Mapping[str, int], **parts: Any) -> int:
        """Add a mesh of one primitive, and return its number."""
        primitive = pygltflib.Primitive(attributes=pygltflib.Attributes(**attributes), **parts)
        return _added(self.scene.meshes, pygltflib.Mesh(name=name, primitives=[primitive]))

    def material(self, name: str, **parts: Any) -> int:
        """Add a material, and return its number."""
        return _added(self.scene.materials, pygltflib.Material(name=name, **parts))

    def write(self, path: Path) -> Path:
        """Write the file in parts; pygltflib would hold three copies of all arrays to do so.

        Raises
        ------
        InputError
            If it would be larger than a GLB can be.
        """
        self.scene.buffers = [pygltflib.Buffer(byteLength=self._length)]
        text = self.scene.gltf_to_json(separators=(",", ":"), indent=None).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + self._length
        if length > LARGEST:
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

    def _view(self, content: Bytes, target: int | None) -> int:
        view = pygltflib.BufferView(buffer=0, byteOffset=self._length, byteLength=content.size, target=target)
        self._parts.append(content)
        self._length += content.size + -content.size % 4
        return _added(self.scene.bufferViews, view)


def _added(entries: list[Any], entry: object) -> int:
    """Append to a list of the scene, and return the number of the new entry."""
    entries.append(entry)
    return len(entries) - 1


def centre_of(grid: Grid) -> npt.NDArray[np.float64]:
    """Return the middle of a grid at height 0, (3,), along the scene's axes.

    Vertices are counted from there, a node's translation is in float64: float32 holds them twice as finely,
    and heights to the bit.
    """
    middle = np.array([0.5 * (grid.west + grid.east)]), np.array([0.5 * (grid.south + grid.north)])
    centre: npt.NDArray[np.float64] = AXES.places(*middle, np.zeros(1))[0] + 0.0
    return centre


def add_ground(glb: Glb, mesh: Mesh, export: Export) -> None:
    """Add the ground, its materials baked into two textures."""
    grid, sampled = export.grid, export.sampled
    step = texel_step(grid)
    looks = material_looks(export.terrain)
    weights = sampled.weights[::step, ::step]
    colour = glb.texture(baked_colour(weights, looks), "ground colour")
    rough = glb.texture(baked_roughness(weights, looks), "ground roughness")
    material = glb.material(
        "ground",
        pbrMetallicRoughness={
            "baseColorTexture": {"index": colour},
            "metallicRoughnessTexture": {"index": rough},
            "metallicFactor": 0.0,
        },
    )
    attributes = {
        "POSITION": glb.attribute(mesh_places(mesh, sampled, _about(grid)), bounds=True),
        "NORMAL": glb.attribute(mesh_normals(mesh, sampled, AXES)),
        "TEXCOORD_0": glb.attribute(mesh_texels(mesh, grid)),
    }
    ground = glb.mesh("ground", attributes, indices=glb.indices(mesh.triangles), material=material)
    glb.node("ground", mesh=ground, translation=centre_of(grid).tolist())


def add_water(glb: Glb, export: Export) -> None:
    """Add rivers and lakes, a node each."""
    grid = export.grid
    material = None
    for water in waters(export.terrain.features, grid):
        if material is None:
            material = glb.material("water", alphaMode="BLEND", pbrMetallicRoughness=_WATER)
        place = _about(grid).places(*water.place.T).astype(np.float32)
        up = np.zeros_like(place)
        up[:, 1] = 1.0
        attributes = {"POSITION": glb.attribute(place, bounds=True), "NORMAL": glb.attribute(up)}
        number = glb.mesh(water.name, attributes, indices=glb.indices(water.triangles), material=material)
        glb.node(water.name, mesh=number, translation=centre_of(grid).tolist())


def _about(grid: Grid) -> EngineAxes:
    east, _, south = centre_of(grid).tolist()
    return EngineAxes("east", "up", "south", origin=(east, -south, 0.0))


class MaterialLooks(NamedTuple):
    """What materials look like from afar."""

    albedo: npt.NDArray[np.float64]  # (materials, 3): linear, 0 … 1
    roughness: npt.NDArray[np.float64]  # (materials,) as in glTF: √α of Trowbridge and Reitz's distribution


def material_looks(terrain: TerrainSource) -> MaterialLooks:
    """Return what a terrain's materials look like: the program's own, or as its sketch wants them."""
    from sketchterrain import compute  # OpenCL: not for a list of targets

    device = terrain.context.device

    def opened() -> ComputeContext:
        return compute.ComputeContext(device if isinstance(device, compute.Device) else None)

    levels = customized_levels(procedural_levels(_TEXELS, opened), terrain.sketch.look, {}, opened)
    colour, relief = (part.reshape(-1, 4)[: len(terrain.material_names)] / 255.0 for part in levels[-1])
    return MaterialLooks(colour[:, :3] ** 2, relief[:, 2])


def baked_colour(weights: Bytes, looks: MaterialLooks) -> Bytes:
    """Return the colours of the ground: materials mixed as light is, then written as sRGB."""
    steps = np.rint(_STEPS * looks.albedo).astype(np.int64)
    return _srgb()[_mixed(weights, steps)]


def baked_roughness(weights: Bytes, looks: MaterialLooks) -> Bytes:
    """Return the roughness of the ground as glTF reads it: in green; blue, the metal in it, is 0."""
    steps = np.rint(255.0 * looks.roughness).astype(np.int64)[:, None]
    image = np.zeros((*weights.shape[:2], 3), np.uint8)
    image[..., 1] = _mixed(weights, steps)[..., 0]
    return image


def _mixed(weights: Bytes, values: npt.NDArray[np.int64]) -> npt.NDArray[np.uint16]:
    """Return weighted means in whole numbers, which are the same on every machine."""
    result = np.empty((*weights.shape[:2], values.shape[1]), np.uint16)
    for top in range(0, len(weights), _ROWS_AT_ONCE):
        rows = slice(top, top + _ROWS_AT_ONCE)
        for channel in range(values.shape[1]):
            total = np.full(weights[rows].shape[:2], _WHOLE // 2, np.int32)
            for material, value in enumerate(values[:, channel]):
                total += weights[rows, :, material] * np.int32(value)
            result[rows, :, channel] = total // _WHOLE
    return result


def _srgb() -> Bytes:
    """Return the sRGB byte of each linear step (IEC 61966-2-1)."""
    linear = np.arange(_STEPS + 1) / _STEPS
    values = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * values).astype(np.uint8)
