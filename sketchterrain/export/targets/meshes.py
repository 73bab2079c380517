"""Plain meshes: OBJ with materials, and STL as a printable solid."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.export.engines import EngineAxes, write_plants_json, write_water_json
from sketchterrain.export.files import write_png
from sketchterrain.export.gltf import bake_colour, material_appearance
from sketchterrain.export.images import write_normals_and_weights
from sketchterrain.export.mesh import check_mesh_error, export_mesh, mesh_metadata
from sketchterrain.export.mesh_files import (
    HEIGHT_DECIMALS,
    ObjObject,
    closed_solid,
    write_mtl,
    write_obj,
    write_stl,
)
from sketchterrain.export.mesh_vertices import (
    mesh_normals,
    mesh_positions,
    mesh_texcoords,
    texture_stride,
    water_meshes,
)
from sketchterrain.export.target import Export, ExportOutput, Target

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
    colours = bake_colour(samples.weights[::stride, ::stride], material_appearance(export.terrain))
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
        for water in water_meshes(export.terrain.features, export.grid):
            up = np.broadcast_to(np.array([0.0, 1.0, 0.0], np.float32), water.position.shape)
            position = _Y_UP.points(*water.position.T).astype(np.float64)
            add(ObjObject(water.name, "water", position, up, None, water.triangles))
    files[path] = "ground and water, m: x east, y up, z south"
    ground = {"Kd": "1 1 1", "Ks": "0 0 0", "illum": "1", "map_Kd": f"{name}_colour.png"}
    files[write_mtl(folder / f"{name}.mtl", {"ground": ground, "water": _WATER})] = "materials of the OBJ"
    files[write_png(folder / f"{name}_colour.png", colours)] = "the ground's colours, sRGB"
    files |= _write_common(export, _Y_UP)
    facts = {"axes": _Y_UP.metadata, "mesh": mesh_metadata(export, result)}
    facts["heights"] = {"numbers": f"text, {HEIGHT_DECIMALS} decimals"}
    return ExportOutput(files, {"up": "Y", "forward": "-Z", "scale": 1.0, "unit": "1 m"}, facts)


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
    return images | write_plants_json(export, axes) | write_water_json(export, axes)


TARGETS: Final = (
    Target(
        name="obj",
        title="Wavefront OBJ",
        summary="ground and water as a mesh with materials and colours, y up",
        write=_write_obj,
        size=513,
        options=frozenset({"error"}),
        check=check_mesh_error,
        disk=300.0,
        memory=150.0,
    ),
    Target(
        name="stl",
        title="STL",
        summary="the ground as a printable solid with walls and a floor, z up",
        write=_write_stl,
        size=513,
        options=frozenset({"error"}),
        check=check_mesh_error,
        disk=120.0,
        memory=150.0,
    ),
)
