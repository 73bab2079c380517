"""Samples of arguments for the loops of elevation, mesh errors, horizon culling and draped cutting."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.elevation.surface import BoxClasses
from sketchterrain.export.mesh import full_mesh
from sketchterrain.host.library import host_function


def _evaluate_surface(size: int) -> tuple[Any, ...]:
    """Points on patches of two grids, the second one rotated, of double steps and masked."""
    random = np.random.default_rng(2)
    side = size // 28 + 1
    row, column = (each.ravel() for each in np.indices((side, side)))
    patches = 2 * side * side
    level = np.repeat([0, 1], side * side)
    step = 2.0**level
    centre = np.tile(28.0 * np.column_stack([column, row]) + 14.0, (2, 1)) * step[:, None]
    to_steps = np.zeros((patches, 2, 6))
    to_steps[:, 0, 1] = to_steps[:, 1, 2] = np.where(level == 0, 1.0, 0.4)
    to_steps[:, 0, 2], to_steps[:, 1, 1] = -0.3 * level, 0.3 * level
    to_steps[:, :, 3:] = random.normal(scale=1e-4, size=(patches, 2, 3))
    coefficients = random.normal(size=(patches, 35, 35)).astype(np.float32)
    mask_of = np.where(level == 1, np.arange(patches) - side * side, -1)
    masks = random.integers(0, 226, (side * side, 35, 35)).astype(np.uint8)
    masks[::2, :20] = 0
    rims = np.column_stack([random.uniform(-16.0, -9.0, len(masks)), random.uniform(9.0, 16.0, len(masks))])
    rims = np.column_stack([rims, rims[::-1], np.full(len(masks), 2.0)])
    reach = np.hstack([centre - 18.0 * step[:, None] ** 2, centre + 18.0 * step[:, None] ** 2])
    x, y = random.uniform(-20.0, size + 20.0, (2, size * size))
    x[:2], y[:2] = [np.nan, centre[0, 0]], [0.0, centre[0, 1]]
    outputs = np.zeros((5, x.size))
    return (
        *(x, y, centre, to_steps, step**-4, np.round(random.normal(size=patches)), level.astype(np.int32)),
        *(coefficients, mask_of, masks, rims, *BoxClasses.from_boxes(reach), random.normal(size=(2, 2))),
        *(*outputs, np.zeros((2, x.size)), 0, x.size),
    )


def _measure_patches(size: int) -> tuple[Any, ...]:
    """Patches of the second level on all rows of a raster with a void."""
    random = np.random.default_rng(3)
    scale, count = 4, max(-(-(size - 1) // (28 * 4)), 1)
    spline = random.normal(size=(28 * count + 7, 28 * count + 7)).astype(np.float32)
    samples = random.normal(size=(size, size)).astype(np.float32)
    samples[: size // 3, size // 2 :] = np.nan
    t = np.arange(scale) / scale
    parts = (1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3
    weights = [each / 6.0 for each in parts]
    return spline, 0, samples, 0, 0.5, *weights, 0, count, np.zeros((count, count))


def _kernels(size: int) -> tuple[Any, ...]:
    """Boxes, growth, first rectangles and corners: squares of three sizes; of some, two rectangles beside."""
    random = np.random.default_rng(4)
    step = 2.0 ** random.integers(0, 3, size)
    middle = np.round(random.uniform(0.0, size, (size, 2)))
    count = random.choice([1, 2], size, p=[0.8, 0.2])
    owner = np.repeat(np.arange(size), count)
    first = np.append(0, np.cumsum(count))
    unit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = unit * (14.0 * step[owner])[:, None, None]
    second = first[1:][count == 2] - 1
    corners[second] *= [1.0, 0.5]
    corners[second, :, 1] += 21.0 * step[owner[second], None]
    is_turned = (owner % 3 == 0)[:, None, None]
    corners = np.where(is_turned, corners @ np.array([[0.8, 0.6], [-0.6, 0.8]]), corners)
    corners += middle[owner, None]
    low, high = corners.min(axis=1), corners.max(axis=1)
    boxes = np.hstack([np.minimum.reduceat(low, first[:-1]), np.maximum.reduceat(high, first[:-1])])
    return boxes, 0.15 * step, first, corners


def _compute_tops(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(5)
    kernels = boxes, growth, *_ = _kernels(size)
    grown = boxes + growth[:, None] * [-1.0, -1.0, 1.0, 1.0]
    rank, error = np.round(np.log2(growth)).astype(np.int64), np.round(random.uniform(0.0, 4.0, size), 1)
    finest, grid = random.random(size) < 0.5, random.integers(0, 3, size).astype(np.int32)
    return (
        *(np.arange(size), rank, error, finest, grid, *kernels, *BoxClasses.from_boxes(grown), 0, size),
        *(np.zeros(size), np.zeros(size, bool), *np.zeros((2, size), np.int64), *np.zeros((2, 2 * size))),
        *(np.zeros((2, 512, 20, 2)), np.zeros((2, 512), np.int64)),
    )


def _mark_kernels(size: int) -> tuple[Any, ...]:
    boxes, growth, first, corners = _kernels(size)
    return boxes, 4.0 * growth, first, corners, -0.3 * size, -0.2 * size, 1.7, np.zeros((size, size), bool)


def _fill_voids(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(6)
    samples = np.round(np.cumsum(random.normal(size=(size, size)), 0), 1).astype(np.float32)
    rough = ndimage.uniform_filter(random.random((size, size)), 4)
    samples[1:-1, 1:-1][rough[1:-1, 1:-1] > np.quantile(rough, 0.8)] = np.nan
    labels = np.zeros((size, size), np.int32)
    ndimage.label(np.isnan(samples), np.ones((3, 3)), output=labels)
    found = [(r.start, r.stop, c.start, c.stop) for r, c in ndimage.find_objects(labels)]
    boxes = np.array(found, np.int64).reshape(-1, 4)
    side = np.maximum(boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2])
    chosen = np.flatnonzero(side <= 64)
    relaxation = 1.0 + 1.0 / (1.0 + 3.0 / (side[chosen] + 2.0))
    return samples, labels, boxes, chosen, relaxation, np.zeros(66 * 66), np.zeros(66 * 66, np.int64)


def _largest_distance(size: int) -> tuple[Any, ...]:
    """All triangles of a raster but some, large ones in both directions, and a degenerate one."""
    random = np.random.default_rng(7)
    mesh, last = full_mesh(size, size), size * size - 1
    large = [[0, size * (size // 2), size - 1], [size - 1, size * (size // 2) + 1, 0], [0, last, last]]
    triangles = np.concatenate([mesh.triangles[: -2 * size], np.array(large, np.uint32)])
    height = np.round(random.normal(size=(size, size)), 1)
    corner = height.ravel() + random.choice([0.0, 0.1], last + 1)
    height[size // 2, size // 2] = np.nan
    return triangles, mesh.column, mesh.row, corner, height, np.ones((size, size), bool)


def _test_against_horizon(size: int) -> tuple[Any, ...]:
    """As many tiles as boxes; bearings also before the first and beyond the last step."""
    random = np.random.default_rng(8)
    limit, far = np.round(random.uniform(1.0, 9.0, (2, size)), 1)
    first, ground_first = random.integers(-1500, 1500, (2, size))
    width, ground_width = random.integers(0, 600, (2, size))
    most, bottom = np.round(random.normal(size=(2, size)), 1)
    tested, raising = np.argsort(limit, kind="stable")[size // 9 :], np.argsort(far, kind="stable")
    ground = ground_first, ground_first + ground_width, bottom
    boxes = tested, limit, first, first + width, most
    return *boxes, raising, far, *ground, np.zeros(size, bool), np.zeros(2048)


def _premultiply(size: int) -> tuple[Any, ...]:
    texels = np.random.default_rng(9).integers(0, 256, (size * size, 4)).astype(np.uint8)
    return texels, np.zeros_like(texels)


def _stroke_pieces(size: int) -> tuple[Any, ...]:
    """Lines of one to six points on a raster, so that some turn straight back."""
    random = np.random.default_rng(10)
    count = random.integers(1, 7, size)
    steps = random.choice([-6.0, 0.0, 6.0], (int(count.sum()), 2)) + np.array([0.0, 1.0])
    first = np.append(0, np.cumsum(count))
    point = np.cumsum(steps, 0) % (size + 7.5)  # so that no step is none
    segments = np.maximum(count - 1, 1)
    owner = np.repeat(np.arange(size), segments)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(segments) - segments, segments)
    n = len(owner)
    outputs = np.zeros((n, 16, 2)), np.zeros(n, np.int64), np.zeros((n, 4)), np.zeros(n), np.zeros(n)
    return point, first, random.uniform(0.5, 4.0, size), owner, place, *outputs


def _polygons(size: int) -> tuple[Float64Array, Int64Array]:
    arguments = _stroke_pieces(size)
    host_function("stroke_pieces")(*arguments)
    return arguments[5], arguments[6]


def _cells_met(size: int) -> tuple[Any, ...]:
    """Polygons in cells of a metre, widened and narrowed, of which only some have room."""
    polygon, count = _polygons(size)
    border = np.random.default_rng(11).choice([-0.001, 0.0, 0.4], len(count))
    return polygon, count, border, size, *np.zeros((2, 60 * size), np.int64)


def _cut_polygons(size: int) -> tuple[Any, ...]:
    """Return the same polygons on two triangles a cell, of up to 64 cells a side."""
    polygon, count = _polygons(size)
    side = min(size, 64)
    found = np.zeros((2, 200 * size), np.int64)
    met = host_function("cells_met")(polygon, count, np.zeros(len(count)), side, *found)
    cell, owner = found[:, : min(met, found.shape[1])].copy()
    row, column = (each.ravel() for each in np.indices((side, side)))
    halves = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], np.float64)
    corners = (np.column_stack([column, row])[:, None, None] + halves).reshape(-1, 3, 2)
    lists = 2 * np.arange(side * side + 1), np.arange(len(corners)), np.zeros(len(corners), np.int64)
    room = 12 * len(cell)
    outputs = *np.zeros((2, room), np.int64), *np.zeros((2, room))
    return polygon, count, cell, owner, corners, *lists, *outputs


SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    "evaluate_surface": _evaluate_surface,
    "measure_patches": _measure_patches,
    "compute_tops": _compute_tops,
    "mark_kernels": _mark_kernels,
    "fill_voids": _fill_voids,
    "largest_distance": _largest_distance,
    "test_against_horizon": _test_against_horizon,
    "premultiply": _premultiply,
    "stroke_pieces": _stroke_pieces,
    "cells_met": _cells_met,
    "cut_polygons": _cut_polygons,
}
"""Functions of fresh arguments by a size, as those of `sketchterrain.benchmarks.host`."""
