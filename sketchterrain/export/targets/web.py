"""Web page: a folder that any browser shows, from a server or by a double click."""

from __future__ import annotations

import io
import json
import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.array_types import UInt8Array
from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.sampled import SampleGrid, sample_terrain, srgb_of
from sketchterrain.export.target import Export, ExportOptions, ExportOutput, Target
from sketchterrain.io.files import write_atomic
from sketchterrain.io.resources import source
from sketchterrain.schema.colours import srgb_to_linear

if TYPE_CHECKING:
    from sketchterrain.export.gltf_plants import ScenePlants
    from sketchterrain.export.mesh import ObjectMesh


FORMAT: Final = 1  # of the data scripts, as in web/viewer.js
LEVELS: Final = 3  # of heights that are finer than the coarsest
STEP: Final = 1 << LEVELS  # vertices between those of the coarsest
_WHOLE: Final = 15  # sum of a vertex's weights
_QUALITY: Final = 85  # of WebP

UInt16Array = npt.NDArray[np.uint16]


def write_data(path: Path, arrays: Mapping[str, npt.NDArray[Any]], facts: Mapping[str, Any]) -> Path:
    """Write facts and arrays as a script, since no page may fetch files from a folder.

    An array is its bytes in planes of equal significance, of the numbers or of their differences, whichever
    is smaller, deflated and in base64.
    """
    entries = []
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values).ravel()
        steps = np.diff(flat, prepend=flat.dtype.type(0))
        plain, differences = (zlib.compress(_byte_planes(each), 9) for each in (flat, steps))
        packed = min(plain, differences, key=len)
        text = b64encode(packed).decode("ascii")
        entries.append([name, flat.dtype.str[1:], flat.size, packed is not plain, text])
    head = ", ".join(json.dumps(each, allow_nan=False) for each in (FORMAT, path.stem, facts))
    lines = ",\n".join(json.dumps(entry) for entry in entries)
    return write_atomic(path, f"sketchterrainData({head}, [\n{lines}\n]);\n".encode())


def _byte_planes(values: npt.NDArray[Any]) -> bytes:
    little = values.astype(values.dtype.newbyteorder("<"))
    return little.view(np.uint8).reshape(-1, values.itemsize).T.tobytes()


def padded(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Repeat the last row and column until their numbers are one more than a multiple of `STEP`."""
    ends = [(0, -(side - 1) % STEP) for side in values.shape[:2]]
    return np.pad(values, ends + [(0, 0)] * (values.ndim - 2), mode="edge")


def height_levels(numbers: UInt16Array) -> list[UInt16Array]:
    """Return the coarsest level of padded numbers, (rows, columns), then the residuals of each finer one.

    Residuals are differences from a cubic through four neighbours: of odd rows in even columns, then of odd
    columns; 0, −1, 1, −2 … are 0, 1, 2, 3 …
    """
    levels = [numbers[::STEP, ::STEP]]
    for level in range(LEVELS - 1, -1, -1):
        fine = numbers[:: 1 << level, :: 1 << level].astype(np.int32)
        rows = fine[1::2, ::2] - _between(fine[::2, ::2])
        columns = fine[:, 1::2] - _between(fine[:, ::2].T).T
        rest = np.concatenate([rows.ravel(), columns.ravel()]).astype(np.int16)
        levels.append((rest << 1 ^ rest >> 15).view(np.uint16))
    return levels


def _between(values: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Interpolate between successive rows in integers, as the viewer does."""
    wide = np.pad(values, [(1, 1), (0, 0)], mode="edge")
    return (9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:] + 8) >> 4


def four_bit_weights(weights: UInt8Array) -> UInt8Array:
    """Return weights of a sum of 255 as (materials, rows, columns) numbers of a sum of 15.

    Sums over the first materials are rounded, so that a weight differs by less than one step.
    """
    upto = np.cumsum(weights, axis=-1, dtype=np.int32)
    steps = np.diff((2 * _WHOLE * upto + 255) // 510, axis=-1, prepend=0)
    return np.moveaxis(steps, -1, 0).astype(np.uint8)


def texture_strip(colour: UInt8Array, tints: npt.NDArray[np.float64]) -> UInt8Array:
    """Return textures (materials, n, n, 4) of √albedo and height as a WebP: tinted colours, then heights."""
    albedo = np.clip((colour[..., :3] / 255.0) ** 2 * tints[:, None, None], 0.0, 1.0)
    pixels = np.concatenate([srgb_of(albedo), np.repeat(colour[..., 3:], 3, axis=-1)], axis=2)
    stream = io.BytesIO()
    Image.fromarray(pixels.reshape(-1, *pixels.shape[2:])).save(stream, "WEBP", quality=_QUALITY, method=4)
    return np.frombuffer(stream.getvalue(), np.uint8)


Arrays = dict[str, npt.NDArray[Any]]
_AXES: Final = EngineAxes("east", "north", "up")
_PAGE: Final = ("index.html", "viewer.js", "ground.js", "plants.js", "camera.js", "shaders.js")
_KERNELS: Final = ("frame", "tone", "tree_light", "water_optics")  # the renderer's shaders that the page uses
_MAX_SIDE: Final = 4097  # vertices, a texture of any graphics card
_MAX_PLANTS: Final = 300_000  # 3 MB
_CELLS: Final = 64  # of plants along a side, as in plants.js
_TEXELS: Final = 256
_LEVELS_OF_PLANTS: Final = (0, 1, 3)  # after the finest: near, farther, shadows
_RINGS, _BAND, _AROUND, _REACH = 56, 11, 384, 6.0  # vertices of the surroundings; their size over the grid's
_CORNERS: Final = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])  # counter-clockwise
_STEPS: Final = 65535


def _check(options: ExportOptions) -> None:
    if (options.size or 0) > _MAX_SIDE:
        raise InputError(f"size = {options.size}: expected at most {_MAX_SIDE} vertices along a page's side")


def _write_web(export: Export) -> ExportOutput:
    scale = HeightQuantisation.from_heights(export.samples.height)
    facts = _scene(export, scale)
    with export.stages.stage("page", "Web page"):
        parts = _ground(export, scale, facts) | _meshes(export) | _plants(export, facts)
        order = sorted(parts, key=lambda name: name in ("weights", f"heights{LEVELS}"))  # the largest last
        written = {write_data(export.folder / f"{name}.js", parts[name], {}): "data" for name in order}
        sky = {"sky": export.scene_view.sky.astype(np.float16).view(np.uint16)}
        written[write_data(export.folder / "scene.js", sky, facts | {"files": order})] = "camera, light, data"
        for name in _PAGE:
            content = files("sketchterrain.export").joinpath("web", name).read_bytes()
            written[write_atomic(export.folder / name, content)] = "the page"
    written[export.folder / "index.html"] = "open it in a browser, or put the folder on a web server"
    entries = {
        "heights": {**scale.metadata, "largest_error": 0.5 * scale.step},
        "axes": _AXES.metadata,
        "plants": facts["plants"],
        "view": export.scene_view.facts,
    }
    settings = {"open": "index.html, by a double click or from any web server; no network is needed"}
    return ExportOutput(written, settings, entries)


def _scene(export: Export, scale: HeightQuantisation) -> dict[str, Any]:
    """Return what the page needs before all else; numbers of the view as they are."""
    view, grid = export.scene_view, export.grid
    given = {name: value for name, value in view._asdict().items() if name not in ("sky", "weather")}
    return {
        "title": export.terrain.sketch.name,
        "grid": {"columns": grid.columns, "rows": grid.rows, "step": STEP, "levels": LEVELS},
        "corner": [grid.west, grid.south],
        "size": [grid.east - grid.west, grid.north - grid.south],
        "low": scale.low,
        "metres": scale.step,
        "sea": export.terrain.sea_level,
        "view": {name: np.asarray(value).tolist() for name, value in given.items()},
        "weather": view.weather,
        "kernels": {name: source(f"render/{name}.glsl") for name in _KERNELS},
    }


def _ground(export: Export, scale: HeightQuantisation, facts: dict[str, Any]) -> dict[str, Arrays]:
    """Return heights level by level, weights of the materials that occur, and their textures."""
    from sketchterrain.export.gltf import material_levels, material_tints

    samples, terrain = export.samples, export.terrain
    present = np.flatnonzero(samples.weights.any(axis=(0, 1)))
    textures = [list(terrain.materials.layers.values())[k] for k in present]
    facts["materials"] = [
        {
            "width": texture.width,
            "bump": texture.bump,
            "coarsest": texture.octaves[1],
            "variations": [
                f"colour *= mix(vec3{each.low}, vec3{each.high}, "
                f"smoothstep({each.start}, {each.full}, {each.noise}));"
                for each in texture.variations
            ],
        }
        for texture in textures
    ]
    colour = material_levels(terrain, _TEXELS)[0][0][present]
    weights = four_bit_weights(padded(samples.weights[..., present]))
    coarsest, *finer = height_levels(padded(scale.encode(samples.height)))
    painted = {} if samples.appearance is None else {"painted": padded(samples.appearance)}
    return {
        "coarse": {"heights": coarsest, "weights": weights[:, ::STEP, ::STEP]},
        "textures": {"webp": texture_strip(colour, material_tints(terrain)[present])},
        **{f"heights{number}": {"rest": rest} for number, rest in enumerate(finer, start=1)},
        "weights": {"weights": weights} | painted,
    }


def _meshes(export: Export) -> dict[str, Arrays]:
    """Return the meshes of waters, roads and what is built, and of the ground around the grid."""
    from sketchterrain.export.gltf import object_colour
    from sketchterrain.export.mesh import WATER, ObjectMesh, built_meshes, object_meshes

    waters = list(object_meshes(export.terrain.features, export.samples))
    if (level := export.terrain.sea_level) is not None:  # beyond the grid
        middle, half = _square(export.grid)
        x, y = (middle + half * _CORNERS * np.array([[[1.0]], [[_REACH]]])).reshape(-1, 2).T
        inner, outer = np.arange(4), np.arange(4, 8)
        sides = np.stack([inner, outer, np.roll(outer, -1), inner, np.roll(outer, -1), np.roll(inner, -1)])
        place = np.stack([x, y, np.full(8, level)], axis=-1)
        waters.append(ObjectMesh("sea", WATER, place, np.zeros((8, 3)), sides.T.astype(np.uint32)))
    built = list(built_meshes(export.terrain, export.grid))
    meshes = {"surroundings": _surroundings(export)}
    if waters:
        meshes["water"] = _mesh(waters, export.grid)
    if built:
        albedo = {name: object_colour(name, export.terrain) for name in {each.material for each in built}}
        colours = np.repeat(
            [albedo[each.material] for each in built], [len(each.position) for each in built], axis=0
        )
        meshes["built"] = _mesh(built, export.grid) | {"tint": _roots(colours)}
    return meshes


def _mesh(meshes: Sequence[ObjectMesh], grid: SampleGrid) -> Arrays:
    first = np.cumsum([0, *(len(each.position) for each in meshes)]).astype(np.uint32)
    triangles = [each.triangles.ravel() + start for each, start in zip(meshes, first[:-1], strict=True)]
    places = np.concatenate([each.position for each in meshes]) - (grid.west, grid.south, 0.0)
    return _centimetres(places) | {"triangles": np.concatenate(triangles)}


def _centimetres(places: npt.NDArray[np.float64]) -> Arrays:
    return dict(zip("xyz", np.rint(100.0 * places.reshape(-1, 3).T).astype(np.int32), strict=True))


def _roots(albedo: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return √albedo (n, 3) as bytes, a colour after the other."""
    return np.asarray(np.rint(255.0 * np.sqrt(np.clip(albedo, 0.0, 1.0))).T, np.uint8)


def _square(grid: SampleGrid) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the middle of a grid and its halves' sizes."""
    low, high = np.array([grid.west, grid.south]), np.array([grid.east, grid.north])
    return 0.5 * (low + high), 0.5 * (high - low)


def _surroundings(export: Export) -> Arrays:
    """Return the ground beyond the grid as a mesh of rings ever farther apart, with the mean colours."""
    from sketchterrain.export.gltf import bake_colour, material_appearance

    grid, terrain, (middle, half) = export.grid, export.terrain, _square(export.grid)
    share = np.arange(_AROUND // 4)[:, None] / (_AROUND // 4)
    sides = zip(_CORNERS, np.roll(_CORNERS, -1, 0), strict=True)
    border = np.concatenate([first + share * (last - first) for first, last in sides])
    growth = 1.0 + (_REACH - 1.0) * np.expm1(np.linspace(0.0, 6.0, _RINGS)) / np.expm1(6.0)
    rings = growth[:, None, None] * border
    x, y = (middle + half * rings).transpose(2, 0, 1)
    (west, south), (east, north) = (middle - _REACH * half).tolist(), (middle + _REACH * half).tolist()
    wide = sample_terrain(terrain, SampleGrid(west, south, east, north, 257, 257))
    colour = bake_colour(wide, 1, material_appearance(terrain)) / 255.0
    column, row = np.rint(128.0 + 128.0 / _REACH * rings).astype(int).transpose(2, 0, 1)
    index = np.arange(_RINGS * _AROUND, dtype=np.uint32).reshape(_RINGS, _AROUND)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    # No finer than the rings show; at the grid's border as it is.
    apart = [max(grid.spacing), *(8.0 * float(half.max()) / _AROUND * growth[1:])]
    bands = [slice(0, 1), *(slice(first, first + _BAND) for first in range(1, _RINGS, _BAND))]
    z = [terrain.heights(x[band], y[band], cell_size=apart[band.start]) for band in bands]
    place = np.stack([x - grid.west, y - grid.south, np.concatenate(z)], axis=-1)
    return _centimetres(place) | {
        "triangles": np.stack([a, b, c, a, c, d], axis=-1),
        "tint": _roots(srgb_to_linear(colour[256 - row, column].reshape(-1, 3))),
    }


def _plants(export: Export, facts: dict[str, Any]) -> dict[str, Arrays]:
    """Return plants by cells of the grid and in a cell by model, and the models."""
    facts["models"], facts["plants"] = [], {"count": 0, "of": 0}
    if not export.options.plants:
        return {}
    from sketchterrain.export.gltf_plants import collect_plants
    from sketchterrain.look.tree_levels import VARIANTS
    from sketchterrain.vegetation.plants import STOREYS

    plants, grid = collect_plants(export, _AXES), export.grid
    if not len(plants.model):
        return {}
    share = (plants.position[:, :2] - (grid.west, grid.south)) / facts["size"]
    place = np.clip(np.rint(share * _STEPS), 0, _STEPS).astype(np.int64)
    # Plants of a model in a cell are in random order: from far away only the first are drawn.
    chance = (place[:, 0] * 40503 ^ place[:, 1] * 30011) & _STEPS
    kinds, model = np.unique(plants.model, return_inverse=True)
    cell = place * _CELLS >> 16
    grass = np.array([plants.species[kind // VARIANTS] not in STOREYS["woody"] for kind in kinds])
    kept = np.lexsort((chance, grass[model]))[:_MAX_PLANTS]  # trees and shrubs first
    order = kept[np.lexsort((chance[kept], model[kept], cell[kept, 0], cell[kept, 1]))]
    largest = float(plants.scale.max())
    facts["plants"] = {"count": len(order), "of": len(plants.model)}
    facts["largestPlant"] = largest
    turns = np.rint(256.0 / (2.0 * np.pi) * plants.rotation[order]).astype(np.int64) % 256
    foliage = {
        "x": place[order, 0].astype(np.uint16),
        "y": place[order, 1].astype(np.uint16),
        "model": model[order].astype(np.uint8),
        "scale": np.rint(255.0 / largest * plants.scale[order]).astype(np.uint8),
        "turn": turns.astype(np.uint8),
    }
    return {"models": _models(plants, kinds.tolist(), facts["models"]), "foliage": foliage}


def _models(plants: ScenePlants, kinds: list[int], facts: list[dict[str, Any]]) -> Arrays:
    from sketchterrain.export.gltf_plants import FINEST, model_mesh

    parts = []
    for kind in kinds:
        levels = [model_mesh(plants, kind, FINEST + level) for level in _LEVELS_OF_PLANTS]
        size = max(float(np.abs(each.position).max()) for each in levels)
        facts.append({"size": size, "vertices": [len(each.position) for each in levels]})
        for each in levels:
            position, normal = (
                values.T[[0, 2, 1]] * [[1], [-1], [1]] for values in (each.position / size, each.normal)
            )
            whole = np.rint(32767.0 * position).astype(np.int16), np.rint(127.0 * normal).astype(np.int8)
            parts.append((*whole, _roots(each.colour[:, :3] / _STEPS)))
    columns = (np.concatenate(column, axis=1) for column in zip(*parts, strict=True))
    return dict(zip(("corner", "normal", "tint"), columns, strict=True))


TARGETS: Final = (
    Target(
        name="web",
        title="Web page",
        summary="a page for any browser with terrain, water, plants and light, without server or network",
        write=_write_web,
        check=_check,
        disk=24.0,
        memory=100.0,
        bytes_per_plant=16.0,
        scene=True,
    ),
)
