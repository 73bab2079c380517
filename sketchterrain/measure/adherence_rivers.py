"""Adherence of rivers: painted strokes against centrelines, beds along these, and standing water."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int64Array, LatticeArray
from sketchterrain.features.table import LINE
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.landforms.hydrology.lakes import index_runs
from sketchterrain.landforms.hydrology.network import skeletons
from sketchterrain.landforms.hydrology.vector_rivers import line_path, line_sizes
from sketchterrain.landforms.placement.feature_types import Lake
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.schema.layers import LAYERS, layer_of, vector_of
from sketchterrain.terrain.recipe import TerrainRecipe

_STEP = 1.0  # m along a centreline
_MAX_STEPS = 50_000
_RISE = 0.01  # m: tolerance for "not rising"
_MAX_DISTANCE = 8.0  # px: of a centreline from the painted stroke it belongs to


def standing_water(
    recipe: TerrainRecipe, layer: str, x: Float64Array, y: Float64Array, ground: Float32Array
) -> BoolArray:
    """Return where the terrain (heights, m) lies under the water of a layer."""
    if LAYERS[layer].kind == "course":
        return _rivers(recipe, x, y, ground)
    if LAYERS[layer].kind == "sea" and recipe.sea_level is not None:
        return np.asarray(ground < recipe.sea_level)
    return _lakes((lake for lake in recipe.lakes if layer_of(lake.id) == layer), x, y, ground)


def _lakes(lakes: Iterable[Lake], x: Float64Array, y: Float64Array, ground: Float32Array) -> BoolArray:
    wet = np.zeros(x.shape, dtype=np.bool_)
    for lake in lakes:
        wet |= _within(lake, x, y) & (ground < lake.level)
    return wet


def _rivers(recipe: TerrainRecipe, x: Float64Array, y: Float64Array, ground: Float32Array) -> BoolArray:
    rivers = [river for river in recipe.rivers if river.label]
    if not rivers:
        return np.zeros(x.shape, dtype=np.bool_)
    line = np.concatenate([river.centreline for river in rivers])
    half = np.concatenate([river.centreline_width for river in rivers]) / 2.0
    # Centrelines have steps shorter than the water is wide, so that the nearest vertex suffices.
    places = np.stack([x.ravel(), y.ravel()], axis=-1)
    bound = 1.5 * float(half.max()) + 1.0
    found = cKDTree(line[:, :2]).query(places, distance_upper_bound=bound)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])
    near = np.isfinite(distance)
    wet = np.zeros(x.size, dtype=np.bool_)
    index = nearest[near]
    wet[near] = (ground.ravel()[near] < line[index, 2]) & (distance[near] <= 1.5 * half[index])
    return wet.reshape(x.shape)


def _within(lake: Lake, x: Float64Array, y: Float64Array) -> BoolArray:
    """Return which positions are nearer to a lake's painted shape than two of its samples."""
    field = lake.shape
    rows, columns = field.inside.shape
    column = np.rint((x - field.west) / field.spacing).astype(np.int64)
    row = np.rint((y - field.south) / field.spacing).astype(np.int64)
    valid = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    result = np.zeros(x.shape, dtype=np.bool_)
    result[valid] = field.inside[row[valid], column[valid]] > -2.0 * field.spacing
    return result


@dataclass(frozen=True)
class RiverAdherence:
    """A river as given and its centrelines; None if lost.

    It is a line of the vector layer, or a painted network: a connected region of the river layer.
    """

    label: int
    id: int  # of the line, or index of the network's first pixel
    area: int  # px
    lost: bool  # no centreline runs near it
    # Sketch pixels from the line, or from the skeleton of the paint, to the centreline and back.
    mean_distance: float | None
    greatest_distance: float | None
    descending: float | None  # share of the centreline, in 1 m steps, where the bed rises by at most 1 cm
    deepest_pit: float | None  # m that the bed lies below a point farther downstream, lakes excluded


def measure_river_adherence(terrain: Terrain) -> tuple[RiverAdherence, ...]:
    """Measure every line, then every painted network, which has the label of its first pixel.

    The river beyond the sketch's edge is not measured: nothing is asked for there.
    """
    sketch = terrain.sketch
    painted = sketch.layers["river"] > 0
    rivers = [river for river in terrain.recipe.rivers if river.label]
    lines = [_inside(terrain, _resample(river.centreline[:, :2])) for river in rivers]
    beds = [_beds(terrain, line) for line in lines]
    bones = [
        (bone.rows[0] * sketch.width_px + bone.columns[0], _positions(terrain, bone.rows, bone.columns))
        for bone in skeletons(painted)
    ]
    result = _measure_lines(terrain) if len(sketch.vectors["river"]) else []
    for network in label_shapes("river", painted.astype(np.uint8)):
        rows, columns = network.pixels(network.mask)
        own = set((rows * sketch.width_px + columns).tolist())
        skeleton = np.concatenate([at for first, at in bones if int(first) in own])
        label = int(sketch.layers["river"].flat[network.id])
        limit = _MAX_DISTANCE * sketch.pixel_size
        courses = [
            (line, bed) for line, bed in zip(lines, beds, strict=True) if _is_near(line, skeleton, limit)
        ]
        to, back = _distances(skeleton, [line for line, _ in courses])
        beds_of = [bed for _, pieces in courses for bed in pieces]
        result.append(_measure((label, network.id, network.area), to, back, beds_of, sketch.pixel_size))
    return tuple(result)


def _resample(points: Float64Array) -> Float64Array:
    """Return positions in even steps (m) along a polyline of shape (n, 2)."""
    lengths = arc_length(points)
    count = min(int(lengths[-1] / _STEP) + 2, _MAX_STEPS)
    return at_lengths(points, lengths, np.linspace(0.0, lengths[-1], count))


def _beds(terrain: Terrain, line: Float64Array) -> list[Float64Array]:
    """Return heights (m) along a line, split at lakes, whose beds are hollows by design."""
    height = terrain.heights(line[:, 0], line[:, 1])
    dry = ~_lakes(terrain.recipe.lakes, line[:, 0], line[:, 1], height)
    return [height[first : last + 1].astype(np.float64) for first, last in index_runs(dry)]


def _distances(given: Float64Array, lines: list[Float64Array]) -> tuple[Float64Array, Float64Array]:
    """Return the distances (m) of given positions from lines, and of the lines from those; empty if lost."""
    if not lines:
        return np.zeros(0), np.zeros(0)
    line = np.concatenate(lines)
    return np.asarray(cKDTree(line).query(given)[0]), np.asarray(cKDTree(given).query(line)[0])


def _measure(
    key: tuple[int, int, int],
    to: Float64Array,
    back: Float64Array,
    beds: list[Float64Array],
    pixel_size: float,
) -> RiverAdherence:
    """Return the adherence of a river (label, id and area), of distances (m) to its centrelines and back."""
    label, name, area = key
    if not len(to) or not len(back):
        return RiverAdherence(label, name, area, True, None, None, None, None)
    steps = np.concatenate([np.zeros(0), *(np.diff(bed) for bed in beds)])
    return RiverAdherence(
        label=label,
        id=name,
        area=area,
        lost=False,
        mean_distance=float(max(to.mean(), back.mean()) / pixel_size),
        greatest_distance=float(max(to.max(), back.max()) / pixel_size),
        descending=float(np.mean(steps <= _RISE)) if steps.size else 1.0,
        deepest_pit=max((float((bed - np.minimum.accumulate(bed)).max()) for bed in beds), default=0.0),
    )


def _measure_lines(terrain: Terrain) -> list[RiverAdherence]:
    """Measure the lines of the vector layer, each by the centrelines that are nearest to it."""
    sketch, layer = terrain.sketch, terrain.sketch.vectors["river"]
    rivers = [each for each in terrain.recipe.rivers if vector_of(each.id) is not None]
    numbers = np.flatnonzero(layer.kinds == LINE)
    given = [np.asarray(line_path(layer, number)) for number in numbers.tolist()]
    places = [_inside(terrain, _resample(each)) for each in given]
    lines = [_inside(terrain, _resample(river.centreline[:, :2])) for river in rivers]
    built, drawn = _Segments([river.centreline[:, :2] for river in rivers]), _Segments(given)
    nearest = [drawn.nearest(line) for line in lines]
    widths = line_sizes(sketch)[0]
    found = []
    for number, index in enumerate(numbers.tolist()):
        if not len(places[number]):
            continue
        own = [line[owner == number] for line, (_, owner) in zip(lines, nearest, strict=True)]
        back = [distance[owner == number] for distance, owner in nearest]
        to, _ = built.nearest(places[number])
        area = round(len(places[number]) * _STEP * float(widths[index]) / sketch.pixel_size**2)
        key = int(layer.labels[index]), int(layer.ids[index]), area
        beds = [bed for line in own if len(line) for bed in _beds(terrain, line)]
        found.append(_measure(key, to, np.concatenate([np.zeros(0), *back]), beds, sketch.pixel_size))
    return found


class _Segments:
    """The segments of lines, to find the nearest one."""

    def __init__(self, lines: Sequence[Float64Array]) -> None:
        import shapely

        ends = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        self._owner = np.repeat(np.arange(len(lines)), [len(each) for each in ends])
        self._points = shapely.points
        self._tree = shapely.STRtree(shapely.linestrings(np.concatenate([np.zeros((0, 2, 2)), *ends])))

    def nearest(self, at: Float64Array) -> tuple[Float64Array, Int64Array]:
        """Return the distances (m) of points (n, 2) from the lines, and the numbers of the nearest ones."""
        if not len(self._owner):
            return np.full(len(at), np.inf), np.full(len(at), -1)
        (_, found), distance = self._tree.query_nearest(
            self._points(at), return_distance=True, all_matches=False
        )
        return distance, self._owner[found]


def _is_near(line: Float64Array, skeleton: Float64Array, limit: float) -> bool:
    """Return whether most of a line lies near a painted skeleton."""
    if len(line) == 0:
        return False
    distance, _ = cKDTree(skeleton).query(line, distance_upper_bound=limit)
    return bool(np.mean(np.isfinite(distance)) > 0.5)


def _inside(terrain: Terrain, line: Float64Array) -> Float64Array:
    east, north = terrain.size
    x, y = line.T
    inside = (x >= 0.0) & (x <= east) & (y >= 0.0) & (y <= north)
    return np.asarray(line[inside])


def _positions(terrain: Terrain, rows: LatticeArray, columns: LatticeArray) -> Float64Array:
    sketch = terrain.sketch
    x, y = columns + 0.5, sketch.height_px - rows - 0.5
    return np.stack([x, y], axis=-1) * sketch.pixel_size
