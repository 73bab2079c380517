"""User features: dart throwing inside painted shapes (Zaaijer 2013, §4.2).

Summits come first: `multitude` of them, far apart. Support features follow, lower than the summits: discs
that overlap along the shape's medial axis, so that a long range is one ridge, then the largest discs that
fill the remaining holes, as far as the fidelity requires.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, StructuredArray
from sketchterrain.geometry.hashing import hash_unit, value_noise
from sketchterrain.landforms.placement.feature_types import LAYER_CODES, TYPES
from sketchterrain.landforms.placement.shapes import (
    MIN_DISC,
    Region,
    Shape,
    ShapePixels,
    find_regions,
    measure_shape,
    shape_depth,
)
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_DARTS_EACH = 64  # darts per requested summit
_ROUNDS = 8  # of darts, closer in each one
_AXIS_SLOPE = 0.7  # of the distance map, below which a pixel is on the medial axis
_SPINE_SPACING = 0.5  # of a disc's radius, between discs along the medial axis at fidelity 1
_MIN_SPINE = 0.3  # of the largest summit's disc: thinner branches of the axis are noise of the brush


def throw_summits(shape: Shape, pixels: ShapePixels, mean: float, multitude: int) -> Int64Array:
    """Throw darts in order of priority: far apart first, then closer until there are enough."""
    depth, deepest = pixels.depth, float(pixels.depth.max())
    highest = ndimage.maximum_filter(shape.depth, size=3, mode="constant")
    peak = (shape.depth == highest)[pixels.row, pixels.column]
    usable = (peak & (depth >= 0.75 * min(mean, deepest))) | (depth >= min(mean, 0.9 * deepest))
    darts = np.flatnonzero(usable)
    most = _DARTS_EACH * (multitude + 4)
    if len(darts) > most:
        darts = darts[np.argpartition(pixels.priority[darts], most)[:most]]
    darts = darts[np.argsort(pixels.priority[darts], kind="stable")]

    # In a thin shape summits are on a line, so their spacing depends on its length, not its area.
    spacing = max(1.7 * mean, 0.6 * shape.area / (2.0 * max(deepest, 0.5) * multitude))
    # That many discs of the mean size have the shape's area; specks hold fewer.
    target = min(multitude, math.ceil(shape.area / (math.pi * MIN_DISC**2)))
    accepted: list[int] = []
    for _ in range(_ROUNDS):
        free = np.ones(len(darts), dtype=np.bool_)
        for index in accepted:
            free &= _apart(pixels, darts, index, spacing)
        while free.any() and len(accepted) < target:
            index = int(darts[np.argmax(free)])
            accepted.append(index)
            free &= _apart(pixels, darts, index, spacing)
        if len(accepted) >= target:
            break
        spacing *= 0.75
    return np.asarray(accepted, dtype=np.int64)


def _apart(pixels: ShapePixels, darts: Int64Array, index: int, spacing: float | Float64Array) -> BoolArray:
    down = pixels.row[darts] - pixels.row[index]
    across = pixels.column[darts] - pixels.column[index]
    return np.asarray(down * down + across * across >= np.maximum(np.square(spacing), 1.0))


def throw_spine(shape: Shape, pixels: ShapePixels, summits: Int64Array, fidelity: float) -> Int64Array:
    """Throw darts at the medial axis, so close that the discs overlap."""
    # A distance map has slope 1 except on the medial axis.
    down, across = np.gradient(np.pad(shape.depth, 1))
    slope2 = np.asarray(down * down + across * across)[1:-1, 1:-1]
    turning = slope2 < _AXIS_SLOPE**2
    darts = np.flatnonzero(turning[pixels.row, pixels.column])
    darts = darts[np.argsort(pixels.priority[darts], kind="stable")]
    spacing = (_SPINE_SPACING + (1.0 - fidelity)) * pixels.disc[darts]
    free = pixels.disc[darts] > _MIN_SPINE * pixels.disc[summits].max()
    near = _DartGrid(shape, pixels, darts, np.maximum(spacing, 1.0))
    for index in summits:
        near.clear(free, int(index))
    accepted: list[int] = []
    for number, index in enumerate(darts.tolist()):
        if free[number]:
            accepted.append(index)
            near.clear(free, index)
    return np.asarray(accepted, dtype=np.int64)


class _DartGrid:
    """Spatial index of darts, so that an accepted dart is not compared with all of them."""

    def __init__(self, shape: Shape, pixels: ShapePixels, darts: Int64Array, spacing: Float64Array) -> None:
        self._pixels, self._darts, self._spacing = pixels, darts, spacing
        self._reach = math.ceil(float(spacing.max(initial=0.0)))
        self._number: Int64Array | None = None
        if len(darts) > (2 * self._reach + 1) ** 2:
            self._number = np.full(shape.mask.shape, -1, dtype=np.int64)
            self._number[pixels.row[darts], pixels.column[darts]] = np.arange(len(darts))

    def clear(self, free: BoolArray, index: int) -> None:
        """Reject the darts that are too close to a pixel."""
        if self._number is None:
            free &= _apart(self._pixels, self._darts, index, self._spacing)
            return
        row, column = int(self._pixels.row[index]), int(self._pixels.column[index])
        rows, columns = (slice(max(at - self._reach, 0), at + self._reach + 1) for at in (row, column))
        window = self._number[rows, columns]
        near = window[window >= 0]
        free[near] &= _apart(self._pixels, self._darts[near], index, self._spacing[near])


_MIN_HOLE = 0.9  # px; narrower holes are noise of the brush, filled at fidelity 1 only


def fill_holes(shape: Shape, pixels: ShapePixels, selected: Int64Array, fidelity: float) -> Int64Array:
    """Return discs for uncovered pixels, the deepest holes first, until enough is covered."""
    cover = _Coverage(shape, pixels)
    for index in selected:
        cover.add(int(index))
    bare_at_most = (1.0 - (0.6 + 0.395 * fidelity**2)) * shape.area
    narrow = _MIN_HOLE - (_MIN_HOLE - 0.5) * fidelity**8
    least = max(narrow, 0.35 * math.sqrt(1.0 - fidelity) * float(pixels.disc.max()))
    accepted: list[int] = []
    for _ in range(_ROUNDS):
        if cover.bare <= bare_at_most:
            break
        holes, depths = cover.holes(least)
        for hole, depth in zip(holes.tolist(), depths.tolist(), strict=True):
            if cover.bare <= bare_at_most:
                break
            if not cover.covered[hole]:
                accepted.append(cover.patch(hole, depth))
        if len(holes) == 0:
            break
    return np.asarray(accepted, dtype=np.int64)


class _Coverage:
    """Coverage of a shape's pixels by the selected discs."""

    def __init__(self, shape: Shape, pixels: ShapePixels) -> None:
        self._pixels = pixels
        self._number = np.full(shape.mask.shape, -1, dtype=np.int64)
        self._number[pixels.row, pixels.column] = np.arange(shape.area)
        self._largest = float(pixels.disc.max())
        self._selected = np.zeros(shape.area, dtype=np.bool_)
        self.covered = np.zeros(shape.area, dtype=np.bool_)
        self.bare = shape.area

    def add(self, index: int) -> None:
        """Cover a pixel's disc."""
        near, distance = self._around(index, float(self._pixels.disc[index]) + 0.5)
        newly = near[(distance < self._pixels.disc[index] + 0.5) & ~self.covered[near]]
        self._selected[index] = True
        self.covered[newly] = True
        self.bare -= len(newly)

    def patch(self, hole: int, depth: float) -> int:
        """Cover a hole, `depth` deep at a pixel, by the largest disc of the shape that can."""
        near, distance = self._around(hole, self._largest)
        able = near[(distance + depth <= self._pixels.disc[near] + 0.5) & ~self._selected[near]]
        if len(able) == 0:
            able = np.array([hole])
        # Steps of a quarter pixel: the hash, not the reading order, decides among discs of similar size.
        size = np.round(4.0 * self._pixels.disc[able])
        best = able[size == size.max()]
        index = int(best[np.argmin(self._pixels.priority[best])])
        self.add(index)
        if not self.covered[hole]:
            self.covered[hole] = True
            self.bare -= 1
        return index

    def holes(self, least: float) -> tuple[Int64Array, Float64Array]:
        """Return the deepest pixels of uncovered areas and their depths (px), deepest first."""
        pixels = self._pixels
        bare = np.zeros(self._number.shape, dtype=np.bool_)
        bare[pixels.row, pixels.column] = ~self.covered
        depth = ndimage.distance_transform_edt(np.pad(bare, 1))[1:-1, 1:-1] - 0.5
        peak = bare & (depth >= least) & (depth == ndimage.maximum_filter(depth, size=3))
        found = self._number[peak]
        order = np.lexsort((pixels.priority[found], -np.round(4.0 * depth[peak])))
        return found[order], depth[peak][order]

    def _around(self, index: int, radius: float) -> tuple[Int64Array, Float64Array]:
        """Return the pixels of the shape in a window around one, and their distances."""
        row, column = int(self._pixels.row[index]), int(self._pixels.column[index])
        reach = math.ceil(radius)
        rows, columns = (slice(max(at - reach, 0), at + reach + 1) for at in (row, column))
        window = self._number[rows, columns]
        near = window[window >= 0]
        return near, np.hypot(self._pixels.row[near] - row, self._pixels.column[near] - column)


USER_FEATURE = np.dtype(
    [
        ("id", "u8"),  # layer code · 2⁴⁸ + pixel index
        ("type", "u1"),
        ("label", "u1"),
        ("row", "i4"),
        ("column", "i4"),
        ("disc", "f8"),  # px, radius of the part of the shape that it represents
        ("share", "f8"),  # of the label's strength
        ("summit", "?"),
        ("shape", "i8"),  # `Shape.id`
        ("inradius", "f8"),  # px, of the shape
    ]
)
"""A user feature; positions are pixels of the sketch."""


def pixel_id(layer: str, row: Int64Array, column: Int64Array, image_width: int) -> npt.NDArray[np.uint64]:
    """Return the stable id of a feature on a pixel of a layer; its top bit is clear."""
    index = np.asarray(row).astype(np.int64) * image_width + np.asarray(column)
    return np.asarray(index + (LAYER_CODES[layer] << 48)).astype(np.uint64)


def mean_size(area: int, multitude: int) -> float:
    """Return the radius (px) of each of `multitude` equal discs with the shape's area, in steps of 2^(1/8).

    The steps keep a dab at a shape's edge from changing all of its features.
    """
    radius = max(math.sqrt(area / (math.pi * multitude)), MIN_DISC)
    return float(2.0 ** (round(8.0 * math.log2(radius)) / 8.0))


def user_features(shape: Shape, *, multitude: int, fidelity: float, seed: int) -> npt.NDArray[np.void]:
    """Break a shape into user features (``USER_FEATURE``), summits first; depends only on its arguments.

    `multitude` ≥ 1 is the number of summits to aim for: fewer where the shape is too small, at least one. The
    union of the discs covers from 60 % to 99.5 % of the shape as `fidelity` goes from 0 to 1.
    """
    mean = mean_size(shape.area, multitude)
    pixels = ShapePixels.from_shape(shape, most=1.25 * mean, seed=seed)
    if shape.area == 1:  # a sketch may contain thousands
        summits = selected = np.zeros(1, dtype=np.int64)
    else:
        summits = throw_summits(shape, pixels, mean, multitude)
        spine = throw_spine(shape, pixels, summits, fidelity)
        support = fill_holes(shape, pixels, np.concatenate([summits, spine]), fidelity)
        selected = np.concatenate([summits, spine, support])

    result = np.zeros(len(selected), dtype=USER_FEATURE)
    result["row"] = pixels.row[selected] + int(shape.rows.start)
    result["column"] = pixels.column[selected] + int(shape.columns.start)
    result["id"] = pixel_id(shape.layer, result["row"], result["column"], shape.image_width)
    result["type"], result["label"] = LAYER_CODES[shape.layer], shape.label
    result["disc"] = pixels.disc[selected]
    result["summit"][: len(summits)] = True
    result["shape"], result["inradius"] = shape.id, shape.depth.max()
    result["share"] = _shares(shape, result, fidelity, seed)
    return result


def _shares(shape: Shape, features: npt.NDArray[np.void], fidelity: float, seed: int) -> Float64Array:
    """Return strengths relative to the label's: 1 for the largest summit, and nowhere more."""
    rule = TYPES[shape.layer]
    disc, summit = features["disc"], features["summit"]
    largest = float(disc[summit].max())
    size = np.minimum(disc / largest, 1.0) ** rule.size_power
    scale = 2.5 * largest
    swing = value_noise(seed, f"{shape.layer} support", features["column"] / scale, features["row"] / scale)
    low, high = rule.support
    share = np.where(summit, 1.0, low + (high - low) * swing) * size
    whole = summit & (disc == largest)
    pixel = features["id"].astype(np.uint64)
    # Only summits differ at random: otherwise ridges would look like strings of pearls.
    swing = np.where(summit, rule.variation * (2.0 * hash_unit(seed, "strength", pixel) - 1.0), 0.0)
    share = np.where(whole, 1.0, np.minimum(share * (1.0 + swing), 1.0))
    return np.asarray(np.maximum(share, rule.min_share * fidelity**4))


def layer_user_features(sketch: Sketch, layer: str, seed: int, run: Runner) -> StructuredArray:
    """Return the user features of a layer, sorted by id; the sketch's own seed is ignored."""
    image, parts = sketch.layers[layer], [np.zeros(0, dtype=USER_FEATURE)]
    for region in run(find_regions, image, hashed=False):
        multitude = max(int(sketch.properties(layer, region.label)["multitude"]), 1)
        parts.append(run(_of_region, layer, image.shape, region, multitude, sketch.fidelity, seed))
    users = np.concatenate(parts)
    ordered: StructuredArray = users[np.argsort(users["id"], kind="stable")]
    return ordered


def _of_region(
    layer: str, size: tuple[int, int], region: Region, multitude: int, fidelity: float, seed: int, run: Runner
) -> StructuredArray:
    shape = measure_shape(layer, size, region, run(shape_depth, region, size, hashed=False))
    return user_features(shape, multitude=multitude, fidelity=fidelity, seed=seed)
