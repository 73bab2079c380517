"""Plain formats: raw numbers, 16-bit PNG, OpenEXR and NumPy arrays."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from sketchterrain.errors import InputError
from sketchterrain.export.engines import requested_storeys, write_tiles
from sketchterrain.export.files import write_values_png
from sketchterrain.export.foliage_files import FoliageOptions, plant_pieces, write_foliage
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.rasters import (
    npy_rows,
    weights_suffix,
    write_exr,
    write_normals_and_weights,
    write_npy,
    write_raw,
)
from sketchterrain.export.roads import write_road_masks
from sketchterrain.export.sampled import CHANNELS, TerrainSamples
from sketchterrain.export.target import (
    NAMED_TILES,
    Export,
    ExportOptions,
    ExportOutput,
    Target,
    TileWindow,
    Tiling,
)
from sketchterrain.export.vectors import land_entries, write_features
from sketchterrain.vegetation.plants import PLANT

_TILE_OPTIONS = NAMED_TILES | {"overlap"}
_AXES = "x east, y north, z up, metres from the sketch's south-west corner"
_DTYPES = {"r16": "<u2", "r16be": ">u2", "r32": "<f4"}
_METRES = {"numbers": "float32", "metres": "number"}
_QUANTISED = frozenset({"r16", "r16be"})


def _check_raw(options: ExportOptions) -> None:
    if options.heights is not None and options.format not in {None, *_QUANTISED}:
        raise InputError(f"raw: {options.format} has heights in metres, only 16-bit numbers have a range")


def _write_raw(export: Export) -> ExportOutput:
    form = str(export.options.format)
    order = "big-endian" if _DTYPES[form].startswith(">") else "little-endian"
    settings = {"Byte Order": order, "Header": "0 bytes", "First Row": "north"}
    write, facts = partial(write_raw, dtype=_DTYPES[form]), {"byte_order": order}
    return _write_images(export, f".{form[:3]}", write, facts, settings, quantised=form in _QUANTISED)


def _write_png16(export: Export) -> ExportOutput:
    settings = {"Colour Space": "linear, non-colour data"}
    return _write_images(export, ".png", write_values_png, {}, settings, quantised=True)


def _write_exr(export: Export) -> ExportOutput:
    settings = {"Colour Space": "linear, non-colour data", "Channel": "Y"}
    return _write_images(export, ".exr", lambda path, height: write_exr(path, {"Y": height}), {}, settings)


def _write_images(
    export: Export,
    suffix: str,
    write: Callable[[Path, Any], Path],
    facts: dict[str, Any],
    settings: dict[str, str],
    *,
    quantised: bool = False,
) -> ExportOutput:
    """Write heights in a format, normals and weights as images, plants as a table."""
    names = export.terrain.material_names
    steps: HeightQuantisation | None = None
    if quantised:
        steps = HeightQuantisation.from_heights(export.samples.height, export.options.heights)

    def write_tile(tile: TileWindow, samples: TerrainSamples) -> dict[Path, str]:
        stem = export.folder / export.tiling.tile_name(export.name, tile)
        numbers = samples.height if steps is None else steps.encode(samples.height)
        path = write(stem.with_name(f"{stem.name}_height{suffix}"), numbers)
        return {path: "heights"} | write_normals_and_weights(stem, samples, names)

    files = write_tiles(export, "files", "Writing files", write_tile)
    materials = [
        {
            "name": name,
            "files": f"*_{weights_suffix(index)}.png",
            "channel": CHANNELS[index % len(CHANNELS)],
        }
        for index, name in enumerate(names)
    ]
    if export.options.plants:
        foliage = FoliageOptions("both" if export.options.grass else "csv", export.options.grass)
        with export.stages.stage("plants", "Plants") as progress:
            bounds = export.grid.bounds
            result = write_foliage(export.folder, export.terrain, bounds, foliage, progress=progress)
        what = {".csv": "trees and shrubs, a line each", ".ply": "plants, grass too, as a point cloud"}
        files |= {path: what[path.suffix] for path in result.files}
    files |= _write_features(export) | write_road_masks(export)
    first = next(export.tiling.tiles(export.grid.columns, export.grid.rows))
    across, up = export.grid.spacing
    common: dict[str, Any] = {
        "Width": first.columns,
        "Height": first.rows,
        "Spacing": {"X": across, "Y": up},
    }
    if steps is None:
        common |= {"Numbers": "float32, m"}
    else:
        common |= {"Numbers": "uint16", "Metres of 0": steps.low, "Metres of 65535": steps.highest}
    facts |= {"heights": _METRES if steps is None else steps.metadata, "axes": _AXES, "materials": materials}
    return ExportOutput(files, common | settings, facts)


def _write_npy(export: Export) -> ExportOutput:
    def write_tile(tile: TileWindow, samples: TerrainSamples) -> dict[Path, str]:
        name = export.tiling.tile_name(export.name, tile)
        arrays: dict[str, tuple[Any, str]] = {
            "height": (samples.height, "heights, float32 (rows, columns), m"),
            "normal": (
                samples.normal,
                "normals east, north, up, uint8 (rows, columns, 3); value / 127.5 - 1",
            ),
            "materials": (samples.weights, "weights, uint8 (rows, columns, materials), sum 255"),
        }
        return {
            write_npy(export.folder / f"{name}_{what}.npy", values): description
            for what, (values, description) in arrays.items()
        }

    files = write_tiles(export, "files", "Writing files", write_tile)
    if export.options.plants:
        path = export.folder / "foliage.npy"
        with export.stages.stage("plants", "Plants") as progress, npy_rows(path, PLANT) as add:
            for storey in requested_storeys(export.options):
                for plants in plant_pieces(export.terrain, export.grid.bounds, storey, progress):
                    add(plants)
        files[path] = "plants, a structured array; species are indices into the sidecar's species"
    files |= _write_features(export) | write_road_masks(export)
    facts = {
        "heights": _METRES,
        "byte_order": "little-endian",
        "axes": _AXES,
        "materials": list(export.terrain.material_names),
        "species": list(export.terrain.species_names),
    }
    return ExportOutput(files, {"Read With": "numpy.load"}, facts)


def _write_features(export: Export) -> dict[Path, str]:
    terrain = export.terrain
    paths = write_features(export.folder, terrain.features, land_entries(terrain.sketch))
    what = "mountains, hills, forests; rivers, lakes, roads, land use; the level of the sea"
    return dict.fromkeys(paths, what)


TARGETS = (
    Target(
        name="raw",
        title="Raw numbers",
        summary="heights as 16-bit or float32 numbers without a header, row after row",
        write=_write_raw,
        formats=("r16", "r32", "r16be"),
        options=_TILE_OPTIONS | {"format", "heights"},
        tiling=Tiling(),
        check=_check_raw,
    ),
    Target(
        name="png16",
        title="PNG, 16 bits",
        summary="heights as 16-bit greyscale PNG",
        write=_write_png16,
        options=_TILE_OPTIONS | {"heights"},
        tiling=Tiling(),
    ),
    Target(
        name="exr",
        title="OpenEXR",
        summary="heights in metres as float32 OpenEXR",
        write=_write_exr,
        options=_TILE_OPTIONS,
        tiling=Tiling(),
    ),
    Target(
        name="npy",
        title="NumPy",
        summary="heights, normals, weights and plants as NumPy arrays",
        write=_write_npy,
        options=_TILE_OPTIONS,
        tiling=Tiling(),
    ),
)
