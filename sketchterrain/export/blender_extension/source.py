"""Reader of exports: ``terrain.json``, and GLB files as arrays; independent of Blender.

Positions are x east, y north, z up, in metres.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

SIDECAR = "terrain.json"
_FORMAT = 1
_TARGETS = ("blender", "gltf")
_TYPES = {5126: "<f4", 5125: "<u4", 5123: "<u2", 5121: "<u1"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES = 4
_MAX_TEXT = 80

Array = npt.NDArray[Any]


class SourceError(Exception):
    """An export that cannot be read, in one line."""


@dataclass(eq=False)
class MeshSource:
    """One mesh of a GLB: triangles, or lines and points of draped layers."""

    name: str
    material: str
    location: tuple[float, float, float]  # of its origin
    position: Array  # (n, 3) float32
    normal: Array | None  # (n, 3)
    uv: Array | None  # (n, 2), v upward
    colour: Array | None  # (n, 4) linear, 0 … 1
    indices: Array  # (k, 3) triangles, or (k, 2) lines


@dataclass(eq=False)
class PlantSource:
    """Plants of one model, its finest level first."""

    name: str
    levels: list[MeshSource]
    position: Array  # (n, 3) float64
    rotation: Array  # (n,) radians about z
    scale: Array  # (n,)


@dataclass(eq=False)
class TerrainExport:
    """One export, read and checked."""

    name: str  # of the sketch
    path: Path  # the folder, or a GLB without a sidecar
    sidecar: dict[str, Any]
    meshes: list[MeshSource] = field(default_factory=list)
    plants: list[PlantSource] = field(default_factory=list)
    colours: dict[str, tuple[float, ...]] = field(default_factory=dict)  # of materials, linear
    baked: dict[str, bytes] = field(default_factory=dict)  # PNGs in the GLB, "ground colour"

    @property
    def mesh_error(self) -> float:
        """Error of the ground (m), 0 for a mesh of all vertices."""
        return float(self.sidecar.get("mesh", {}).get("error_measured", 1.0))

    @property
    def ground(self) -> MeshSource:
        """The terrain's mesh."""
        return next(mesh for mesh in self.meshes if mesh.name == "ground")


def read_terrain(path: Path) -> TerrainExport:
    """Read an export's folder, its ``terrain.json`` or a GLB; raise `SourceError`."""
    try:
        folder = path if path.is_dir() else path.parent
        sidecar = _read_sidecar(folder) if (folder / SIDECAR).is_file() else None
        listed = {entry["file"] for entry in (sidecar or {"files": []})["files"]}
        if sidecar is None or (path.suffix == ".glb" and path.name not in listed):
            if path.suffix != ".glb":
                raise SourceError(
                    f"{_short(folder)}: no {SIDECAR}: expected a folder of `sketchterrain export`"
                )
            source = TerrainExport(path.stem, path, {})
            glbs = [path]
        else:
            source = TerrainExport(sidecar["sketch"], folder, sidecar)
            missing = [name for name in sorted(listed) if not (folder / name).is_file()]
            if missing:
                raise SourceError(f"{_short(folder)}: {missing[0]} is missing: export it again")
            glbs = [folder / n for n in sorted(listed) if n.endswith(".glb") and "_plant_points" not in n]
        for glb in glbs:
            _read_glb(glb, source)
    except OSError as error:
        raise SourceError(f"{_short(path)}: cannot be read ({error.strerror})") from error
    if not any(mesh.name == "ground" for mesh in source.meshes):
        raise SourceError(f"{_short(path)}: no mesh named ground: expected a GLB of `sketchterrain export`")
    return source


def _read_sidecar(folder: Path) -> dict[str, Any]:
    path = folder / SIDECAR
    try:
        content: dict[str, Any] = json.loads(path.read_bytes())
        version, target, _ = content["format"], content["target"], content["files"]
    except (ValueError, KeyError, TypeError) as error:
        raise SourceError(f"{_short(path)}: not a sidecar of `sketchterrain export`") from error
    if version != _FORMAT:
        raise SourceError(f"{_short(path)}: format {version!r}: this extension reads format {_FORMAT}")
    if target not in _TARGETS:
        expected = " or ".join(f"--to {each}" for each in _TARGETS)
        raise SourceError(f"{_short(path)}: an export for {target!r}: expected {expected}")
    return content


def _read_glb(path: Path, source: TerrainExport) -> None:
    """Add the meshes, plants and materials of a GLB."""
    content = path.read_bytes()
    try:
        magic, version, length = struct.unpack_from("<4sII", content)
        size, kind = struct.unpack_from("<I4s", content, 12)
        if magic != b"glTF" or version != 2 or kind != b"JSON":
            raise SourceError(f"{_short(path)}: not a GLB of version 2")
        if length != len(content):
            raise SourceError(f"{_short(path)}: truncated: {len(content)} of {length} bytes: export it again")
        gltf = json.loads(content[20 : 20 + size])
        if gltf["asset"].get("generator") != "sketchterrain":
            raise SourceError(f"{_short(path)}: of another program: expected a GLB of `sketchterrain export`")
        _Glb(gltf, memoryview(content)[28 + size :]).read(source)
    except (struct.error, ValueError, KeyError, IndexError, TypeError) as error:
        raise SourceError(f"{_short(path)}: damaged: export it again") from error


@dataclass
class _Glb:
    gltf: dict[str, Any]
    binary: memoryview

    def read(self, source: TerrainExport) -> None:
        for material in self.gltf.get("materials", ()):
            colour = material["pbrMetallicRoughness"].get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
            source.colours[material["name"]] = tuple(colour)
        for image in self.gltf.get("images", ()):
            source.baked[image["name"]] = bytes(self._view(image["bufferView"]))
        nodes = self.gltf["nodes"]
        for number in self.gltf["scenes"][0]["nodes"]:
            node = nodes[number]
            extensions = node.get("extensions", {})
            if "EXT_mesh_gpu_instancing" not in extensions:
                source.meshes.append(self._mesh(node))
                continue
            instances = extensions["EXT_mesh_gpu_instancing"]["attributes"]
            coarser = extensions.get("MSFT_lod", {"ids": []})["ids"]
            place = self._values(instances["TRANSLATION"]).astype(np.float64) + node["translation"]
            turn = self._values(instances["ROTATION"])
            source.plants.append(
                PlantSource(
                    node["name"],
                    [self._mesh(each) for each in (node, *(nodes[number] for number in coarser))],
                    _z_up(place),
                    2.0 * np.arctan2(turn[:, 1], turn[:, 3]),
                    self._values(instances["SCALE"])[:, 0],
                )
            )

    def _mesh(self, node: dict[str, Any]) -> MeshSource:
        (primitive,) = self.gltf["meshes"][node["mesh"]]["primitives"]
        found = {name: self._values(index) for name, index in primitive["attributes"].items()}
        position, normal, uv = found["POSITION"], found.get("NORMAL"), found.get("TEXCOORD_0")
        wide = 3 if primitive.get("mode", _TRIANGLES) == _TRIANGLES else 2
        indices = np.arange(len(position)) if wide == 3 else np.zeros(0)
        if "indices" in primitive:
            indices = self._values(primitive["indices"])
        if len(indices) and int(indices.max()) >= len(position):
            raise IndexError
        return MeshSource(
            node["name"],
            self.gltf["materials"][primitive["material"]]["name"],
            tuple(_z_up(np.array([node.get("translation", (0.0, 0.0, 0.0))]))[0].tolist()),
            _z_up(position),
            None if normal is None else _z_up(normal),
            None if uv is None else np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1),
            found["COLOR_0"] / np.float32(65535.0) if "COLOR_0" in found else None,
            indices.reshape(-1, wide).astype(np.int32),
        )

    def _values(self, index: int) -> Array:
        accessor = self.gltf["accessors"][index]
        wide, dtype = _WIDTHS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        view = self._view(accessor["bufferView"])[accessor.get("byteOffset", 0) :]
        count = accessor["count"]
        return np.frombuffer(view, dtype, count * wide).reshape((count, wide) if wide > 1 else (count,))

    def _view(self, index: int) -> memoryview:
        view = self.gltf["bufferViews"][index]
        start = view["byteOffset"]
        return self.binary[start : start + view["byteLength"]]


def _z_up(vectors: Array) -> Array:
    east, up, south = vectors.T
    return np.stack([east, -south, up], axis=-1)


def _short(path: Path) -> str:
    text = str(path)
    return text if len(text) <= _MAX_TEXT else f"…{text[-_MAX_TEXT:]}"
