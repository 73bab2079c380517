"""Plain meshes: OBJ with materials, and STL as a printable solid.

Wavefront's "Object Files (.obj)": vertices are counted from 1 through the whole file; texture coordinates
grow from the picture's lower left corner. 3D Systems' "StereoLithography Interface Specification": a header
of 80 bytes, the number of triangles, then 50 bytes each, corners counter-clockwise from outside.
"""

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, write_plants_json
from sketchterrain.export.files import format_rows, write_png
from sketchterrain.export.gltf import bake_colour, material_appearance, object_colour
from sketchterrain.export.mesh import (
    WATER,
    GridMesh,
    check_mesh_error,
    export_mesh,
    mesh_metadata,
    mesh_normals,
    mesh_positions,
    mesh_texcoords,
    scene_objects,
    texture_stride,
)
from sketchterrain.export.rasters import write_normals_and_weights
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import row_bands
from sketchterrain.export.target import Export, ExportOutput, Target
from sketchterrain.io.files import atomic_file, wrap_os_errors, write_atomic

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
        for rows in row_bands(len(values), _ROWS_AT_ONCE):
            stream.write(format_rows(f"{word} {_ROWS[word]}\n", *values[rows].T))
    starts = [first[word] for word in ("v", "vt", "vn") if word in columns]
    number = np.arange(len(part.position))
    corners = np.array(
        format_rows(f"{corner} ", *(number + start for start in starts)).decode().split(), object
    )
    for rows in row_bands(len(part.triangles), _ROWS_AT_ONCE):
        stream.write(format_rows("f %s %s %s\n", *corners[part.triangles[rows]].T))
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
        for rows in row_bands(len(triangles), _ROWS_AT_ONCE):
            corners = position[triangles[rows]]
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
        order = np.argsort(along[index], kind="stable")
        ring.append(index[order][:-1])  # its last vertex is the next side's first
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


_Y_UP: Final = EngineAxes("east", "up", "south")
_Z_UP: Final = EngineAxes("east", "north", "up")
_BASE: Final = 0.02  # thickness below the lowest height, as a share of the longer side
_PRINT: Final = 100.0  # mm, longer side of the print whose scale the sidecar states
_WATER: Final = {"Kd": "0.035 0.085 0.095", "Ks": "0.04 0.04 0.04", "Ns": "500", "d": "0.8", "illum": "2"}


def _write_obj(export: Export) -> ExportOutput:
    """Write the terrain with baked colours and the water as objects of one file, y up."""
    name, folder = export.name, export.folder
    result = export_mesh(export, decimals=HEIGHT_DECIMALS)
    mesh, samples = result.mesh, export.samples
    stride = texture_stride(export.grid)
    colours = bake_colour(samples, stride, material_appearance(export.terrain))
    files: dict[Path, str] = {}
    path = folder / f"{name}.obj"
    with export.stages.stage("obj", "OBJ"), write_obj(path, f"{name}.mtl") as add:
        add(
            ObjObject(
                "ground",
                "ground",
                mesh_positions(mesh, samples, _Y_UP).astype(np.float64),
                mesh_normals(mesh, samples, _Y_UP),
                mesh_texcoords(mesh, export.grid),
                mesh.triangles,
            )
        )
        materials: dict[str, dict[str, str]] = {}
        for each in scene_objects(export):
            if each.material not in materials:
                colour = "" if each.material == WATER else _rgb(object_colour(each.material, export.terrain))
                materials[each.material] = {"Kd": colour, "illum": "1"} if colour else _WATER
            position = _Y_UP.points(*each.position.T).astype(np.float64)
            normal = _Y_UP.vectors(each.normal).astype(np.float32)
            add(ObjObject(each.name, each.material, position, normal, None, each.triangles))
    files[path] = "ground, water, roads and buildings, m: x east, y up, z south"
    ground = {"Kd": "1 1 1", "Ks": "0 0 0", "illum": "1", "map_Kd": f"{name}_colour.png"}
    files[write_mtl(folder / f"{name}.mtl", {"ground": ground} | materials)] = "materials of the OBJ"
    files[write_png(folder / f"{name}_colour.png", colours)] = "the ground's colours, sRGB"
    files |= _write_common(export, _Y_UP)
    facts = {"axes": _Y_UP.metadata, "mesh": mesh_metadata(export, result)}
    facts["heights"] = {"numbers": f"text, {HEIGHT_DECIMALS} decimals"}
    return ExportOutput(files, {"up": "Y", "forward": "-Z", "scale": 1.0, "unit": "1 m"}, facts)


def _rgb(colour: list[float]) -> str:
    """Return a linear colour as an OBJ's sRGB."""
    return " ".join(f"{value ** (1.0 / 2.2):.3f}" for value in colour)


def _write_stl(export: Export) -> ExportOutput:
    """Write the terrain as a closed solid with walls and a flat floor, z up."""
    grid = export.grid
    result = export_mesh(export)
    longer = max(grid.east - grid.west, grid.north - grid.south)
    base = float(export.samples.height.min()) - _BASE * longer
    with export.stages.stage("stl", "STL"):
        surface = mesh_positions(result.mesh, export.samples, _Z_UP)
        position, triangles = closed_solid(result.mesh, surface, base)
        path = write_stl(export.folder / f"{export.name}.stl", position, triangles)
    files = {path: "the ground as a solid with walls and a floor, m: x east, y north, z up"}
    files |= _write_common(export, _Z_UP)
    facts: dict[str, Any] = {"axes": _Z_UP.metadata, "byte_order": "little-endian"}
    facts["mesh"] = mesh_metadata(export, result) | {"solid_triangles": len(triangles), "floor": base}
    facts["heights"] = {"numbers": "float32"}
    settings = {
        "unit": "m; slicers read STL as mm",
        f"scale_for_{_PRINT:g}_mm": _PRINT / longer,
        "up": "+Z",
    }
    return ExportOutput(files, settings, facts)


def _write_common(export: Export, axes: EngineAxes) -> dict[Path, str]:
    stem, names = export.folder / export.name, export.terrain.material_names
    images = write_normals_and_weights(stem, export.samples, names)
    return images | write_plants_json(export, axes) | write_corridors(export, axes)


_OBJ: Final = Target(
    name="obj",
    title="Wavefront OBJ",
    summary="ground and water as a mesh with materials and colours, y up",
    write=_write_obj,
    size=513,
    options=frozenset({"error"}),
    check=check_mesh_error,
    disk=300.0,
    memory=150.0,
)
TARGETS: Final = (
    _OBJ,
    replace(
        _OBJ,
        name="stl",
        title="STL",
        summary="the ground as a printable solid with walls and a floor, z up",
        write=_write_stl,
        disk=120.0,
    ),
)
