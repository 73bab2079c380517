"""Blender: heights as an OpenEXR displacement, and the same terrain as a GLB."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from sketchterrain.export.engines import EngineAxes, write_all_water
from sketchterrain.export.gltf import AXES, Glb
from sketchterrain.export.gltf_plants import BYTES_PER_PLANT, add_instances, gathered_plants
from sketchterrain.export.images import ground_images
from sketchterrain.export.rasters import write_exr
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import Export, Target, Written
from sketchterrain.export.targets.gltf import (
    check_glb,
    ground_scene,
    plant_facts,
    write_points,
)

_AXES: Final = EngineAxes("east", "north", "up")


def write_blender(export: Export) -> Written:
    """Write an EXR with heights in metres for a Displace modifier or a shader, and a GLB with all the rest.

    Blender's manual, "Displace Modifier": a vertex is moved by strength · (value − midlevel). Its importer of
    glTF turns y up into z up, so the GLB comes to lie where the displaced grid does.
    """
    plants, counted = _plants(export) if export.options.plants else ({}, {})
    heights = export.folder / f"{export.name}_height.exr"
    with export.stages.stage("exr", "Displacement"):
        channels = dict.fromkeys("RGB", export.sampled.height)
        files: dict[Path, str] = {write_exr(heights, channels): "heights, m; row 0 is the north edge"}
    scene, facts = ground_scene(export)
    path = export.folder / f"{export.name}.glb"
    with export.stages.stage("glb", "GLB"):
        files[scene.write(path)] = "ground and water; lies where the displaced grid does"
    files |= (
        plants
        | write_all_water(export, _AXES)
        | ground_images(export.folder / export.name, export.sampled, export.terrain.material_names)
    )
    facts["heights"] = {"numbers": "float32", "channels": "R = G = B", "metres": "value"}
    facts["axes"] = _AXES.facts
    return Written(files, _settings(export.grid, heights.name, path.name), facts | counted)


def _plants(export: Export) -> tuple[dict[Path, str], dict[str, Any]]:
    """Write plants apart, as instances and as points, and return what the sidecar says of them."""
    with export.stages.stage("plants", "Plants"):
        planting = gathered_plants(export, AXES)
        scene = Glb()
        facts = {"plants": plant_facts(planting, add_instances(scene, planting))}
    if not len(planting.model):
        return {}, facts
    path = scene.write(export.folder / f"{export.name}_plants.glb")
    files = {path: "plants as instances, each of them an object in Blender"}
    return files | write_points(export, planting), facts


def _settings(grid: Grid, heights: str, scene: str) -> dict[str, Any]:
    dx, dy = grid.spacing
    middle = {"x": 0.5 * (grid.west + grid.east), "y": 0.5 * (grid.south + grid.north), "z": 0.0}
    image = {"file": heights, "colour_space": "Non-Color", "extension": "Extend"}
    return {
        "glb": {"file": scene, "how": "File, Import, glTF 2.0; location and scale as they come"},
        "plants": "each instance becomes an object; of many thousands take the points, for geometry nodes",
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
                # Half a cell more on each side: the middle of a texel is then where its height was taken.
                "size": 1.0,
                "location": middle,
                "scale": {"x": grid.columns * dx, "y": grid.rows * dy, "z": 1.0},
            },
            "image_texture": image | {"interpolation": "Linear"},
            "scale": 1.0,
            "midlevel": 0.0,
        },
        "uv": "U grows eastward, V northward: the picture's upper edge is the north",
    }


TARGETS: Final = (
    Target(
        name="blender",
        title="Blender",
        line="heights as a float32 OpenEXR displacement, and a GLB with ground, water and plants",
        write=write_blender,
        knows=frozenset({"error"}),
        check=check_glb,
        disk=92.0,
        memory=150.0,
        bytes_per_plant=BYTES_PER_PLANT,
    ),
)
