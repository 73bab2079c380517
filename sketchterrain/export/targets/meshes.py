"""Plain meshes: OBJ with its materials, and STL as a solid that can be printed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.export.engines import EngineAxes, write_all_plants, write_all_water
from sketchterrain.export.files import write_png
from sketchterrain.export.gltf import baked_colour, material_looks
from sketchterrain.export.images import ground_images
from sketchterrain.export.mesh import check_error, ground_mesh, mesh_facts
from sketchterrain.export.mesh_files import HEIGHT_DECIMALS, ObjPart, solid, write_mtl, write_obj, write_stl
from sketchterrain.export.mesh_vertices import mesh_normals, mesh_places, mesh_texels, texel_step, waters
from sketchterrain.export.target import Export, Target, Written

_UPRIGHT: Final = EngineAxes("east", "up", "south")
_WORLD: Final = EngineAxes("east", "north", "up")
_BASE: Final = 0.02  # thickness under the lowest ground, of the longer side
_PRINT: Final = 100.0  # mm: the longer side of a print whose scale the sidecar tells
_WATER: Final = {"Kd": "0.035 0.085 0.095", "Ks": "0.04 0.04 0.04", "Ns": "500", "d": "0.8", "illum": "2"}


def write_meshes_obj(export: Export) -> Written:
    """Write the ground with its baked colours and the waters as objects of one file, y up."""
    name, folder = export.name, export.folder
    made = ground_mesh(export, decimals=HEIGHT_DECIMALS)
    step = texel_step(export.grid)
    colours = baked_colour(export.sampled.weights[::step, ::step], material_looks(export.terrain))
    files: dict[Path, str] = {}
    path = folder / f"{name}.obj"
    with export.stages.stage("obj", "OBJ"), write_obj(path, f"{name}.mtl") as add:
        add(
            ObjPart(
                "ground",
                "ground",
                mesh_places(made.mesh, export.sampled, _UPRIGHT).astype(np.float64),
                mesh_normals(made.mesh, export.sampled, _UPRIGHT),
                mesh_texels(made.mesh, export.grid),
                made.mesh.triangles,
            )
        )
        for water in waters(export.terrain.features, export.grid):
            up = np.broadcast_to(np.array([0.0, 1.0, 0.0], np.float32), water.place.shape)
            place = _UPRIGHT.places(*water.place.T).astype(np.float64)
            add(ObjPart(water.name, "water", place, up, None, water.triangles))
    files[path] = "ground and water, m: x east, y up, z south"
    ground = {"Kd": "1 1 1", "Ks": "0 0 0", "illum": "1", "map_Kd": f"{name}_colour.png"}
    files[write_mtl(folder / f"{name}.mtl", {"ground": ground, "water": _WATER})] = "materials of the OBJ"
    files[write_png(folder / f"{name}_colour.png", colours)] = "the ground's colours, sRGB"
    files |= (
        ground_images(export.folder / export.name, export.sampled, export.terrain.material_names)
        | write_all_plants(export, _UPRIGHT)
        | write_all_water(export, _UPRIGHT)
    )
    facts = {"axes": _UPRIGHT.facts, "mesh": mesh_facts(export, made)}
    facts["heights"] = {"numbers": f"text, {HEIGHT_DECIMALS} decimals"}
    return Written(files, {"up": "Y", "forward": "-Z", "scale": 1.0, "unit": "1 m"}, facts)


def write_meshes_stl(export: Export) -> Written:
    """Write the ground as a solid: walls on its four sides, a flat floor, z up."""
    name, grid = export.name, export.grid
    made = ground_mesh(export)
    longer = max(grid.east - grid.west, grid.north - grid.south)
    base = float(export.sampled.height.min()) - _BASE * longer
    with export.stages.stage("stl", "STL"):
        body = solid(made.mesh, mesh_places(made.mesh, export.sampled, _WORLD), base)
        path = write_stl(export.folder / f"{name}.stl", body.place, body.triangles)
    files = {path: "the ground as a solid with walls and a floor, m: x east, y north, z up"}
    files |= (
        ground_images(export.folder / export.name, export.sampled, export.terrain.material_names)
        | write_all_plants(export, _WORLD)
        | write_all_water(export, _WORLD)
    )
    facts: dict[str, Any] = {"axes": _WORLD.facts, "byte_order": "little-endian"}
    facts["mesh"] = mesh_facts(export, made) | {"solid_triangles": len(body.triangles), "floor": base}
    facts["heights"] = {"numbers": "float32"}
    settings = {
        "unit": "m; slicers take STL for mm",
        f"scale_for_{_PRINT:g}_mm": _PRINT / longer,
        "up": "+Z",
    }
    return Written(files, settings, facts)


TARGETS: Final = (
    Target(
        name="obj",
        title="Wavefront OBJ",
        line="ground and water as a mesh with materials and colours, y up",
        write=write_meshes_obj,
        size=513,
        knows=frozenset({"error"}),
        check=check_error,
        disk=300.0,
        memory=150.0,
    ),
    Target(
        name="stl",
        title="STL",
        line="the ground as a solid with walls and a floor, to be printed, z up",
        write=write_meshes_stl,
        size=513,
        knows=frozenset({"error"}),
        check=check_error,
        disk=120.0,
        memory=150.0,
    ),
)
