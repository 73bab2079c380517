"""Adherence of rivers: painted strokes against centrelines, beds along these, and standing water."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, LatticeArray
from sketchterrain.document.layers import LAYERS, layer_of
from sketchterrain.hydrology.network import skeletons
from sketchterrain.placement.feature_types import Lake
from sketchterrain.placement.shapes import Shape, label_shapes
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.terrain import Terrain

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
    """One painted river network (a connected region of the river layer) and its centrelines; None if lost."""

    label: int
    id: int
    area: int
    lost: bool  # no centreline runs near it
    mean_distance: float | None  # sketch pixels from the painted skeleton to the centreline and back
    greatest_distance: float | None
    descending: float | None  # share of the centreline, in 1 m steps, where the bed rises by at most 1 cm
    deepest_pit: float | None  # m that the bed lies below a point farther downstream, lakes excluded


def measure_river_adherence(terrain: Terrain) -> tuple[RiverAdherence, ...]:
    """Measure every painted river; labels that touch are one network, with the label of its first pixel.

    The river beyond the sketch's edge is not measured: nothing is painted there.
    """
    sketch = terrain.sketch
    painted = sketch.layers["river"] > 0
    rivers = [river for river in terrain.recipe.rivers if river.label]
    lines = [_inside(terrain, resample(river.centreline[:, :2])) for river in rivers]
    beds = [_beds(terrain, line) for line in lines]
    bones = [
        (bone.rows[0] * sketch.width_px + bone.columns[0], _positions(terrain, bone.rows, bone.columns))
        for bone in skeletons(painted)
    ]
    result = []
    for network in label_shapes("river", painted.astype(np.uint8)):
        rows, columns = network.pixels(network.mask)
        own = set((rows * sketch.width_px + columns).tolist())
        skeleton = np.concatenate([at for first, at in bones if int(first) in own])
        label = int(sketch.layers["river"].flat[network.id])
        limit = _MAX_DISTANCE * sketch.pixel_size
        courses = [
            (line, bed) for line, bed in zip(lines, beds, strict=True) if _is_near(line, skeleton, limit)
        ]
        result.append(_measure(network, label, skeleton, courses, sketch.pixel_size))
    return tuple(result)


def resample(points: Float64Array, step: float = _STEP) -> Float64Array:
    """Return positions in even steps (m) along a polyline of shape (n, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = min(int(lengths[-1] / step) + 2, _MAX_STEPS)
    at = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(at, lengths, points[:, axis]) for axis in (0, 1)], axis=-1)


def _beds(terrain: Terrain, line: Float64Array) -> list[Float64Array]:
    """Return heights (m) along a line, split at lakes, whose beds are hollows by design."""
    height = terrain.heights(line[:, 0], line[:, 1])
    dry = ~_lakes(terrain.recipe.lakes, line[:, 0], line[:, 1], height)
    starts = np.flatnonzero(np.diff(dry.astype(np.int8), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(dry.astype(np.int8), append=0) == -1) + 1
    return [height[start:end].astype(np.float64) for start, end in zip(starts, ends, strict=True)]


def _measure(
    network: Shape,
    label: int,
    skeleton: Float64Array,
    courses: list[tuple[Float64Array, list[Float64Array]]],
    pixel_size: float,
) -> RiverAdherence:
    if not courses:
        return RiverAdherence(label, network.id, network.area, True, None, None, None, None)
    line = np.concatenate([line for line, _ in courses])
    to = np.asarray(cKDTree(line).query(skeleton)[0])
    back = np.asarray(cKDTree(skeleton).query(line)[0])
    beds = [bed for _, pieces in courses for bed in pieces]
    steps = np.concatenate([np.zeros(0), *(np.diff(bed) for bed in beds)])
    return RiverAdherence(
        label=label,
        id=network.id,
        area=network.area,
        lost=False,
        mean_distance=float(max(to.mean(), back.mean()) / pixel_size),
        greatest_distance=float(max(to.max(), back.max()) / pixel_size),
        descending=float(np.mean(steps <= _RISE)) if steps.size else 1.0,
        deepest_pit=max((float((bed - np.minimum.accumulate(bed)).max()) for bed in beds), default=0.0),
    )


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
