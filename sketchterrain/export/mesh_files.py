"""Mesh files: Wavefront OBJ with materials, and binary STL of a closed solid.

Wavefront's "Object Files (.obj)": vertices are counted from 1 through the whole file; texture coordinates
grow from the picture's lower left corner. 3D Systems' "StereoLithography Interface Specification": a header
of 80 bytes, the number of triangles, then 50 bytes each, corners counter-clockwise from outside.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.export.files import format_rows
from sketchterrain.export.mesh import GridMesh
from sketchterrain.whole_files import atomic_file, wrap_os_errors, write_atomic

HEIGHT_DECIMALS: Final = 4  # of metres

_ROWS_AT_ONCE = 1 << 12
# Positions have six decimals: spacings are seldom whole metres.
_ROWS: Final = {"v": f"%.6f %.{HEIGHT_DECIMALS}f %.6f", "vt": "%.6f %.6f", "vn": "%.4f %.4f %.4f"}


class ObjObject(NamedTuple):
    """An object of an OBJ file, y up."""

    name: str
    material: str
    position: npt.NDArray[np.float64]  # (n, 3)
    normal: npt.NDArray[np.float32]
    texcoord: npt.NDArray[np.float32] | None  # (n, 2) from the image's upper left corner
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from outside


@contextmanager
def write_obj(path: Path, library: str) -> Iterator[Callable[[ObjObject], None]]:
    """Yield a function that appends an object to an OBJ; the file appears on success."""
    with atomic_file(path) as stream:
        stream.write(f"# x east, y up, z south, metres\nmtllib {library}\n".encode())
        first = {"v": 1, "vt": 1, "vn": 1}  # numbers of the next object's first vertex

        def add(part: ObjObject) -> None:
            with wrap_os_errors(path):
                _write_object(stream, part, first)

        yield add


def write_mtl(path: Path, materials: Mapping[str, Mapping[str, str]]) -> Path:
    """Write the statements of each material, by its name."""
    lines = [
        line
        for name, statements in materials.items()
        for line in (f"newmtl {name}", *(f"{key} {value}" for key, value in statements.items()), "")
    ]
    return write_atomic(path, "\n".join(lines).encode())


def _write_object(stream: BinaryIO, part: ObjObject, first: dict[str, int]) -> None:
    stream.write(f"o {part.name.replace(' ', '_')}\nusemtl {part.material}\n".encode())
    columns: dict[str, npt.NDArray[np.floating]] = {"v": part.position, "vn": part.normal}
    corner = "%d//%d"
    if part.texcoord is not None:
        columns["vt"] = np.stack([part.texcoord[:, 0], np.float32(1.0) - part.texcoord[:, 1]], axis=-1)
        corner = "%d/%d/%d"
    for word, values in columns.items():
        for row in range(0, len(values), _ROWS_AT_ONCE):
            stream.write(format_rows(f"{word} {_ROWS[word]}\n", *values[row : row + _ROWS_AT_ONCE].T))
    starts = [first[word] for word in ("v", "vt", "vn") if word in columns]
    number = np.arange(len(part.position))
    corners = np.array(
        format_rows(f"{corner} ", *(number + start for start in starts)).decode().split(), object
    )
    for row in range(0, len(part.triangles), _ROWS_AT_ONCE):
        faces = corners[part.triangles[row : row + _ROWS_AT_ONCE]]
        stream.write(format_rows("f %s %s %s\n", *faces.T))
    for word, values in columns.items():
        first[word] += len(values)


_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEADER: Final = b"binary STL of sketchterrain; x east, y north, z up, metres"
_MAX_TRIANGLES: Final = (1 << 32) - 1


def write_stl(path: Path, position: npt.NDArray[np.float32], triangles: npt.NDArray[np.uint32]) -> Path:
    """Write triangles, (k, 3) indices of (n, 3) positions, as binary STL."""
    if len(triangles) > _MAX_TRIANGLES:
        raise InputError(
            f"{path.name}: an STL holds {_MAX_TRIANGLES} triangles, this one needs {len(triangles)}"
        )
    with atomic_file(path) as stream, wrap_os_errors(path):
        stream.write(_HEADER.ljust(80) + struct.pack("<I", len(triangles)))
        for row in range(0, len(triangles), _ROWS_AT_ONCE):
            corners = position[triangles[row : row + _ROWS_AT_ONCE]]
            sides = corners[:, 1:].astype(np.float64) - corners[:, :1]
            normal = np.cross(sides[:, 0], sides[:, 1])
            facets = np.zeros(len(corners), _FACET)
            facets["normal"] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
            facets["corners"] = corners
            stream.write(facets.tobytes())
    return path


def boundary(mesh: GridMesh) -> npt.NDArray[np.int64]:
    """Return the vertices on a mesh's boundary, counter-clockwise from the south-west."""
    last_column, last_row = int(mesh.column.max()), int(mesh.row.max())
    sides = (
        (mesh.row == last_row, mesh.column),
        (mesh.column == last_column, -mesh.row),
        (mesh.row == 0, -mesh.column),
        (mesh.column == 0, mesh.row),
    )
    ring = []
    for on_side, along in sides:
        index = np.flatnonzero(on_side)
        ring.append(
            index[np.argsort(along[index], kind="stable")][:-1]
        )  # its last vertex is the next side's first
    return np.concatenate(ring)


def closed_solid(
    mesh: GridMesh, position: npt.NDArray[np.float32], base: float
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
    """Return positions and triangles of a mesh with walls and a floor: a closed, oriented 2-manifold."""
    top = boundary(mesh)
    following = np.roll(top, -1)
    count = len(position)
    below = count + np.arange(len(top))
    below_following = np.roll(below, -1)
    middle = np.full(len(top), count + len(top))
    floor = position[top].copy()
    floor[:, 2] = base
    low, high = position.min(axis=0), position.max(axis=0)
    centre = np.array([[0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), base]], np.float32)
    walls = [
        np.stack([below, below_following, following], axis=-1),
        np.stack([below, following, top], axis=-1),
        np.stack([middle, below_following, below], axis=-1),
    ]
    triangles = np.concatenate([mesh.triangles, *(wall.astype(np.uint32) for wall in walls)])
    return np.concatenate([position, floor, centre]), triangles
