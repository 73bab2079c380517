"""Painted mountains and hills that raise ground: their radii, and heights as they are built."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import (
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    StructuredArray,
)
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, TYPES, GroundHeight, visible_radius
from sketchterrain.landforms.placement.heights import built_height, exactness, shape_height
from sketchterrain.landforms.placement.shapes import find_regions, region_numbers, shape_depth
from sketchterrain.schema.layers import HEIGHT_LIMIT, LAYERS
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

Number = TypeVar("Number", bound=np.generic)

_FILLING = 0.9  # visible radii by which features grow within their painted shape, at a fidelity of 1
_MIN_SHARE = 0.36  # of its shape's height: as in `placement`


class UpliftFeatures(NamedTuple):
    """Features that raise ground, sorted by id; arrays of shape (n,). Those without height calm it."""

    x: Float64Array  # m
    y: Float64Array
    radius: Float64Array  # m, to a quarter of the shape's height
    height: Float64Array  # m, as built
    peakiness: Float64Array
    erosion: Float64Array
    strata: Float64Array
    is_rock: BoolArray  # mountains
    summit: Float64Array  # elevation (m) that it rises to, −inf where its height is added to the ground
    shape: Int64Array  # number of the painted shape that a feature belongs to
    region: Int64Array  # number of that shape within its layer, −1 for features that were added

    def of(self, members: Int64Array) -> UpliftFeatures:
        """Return some of the features."""
        return UpliftFeatures._make(each[members] for each in self)

    def rows(self) -> set[tuple[float, ...]]:
        """Return the features without the numbers of their shapes, which other shapes change."""
        return set(zip(*(each.tolist() for each in self[:-2]), strict=True))

    def cover(self, at: Float64Array) -> BoolArray:
        """Return whether positions (n, 2), m, are in the radius of any feature."""
        away = np.hypot(at[:, :1] - self.x, at[:, 1:2] - self.y)
        return np.asarray((away < self.radius).any(axis=1))


_NONE, _NUMBERS, _FLAGS = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.bool_)
NO_FEATURES: Final = UpliftFeatures(
    _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _FLAGS, _NONE, _NUMBERS, _NUMBERS
)


def uplift_features(
    sketch: Sketch, points: StructuredArray, run: Runner | None = None, data: GroundHeight | None = None
) -> UpliftFeatures:
    """Return the mountains and hills among placed features (``FEATURE``), with heights as they are built.

    A feature belongs to the shape that its id names, wherever it was moved to; one that was added is a shape
    of its own, with its radius as inradius. With elevation `data`, shapes whose heights are elevations rise
    to these from the mean height of the data at their features; features on higher ground raise nothing.
    """
    run = Runner() if run is None else run
    points = points[np.isin(points["type"], [FEATURE_TYPES.index(name) for name in ("mountain", "hill")])]
    radius, height = np.zeros(len(points)), points["strength"].astype(np.float64)
    summit = np.full(len(points), -np.inf)
    number, count = np.zeros(len(points), np.int64), 0
    region = np.zeros(len(points), np.int64)
    for name in ("mountain", "hill"):
        of_type = np.flatnonzero(points["type"] == FEATURE_TYPES.index(name))
        shape, inradius, built, limit, top = _shapes_of(sketch, name, points[of_type], run)
        number[of_type] = count + shape
        count += len(inradius)
        alone = inradius[shape] <= 0.0
        region[of_type] = np.where(alone, -1, shape)
        own = height[of_type]
        whole = np.where(alone, own, built[shape])
        share = np.clip(own / np.maximum(whole, 1e-9), _MIN_SHARE, 1.0)
        peakiness = points["peakiness"][of_type].astype(np.float64)
        visible = visible_radius(name, share, peakiness, sketch.fidelity) / TYPES[name].radius_ratio
        radius[of_type] = points["radius"][of_type] * visible
        wide = np.where(alone, radius[of_type], inradius[shape])
        # Only edits make features higher than their shapes.
        for k in np.flatnonzero(alone | (own > (1.0 + 1e-6) * whole)).tolist():
            highest = built_height(float(own[k]), float(wide[k]), sketch.fidelity, float(limit[shape[k]]))
            own[k] = highest if alone[k] else max(highest, whole[k])
        for k in np.flatnonzero(top > -np.inf).tolist():
            at = of_type[shape == k]
            if data is None or not len(at):
                continue
            ground = data(*(points[axis][at].astype(np.float64) for axis in ("x", "y")))
            mean = float(ground.mean())
            rise = built_height(float(top[k]) - mean, float(inradius[k]), sketch.fidelity, float(limit[k]))
            summit[at] = mean + own[shape == k] / max(built[k], 1e-9) * max(rise, 0.0)
            own[shape == k] = np.maximum(summit[at] - ground, 0.0) * (rise > 0.0)
        height[of_type] = own
    is_rock = np.asarray(points["type"] == FEATURE_TYPES.index("mountain"))
    names = "x", "y", "peakiness", "erosion", "strata"
    x, y, peakiness, erosion, strata = (points[name].astype(np.float64) for name in names)
    return UpliftFeatures(x, y, radius, height, peakiness, erosion, strata, is_rock, summit, number, region)


def _shapes_of(
    sketch: Sketch, name: str, points: StructuredArray, run: Runner
) -> tuple[Int64Array, Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return each feature's shape; inradii, built heights (m), height limits and elevations of shapes.

    Elevations (m) are −inf where heights are added to the ground. Features that were added have shapes of
    their own, with inradius 0.
    """
    image = sketch.layers[name]
    regions = run(find_regions, image, hashed=False)
    number = region_numbers(image, regions)
    measures = np.zeros((len(regions), 4))
    for index, region in enumerate(regions):
        depth = run(shape_depth, region, image.shape, hashed=False)
        inradius, properties = float(depth.max()) * sketch.pixel_size, sketch.properties(name, region.label)
        built = shape_height(properties, inradius, sketch.fidelity).built
        top = float(properties["height"])
        is_elevation = properties.get("reach") == "absolute" and top > 0.0
        measures[index] = inradius, built, properties["height_limit"], top if is_elevation else -np.inf
    pixel = (points["id"] & np.uint64((1 << 48) - 1)).astype(np.int64)
    painted = points["painted"] & (points["id"] >> np.uint64(48) == LAYERS[name].code) & (pixel < image.size)
    shape = np.where(painted, number.ravel()[np.where(painted, pixel, 0)], -1)
    alone = np.flatnonzero(shape < 0)
    shape[alone] = len(regions) + np.arange(len(alone))
    added = np.tile([0.0, 0.0, HEIGHT_LIMIT, -np.inf], (len(alone), 1))
    inradius, built, limit, top = np.concatenate([measures, added]).T
    return shape, inradius, built, limit, top


@dataclass(frozen=True, eq=False)
class Outline:
    """Distance inside a layer's painted shapes, at nodes of level 0 over the sketch."""

    depth: Float32Array  # (rows, columns), m, from the sketch's south-west corner; negative outside
    region: Int32Array  # (rows, columns): numbers of shapes, −1 outside
    filling: float  # radii by which features grow within their shapes
    exactness: float  # 0 … 1: how steeply features rise from their outlines

    def depth_at(self, origin: tuple[int, int], shape: tuple[int, ...]) -> Float64Array:
        """Return the distance inside (m) at a raster of nodes; −inf beyond the sketch."""
        return _window(self.depth, origin, np.full(shape, -np.inf))

    def region_at(self, origin: tuple[int, int], shape: tuple[int, ...]) -> Int32Array:
        """Return the numbers of shapes at a raster of nodes."""
        return _window(self.region, origin, np.full(shape, -1, np.int32))


def _window(
    nodes: npt.NDArray[Number], origin: tuple[int, int], found: npt.NDArray[Number]
) -> npt.NDArray[Number]:
    """Copy those nodes over the sketch that lie in a raster of nodes into it."""
    rows, columns = nodes.shape
    south, west = max(-origin[0], 0), max(-origin[1], 0)
    north, east = min(rows - origin[0], found.shape[0]), min(columns - origin[1], found.shape[1])
    if south < north and west < east:
        part = nodes[south + origin[0] : north + origin[0], west + origin[1] : east + origin[1]]
        found[south:north, west:east] = part
    return found


def painted_outline(sketch: Sketch, layer: str, cell: float, run: Runner) -> Outline | None:
    """Return the outline of a layer's shapes at nodes of a spacing (m); None where nothing is painted.

    Features fill their shapes, and rise from their outlines, as the sketch's fidelity asks.
    """
    painted = sketch.layers[layer] != 0
    if not painted.any():
        return None
    stride = max(int(0.5 * cell / sketch.pixel_size), 1)
    nodes = np.s_[stride // 2 :: stride, stride // 2 :: stride]
    painted = painted[nodes]
    side = stride * sketch.pixel_size
    inset = -ndimage.distance_transform_edt(~painted)
    for box in ndimage.find_objects(painted.astype(np.int8)):  # one, or none between the nodes
        inset[box] += ndimage.distance_transform_edt(np.pad(painted[box], 1))[1:-1, 1:-1]
    columns, rows = (int(each / cell) + 1 for each in sketch.size)
    y = (sketch.size[1] - np.arange(rows) * cell) / side - 0.5
    x = np.arange(columns) * cell / side - 0.5
    at = np.meshgrid(y, x, indexing="ij")
    depth = side * ndimage.map_coordinates(inset, at, order=1, mode="nearest")
    image = sketch.layers[layer]
    number = region_numbers(image, run(find_regions, image, hashed=False))[nodes]
    region = ndimage.map_coordinates(number, at, order=0, mode="nearest")
    filling, exact = _FILLING * sketch.fidelity, exactness(sketch.fidelity)
    return Outline(depth.astype(np.float32), region.astype(np.int32), filling, exact)
