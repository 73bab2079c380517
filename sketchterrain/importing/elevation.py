"""Sketches on real elevation: place, size and climate from DEM files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.parameters import GROUND, SKETCH
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import DEFAULT_SIDE, Sketch
from sketchterrain.document.toml_format import starter_sketch
from sketchterrain.elevation.base import BaseElevation, combine_rasters, grid_at
from sketchterrain.elevation.grids import SUFFIXES, ElevationGrid, SketchFrame
from sketchterrain.errors import InputError, one_line
from sketchterrain.importing.vector_files import metric_crs_at, to_longitude_latitude
from sketchterrain.io.crs import crs_text, parse_crs, parse_metric_crs
from sketchterrain.io.files import wrap_read_errors

_MAX_SIDE: Final = 2048  # px of the sketch, of which each is a step of the data where that is allowed
_SEA_SHARE: Final = 0.01  # of the rim that is no higher than 0 m beside a sea
_RIM_POINTS: Final = 1024
_WHOLE_METRES: Final = 100.0  # m: corners of larger sketches are at whole metres
# Tree lines fall from 3800 m in the tropics to 0 m at 70° (Körner 2012); snow lies 800 m above them.
_TREE_LINE, _TROPICS, _NO_TREES, _SNOW_ABOVE = 3800.0, 30.0, 70.0, 800.0


class ElevationSketch(NamedTuple):
    """An empty sketch on real elevation."""

    sketch: Sketch
    base: BaseElevation  # in the sketch's CRS, not from its corner
    findings: tuple[str, ...]


def sketch_on_elevation(
    sources: Sequence[RasterSource],
    *,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    extent: float | None = None,
    vertical: str = "",
) -> ElevationSketch:
    """Return an empty sketch whose ground is that of DEM files, as large as they allow.

    Parameters
    ----------
    sources
        Elevation rasters, at least one.
    crs
        Metric CRS of the sketch; by default that of the first file, or its UTM zone.
    origin
        South-west corner in it (m); by default the largest rectangle inside of all data is taken.
    extent
        Longer side (m), in the middle of that rectangle; by default all of it.
    vertical
        Vertical datum of the sketch.

    Raises
    ------
    InputError
        If a file cannot be read, or no data are where the sketch would be.
    """
    memory = LRUCache()
    if crs is not None:
        parse_metric_crs(crs)
    else:
        first = grid_at(sources[0], SketchFrame("EPSG:4326"))
        crs = crs_text(metric_crs_at(parse_crs(first.crs), _middle(first))) if first.crs else ""
    base = combine_rasters(sources, SketchFrame(crs), memory, vertical=vertical)
    west, south, width, depth = _placed_area(base, origin, extent)
    step = min(each.patches.step for each in base.grids)
    shape, pixel = _canvas(width, depth, step)
    findings = list(base.findings)
    along_rim = _rim(west, south, shape[1] * pixel, shape[0] * pixel)
    height = base.heights(*along_rim, 2.0 * step).height
    if not np.isfinite(height).any():
        raise InputError(f"no elevation where the sketch would be: its corner is at {west:.0f}, {south:.0f}")
    fields: dict[str, Any] = {"ground": {"relief": _relief(base, (west, south, width, depth), step)}}
    if np.mean(height <= 0.0) > _SEA_SHARE:
        fields["coast"] = {"sea_level": 0.0}
        findings.append("heights of 0 m and less at the rim: taken for a sea, [coast] sea_level = 0")
    if crs:
        middle = np.array([[west + 0.5 * width, south + 0.5 * depth]])
        latitude = float(to_longitude_latitude(parse_crs(crs), middle)[0][1])
        fields |= {"climate": _climate(latitude), "weather": {"latitude": round(latitude, 2)}}
    sketch = Sketch(
        name=Path(sources[0].path).name.partition(".")[0][:200] or "Untitled",
        extent=max(shape) * pixel,
        frame={"crs": crs, "east": west, "north": south, "vertical": vertical},
        layers={"mountain": np.zeros(shape, np.uint8)},
        labels=starter_sketch().labels,
        rasters=tuple(sources),
        **fields,
    )
    return ElevationSketch(sketch, base, tuple(findings))


def _placed_area(
    base: BaseElevation, origin: tuple[float, float] | None, extent: float | None
) -> tuple[float, float, float, float]:
    """Return the south-west corner (m), width and depth of a sketch; see `sketch_on_elevation`."""
    west, south, east, north = _whole_area(base)
    if min(east - west, north - south) > _WHOLE_METRES:
        west, south, east, north = math.ceil(west), math.ceil(south), math.floor(east), math.floor(north)
    longest = float(SKETCH["extent"].high) if extent is None else extent
    width, depth = min(east - west, longest), min(north - south, longest)
    if origin is None:
        origin = west + 0.5 * (east - west - width), south + 0.5 * (north - south - depth)
    return *origin, width, depth


def _canvas(width: float, depth: float, step: float) -> tuple[tuple[int, int], float]:
    """Return the rows and columns of a sketch within a size (m), and the side of its pixels (m)."""
    longer = max(width, depth)
    count = min(max(round(longer / step), DEFAULT_SIDE), _MAX_SIDE)
    rows, columns = (max(math.floor(side * count / longer + 1e-6), 1) for side in (depth, width))
    return (rows, columns), longer / count


def elevation_files(paths: Iterable[Path]) -> list[Path]:
    """Return files, and those of elevation in folders; raise InputError for a folder without any."""
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        with wrap_read_errors(path):
            inside = sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES)
        if not inside:
            raise InputError(f"{one_line(path)}: no elevation in it: expected files {', '.join(SUFFIXES)}")
        found += inside
    return found


def _middle(grid: ElevationGrid) -> tuple[float, float]:
    """Return the middle of a grid in its own CRS."""
    a, b, c, d, e, f = grid.place
    row, column = (0.5 * (each - 1) for each in grid.samples.shape)
    return a * column + b * row + c, d * column + e * row + f


def _climate(latitude: float) -> dict[str, float]:
    """Return the tree line and the snow line (m) at a latitude."""
    share = (_NO_TREES - abs(latitude)) / (_NO_TREES - _TROPICS)
    tree_line = 50.0 * round(_TREE_LINE * min(max(share, 0.0), 1.0) / 50.0)
    return {"tree_line": tree_line, "snow_line": tree_line + _SNOW_ABOVE}


def _relief(base: BaseElevation, area: tuple[float, float, float, float], step: float) -> float:
    """Return the mean relief (m) of the data: ground in voids and around them is as rugged."""
    west, south, width, depth = area
    wavelength = float(GROUND["wavelength"].default)
    cell = max(step, wavelength / 8.0, max(width, depth) / 256.0)
    x, y = np.meshgrid(np.arange(west, west + width, cell), np.arange(south, south + depth, cell))
    height = base.heights(x, y, cell).height
    side = max(round(wavelength / cell), 3)
    local = ndimage.maximum_filter(height, side) - ndimage.minimum_filter(height, side)
    relief = float(np.nanmean(local)) if np.isfinite(local).any() else 0.0
    return min(max(10.0 * round(relief / 10.0), 10.0), float(GROUND["relief"].high))


def _rim(west: float, south: float, width: float, depth: float) -> tuple[Any, Any]:
    """Return points (m) along the rim of a rectangle."""
    t = np.linspace(0.0, 1.0, _RIM_POINTS // 4, endpoint=False)
    zero, one = np.zeros_like(t), np.ones_like(t)
    x, y = np.concatenate([t, one, 1.0 - t, zero]), np.concatenate([zero, t, one, 1.0 - t])
    return west + x * width, south + y * depth


def _whole_area(base: BaseElevation) -> tuple[float, float, float, float]:
    """Return the largest rectangle (west, south, east, north) in which the data have their whole weight."""
    fade = base.fade
    nodes: Float64Array = fade.spacing * np.indices(fade.coefficients.shape, np.float64)
    weight = base.weight(fade.west + nodes[1], fade.south + nodes[0])
    row, column, height, width = _largest_rectangle(weight > 1.0 - 1e-9)
    if not (height > 1 and width > 1):
        raise InputError(
            "the elevation data are too small, or too full of voids, for a sketch inside of them"
        )
    west, south = fade.west + fade.spacing * column, fade.south + fade.spacing * row
    return west, south, west + fade.spacing * (width - 1), south + fade.spacing * (height - 1)


def _largest_rectangle(inside: BoolArray) -> tuple[int, int, int, int]:
    """Return first row and column, rows and columns of the largest rectangle of set nodes, voids filled."""
    best, found = 0, (0, 0, 0, 0)
    rising = np.zeros(inside.shape[1] + 1, np.int64)  # set nodes up to this row; a last column ends all runs
    for row, line in enumerate(ndimage.binary_fill_holes(inside)):
        rising[:-1] = (rising[:-1] + 1) * line
        starts: list[tuple[int, int]] = []  # columns where rectangles of rising heights start
        for column, height in enumerate(rising.tolist()):
            start = column
            while starts and starts[-1][1] >= height:
                start, top = starts.pop()
                if top * (column - start) > best:
                    best, found = top * (column - start), (row + 1 - top, start, top, column - start)
            starts.append((start, height))
    return found
