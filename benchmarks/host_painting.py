"""Samples of arguments for loops over what is painted: draped features, labels, roads, edges of areas."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array

_SQUARE: Final = 192  # texels along a tile
_FREE: Final = 1 << 60


def _drape_pieces(size: int) -> tuple[Any, ...]:
    """Return strokes, rings and points in turn, some on borders of blocks, with equal points and far ends."""
    random = np.random.default_rng(2)
    kind = np.resize(np.array([0, 1, 2], np.int8), size)
    count = np.where(kind == 2, 1, random.integers(2, 20, size))
    first = np.append(0, np.cumsum(count))
    points = np.repeat(random.uniform(-50.0, _SQUARE + 50.0, (size, 2)), count, axis=0)
    points += (
        random.normal(0.0, 1.0, points.shape) * np.repeat(10.0 ** random.uniform(0, 3, size), count)[:, None]
    )
    points[::7] = np.round(points[::7] / 8.0) * 8.0
    points[1::9] = points[::9][: len(points[1::9])]
    points[first[1:][kind == 1] - 1] = points[first[:-1][kind == 1]]
    ends, reach = random.integers(0, 16, size).astype(np.uint8), random.choice([0.0, 1.5, 20.0], size)
    pieces, pairs = 20 * size + 99, 200 * size + 999
    given = kind, first, points, ends, reach, random.random(size) < 0.5
    found = np.zeros((pieces, 8)), np.zeros(pieces, np.int32), np.zeros((pairs, 3), np.int32)
    return *given, *found, np.zeros(2, np.int64), np.zeros_like(points)


def _encode_texels(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(11)
    painted, moments = (random.uniform(-0.1, 1.1, (size * size, n)).astype(np.float32) for n in (4, 5))
    moments[::3, :2] *= 60.0
    return painted, moments, *np.zeros((2, size * size, 4), np.uint8)


def _choose_labels(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(3)
    low = np.round(random.uniform(0.0, 900.0, (size, 2)))
    boxes = np.concatenate([low, low + random.integers(5, 90, (size, 2))], axis=1)
    state, labels = random.integers(0, 3, size).astype(np.int8), random.integers(0, size // 4 + 1, size)
    order, chosen = np.argsort(-state, kind="stable"), np.zeros(size, np.bool_)
    return order, boxes, labels, state, 200, 6.0, 300.0, chosen, np.zeros(size, np.int64)


def _lines_around(size: int) -> tuple[Any, ...]:
    _, first, points, *_ = _drape_pieces(size)
    found = np.zeros(size), np.zeros(size, np.int64)
    return first[:-1].copy(), np.diff(first).astype(np.int32), points, 90.0, 110.0, *found


def _graph(size: int) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Return a network of some junctions: neighbours from each on, neighbours, and limits of height."""
    random = np.random.default_rng(4)
    ends = np.append(np.arange(size), random.integers(0, size, (2, size)).max(axis=0))
    source, target = np.append(ends, np.roll(ends, 1)), np.append(np.roll(ends, 1), ends)
    order = np.argsort(source, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(source, minlength=size)))
    return starts, target[order], np.tile(random.integers(0, 1 << 16, 2 * size), 2)[order]


def _share_excess(size: int) -> tuple[Any, ...]:
    starts, to, weight = _graph(size)
    height = np.round(np.random.default_rng(5).normal(0.0, 5.0, size), 1)
    height[::5] = -0.0
    return starts, to, weight * 2.0**-16, height, np.zeros(size)


def _lower_envelope(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(6)
    values = np.where(random.random(size) < 0.3, random.integers(-1 << 20, 1 << 20, size), _FREE)
    return values, *_graph(size), _FREE, *np.zeros((2, size), np.int64), np.zeros(size, np.bool_)


def _legs(size: int) -> tuple[Int64Array, Float64Array, Float64Array, Float64Array]:
    """Return the first stations of as many legs, places along them, ground in m with ties, and reaches."""
    random = np.random.default_rng(7)
    count = random.integers(2, 60, size)
    first = np.append(0, np.cumsum(count))
    along = np.cumsum(random.choice([0.5, 1.0, 2.5, 5.0], first[-1]))
    along -= np.repeat(along[first[:-1]], count)
    ground = np.round(np.cumsum(random.normal(0.0, 1.0, first[-1])), 1)
    ground[::11] = -0.0
    last = np.repeat(along[first[1:] - 1], count)
    return first, along, ground, np.minimum(np.minimum(along, last - along), 30.0)


def _least_squares(size: int) -> tuple[Any, ...]:
    first, along, ground, _ = _legs(size)
    random = np.random.default_rng(8)
    share = np.where(random.random(len(along)) < 0.2, 0.0, random.choice([1.0, 2.5, 3.75], len(along)))
    most = np.floor(0.1 * np.abs(np.diff(along)) * 2.0**16) * 2.0**-16
    ends = ground[np.stack([first[:-1], first[1:] - 1], axis=1)]
    return first, ground, share, most, ends, np.zeros(len(along)), np.zeros((4, 124))


def _mean_heights(size: int) -> tuple[Any, ...]:
    first, along, ground, reach = _legs(size)
    return size, along, first, ground, reach, np.zeros(len(along)), np.zeros(len(along))


def _united_reaches(size: int) -> tuple[Any, ...]:
    first, along, ground, _ = _legs(size)
    return size, along, first, np.abs(ground), np.zeros(len(along))


def _sum_edges(size: int) -> tuple[Any, ...]:
    """Return edges of all lengths on a raster of the size; some are level, upright or along texels."""
    random = np.random.default_rng(9)
    edges = random.uniform(-3.0, size + 3.0, (4 * size, 4))
    edges[:, 2:] = random.normal(0.0, 1.0, (4 * size, 2)) * 10.0 ** random.uniform(-1, 2, (4 * size, 1))
    edges[::3] = np.round(edges[::3])
    values = 2.0**40 * random.random((4 * size, 4))
    total = random.integers(-99, 99, (size, size, 4))
    return edges, values, total, np.zeros((size, size + 1, 4), np.int64)


def _edges_near(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(10)
    first = np.append(0, np.cumsum(random.integers(0, 99, size)))
    edges = random.normal(0.0, 1.0, (first[-1], 4)) * 10.0 ** random.uniform(0, 7, (first[-1], 1))
    edges[::3] = np.round(edges[::3])
    low = random.integers(-40, 40, (size, 2))
    blocks = np.concatenate([low, low + random.integers(0, 99, (size, 2))], axis=1)
    found = np.zeros(size, np.bool_), np.zeros(size, np.int64), *np.zeros((2, len(edges), 4), np.int32)
    return first, edges, blocks, 5, 0.75, 1 << 30, *found


SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    "drape_pieces": _drape_pieces,
    "encode_texels": _encode_texels,
    "choose_labels": _choose_labels,
    "lines_around": _lines_around,
    "share_excess": _share_excess,
    "lower_envelope": _lower_envelope,
    "least_squares": _least_squares,
    "mean_heights": _mean_heights,
    "united_reaches": _united_reaches,
    "sum_edges": _sum_edges,
    "edges_near": _edges_near,
}
"""Functions of fresh arguments by a number of items, or the side of a raster; scratch comes last."""
