"""glTF: one GLB with terrain, water and plants, and another with the plants as points."""

from pathlib import Path
from typing import Any, Final

from sketchterrain.errors import InputError
from sketchterrain.export.gltf import AXES, GlbWriter, add_drapes, add_ground, add_objects, grid_centre
from sketchterrain.export.gltf_plants import (
    BYTES_PER_PLANT,
    PlantInstances,
    add_instances,
    add_points,
    collect_plants,
)
from sketchterrain.export.mesh import check_mesh_error, export_mesh, mesh_metadata
from sketchterrain.export.rasters import write_normals_and_weights
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.target import Export, ExportOptions, ExportOutput, Target

_MAX_SIDE: Final = 8193  # vertices, of 56 bytes including their triangles


def check_glb(options: ExportOptions) -> None:
    """Raise `InputError` if a mesh does not fit into a GLB."""
    check_mesh_error(options)
    if options.error is None and (options.size or 0) > _MAX_SIDE:
        raise InputError(
            f"size = {options.size}: a GLB holds 4 GiB, a mesh of all vertices {_MAX_SIDE} along a side: "
            "expected fewer vertices, or an error of the mesh"
        )


def _write_gltf(export: Export) -> ExportOutput:
    with export.stages.stage("plants", "Plants"):
        plants = collect_plants(export, AXES)
        points = write_plant_points(export, plants)
    scene, facts = terrain_scene(export)
    if export.options.plants:
        facts["plants"] = {"count": len(plants.model), "level_of_detail": add_instances(scene, plants)}
    path = export.folder / f"{export.name}.glb"
    with export.stages.stage("glb", "GLB"):
        scene.write(path)
    files = {path: "ground, water and plants, m: x east, y up, z south"} | points
    files |= write_corridors(export, AXES) | write_normals_and_weights(
        export.folder / export.name, export.samples, export.terrain.material_names
    )
    settings: dict[str, Any] = {"up": "+Y", "unit": "1 m", "scale": 1.0}
    if points:
        settings["plants"] = (
            "instances (EXT_mesh_gpu_instancing); where a program shows only one plant of each kind: "
            f"{next(iter(points)).name}, of the same origin"
        )
    return ExportOutput(files, settings, facts)


def terrain_scene(export: Export) -> tuple[GlbWriter, dict[str, Any]]:
    """Return a scene with terrain and water, and its sidecar entries.

    Vertices are float32 from the centre of the terrain, indices 32 bits (glTF 2.0 specification, "Meshes").
    """
    result = export_mesh(export)
    scene = GlbWriter()
    add_ground(scene, result.mesh, export)
    add_objects(scene, export)
    add_drapes(scene, export)
    facts = {"heights": {"numbers": "float32"}, "axes": AXES.metadata, "byte_order": "little-endian"}
    return scene, facts | {"mesh": mesh_metadata(export, result)}


def write_plant_points(export: Export, plants: PlantInstances) -> dict[Path, str]:
    """Write plants as ``NAME_plant_points.glb`` if there are any; return the file with its description."""
    if not len(plants.model):
        return {}
    points = GlbWriter()
    add_points(points, plants, grid_centre(export.grid))
    path = points.write(export.folder / f"{export.name}_plant_points.glb")
    return {path: "plants as points, a node a species, with _SCALE and _ROTATION"}


TARGETS: Final = (
    Target(
        name="gltf",
        title="glTF",
        summary="a GLB: mesh with baked materials, water, plants as instances; also plants as points",
        write=_write_gltf,
        options=frozenset({"error"}),
        check=check_glb,
        disk=80.0,
        memory=150.0,
        bytes_per_plant=BYTES_PER_PLANT,
    ),
)
