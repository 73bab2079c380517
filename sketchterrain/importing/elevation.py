"""Sketches on real elevation: place, size and climate from DEM files; heights and areas of rasters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import contourpy
import numpy as np
import shapely
from rasterio.warp import transform_bounds
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import DEFAULT_SIDE, Sketch
from sketchterrain.document.toml_format import starter_sketch
from sketchterrain.elevation.base import BaseElevation, combine_rasters, grid_in_datum, held_grids, patches_of
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.offsets import corrections, measure_offsets
from sketchterrain.elevation.pictures import WarpedPicture, picture_file
from sketchterrain.elevation.raster_reader import PLAIN, SUFFIXES
from sketchterrain.errors import InputError, one_line
from sketchterrain.features.files import reproject
from sketchterrain.features.table import AREA, Feature, on_grid
from sketchterrain.importing.vector_files import metric_crs_at, to_longitude_latitude
from sketchterrain.io.crs import crs_text, parse_crs, parse_metric_crs
from sketchterrain.schema.parameters import GROUND, SKETCH
from sketchterrain.stages.runner import Runner

MIN_SAMPLES: Final = 64
"""Fewest samples of a level area."""

_BANKS = 0.9  # share of the samples around that are higher; the others are outlets
_ELONGATED = 12.0  # area by that of its largest circle, from which on a water is a reach of a river
_NEAR = 3  # samples between reaches of one river
_BLOCK = np.ones((3, 3), bool)


class FlatWater(NamedTuple):
    """A level area in higher ground."""

    level: float  # m
    rings: tuple[Float64Array, ...]  # (n, 2), m: border, then islands; the first vertex is not repeated
    area: float  # m²
    is_river: bool  # elongated
    step: float  # m: the least from another reach beside it; NaN without one


class _WaterLevel(NamedTuple):
    height: float
    box: tuple[slice, slice]  # around the region
    region: BoolArray


def flat_waters(grid: ElevationGrid, least: int = MIN_SAMPLES) -> list[FlatWater]:
    """Return level areas of at least some samples, and at least 3 wide, which higher ground surrounds.

    A level area at 0 m that reaches the grid's rim is the sea, and is not returned.
    """
    heights = np.nan_to_num(grid.samples, nan=np.inf)
    level = ndimage.maximum_filter(heights, 3) == ndimage.minimum_filter(heights, 3)
    labels, _ = ndimage.label(level & np.isfinite(heights), _BLOCK)
    marks = np.zeros([n + 2 * _NEAR for n in labels.shape], np.int32)  # of the waters found
    found: list[_WaterLevel] = []
    for label, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        start = max(rows.start - 2, 0), max(columns.start - 2, 0)
        box = slice(start[0], rows.stop + 2), slice(start[1], columns.stop + 2)
        region = ndimage.binary_dilation(labels[box] == label, _BLOCK)
        if np.count_nonzero(region) < least:
            continue
        around = ndimage.binary_dilation(region, _BLOCK) & ~region & np.isfinite(grid.samples[box])
        height = float(heights[box][region][0])
        at_rim = start[0] == 0 or start[1] == 0 or box[0].stop > len(labels) or box[1].stop > labels.shape[1]
        if (at_rim and height == 0.0) or not around.any() or np.mean(heights[box][around] > height) < _BANKS:
            continue
        found.append(_WaterLevel(height, box, region))
        marks[_NEAR:-_NEAR, _NEAR:-_NEAR][box][region] = len(found)
    return [_water(grid, each, found, marks) for each in found]


def water_findings(waters: Sequence[FlatWater]) -> tuple[str, ...]:
    """Return what was found, in words."""
    lakes, reaches = ([each for each in waters if each.is_river is kind] for kind in (False, True))
    told = []
    if lakes:
        area = sum(each.area for each in lakes) / 1e6
        what = "lake" if len(lakes) == 1 else "lakes"
        told.append(f"{len(lakes)} flattened {what} of {area:.3g} km² in all")
    if reaches:
        steps = [each.step for each in reaches if np.isfinite(each.step)]
        text = f", in steps of {min(steps):.3g} to {max(steps):.3g} m" if steps else ""
        told.append(f"{len(reaches)} level reaches of rivers{text}")
    return tuple(told)


def _water(grid: ElevationGrid, water: _WaterLevel, found: list[_WaterLevel], marks: Int32Array) -> FlatWater:
    """Return the outline and facts of a level area; `marks` has the numbers of all, in a margin of zeros."""
    rows, columns = water.box
    padded = np.pad(water.region, 1)
    rings = []
    for line in contourpy.contour_generator(z=padded.astype(np.float64)).lines(0.5):
        column, row = (line[:-1] + np.array([columns.start - 1.0, rows.start - 1.0])).T
        rings.append(np.stack(grid.to_metres(column, row), axis=1))
    areas = []
    for x, y in (ring.T for ring in rings):
        areas.append(0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))))
    order = np.argsort(areas)[::-1]
    widest = float(ndimage.distance_transform_edt(padded).max())
    is_river = np.count_nonzero(padded) > _ELONGATED * np.pi * widest**2
    near = ndimage.binary_dilation(np.pad(water.region, _NEAR), iterations=_NEAR)
    window = marks[rows.start : rows.start + len(near), columns.start : columns.start + near.shape[1]]
    rises = [abs(found[each - 1].height - water.height) for each in np.unique(window[near]) if each]
    step = min((each for each in rises if each), default=np.nan)
    area = 2.0 * max(areas) - sum(areas)
    return FlatWater(water.height, tuple(rings[each] for each in order), area, bool(is_river), step)


_MAX_SIDE: Final = 2048  # px of the sketch, of which each is a step of the data where that is allowed
_SEA_SHARE, _RIM_POINTS = 0.01, 257  # of the rim that is no higher than 0 m beside a sea; along a side
# Tree lines fall from 3800 m in the tropics to 0 m at 70° (Körner 2012); snow lies 800 m above them.
_TREE_LINE, _TROPICS, _NO_TREES, _SNOW_ABOVE = 3800.0, 30.0, 70.0, 800.0


def sketch_on_elevation(
    sources: Sequence[RasterSource],
    *,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    extent: float | None = None,
    vertical: str = "",
    degrees: tuple[float, float, float, float] | None = None,
) -> tuple[Sketch, BaseElevation]:
    """Return an empty sketch on elevation rasters, and their base in its CRS, not from its corner.

    By default its CRS is that of the first raster, or its UTM zone, and it is the largest rectangle in which
    the data have their whole weight, limited to a rectangle of longitudes and latitudes, `degrees`. `extent`
    (m) is the longer side of a part in its middle, or from `origin`. Raise InputError if a file cannot be
    read or the sketch would have no data.
    """
    if crs is not None:
        parse_metric_crs(crs)
    else:
        with grid_in_datum(sources[0], SketchFrame("EPSG:4326"), "") as first:
            a, b, c, d, e, f = first.place
            row, column = (0.5 * (each - 1) for each in first.shape)
            place = a * column + b * row + c, d * column + e * row + f
            crs = crs_text(metric_crs_at(parse_crs(first.crs), place)) if first.crs else ""
    base = combine_rasters(sources, SketchFrame(crs), Runner(), vertical=vertical)
    west, south, east, north = _whole_area(base)
    if degrees is not None and crs:
        outline = shapely.segmentize(shapely.box(*degrees), 0.1)
        x, y = reproject(shapely.get_coordinates(outline), parse_crs("OGC:CRS84"), parse_crs(crs)).T
        west, east = max(west, float(x.min())), min(east, float(x.max()))
        south, north = max(south, float(y.min())), min(north, float(y.max()))
        if not (west < east and south < north):
            raise InputError("the vectors are outside of the elevation")
    longest = float(SKETCH["extent"].high) if extent is None else extent
    width, depth = min(east - west, longest), min(north - south, longest)
    middle = round(0.5 * (west + east - width), 2), round(0.5 * (south + north - depth), 2)
    left, bottom = middle if origin is None else origin
    step = min(each.patches.step for each in base.grids)
    longer = max(width, depth)
    count = min(max(round(longer / step), DEFAULT_SIDE), _MAX_SIDE)
    shape = tuple(max(math.floor(side * count / longer + 1e-6), 1) for side in (depth, width))
    x, y = np.meshgrid(*(np.linspace(0.0, side, _RIM_POINTS) for side in (width, depth)))
    spacing = longer / (_RIM_POINTS - 1)
    height = base.heights(left + x, bottom + y, max(2.0 * step, 0.25 * spacing)).height
    fields: dict[str, Any] = {"ground": {"relief": _relief(height, spacing)}}
    if not np.isfinite(height).any():
        raise InputError(f"no elevation where the sketch would be: its corner is at {left}, {bottom}")
    rim = np.concatenate([height[0], height[-1], height[:, 0], height[:, -1]])
    if np.mean(rim <= 0.0) > _SEA_SHARE:
        fields["coast"] = {"sea_level": 0.0}
        told = "heights of 0 m and less at the rim: taken for a sea, [coast] sea_level = 0"
        base = replace(base, findings=(*base.findings, told))
    if crs:
        fields |= _climate(crs, left + 0.5 * width, bottom + 0.5 * depth)
    sketch = Sketch(
        name=Path(sources[0].path).name.partition(".")[0][:200] or "Untitled",
        extent=longer * max(shape) / count,
        frame={"crs": crs, "east": left, "north": bottom, "vertical": vertical},
        layers={"mountain": np.zeros(shape, np.uint8)},
        labels=starter_sketch().labels,
        rasters=tuple(sources),
        **fields,
    )
    return sketch, base


def aligned(sketch: Sketch) -> Sketch:
    """Return a sketch whose overlapping elevation agrees: the most accurate stays, others get offsets."""
    sources, grids = sketch.elevation_rasters, patches_of(sketch)
    metres = dict(zip(sources, corrections(grids, measure_offsets(grids)), strict=True))

    def raised(source: RasterSource) -> RasterSource:
        change = metres.get(source, 0.0)
        return replace(source, offset=round(source.offset + change, 3)) if abs(change) >= 1e-3 else source

    return sketch.replace(rasters=tuple(map(raised, sketch.rasters)))


def with_lakes(sketch: Sketch) -> tuple[Sketch, tuple[str, ...]]:
    """Return a sketch with the lakes that its elevation has as level areas, and what was found, in words."""
    layer = sketch.vectors["lake"]
    known = {tuple(layer.vertices[first]) for first in layer.rings[:-1]}
    waters = [each for grid in held_grids(sketch) for each in flat_waters(grid)]
    outlines = [tuple(map(on_grid, each.rings)) for each in waters if not each.is_river]
    new = [
        Feature(AREA, rings, 1)
        for rings in outlines
        if tuple(rings[0][0]) not in known and ((rings[0] >= 0.0) & (rings[0] <= sketch.size)).all()
    ]
    vectors = {**sketch.vectors, "lake": layer.edited(add=new)} if new else sketch.vectors
    return sketch.replace(vectors=vectors), water_findings(waters)


def elevation_files(path: Path) -> list[Path]:
    """Return a file, or the files of elevation in a folder; raise InputError for one without any."""
    if not path.is_dir():
        return [path]
    found = sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES)
    # Beside elevation they are previews.
    found = [each for each in found if each.suffix.lower() not in (".png", *PLAIN)] or found
    if not found:
        raise InputError(f"{one_line(path)}: no elevation in it: expected files {', '.join(SUFFIXES)}")
    return found


def _climate(crs: str, x: float, y: float) -> dict[str, Any]:
    """Return the tree line, snow line (m) and latitude of a place, as tables of a sketch."""
    latitude = float(to_longitude_latitude(parse_crs(crs), np.array([[x, y]]))[0][1])
    share = (_NO_TREES - abs(latitude)) / (_NO_TREES - _TROPICS)
    trees = 50.0 * round(_TREE_LINE * min(max(share, 0.0), 1.0) / 50.0)
    climate = {"tree_line": trees, "snow_line": trees + _SNOW_ABOVE}
    return {"climate": climate, "weather": {"latitude": round(latitude, 2)}}


def _relief(height: Float64Array, spacing: float) -> float:
    """Return the mean relief (m) of heights: ground in voids and around them is as rugged."""
    side = max(round(float(GROUND["wavelength"].default) / spacing), 3)
    local = ndimage.maximum_filter(height, side) - ndimage.minimum_filter(height, side)
    known = local[np.isfinite(local)]
    relief = float(known.mean()) if len(known) else 0.0
    return min(max(10.0 * round(relief / 10.0), 10.0), float(GROUND["relief"].high))


def _whole_area(base: BaseElevation) -> tuple[float, float, float, float]:
    """Return the largest rectangle (west, south, east, north) in which the data have their whole weight."""
    fade = base.fade
    nodes: Float64Array = fade.spacing * np.indices(fade.coefficients.shape, np.float64)
    weight = base.weight(fade.west + nodes[1], fade.south + nodes[0])
    row, column, height, width = _largest_rectangle(
        # A node less: the fade of the sketch has other nodes.
        ndimage.minimum_filter(weight, 3) > 1.0 - 1e-9
    )
    if not (height > 1 and width > 1):
        raise InputError("expected more elevation: the data are too small, or too full of voids")
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


_METRES_PER_DEGREE: Final = 111_320.0


class RasterArea(NamedTuple):
    """The area of a georeferenced raster."""

    frame: dict[str, Any]  # of a sketch with the same south-west corner, by the names in `FRAME`
    size: tuple[float, float]  # m eastward and northward


def raster_area(source: RasterSource) -> RasterArea | None:
    """Return the area of a raster, in a UTM zone unless its own CRS is metric; None without a CRS.

    Raise InputError if it cannot be read.
    """
    with picture_file(source) as path:
        picture = WarpedPicture(path, source.band, None)
    if not picture.crs:
        return None
    (west, south, east, north), crs = picture.box, parse_crs(picture.crs)
    target = metric_crs_at(crs, (0.5 * (west + east), 0.5 * (south + north)))
    west, south, east, north = transform_bounds(crs, target, west, south, east, north)
    frame = {"crs": crs_text(target), "east": west, "north": south}
    return RasterArea(frame, (east - west, north - south))


def read_heights(path: Path, cell: float | None = None) -> tuple[Float64Array, float]:
    """Return heights (rows, columns), m, north up, NaN where unknown, and the side of a cell, m.

    A raster in degrees is resampled along its rows to square cells. ``cell`` replaces the file's own cell
    size; a ``.npy`` file needs it.

    Raises
    ------
    InputError
        If the file cannot be read, has no heights, or no cell size is known.
    """
    grid = read_grid(path, SketchFrame("EPSG:4326"), RasterSource("file", cell=cell or 0.0)).held()
    a, b, _, d, e, f = grid.place
    height = grid.samples.astype(np.float64)[:: 1 if e < 0.0 else -1]
    width, depth = math.hypot(a, d), math.hypot(b, e)
    if grid.crs and parse_crs(grid.crs).is_geographic:
        latitude = f + 0.5 * e * (len(height) - 1)
        width *= _METRES_PER_DEGREE * math.cos(math.radians(latitude))
        depth *= _METRES_PER_DEGREE
    if abs(width / depth - 1.0) > 1e-3:
        at = np.arange(int((height.shape[1] - 1) * width / depth) + 1) * depth / width
        known = np.arange(height.shape[1])
        height = np.stack([np.interp(at, known, row) for row in height])
    return height, float(cell or depth)
