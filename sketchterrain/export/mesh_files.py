"""Triangles as files: Wavefront OBJ with its materials, and binary STL of a solid with walls and a floor.

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
from sketchterrain.export.files import text_rows
from sketchterrain.export.mesh import Mesh
from sketchterrain.whole_files import atomic_file, wrap_os_errors, write_atomic

HEIGHT_DECIMALS: Final = 4
"""Of a metre."""

_AT_ONCE = 1 << 12  # rows
# Places have six decimals: grids are seldom whole metres apart.
_ROWS: Final = {"v": f"%.6f %.{HEIGHT_DECIMALS}f %.6f", "vt": "%.6f %.6f", "vn": "%.4f %.4f %.4f"}


class ObjPart(NamedTuple):
    """An object of a file: its vertices along the file's axes, y up."""

    name: str
    material: str
    place: npt.NDArray[np.float64]  # (n, 3) along the axes of the file, y up
    normal: npt.NDArray[np.float32]
    texel: npt.NDArray[np.float32] | None  # (n, 2) from the picture's upper left corner
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from outside


@contextmanager
def write_obj(path: Path, library: str) -> Iterator[Callable[[ObjPart], None]]:
    """Yield a function that adds an object to an OBJ; the file appears once the context has ended well."""
    with atomic_file(path) as stream:
        stream.write(f"# x east, y up, z south, metres\nmtllib {library}\n".encode())
        counted = {"v": 1, "vt": 1, "vn": 1}

        def add(part: ObjPart) -> None:
            with wrap_os_errors(path):
                _write(stream, part, counted)

        yield add


def write_mtl(path: Path, materials: Mapping[str, Mapping[str, str]]) -> Path:
    """Write materials: the statements of each, by its name."""
    lines = [
        line
        for name, statements in materials.items()
        for line in (f"newmtl {name}", *(f"{key} {value}" for key, value in statements.items()), "")
    ]
    return write_atomic(path, "\n".join(lines).encode())


def _write(stream: BinaryIO, part: ObjPart, counted: dict[str, int]) -> None:
    stream.write(f"o {part.name.replace(' ', '_')}\nusemtl {part.material}\n".encode())
    columns: dict[str, npt.NDArray[np.floating]] = {"v": part.place, "vn": part.normal}
    corner = "%d//%d"
    if part.texel is not None:
        columns["vt"] = np.stack([part.texel[:, 0], np.float32(1.0) - part.texel[:, 1]], axis=-1)
        corner = "%d/%d/%d"
    for word, values in columns.items():
        for first in range(0, len(values), _AT_ONCE):
            stream.write(text_rows(f"{word} {_ROWS[word]}\n", *values[first : first + _AT_ONCE].T))
    starts = [counted[word] for word in ("v", "vt", "vn") if word in columns]
    number = np.arange(len(part.place))
    corners = np.array(
        text_rows(f"{corner} ", *(number + start for start in starts)).decode().split(), object
    )
    for first in range(0, len(part.triangles), _AT_ONCE):
        some = corners[part.triangles[first : first + _AT_ONCE]]
        stream.write(text_rows("f %s %s %s\n", *some.T))
    for word, values in columns.items():
        counted[word] += len(values)


_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEADER: Final = b"binary STL of sketchterrain; x east, y north, z up, metres"
_MOST: Final = (1 << 32) - 1


def write_stl(path: Path, place: npt.NDArray[np.float32], triangles: npt.NDArray[np.uint32]) -> Path:
    """Write triangles."""
    if len(triangles) > _MOST:
        raise InputError(f"{path.name}: an STL holds {_MOST} triangles, this one needs {len(triangles)}")
    with atomic_file(path) as stream, wrap_os_errors(path):
        stream.write(_HEADER.ljust(80) + struct.pack("<I", len(triangles)))
        for first in range(0, len(triangles), _AT_ONCE):
            corners = place[triangles[first : first + _AT_ONCE]]
            sides = corners[:, 1:].astype(np.float64) - corners[:, :1]
            normal = np.cross(sides[:, 0], sides[:, 1])
            facets = np.zeros(len(corners), _FACET)
            facets["normal"] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
            facets["corners"] = corners
            stream.write(facets.tobytes())
    return path


class Solid(NamedTuple):
    """Triangles that enclose a body, counter-clockwise from outside."""

    place: npt.NDArray[np.float32]  # (n, 3): x east, y north, z up
    triangles: npt.NDArray[np.uint32]  # (k, 3)


def border(mesh: Mesh) -> npt.NDArray[np.int64]:
    """Return the vertices on the edges of a mesh's rectangle, counter-clockwise from the south-west."""
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
        ring.append(index[np.argsort(along[index], kind="stable")][:-1])  # its end begins the next side
    return np.concatenate(ring)


def solid(mesh: Mesh, place: npt.NDArray[np.float32], base: float) -> Solid:
    """Return a mesh with walls and a floor: every edge belongs to two triangles, once each way."""
    top = border(mesh)
    following = np.roll(top, -1)
    count = len(place)
    below = count + np.arange(len(top))
    below_following = np.roll(below, -1)
    middle = np.full(len(top), count + len(top))
    floor = place[top].copy()
    floor[:, 2] = base
    low, high = place.min(axis=0), place.max(axis=0)
    centre = np.array([[0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), base]], np.float32)
    walls = [
        np.stack([below, below_following, following], axis=-1),
        np.stack([below, following, top], axis=-1),
        np.stack([middle, below_following, below], axis=-1),
    ]
    triangles = np.concatenate([mesh.triangles, *(wall.astype(np.uint32) for wall in walls)])
    return Solid(np.concatenate([place, floor, centre]), triangles)
