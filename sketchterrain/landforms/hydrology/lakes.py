"""Lakes: outlines, water levels, and the rivers through them."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.hashing import gaussian_filter, rounded, value_noise
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.hydrology.courses import RiverCourse
from sketchterrain.landforms.hydrology.river_shape import Network
from sketchterrain.landforms.hydrology.water_levels import LakeReach, join_water_levels, solve_water_levels
from sketchterrain.landforms.placement.covers import shape_field, shore_positions
from sketchterrain.landforms.placement.feature_types import (
    LAYER_CODES,
    GroundHeight,
    Lake,
    ShapeField,
    distance_inside,
    lake_centre,
    smoothstep,
)
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.schema.layers import id_of_vector
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.features.table import FeatureTable

Runs: TypeAlias = list[tuple[int, int, int]]
"""First point, last point and lake (an index) of each run of a course inside a lake, upstream first."""

_MARGIN_PIXELS, _MARGIN = 6.0, 60.0  # px, m; the larger one applies
_LOW_SHORE = 10.0  # percentile of the heights along the shore that limits the water level
_FREEBOARD = 0.25  # m between the water and that height
_RIM = 0.2  # share of the margin around a lake where the lake alone shapes the terrain
_ROUNDS = 16
_ABOVE_SEA = 0.2  # m that a lake beside the sea lies above it, at least
_MOUTH_WIDTHS = 5.0  # of the river: radius of the lake in which it ends
_MOUTH_EXTENT = (0.012, 0.05)  # … between these shares of the sketch's extent
_MOUTH_DEPTHS = 3.0  # of the river: depth of that lake
_MIN_SIDE, _MAX_SIDE = 16, 512  # samples along the longer side of an area, without its margin
_LEAST_SPACING = 0.25  # m
_BEYOND_BIT = 1 << 47  # in the ids of lakes that were not painted

# Shorelines of painted lakes: octaves of noise in the distance field, finer than the sketch's pixels.
_RAGGED = (0.5, 20.0)  # px: greatest shift of the shore at fidelity 1, and what is added at fidelity 0
_RAGGED_SHARE = 0.25  # … and at most this share of the lake's greatest distance from the shore
_COVE = 4.0  # shifts: unit of the coarsest octave of a fractal outline
_OCTAVES, _GAIN = 5, 0.58  # finer octaves, and their amplitude over that of twice the unit
_ROUNDING = 0.5  # shifts: standard deviation of the blur that rounds corners
_SMOOTH_SHORES = 0.25  # share of the finer octaves where a shore is smoothest
_TURN = (0.8, 0.6)  # cosine and sine by which each octave's lattice is turned: none follows the axes
_SHELVING = (0.45, 1.45)  # distances are scaled by 0.45 … 1.9: shelving and steep shores
_REACH = 0.8  # of the margin outside, and of the greatest distance inside, that all this reaches
_MOUTH_CALM = (2.0, 8.0)  # px from rivers between which the shore starts to shift: they still end in the lake

# Deltas: fans of sediment where rivers enter lakes.
_DELTA_WIDTHS = 9.0  # radius, widths of the river …
_DELTA_SHARE = 0.4  # … and at most this share of the lake's greatest distance from the shore
_LEAST_DELTA = 2.0  # m, width of the river
_FAN = (0.45, 0.5)  # land that it gains: of the radius, and at most of the way that the river runs inside
_LOBES = 0.3  # of the radius: unit of the noise that parts a fan into lobes
_FINE_SIDE = 400  # samples along the longer side that a field is refined to, at most
_FINE_SPACING = 2.0  # m
_FIELD_STEP = 2.0**-9  # m, to which fields are rounded


_PAINTED: Final = ("layers.lake", "layers.river", "vectors.river", "extent", "size", "fidelity")


def painted_lakes(
    sketch: Sketch,
    ground: GroundHeight,
    run: Runner | None = None,
    *,
    seed: int = 0,
    sea_level: float | None = None,
) -> list[Lake]:
    """Return the painted lakes in reading order, then those from vectors, as high as their low shores allow.

    Those in the sea are left out, others lie above its level.
    """
    run = Runner() if run is None else run
    lowest = -np.inf if sea_level is None else sea_level + _ABOVE_SEA
    areas = sketch.vectors["lake"]
    outlines: list[_LakeOutline] = run(_lake_outlines, part_of(sketch, *_PAINTED), seed)
    if len(areas):
        outlines = outlines + run(_area_outlines, areas, sketch.pixel_size)
    if not outlines:
        return []
    at = np.concatenate([each.shore for each in outlines])
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    shores = np.split(heights, np.cumsum([len(each.shore) for each in outlines])[:-1])
    return [
        Lake(
            id=each.id,
            label=each.label,
            shape=each.field,
            level=max(_rim_level(shore), lowest),
            depth=float(sketch.properties("lake", each.label)["depth"]) if each.depth is None else each.depth,
        )
        for each, shore in zip(outlines, shores, strict=True)
        if sea_level is None or np.median(shore) > sea_level
    ]


def _rim_level(shore: Float64Array) -> float:
    """Return the level (m) that the heights along a shore can hold."""
    return float(rounded(np.percentile(shore, _LOW_SHORE))) - _FREEBOARD


class _LakeOutline(NamedTuple):
    """A painted lake without its water."""

    id: int
    label: int
    field: ShapeField
    shore: Float64Array
    depth: float | None = None  # m; None: its label's


def _lake_outlines(sketch: Sketch, seed: int) -> list[_LakeOutline]:
    margin = max(_MARGIN_PIXELS * sketch.pixel_size, _MARGIN)
    shapes = label_shapes("lake", sketch.layers["lake"])
    rivers = _river_positions(sketch) if shapes else None
    found = []
    for shape in shapes:
        field = natural_shore(
            shape_field(sketch, shape, margin=margin),
            pixel=sketch.pixel_size,
            shift=(_RAGGED[0] + _RAGGED[1] * (1.0 - sketch.fidelity)) * sketch.pixel_size,
            seed=seed,
            rivers=rivers,
        )
        name = LAYER_CODES["lake"] << 48 | shape.id
        found.append(_LakeOutline(name, shape.label, field, shore_positions(field)))
    return found


def _river_positions(sketch: Sketch) -> cKDTree | None:
    """Return a tree of positions (m) along rivers, at most a pixel apart; None without rivers."""
    import shapely

    row, column = np.nonzero(sketch.layers["river"])
    painted = np.column_stack([column + 0.5, sketch.height_px - row - 0.5]) * sketch.pixel_size
    lines = shapely.segmentize(sketch.vectors["river"].shapes(), sketch.pixel_size)
    positions = np.concatenate([painted, shapely.get_coordinates(lines)])
    return cKDTree(positions) if len(positions) else None


def natural_shore(
    field: ShapeField, *, pixel: float, shift: float, seed: int, rivers: cKDTree | None = None
) -> ShapeField:
    """Return a shape's field with coves, headlands and shores of varying slope.

    With d the distance inside, n noise and m > 0 smoother noise, it is (d + shift · n) m near the border and
    d at the field's rim and in the middle. `pixel` and `shift` are in m; near `rivers` the border stays.
    """
    most, margin = float(field.inside.max()), -float(field.inside[[0, -1]].max())
    shift = min(shift, _RAGGED_SHARE * most)
    finer = min(int(field.spacing / _FINE_SPACING), (_FINE_SIDE - 1) // (max(field.inside.shape) - 1))
    finer = max(finer, 1)
    spacing, shape = field.spacing / finer, [(count - 1) * finer + 1 for count in field.inside.shape]
    mesh = spacing * -(-max(shape) // _FINE_SIDE)  # what meshes of lakes resolve
    zoom = [fine / count for fine, count in zip(shape, field.inside.shape, strict=True)]
    inside = ndimage.zoom(field.inside.astype(np.float64), zoom, order=2, mode="nearest")
    reach = _REACH * np.where(inside > 0.0, most, margin)
    row, column = np.nonzero(np.abs(inside) < reach)
    at = np.column_stack([field.west + column * spacing, field.south + row * spacing])
    d = inside[row, column]
    fade = (1.0 - np.square(d / reach[row, column])) ** 2
    free = fade
    if rivers is not None:
        near, far = (each * pixel for each in _MOUTH_CALM)
        away = np.asarray(rivers.query(at, distance_upper_bound=far)[0])
        free = fade * smoothstep((np.minimum(away, far) - near) / (far - near))
    steep = value_noise(seed, "shelving shore", *(at / (2.0 * _COVE * shift)).T)
    rounding = gaussian_filter(inside, _ROUNDING * shift / spacing, axes=(0, 1))[row, column] - d
    scale = 1.0 + (_SHELVING[0] + _SHELVING[1] * steep * steep - 1.0) * fade
    inside[row, column] = (d + free * (rounding + shift * _shore_noise(at, shift, mesh, seed))) * scale
    return dataclasses.replace(field, spacing=spacing, inside=rounded(inside, _FIELD_STEP).astype(np.float32))


def _shore_noise(at: Float64Array, shift: float, spacing: float, seed: int) -> Float64Array:
    """Return noise about -1 … 1 at positions (n, 2; m), of octaves that a `spacing` (m) resolves."""
    total, (x, y), share = np.zeros(len(at)), at.T / (_COVE * shift), 1.0
    rough = _SMOOTH_SHORES + (1.0 - _SMOOTH_SHORES) * value_noise(seed, "rough shore", 0.3 * x, 0.3 * y)
    resolved = int(np.log2(max(0.5 * _COVE * shift / spacing, 1.0)))
    for octave in range(min(_OCTAVES, resolved) + 1):
        wave = 2.0 * value_noise(seed, f"shore {octave}", x, y) - 1.0
        total += share * wave * (rough if octave else 1.0)
        x, y = 2.0 * (_TURN[0] * x - _TURN[1] * y), 2.0 * (_TURN[1] * x + _TURN[0] * y)
        share *= _GAIN
    return total


def with_deltas(
    lakes: Sequence[Lake], courses: Sequence[RiverCourse], *, seed: int, run: Runner
) -> list[Lake]:
    """Return lakes with deltas at the mouths of rivers."""
    found = []
    for lake in lakes:
        mouths = _mouths(lake, courses)
        shape = run(_with_fans, lake.shape, mouths, seed)
        found.append(dataclasses.replace(lake, shape=shape) if mouths else lake)
    return found


def _mouths(lake: Lake, courses: Sequence[RiverCourse]) -> list[list[float]]:
    """Return where courses enter a lake: x, y, radius of the fan and the land that it gains (m)."""
    found, most = [], _DELTA_SHARE * float(lake.shape.inside.max())
    for course in courses:
        if course.width.max() < _LEAST_DELTA or not _meets(lake.shape, course.line):
            continue
        depth = distance_inside(lake.shape, course.line)
        for first, last in index_runs(depth > 0.0):
            radius = min(_DELTA_WIDTHS * float(course.width[first]), most)
            gained = min(_FAN[0] * radius, _FAN[1] * float(depth[first : last + 1].max()))
            if first > 0:
                found.append([*map(float, course.line[first]), radius, gained])
    return found


def _with_fans(field: ShapeField, mouths: Sequence[Sequence[float]], seed: int) -> ShapeField:
    """Return a field less g (1 - r²/R²)² n inside, n noise: land and shoals around each mouth."""
    inside = field.inside.astype(np.float64)
    north, east = field.spacing * np.indices(inside.shape)
    east, north = east + field.west, north + field.south
    for x, y, radius, gained in mouths:
        near = np.maximum(1.0 - (np.square(east - x) + np.square(north - y)) / radius**2, 0.0)
        fan = near > 0.0
        lobes = value_noise(seed, "delta", east[fan] / (_LOBES * radius), north[fan] / (_LOBES * radius))
        land = gained * np.square(near[fan]) * (0.3 + 1.2 * lobes)
        inside[fan] -= land * smoothstep(4.0 * inside[fan] / gained + 0.5)
    return dataclasses.replace(field, inside=rounded(inside, _FIELD_STEP).astype(np.float32))


def _area_outlines(areas: FeatureTable, pixel_size: float) -> list[_LakeOutline]:
    """Return the outlines of the lakes from vectors."""
    depths = areas.columns.get("depth", np.full(len(areas), np.nan))
    margin = max(_MARGIN_PIXELS * pixel_size, _MARGIN)
    found = []
    for shape, name, label, depth in zip(areas.shapes(), areas.ids, areas.labels, depths, strict=True):
        field = area_field(shape, spacing=pixel_size, margin=margin)
        known = None if np.isnan(depth) else float(depth)
        found.append(
            _LakeOutline(id_of_vector("lake", int(name)), int(label), field, shore_positions(field), known)
        )
    return found


def area_field(area: Any, *, spacing: float, margin: float) -> ShapeField:
    """Return the signed distance to the border of an area (shapely, m), with up to `margin` (m) around it.

    Samples are `spacing` (m) apart, or closer in small areas, whose margin is smaller too.
    """
    import shapely

    west, south, east, north = area.bounds
    longer = max(east - west, north - south)
    spacing = float(np.clip(spacing, longer / _MAX_SIDE, max(longer / _MIN_SIDE, _LEAST_SPACING)))
    rim = int(np.ceil(min(margin, _MARGIN + longer) / spacing)) + 1
    x = west + spacing * np.arange(-rim, int(np.ceil((east - west) / spacing)) + rim + 1)
    y = south + spacing * np.arange(-rim, int(np.ceil((north - south) / spacing)) + rim + 1)
    at_x, at_y = (each.ravel() for each in np.meshgrid(x, y))
    corners = [shapely.get_coordinates(ring) for ring in shapely.get_rings(area)]
    sides = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in corners]
    border = shapely.STRtree(shapely.linestrings(np.concatenate(sides)))
    points = shapely.points(at_x, at_y)
    away = border.query_nearest(points, all_matches=False, return_distance=True)[1]
    inside = np.where(shapely.contains_xy(area, at_x, at_y), away, -away).reshape(len(y), len(x))
    return ShapeField(float(x[0]), float(y[0]), spacing, inside.astype(np.float32))


def mouth_lakes(
    sketch: Sketch, courses: Sequence[RiverCourse], *, seed: int, at_sea: Collection[int] = ()
) -> list[Lake]:
    """Return the lakes at the ends of rivers beyond the sketch, unless another river is too near.

    Rivers that end in the sea, by their ids, have none, nor have streams.

    Their level is still infinite: it is that of the river.
    """
    lakes: list[Lake] = []
    for course in courses:
        end = course.line[-1]
        outside = float(np.hypot(*(end - np.clip(end, 0.0, np.array(sketch.size)))))
        if course.parent is not None or outside <= 0.0 or course.label == 0 or course.id in at_sea:
            continue
        low, high = (share * sketch.extent for share in _MOUTH_EXTENT)
        radius = float(np.clip(_MOUTH_WIDTHS * course.width[-1], low, high))
        margin = max(_MARGIN, 0.5 * radius)
        clear = min(
            [
                outside - margin,
                *(_distance(end, other.line) - margin for other in courses if other is not course),
            ]
        )
        radius = min(radius, clear / 1.4, 0.3 * float(arc_length(course.line)[-1]))
        if radius < 1.5 * course.width[-1] or any(
            _distance(end, lake_centre(x)[None]) < 4 * radius for x in lakes
        ):
            continue
        lakes.append(
            Lake(
                id=LAYER_CODES["lake"] << 48 | _BEYOND_BIT | (course.id & (_BEYOND_BIT - 1)),
                label=0,
                shape=_rounded_shape(end, radius, margin, seed=seed, name=course.id),
                level=float("inf"),
                depth=_MOUTH_DEPTHS * float(course.depth[-1]),
            )
        )
    return lakes


def runs_inside(lakes: Sequence[Lake], line: Float64Array) -> Runs:
    """Return the runs of a centreline that lie in lakes."""
    return sorted(
        (first, last, number)
        for number, lake in enumerate(lakes)
        if _meets(lake.shape, line)
        for first, last in index_runs(distance_inside(lake.shape, line) > 0.0)
    )


def _meets(field: ShapeField, line: Float64Array) -> bool:
    """Return whether the box of a line meets that of a field."""
    low = np.array([field.west, field.south])
    high = low + field.spacing * (np.array(field.inside.shape[::-1]) - 1)
    return bool(((line.min(axis=0) <= high) & (line.max(axis=0) >= low)).all())


def lake_reaches(lakes: Sequence[Lake], line: Float64Array) -> list[tuple[int, int, int, int]]:
    """Return (shore, first, last, lake) of a centreline's runs in and beside lakes; see `LakeReach`."""
    found = []
    for number, lake in enumerate(lakes):
        if not _meets(lake.shape, line):
            continue
        depth = distance_inside(lake.shape, line)
        rim = _RIM * float(lake.shape.inside[[0, -1]].max())  # below zero: outside
        inside = index_runs(depth > 0.0)
        for start, stop in index_runs(depth > rim):
            shore, own = start, [run for run in inside if start <= run[0] <= stop]
            for first, last in own:
                found.append((shore, first, last, number))
                shore = last + 1
            if not own:
                found.append((start, stop + 1, stop, number))
    return sorted(found, key=lambda run: run[1:])


def index_runs(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(turns[::2], turns[1::2], strict=True)]


def solve_lake_levels(
    lakes: Sequence[Lake],
    network: Network,
    grounds: Sequence[Float64Array],
    tides: Sequence[Sequence[LakeReach]] = (),
) -> tuple[list[Lake], list[Float64Array]]:
    """Lower lakes until no river flows up into one; return lakes and water levels along each course.

    `tides` are the reaches of courses at the level of the sea, if there is one.
    """
    tides = tides or [()] * len(network.courses)
    runs = [lake_reaches(lakes, course.line) for course in network.courses]
    water = np.array([lake.level for lake in lakes])
    levels = solve_water_levels(network, grounds, tides)
    for _ in range(_ROUNDS):
        previous = water.copy()
        for course, own, level in zip(network.courses, runs, levels, strict=True):
            for _, first, last, lake in own:
                if last < first or course.label == 0:
                    continue  # the course only passes by, or the ground was drained to the lake
                inflow = level[first - 1] if first > 0 else level[min(last + 1, len(level) - 1)]
                water[lake] = min(water[lake], inflow)
        still = [
            [*(LakeReach(shore, a, b, float(water[lake])) for shore, a, b, lake in own), *tide]
            for own, tide in zip(runs, tides, strict=True)
        ]
        levels = solve_water_levels(network, grounds, still)
        if (water == previous).all():
            break
    return [
        dataclasses.replace(lake, level=float(level))
        for lake, level in zip(lakes, water, strict=True)
        if np.isfinite(level)
    ], join_water_levels(network, levels)


@dataclasses.dataclass(frozen=True, eq=False)
class WaterPixels:
    """Pixels of water, at least one, in a tree."""

    at: npt.NDArray[np.floating[Any]]  # (n, 2) rows and columns

    @cached_property
    def tree(self) -> cKDTree:
        """The tree."""
        return cKDTree(self.at)


def lake_pixels(lakes: LabelImage) -> WaterPixels | None:
    """Return the painted lakes' pixels; None without a lake."""
    painted = np.argwhere(lakes > 0).astype(np.float64)
    return WaterPixels(painted) if len(painted) else None


def _distance(point: Float64Array, line: Float64Array) -> float:
    return float(np.sqrt(((line - point) ** 2).sum(axis=1)).min())


def _rounded_shape(centre: Float64Array, radius: float, margin: float, *, seed: int, name: int) -> ShapeField:
    """Return a rounded shape with a hashed outline around a point."""
    spacing = radius / 12.0
    half = int(np.ceil((1.4 * radius + margin) / spacing)) + 1
    steps = spacing * np.arange(-half, half + 1)
    east, north = np.meshgrid(steps, steps)
    distance = np.hypot(east, north)
    scale = 1.2 / np.maximum(distance, 1e-9)
    key = float(name % 2**20)
    swing = value_noise(seed, "lake beyond the edge", key + 10.0 + scale * east, key + 10.0 + scale * north)
    inside = radius * (0.75 + 0.6 * swing) - distance
    return ShapeField(
        west=float(centre[0] - spacing * half),
        south=float(centre[1] - spacing * half),
        spacing=spacing,
        inside=inside.astype(np.float32),
    )
