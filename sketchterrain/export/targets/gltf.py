"""glTF: one GLB with ground, water and plants, and another with the plants as points."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from sketchterrain.errors import InputError
from sketchterrain.export.engines import write_all_water
from sketchterrain.export.gltf import AXES, Glb, add_ground, add_water, centre_of
from sketchterrain.export.gltf_plants import (
    BYTES_PER_PLANT,
    Planting,
    add_instances,
    add_points,
    gathered_plants,
)
from sketchterrain.export.images import ground_images
from sketchterrain.export.mesh import check_error, ground_mesh, mesh_facts
from sketchterrain.export.target import Export, ExportOptions, Target, Written

_MOST: Final = 8193  # vertices of 56 bytes, their triangles counted in


def check_glb(options: ExportOptions) -> None:
    """Refuse what fits into no GLB before any work is done."""
    check_error(options)
    if options.error is None and (options.size or 0) > _MOST:
        raise InputError(
            f"size = {options.size}: a GLB holds 4 GiB, a mesh of all vertices {_MOST} along a side: "
            "expected fewer, or an error that the mesh may have"
        )


def write_gltf(export: Export) -> Written:
    """Write what programs that read glTF 2.0 take, and beside it images of the ground."""
    with export.stages.stage("plants", "Plants"):
        planting = gathered_plants(export, AXES)
        points = write_points(export, planting)
    scene, facts = ground_scene(export)
    if export.options.plants:
        facts["plants"] = plant_facts(planting, add_instances(scene, planting))
    path = export.folder / f"{export.name}.glb"
    with export.stages.stage("glb", "GLB"):
        scene.write(path)
    files = {path: "ground, water and plants, m: x east, y up, z south"} | points
    files |= write_all_water(export, AXES) | ground_images(
        export.folder / export.name, export.sampled, export.terrain.material_names
    )
    settings: dict[str, Any] = {"up": "+Y", "unit": "1 m", "scale": 1.0}
    if points:
        settings["plants"] = (
            "instances (EXT_mesh_gpu_instancing); where a program shows one plant of each kind only: "
            f"{next(iter(points)).name}, of the same origin"
        )
    return Written(files, settings, facts)


def ground_scene(export: Export) -> tuple[Glb, dict[str, Any]]:
    """Return a scene with ground and water, and what the sidecar says of it.

    Vertices are float32 from the middle of the ground on, indices 32 bits (glTF 2.0 specification, "Meshes").
    """
    made = ground_mesh(export)
    scene = Glb()
    add_ground(scene, made.mesh, export)
    add_water(scene, export)
    facts = {"heights": {"numbers": "float32"}, "axes": AXES.facts, "byte_order": "little-endian"}
    return scene, facts | {"mesh": mesh_facts(export, made)}


def write_points(export: Export, planting: Planting) -> dict[Path, str]:
    """Write plants as ``NAME_plant_points.glb``, if there are any, and return what it is."""
    if not len(planting.model):
        return {}
    points = Glb()
    add_points(points, planting, centre_of(export.grid))
    path = points.write(export.folder / f"{export.name}_plant_points.glb")
    return {path: "plants as points, a node a species, with _SCALE and _ROTATION"}


def plant_facts(planting: Planting, detail: int) -> dict[str, Any]:
    """Return what the sidecar says of plants."""
    return {"count": len(planting.model), "level_of_detail": detail}


TARGETS: Final = (
    Target(
        name="gltf",
        title="glTF",
        line="a GLB: mesh with baked materials, water, plants as instances; plants as points besides",
        write=write_gltf,
        knows=frozenset({"error"}),
        check=check_glb,
        disk=80.0,
        memory=150.0,
        bytes_per_plant=BYTES_PER_PLANT,
    ),
)
