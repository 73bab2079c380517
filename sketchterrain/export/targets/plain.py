"""Plain formats: raw numbers, 16-bit PNG, OpenEXR and NumPy arrays, for whatever reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.export.features import write_features
from sketchterrain.export.files import write_values_png
from sketchterrain.export.foliage_files import FoliageFiles, write_foliage
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.images import ground_images, weights_suffix
from sketchterrain.export.rasters import npy_rows, write_exr, write_npy, write_raw
from sketchterrain.export.sampled import Sampled
from sketchterrain.export.target import Export, ExportOptions, Target, Written
from sketchterrain.export.tiling import Tiling
from sketchterrain.export.weights import CHANNELS
from sketchterrain.terrain.plant import PLANT

Heights = npt.NDArray[np.float32]
_TILED = frozenset({"tiles", "overlap", "tile_name", "tile_first", "tiles_from_south"})
_AXES = "x east, y north, z up, metres from the sketch's south-west corner"
_KINDS = {"r16": "<u2", "r16be": ">u2", "r32": "<f4"}
_IN_STEPS = frozenset({"r16", "r16be"})


def _check_raw(options: ExportOptions) -> None:
    if options.heights is not None and options.format not in {None, *_IN_STEPS}:
        raise InputError(f"raw: {options.format} has heights in metres, only 16-bit numbers have a range")


def _write_raw(export: Export) -> Written:
    form = str(export.options.format)
    kind = _KINDS[form]
    steps = _steps(export) if form in _IN_STEPS else None

    def write(path: Path, height: Heights) -> Path:
        numbers = height if steps is None else steps.encode(height)
        return write_raw(path.with_name(f"{path.name}.{form[:3]}"), numbers, kind)

    order = "big-endian" if kind.startswith(">") else "little-endian"
    settings = {"Byte Order": order, "Header": "0 bytes", "First Row": "north"}
    return _images(export, write, steps, {"byte_order": order}, settings)


def _write_png16(export: Export) -> Written:
    steps = _steps(export)

    def write(path: Path, height: Heights) -> Path:
        return write_values_png(path.with_name(f"{path.name}.png"), steps.encode(height))

    return _images(export, write, steps, {}, {"Colour Space": "linear, non-colour data"})


def _write_exr(export: Export) -> Written:
    def write(path: Path, height: Heights) -> Path:
        return write_exr(path.with_name(f"{path.name}.exr"), {"Y": height})

    return _images(export, write, None, {}, {"Colour Space": "linear, non-colour data", "Channel": "Y"})


def _steps(export: Export) -> HeightSteps:
    return HeightSteps.of(export.sampled.height, export.options.heights)


def _images(
    export: Export,
    write: Callable[[Path, Heights], Path],
    steps: HeightSteps | None,
    facts: dict[str, Any],
    settings: dict[str, str],
) -> Written:
    """Write heights as a format has them, normals and weights as images, plants as a table."""
    files: dict[Path, str] = {}
    names = export.terrain.material_names
    with export.stages.stage("files", "Writing files") as tell:
        for share, stem, part in _parts(export):
            files[write(stem.with_name(f"{stem.name}_height"), part.height)] = "heights"
            files |= ground_images(stem, part, names)
            tell(share)
    materials = [
        {
            "name": name,
            "files": f"*_{weights_suffix(index)}.png",
            "channel": CHANNELS[index % len(CHANNELS)],
        }
        for index, name in enumerate(names)
    ]
    files |= _plant_table(export) | _features(export)
    facts |= {"heights": _height_facts(steps), "axes": _AXES, "materials": materials}
    return Written(files, _image_settings(export, steps) | settings, facts)


def _height_facts(steps: HeightSteps | None) -> dict[str, Any]:
    if steps is None:
        return {"numbers": "float32", "metres": "number"}
    return {"numbers": "uint16", **steps.facts}


def _image_settings(export: Export, steps: HeightSteps | None) -> dict[str, Any]:
    """Return what programs ask for that know nothing but numbers."""
    first = next(export.tiling.pieces(export.grid.columns, export.grid.rows))
    across, up = export.grid.spacing
    settings = {"Width": first.columns, "Height": first.rows, "Spacing": {"X": across, "Y": up}}
    if steps is None:
        return settings | {"Numbers": "float32, m"}
    return settings | {"Numbers": "uint16", "Metres of 0": steps.low, "Metres of 65535": steps.highest}


def _write_npy(export: Export) -> Written:
    files: dict[Path, str] = {}
    with export.stages.stage("files", "Writing files") as tell:
        for share, stem, part in _parts(export):
            for what, values, line in (
                ("height", part.height, "heights, float32 (rows, columns), m"),
                (
                    "normal",
                    part.normal,
                    "normals east, north, up, uint8 (rows, columns, 3); value / 127.5 - 1",
                ),
                ("materials", part.weights, "weights, uint8 (rows, columns, materials), sum 255"),
            ):
                files[write_npy(stem.with_name(f"{stem.name}_{what}.npy"), values)] = line
            tell(share)
    files |= _plant_rows(export) | _features(export)
    facts = {
        "heights": _height_facts(None),
        "byte_order": "little-endian",
        "axes": _AXES,
        "materials": list(export.terrain.material_names),
        "species": list(export.terrain.species_names),
    }
    return Written(files, {"Read With": "numpy.load"}, facts)


def _parts(export: Export) -> list[tuple[float, Path, Sampled]]:
    """Return the tiles: how much is done with each, its path without an ending, and what it holds."""
    pieces = list(export.tiling.pieces(export.grid.columns, export.grid.rows))
    return [
        (
            number / len(pieces),
            export.folder / export.tiling.name(export.name, piece),
            export.sampled.part(piece.left, piece.top, piece.columns, piece.rows),
        )
        for number, piece in enumerate(pieces, start=1)
    ]


def _plant_table(export: Export) -> dict[Path, str]:
    if not export.options.plants:
        return {}
    wanted = FoliageFiles("both" if export.options.grass else "csv", export.options.grass)
    with export.stages.stage("plants", "Plants") as tell:
        written = write_foliage(export.folder, export.terrain, export.grid.area, wanted, progress=tell)
    what = {".csv": "trees and shrubs, a line each", ".ply": "plants, grass too, as a point cloud"}
    return {path: what[path.suffix] for path in written.files}


def _plant_rows(export: Export) -> dict[Path, str]:
    if not export.options.plants:
        return {}
    path = export.folder / "foliage.npy"
    _, south, _, north = export.grid.area
    with export.stages.stage("plants", "Plants") as tell, npy_rows(path, PLANT) as add:
        for storey in ("woody", "grass") if export.options.grass else ("woody",):
            for plants in export.terrain.foliage_pieces(*export.grid.area, storey=storey):
                add(plants)
                if len(plants):  # they come in rows from south to north
                    tell(float(plants["y"].max() - south) / (north - south))
    return {path: "plants, a structured array; species are indices into the sidecar's species"}


def _features(export: Export) -> dict[Path, str]:
    paths = write_features(export.folder, export.terrain.features)
    return dict.fromkeys(paths, "mountains, hills, forests; rivers as centrelines, lakes as outlines")


_TILING = Tiling(overlap=1)
TARGETS = (
    Target(
        name="raw",
        title="Raw numbers",
        line="heights as 16-bit or float32 numbers without a header, row after row",
        write=_write_raw,
        formats=("r16", "r32", "r16be"),
        knows=_TILED | {"format", "heights"},
        tiling=_TILING,
        check=_check_raw,
    ),
    Target(
        name="png16",
        title="PNG, 16 bits",
        line="heights as 16-bit greyscale PNG",
        write=_write_png16,
        knows=_TILED | {"heights"},
        tiling=_TILING,
    ),
    Target(
        name="exr",
        title="OpenEXR",
        line="heights in metres as float32 OpenEXR",
        write=_write_exr,
        knows=_TILED,
        tiling=_TILING,
    ),
    Target(
        name="npy",
        title="NumPy",
        line="heights, normals, weights and plants as NumPy arrays",
        write=_write_npy,
        knows=_TILED,
        tiling=_TILING,
    ),
)
