"""A GLB file: a glTF scene in JSON and all its numbers in one binary chunk, written in pieces.

glTF 2.0 specification, "Binary glTF Layout" and "Data Alignment": chunks and accessors begin at multiples of
four bytes, lengths are 32-bit.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["LARGEST", "Glb"]

LARGEST: Final = (1 << 32) - 1
"""Bytes of a GLB at most."""

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_COMPONENTS: Final = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121}
_SHAPES: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")


class Glb:
    """A file that is put together; what it holds is written by :meth:`write` alone.

    Attributes
    ----------
    scene : pygltflib.GLTF2
        All but the numbers; to be added to.
    """

    def __init__(self) -> None:
        import pygltflib

        self.scene = pygltflib.GLTF2(
            asset=pygltflib.Asset(version="2.0", generator="sketchterrain"),
            scene=0,
            scenes=[pygltflib.Scene(nodes=[])],
        )
        self._parts: list[npt.NDArray[np.uint8]] = []
        self._length = 0

    def attribute(
        self, values: npt.NDArray[Any], *, bounds: bool = False, normalized: bool = False, vertex: bool = True
    ) -> int:
        """Add numbers, a row a vertex, plant or point, and return their accessor.

        Parameters
        ----------
        values
            (n,) or (n, 2 … 4) of float32, uint32, uint16 or uint8; rows are multiples of four bytes long.
        bounds
            Whether least and greatest numbers are told, as positions need it.
        normalized
            Whether whole numbers stand for 0 … 1.
        vertex
            Whether a mesh's vertices are what has them.
        """
        target = _ARRAY_BUFFER if vertex else None
        return self._accessor(values, target, bounds=bounds, normalized=normalized)

    def indices(self, triangles: npt.NDArray[np.uint32]) -> int:
        """Add triangles, (n, 3), and return their accessor."""
        return self._accessor(triangles.reshape(-1), _ELEMENT_ARRAY_BUFFER)

    def texture(self, png: bytes, name: str) -> int:
        """Add a PNG image that ends at its edges, and return its texture."""
        import pygltflib

        scene = self.scene
        if not scene.samplers:
            clamp = pygltflib.CLAMP_TO_EDGE
            scene.samplers.append(
                pygltflib.Sampler(
                    magFilter=pygltflib.LINEAR,
                    minFilter=pygltflib.LINEAR_MIPMAP_LINEAR,
                    wrapS=clamp,
                    wrapT=clamp,
                )
            )
        view = self._view(np.frombuffer(png, np.uint8), None)
        scene.images.append(pygltflib.Image(bufferView=view, mimeType="image/png", name=name))
        scene.textures.append(pygltflib.Texture(sampler=0, source=len(scene.images) - 1))
        return len(scene.textures) - 1

    def node(self, name: str, **parts: Any) -> None:
        """Add something to the scene."""
        import pygltflib

        self.scene.scenes[0].nodes.append(len(self.scene.nodes))
        self.scene.nodes.append(pygltflib.Node(name=name, **parts))

    def mesh(self, name: str, attributes: Mapping[str, int], **parts: Any) -> int:
        """Add a mesh of one primitive, and return its number."""
        import pygltflib

        primitive = pygltflib.Primitive(attributes=pygltflib.Attributes(**attributes), **parts)
        self.scene.meshes.append(pygltflib.Mesh(name=name, primitives=[primitive]))
        return len(self.scene.meshes) - 1

    def material(self, name: str, **parts: Any) -> int:
        """Add a material, and return its number."""
        import pygltflib

        self.scene.materials.append(pygltflib.Material(name=name, **parts))
        return len(self.scene.materials) - 1

    def write(self, path: Path) -> Path:
        """Write the file; the same scene gives the same bytes.

        Raises
        ------
        InputError
            If it would be larger than a GLB can be.
        SketchterrainError
            If the system cannot write it.
        """
        import pygltflib

        self.scene.buffers = [pygltflib.Buffer(byteLength=self._length)]
        text = self.scene.gltf_to_json(separators=(",", ":"), indent=None).encode()
        text += b" " * (-len(text) % 4)
        length = _HEADER.size + _CHUNK.size + len(text) + _CHUNK.size + self._length
        if length > LARGEST:
            raise InputError(f"{path.name}: a GLB holds 4 GiB, this one needs {length / (1 << 30):.1f} GiB")
        with whole_file(path) as stream, telling_failure(path):
            stream.write(_HEADER.pack(b"glTF", 2, length) + _CHUNK.pack(len(text), b"JSON") + text)
            stream.write(_CHUNK.pack(self._length, b"BIN\0"))
            for part in self._parts:
                stream.write(part.data)
                stream.write(bytes(-part.size % 4))
        return path

    def _accessor(
        self, values: npt.NDArray[Any], target: int | None, *, bounds: bool = False, normalized: bool = False
    ) -> int:
        import pygltflib

        rows = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        wide = rows.shape[1] if rows.ndim > 1 else 1
        ends: dict[str, Any] = {}
        if bounds:
            flat = rows.reshape(len(rows), wide)
            ends = {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.scene.accessors.append(
            pygltflib.Accessor(
                bufferView=self._view(rows.reshape(-1).view(np.uint8), target),
                byteOffset=0,
                componentType=_COMPONENTS[rows.dtype.name],
                count=len(rows),
                type=_SHAPES[wide],
                normalized=normalized or None,
                **ends,
            )
        )
        return len(self.scene.accessors) - 1

    def _view(self, content: npt.NDArray[np.uint8], target: int | None) -> int:
        import pygltflib

        view = pygltflib.BufferView(buffer=0, byteOffset=self._length, byteLength=content.size, target=target)
        self.scene.bufferViews.append(view)
        self._parts.append(content)
        self._length += content.size + -content.size % 4
        return len(self.scene.bufferViews) - 1
