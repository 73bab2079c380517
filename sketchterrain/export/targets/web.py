"""Web page: a folder that any browser shows, from a server or by a double click."""

from __future__ import annotations

import math
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.sampled import SampleGrid, sample_terrain
from sketchterrain.export.target import Export, ExportOptions, ExportOutput, Target
from sketchterrain.export.web_data import (
    LEVELS,
    STEP,
    four_bit_weights,
    height_levels,
    padded,
    texture_strip,
    write_data,
)
from sketchterrain.io.files import write_atomic
from sketchterrain.io.resources import source

if TYPE_CHECKING:
    from sketchterrain.export.gltf_plants import PlantInstances
    from sketchterrain.export.mesh import ObjectMesh

_AXES: Final = EngineAxes("east", "north", "up")
_PAGE: Final = ("index.html", "viewer.js", "ground.js", "plants.js", "camera.js", "shaders.js")
_KERNELS: Final = ("frame", "tone", "tree_light", "water_optics")  # shaders that the page has from the renderer
_MAX_SIDE: Final = 4097  # vertices: textures of any graphics card
_MAX_PLANTS: Final = 300_000  # 2.5 MB
_CELLS: Final = 64  # of plants along a side, as in web/plants.js
_TEXELS: Final = 256
_RINGS, _AROUND, _REACH = 64, 512, 6.0  # vertices of the surroundings outward and around; size over the grid's
_STEPS: Final = 65535
_CENTIMETRES: Final = 100.0


def _check(options: ExportOptions) -> None:
    if (options.size or 0) > _MAX_SIDE:
        raise InputError(f"size = {options.size}: expected at most {_MAX_SIDE} vertices along a side of a page")


def _write_web(export: Export) -> ExportOutput:
    scale = HeightQuantisation.from_heights(export.samples.height)
    with export.stages.stage("page", "Web page"):
        facts = _scene_facts(export, scale)
        written = _ground(export, scale, facts) | _objects(export, facts) | _plants(export, facts)
        written |= _surroundings(export, facts)
        facts["files"] = [path.stem for path in written]
        sky = np.asarray(facts.pop("sky"), np.float16).view(np.uint16)
        scene = write_data(export.folder / "scene.js", {"sky": sky}, facts)
        page = {name: files("sketchterrain.export").joinpath("web", name).read_bytes() for name in _PAGE}
        shown = {write_atomic(export.folder / name, content): "the page" for name, content in page.items()}
    shown[export.folder / "index.html"] = "the page: open it in a browser, or put the folder on a web server"
    entries = {
        "heights": {"numbers": "uint16", **scale.metadata, "largest_error": 0.5 * scale.step},
        "axes": _AXES.metadata,
        "view": None if export.view is None else export.view.facts,
        "plants": facts["plants"],
    }
    settings = {"open": "index.html, by double click or from any static web server", "network": "not needed"}
    return ExportOutput(shown | {scene: "camera, light and list of the data"} | written, settings, entries)


def _scene_facts(export: Export, scale: HeightQuantisation) -> dict[str, Any]:
    view, grid = export.view, export.grid
    if view is None:
        raise ValueError("a web page needs the preview's camera and light")
    bearing, rise = math.radians(view.sun_azimuth), math.radians(view.sun_elevation)
    flat = math.cos(rise)
    return {
        "title": export.terrain.sketch.name,
        "columns": grid.columns,
        "rows": grid.rows,
        "step": STEP,
        "levels": LEVELS,
        "west": grid.west,
        "south": grid.south,
        "size": [grid.east - grid.west, grid.north - grid.south],
        "low": scale.low,
        "metres": scale.step,
        "sea": export.terrain.sea_level,
        "eye": view.eye,
        "target": view.target,
        "fov": view.fov,
        "toSun": [flat * math.sin(bearing), flat * math.cos(bearing), math.sin(rise)],
        "sunlight": view.sunlight.tolist(),
        "harmonics": view.harmonics.tolist(),
        "sky": view.sky,
        "haze": [*view.haze.tolist(), view.haze_height],
        "air": [*view.air.tolist(), view.air_height],
        "exposure": view.exposure,
        "weather": view.weather,
        "kernels": {name: source(f"render/{name}.glsl") for name in _KERNELS},
    }


def _ground(export: Export, scale: HeightQuantisation, facts: dict[str, Any]) -> dict[Path, str]:
    """Write heights level by level, weights of the materials that there are, and their textures."""
    from sketchterrain.export.gltf import material_levels

    samples, terrain = export.samples, export.terrain
    present = np.flatnonzero(samples.weights.reshape(-1, samples.weights.shape[-1]).any(axis=0))
    weights = four_bit_weights(padded(samples.weights[..., present]))
    coarsest, *finer = height_levels(padded(scale.encode(samples.height)))
    layers = list(terrain.materials.layers.values())
    levels = material_levels(terrain, _TEXELS)
    facts["materials"] = [
        {
            "name": layers[k].name,
            "width": layers[k].width,
            "bump": layers[k].bump,
            "octaves": layers[k].octaves,
            "roughness": float(levels[-1][1][k, 0, 0, 2]) / 255.0,
        }
        for k in present.tolist()
    ]
    folder = export.folder
    coarse = {"heights": coarsest, "weights": weights[:, ::STEP, ::STEP]}
    written = {write_data(folder / "coarse.js", coarse): "heights and materials, every eighth vertex"}
    textures = {"webp": texture_strip(levels, present)}
    written[write_data(folder / "textures.js", textures)] = "textures of the materials"
    for number, rest in enumerate(finer[:-1], start=1):
        written[write_data(folder / f"heights{number}.js", {"rest": rest})] = "heights, a finer level"
    painted = {} if samples.appearance is None else {"painted": np.moveaxis(padded(samples.appearance), -1, 0)}
    written[write_data(folder / "weights.js", {"weights": weights} | painted)] = "weights of the materials"
    written[write_data(folder / f"heights{LEVELS}.js", {"rest": finer[-1]})] = "heights, the finest level"
    return written


def _objects(export: Export, facts: dict[str, Any]) -> dict[Path, str]:
    """Write waters, and roads and what is built, as meshes in centimetres from the grid's corner."""
    from sketchterrain.export.gltf import object_colour
    from sketchterrain.export.mesh import built_meshes, object_meshes

    waters = list(object_meshes(export.terrain.features, export.samples))
    built = list(built_meshes(export.terrain, export.grid))
    names = list(dict.fromkeys(each.material for each in built))
    facts["colours"] = [object_colour(name, export.terrain) for name in names]
    written = {}
    for name, meshes, what in (("water", waters, "waters"), ("built", built, "roads and what is built")):
        if meshes:
            arrays = _mesh_arrays(meshes, export.grid)
            if name == "built":
                counts = [len(each.position) for each in meshes]
                arrays["material"] = np.repeat([names.index(each.material) for each in meshes], counts)
                arrays["material"] = arrays["material"].astype(np.uint8)
            written[write_data(export.folder / f"{name}.js", arrays)] = what
    return written


def _mesh_arrays(meshes: Iterable[ObjectMesh], grid: SampleGrid) -> dict[str, np.ndarray]:
    first, triangles, places = 0, [], []
    for each in meshes:
        triangles.append(each.triangles.ravel() + np.uint32(first))
        places.append(each.position - (grid.west, grid.south, 0.0))
        first += len(each.position)
    whole = np.rint(_CENTIMETRES * np.concatenate(places).T).astype(np.int32)
    return {"x": whole[0], "y": whole[1], "z": whole[2], "triangles": np.concatenate(triangles)}


def _plants(export: Export, facts: dict[str, Any]) -> dict[Path, str]:
    """Write plants by cells of the ground, within a cell by model, and their models at two levels of detail."""
    facts["models"], facts["plants"] = [], {"count": 0, "of": 0}
    if not export.options.plants:
        return {}
    from sketchterrain.export.gltf_plants import collect_plants

    plants = collect_plants(export, _AXES)
    grid, count = export.grid, len(plants.model)
    share = (plants.position[:, :2] - (grid.west, grid.south)) / (grid.east - grid.west, grid.north - grid.south)
    place = np.clip(np.rint(share * _STEPS), 0, _STEPS).astype(np.int64)
    chance = (place[:, 0] * 40503 ^ place[:, 1] * 30011) & _STEPS  # the order in which distant plants are left out
    kinds, model = np.unique(plants.model, return_inverse=True)
    cell = place * _CELLS >> 16
    order = np.lexsort((chance, model, cell[:, 0], cell[:, 1]))
    order = order[np.sort(np.argsort(chance[order], kind="stable")[:_MAX_PLANTS])]
    facts["plants"] = {"count": len(order), "of": count}
    if not count:
        return {}
    largest = float(plants.scale.max())
    turns = np.mod(plants.rotation[order] / (2.0 * np.pi), 1.0)
    arrays = {
        "x": place[order, 0].astype(np.uint16),
        "y": place[order, 1].astype(np.uint16),
        "model": model[order].astype(np.uint8),
        "scale": np.rint(255.0 / largest * plants.scale[order]).astype(np.uint8),
        "turn": (np.rint(256.0 * turns).astype(np.int64) % 256).astype(np.uint8),
    }
    facts["largestPlant"] = largest
    models = _models(plants, kinds.tolist(), facts["models"])
    return {
        write_data(export.folder / "models.js", models): "models of plants",
        write_data(export.folder / "foliage.js", arrays): "plants",
    }


def _models(plants: PlantInstances, kinds: list[int], facts: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    from sketchterrain.export.gltf_plants import FINEST, model_mesh

    parts = []
    for kind in kinds:
        levels = [model_mesh(plants, kind, FINEST + level) for level in (0, 1)]
        size = float(max(np.abs(each.position).max() for each in levels))
        facts.append({"size": size, "vertices": [len(each.position) for each in levels]})
        for each in levels:
            east, up, south = each.position.T / size
            normal = np.stack([each.normal[:, 0], -each.normal[:, 2], each.normal[:, 1]])
            colour = np.sqrt(each.colour[:, :3].T / _STEPS)
            parts.append(
                (
                    np.rint(32767.0 * np.stack([east, -south, up])).astype(np.int16),
                    np.rint(127.0 * normal).astype(np.int8),
                    np.rint(255.0 * colour).astype(np.uint8),
                )
            )
    names = ("position", "normal", "colour")
    return {name: np.concatenate(column, axis=1) for name, column in zip(names, zip(*parts, strict=True), strict=True)}


def _surroundings(export: Export, facts: dict[str, Any]) -> dict[Path, str]:
    """Write the ground beyond the grid: rings around its border, ever farther apart, with their mean colour."""
    from sketchterrain.export.gltf import bake_colour, material_appearance

    grid, terrain = export.grid, export.terrain
    middle = np.array([grid.west + grid.east, grid.south + grid.north]) / 2.0
    half = np.array([grid.east - grid.west, grid.north - grid.south]) / 2.0
    turn = np.linspace(0.0, 8.0, _AROUND, endpoint=False)
    # Around a square from its north-east corner, counter-clockwise.
    x = np.interp(turn, [0, 2, 4, 6, 8], [1, -1, -1, 1, 1])
    y = np.interp(turn, [0, 2, 4, 6, 8], [1, 1, -1, -1, 1])
    growth = 1.0 + (_REACH - 1.0) * np.expm1(6.0 * np.linspace(0.0, 1.0, _RINGS)) / np.expm1(6.0)
    border = half * np.stack([x, y], axis=-1)
    place = middle + growth[:, None, None] * border
    height = terrain.heights(place[..., 0], place[..., 1])
    corner, far = middle - _REACH * half, middle + _REACH * half
    wide = SampleGrid(corner[0], corner[1], far[0], far[1], 257, 257)
    samples = sample_terrain(terrain, wide)
    colour = bake_colour(samples, 1, material_appearance(terrain))
    column, row = (np.rint((place - corner) / (far - corner) * 256.0).astype(int)).transpose(2, 0, 1)
    low, high = float(height.min()), float(height.max())
    facts["surroundings"] = {
        "rings": _RINGS,
        "around": _AROUND,
        "growth": np.round(growth, 6).tolist(),
        "low": low,
        "metres": (high - low) / _STEPS,
    }
    numbers = np.rint((height - low) / max(high - low, 1e-3) * _STEPS).astype(np.uint16)
    arrays = {"height": numbers, "colour": np.moveaxis(colour[256 - row, column], -1, 0)}
    return {write_data(export.folder / "surroundings.js", arrays): "ground beyond the page's"}


TARGETS: Final = (
    Target(
        name="web",
        title="Web page",
        summary="a page for any browser: terrain, water, plants and light, without network or server",
        write=_write_web,
        check=_check,
        disk=24.0,
        memory=100.0,
        bytes_per_plant=16.0,
        scene=True,
    ),
)
