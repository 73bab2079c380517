"""GLB files: a whole scene for any program, and one for Blender beside an OpenEXR displacement."""

import zipfile
from dataclasses import replace
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.errors import InputError, one_line
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.files import write_png
from sketchterrain.export.gltf import (
    AXES,
    GlbWriter,
    add_drapes,
    add_ground,
    add_objects,
    grid_centre,
    material_levels,
    material_tints,
)
from sketchterrain.export.gltf_plants import (
    BYTES_PER_PLANT,
    FINEST,
    ScenePlants,
    add_instances,
    add_points,
    collect_plants,
)
from sketchterrain.export.mesh import check_mesh_error, export_mesh, mesh_metadata
from sketchterrain.export.rasters import weights_suffix, write_exr, write_normals_and_weights
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import CHANNELS, SampleGrid, appearance_picture
from sketchterrain.export.target import Export, ExportOptions, ExportOutput, SceneView, Target
from sketchterrain.io.files import atomic_file
from sketchterrain.schema.geology import Strata

_AXES: Final = EngineAxes("east", "north", "up")
_EXTENSION: Final = "blender_extension"  # its folder
_SUFFIXES: Final = (".py", ".toml")
_TEXELS: Final = 512  # along a side of a material's tile
_WHOLE: Final = 255.0
_MAX_SIDE: Final = 8193  # vertices, of 56 bytes including their triangles
_COARSER: Final = (FINEST + 1, FINEST + 2)  # levels of detail of plants, of about 170 and 30 triangles


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


def write_plant_points(export: Export, plants: ScenePlants) -> dict[Path, str]:
    """Write plants as ``NAME_plant_points.glb`` if there are any; return the file with its description."""
    if not len(plants.model):
        return {}
    points = GlbWriter()
    add_points(points, plants, grid_centre(export.grid))
    path = points.write(export.folder / f"{export.name}_plant_points.glb")
    return {path: "plants as points, a node a species, with _SCALE and _ROTATION"}


def _write_blender(export: Export) -> ExportOutput:
    """Write an EXR with heights in metres for a Displace modifier or a shader, and a GLB with all the rest.

    Blender's manual, "Displace Modifier": a vertex moves by strength · (value − midlevel). Its glTF importer
    converts y up to z up, so the GLB coincides with the displaced grid. The extension for Blender reads
    the GLBs, the tiles and the sidecar.
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
    with export.stages.stage("tiles", "Material tiles"):
        tiles, facts["tiles_of_materials"] = _write_tiles(export)
    files |= tiles
    view = export.scene_view
    facts["scene"] = view.facts | _light_of_sky(view, float(export.samples.height.max()))
    facts["heights"] = {"numbers": "float32", "channels": "R = G = B", "metres": "value"}
    facts["axes"] = _AXES.metadata
    return ExportOutput(files, _settings(export.grid, heights.name, path.name), facts | plant_facts)


def _write_plants(export: Export) -> tuple[dict[Path, str], dict[str, Any]]:
    """Write plants separately, as instances and as points, and return the files and sidecar entries."""
    with export.stages.stage("plants", "Plants"):
        plants = collect_plants(export, AXES)
        scene = GlbWriter()
        add_instances(scene, plants, _COARSER)
    facts = {"plants": {"count": len(plants.model), "levels_of_detail": [FINEST, *_COARSER]}}
    if not len(plants.model):
        return {}, facts
    path = scene.write(export.folder / f"{export.name}_plants.glb")
    files = {path: "plants as instances of models at three levels of detail"}
    return files | write_plant_points(export, plants), facts


def write_extension(path: Path) -> Path:
    """Write the extension's manifest and modules, uncompressed and without times: always the same bytes."""
    if path.suffix.lower() != ".zip" or path.is_dir():
        raise InputError(f"expected the name of a .zip file, got {one_line(path)!r}")
    parts = package_files("sketchterrain.export").joinpath(_EXTENSION).iterdir()
    with atomic_file(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for part in sorted(parts, key=lambda part: part.name):
            if part.name.endswith(_SUFFIXES):
                archive.writestr(zipfile.ZipInfo(part.name), part.read_bytes())
    return path


def _light_of_sky(view: SceneView, summit: float) -> dict[str, Any]:
    """Return the sky's irradiance on level ground, and light and extinction of the air towards a summit."""
    c = view.harmonics
    angle = abs((view.heading - view.sun_azimuth + 180.0) % 360.0 - 180.0)
    column = round(np.sqrt(angle / 180.0) * (view.sky.shape[1] - 1))
    level = len(view.sky) // 4  # rows of the air below and above the horizon, then rows of the sky
    heights = np.maximum(np.linspace(view.eye[2], max(summit, view.eye[2]), 16), 0.0)
    thin_haze, thin_air = (np.exp(-heights / each).mean() for each in (view.haze_height, view.air_height))
    extinction = view.haze * thin_haze + view.air * thin_air
    return {
        "skylight": (c[0] + c[2] + 2.0 * c[6]).tolist(),
        "air": {"radiance": view.sky[level, column].tolist(), "extinction": extinction.tolist()},
    }


def _write_tiles(export: Export) -> tuple[dict[Path, str], list[dict[str, Any]]]:
    """Write a repeating texture of each material that has weight; return the files and sidecar entries."""
    terrain, table = export.terrain, export.terrain.materials
    (roots, relief), *_ = material_levels(terrain, _TEXELS)
    strata, tints = Strata.from_settings(terrain.sketch.geology), material_tints(terrain)
    has_weight = export.samples.weights.max(axis=(0, 1)) > 0
    files, entries = dict[Path, str](), []
    for index, material in enumerate(table):
        if has_weight[index]:
            texture, look = material.texture, terrain.sketch.looks.get(material.name, {})
            path = export.folder / f"{export.name}_tile_{material.name}.png"
            what = f"{material.title}: a tile to repeat, sRGB; height as opacity"
            painted = roots[index, ::-1].astype(np.float64)  # √albedo and height
            painted[..., :3] *= np.sqrt(tints[index])
            picture = np.rint(np.minimum(painted, _WHOLE)).astype(np.uint8)
            files[write_png(path, appearance_picture(picture))] = what
            width = look.get("size") or texture.width
            entries.append(
                {
                    "material": material.name,
                    "title": material.title,
                    "file": path.name,
                    "width": width,
                    "coarsest_width": width * 2 ** texture.octaves[1],
                    "relief": width * texture.bump * look.get("bump", 1.0),
                    "roughness": round(float(relief[index, ..., 2].mean() / _WHOLE), 4),
                    "tints": [[each.low, each.high] for each in texture.variations],
                    "beds": [*strata.across, strata.rock.banding] if texture.bedded else [],
                    "weights": f"{export.name}_{weights_suffix(index)}.png",
                    "channel": index % len(CHANNELS),
                }
            )
    return files, entries


def _settings(grid: SampleGrid, heights: str, scene: str) -> dict[str, Any]:
    dx, dy = grid.spacing
    middle = {"x": 0.5 * (grid.west + grid.east), "y": 0.5 * (grid.south + grid.north), "z": 0.0}
    image = {"file": heights, "colour_space": "Non-Color", "extension": "Extend"}
    return {
        "extension": "File, Import, Sketchterrain: this folder; `sketchterrain blender-extension` writes it",
        "glb": {"file": scene, "how": "without the extension: File, Import, glTF 2.0; unchanged"},
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


GLTF: Final = Target(
    name="gltf",
    title="glTF",
    summary="a GLB: mesh with baked materials, water, plants as instances; also plants as points",
    write=_write_gltf,
    options=frozenset({"error"}),
    check=check_glb,
    disk=80.0,
    memory=150.0,
    bytes_per_plant=BYTES_PER_PLANT,
)
TARGETS: Final = (
    GLTF,
    replace(
        GLTF,
        name="blender",
        title="Blender",
        summary="a GLB with ground, water and plants, material tiles, and heights as an OpenEXR displacement",
        write=_write_blender,
        disk=92.0,
        scene=True,
    ),
)
