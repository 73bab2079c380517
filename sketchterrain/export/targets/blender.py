"""Blender: heights as an OpenEXR displacement, and the same terrain as a GLB."""

from pathlib import Path
from typing import Any, Final

from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.gltf import AXES, GlbWriter
from sketchterrain.export.gltf_plants import BYTES_PER_PLANT, add_instances, collect_plants
from sketchterrain.export.rasters import write_exr, write_normals_and_weights
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import SampleGrid
from sketchterrain.export.target import Export, ExportOutput, Target
from sketchterrain.export.targets.gltf import check_glb, plant_metadata, terrain_scene, write_plant_points

_AXES: Final = EngineAxes("east", "north", "up")


def _write_blender(export: Export) -> ExportOutput:
    """Write an EXR with heights in metres for a Displace modifier or a shader, and a GLB with all the rest.

    Blender's manual, "Displace Modifier": a vertex moves by strength · (value − midlevel). Its glTF importer
    converts y up to z up, so the GLB coincides with the displaced grid.
    """
    plants, plant_facts = _write_plants(export) if export.options.plants else ({}, {})
    heights = export.folder / f"{export.name}_height.exr"
    with export.stages.stage("exr", "Displacement"):
        channels = dict.fromkeys("RGB", export.samples.height)
        files: dict[Path, str] = {write_exr(heights, channels): "heights, m; row 0 is the north edge"}
    scene, facts = terrain_scene(export)
    path = export.folder / f"{export.name}.glb"
    with export.stages.stage("glb", "GLB"):
        files[scene.write(path)] = "ground and water; coincides with the displaced grid"
    files |= plants | write_corridors(export, _AXES)
    files |= write_normals_and_weights(
        export.folder / export.name, export.samples, export.terrain.material_names
    )
    facts["heights"] = {"numbers": "float32", "channels": "R = G = B", "metres": "value"}
    facts["axes"] = _AXES.metadata
    return ExportOutput(files, _settings(export.grid, heights.name, path.name), facts | plant_facts)


def _write_plants(export: Export) -> tuple[dict[Path, str], dict[str, Any]]:
    """Write plants separately, as instances and as points, and return the files and sidecar entries."""
    with export.stages.stage("plants", "Plants"):
        plants = collect_plants(export, AXES)
        scene = GlbWriter()
        facts = {"plants": plant_metadata(plants, add_instances(scene, plants))}
    if not len(plants.model):
        return {}, facts
    path = scene.write(export.folder / f"{export.name}_plants.glb")
    files = {path: "plants as instances, each of them an object in Blender"}
    return files | write_plant_points(export, plants), facts


def _settings(grid: SampleGrid, heights: str, scene: str) -> dict[str, Any]:
    dx, dy = grid.spacing
    middle = {"x": 0.5 * (grid.west + grid.east), "y": 0.5 * (grid.south + grid.north), "z": 0.0}
    image = {"file": heights, "colour_space": "Non-Color", "extension": "Extend"}
    return {
        "glb": {"file": scene, "how": "File, Import, glTF 2.0; location and scale unchanged"},
        "plants": "each instance becomes an object; for many thousands use the points, with geometry nodes",
        "displace_modifier": {
            "grid": {
                "x_subdivisions": grid.columns - 1,
                "y_subdivisions": grid.rows - 1,
                "size": 1.0,
                "location": middle,
                "scale": {"x": grid.east - grid.west, "y": grid.north - grid.south, "z": 1.0},
            },
            "texture": image | {"interpolation": False, "clamp": False},
            "texture_coordinates": "UV",
            "direction": "Z",
            "strength": 1.0,
            "midlevel": 0.0,
        },
        "displacement_node": {
            "plane": {
                # Half a cell larger on each side, so that heights are at the centres of texels.
                "size": 1.0,
                "location": middle,
                "scale": {"x": grid.columns * dx, "y": grid.rows * dy, "z": 1.0},
            },
            "image_texture": image | {"interpolation": "Linear"},
            "scale": 1.0,
            "midlevel": 0.0,
        },
        "uv": "U grows eastward, V northward: the image's upper edge is the north",
    }


TARGETS: Final = (
    Target(
        name="blender",
        title="Blender",
        summary="heights as a float32 OpenEXR displacement, and a GLB with ground, water and plants",
        write=_write_blender,
        options=frozenset({"error"}),
        check=check_glb,
        disk=92.0,
        memory=150.0,
        bytes_per_plant=BYTES_PER_PLANT,
    ),
)
