"""Samples of arguments for the loops of the mesh, of relief and of painted uplift: see `host`."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.landforms import mesh, mesh_nodes, mesh_vertices, relief_fields
from sketchterrain.landforms.mesh import MeshTable
from sketchterrain.landforms.mesh_nodes import CellNodes
from sketchterrain.landforms.relief_fields import UnpaintedSettings

_LEVEL: Final = 2  # of the samples' nodes
_FIRST: Final = 130, -45  # column and row of their first quad: ranges beyond the sketch, and negative rows
_SETTINGS: Final = UnpaintedSettings(
    7680.0, 3, mountain_density=0.04, hill_density=0.2, surroundings=600.0, rocky_surroundings=True
)
_MESH: Final = mesh.mesh_parameters(3, 5.2)
_FIELDS: Final = relief_fields.uplift_fields(_SETTINGS)
_RULE: Final = mesh.PassRule(1.0, 1.8, 0.0045, 1920.0)
_SLOPES: Final = 5.2, _FIELDS.per_relief, 0.25, 1.875  # as `mesh_vertices.vertex_heights` takes them


def _empty(*shape: int) -> Float64Array:
    return np.empty(shape)


def _integers(*shape: int) -> Any:
    return np.empty(shape, np.int64)


def _vertices(rows: int, columns: int) -> tuple[Any, ...]:
    """Return offsets of sites, diagonals, centroids, probes and relief."""
    x, y, diagonal = mesh.lattice_sites(_MESH, *_FIRST, rows, columns)
    centre, probe = mesh_vertices.vertices(*_FIRST, x, y, diagonal)
    return x, y, diagonal, centre, probe, relief_fields.relief_at(_FIELDS, centre)[0]


def _table(rows: int, columns: int) -> MeshTable:
    x, y, diagonal, centre, probe, relief = _vertices(rows, columns)
    level, course = mesh_vertices.receivers(_MESH, diagonal, probe, relief)
    height, upstream = mesh_vertices.vertex_heights(diagonal, centre, level, course, relief, _SLOPES)
    sites = relief_fields.site_relief(_FIELDS, *_FIRST, x, y)
    height, receiver = mesh_vertices.captured(diagonal, centre, height, relief, sites, _SLOPES)
    low = mesh.lowest_around_sites(diagonal, height)
    return MeshTable(*_FIRST, x, y, diagonal, height, receiver, upstream, relief, sites, low)


def _window(size: int) -> tuple[MeshTable, tuple[int, int, int, int, int]]:
    """Return a table and the window (level, column, row, rows, columns) of nodes in its middle."""
    side, nodes = (size >> 4) + 8, 1 << (6 - _LEVEL)
    return _table(side, side), (_LEVEL, (_FIRST[0] + 3) * nodes, (_FIRST[1] + 3) * nodes, size, size)


def _places(size: int) -> tuple[MeshTable, Any, Float64Array, Float64Array]:
    table, window = _window(size)
    return table, *mesh_nodes.owners(_MESH, table, *window)


def _value_noise_row(size: int) -> tuple[Any, ...]:
    return 2**63 + 9, -3000, 16, -77, 7, 0.9, np.linspace(-1.0, 1.0, size)


def _lattice_sites(size: int) -> tuple[Any, ...]:
    return _MESH, *_FIRST, _empty(size + 1, size + 1), _empty(size + 1, size + 1), _integers(size, size)


def _edge_height(size: int) -> tuple[Any, ...]:
    table, quad = _table(size, size), size // 2
    ends = (1, 3) if table.diagonal[quad, quad] else (0, 2)
    return table, _RULE, quad, quad, 0, *ends, 0.2


def _lowest_around_sites(size: int) -> tuple[Any, ...]:
    height = np.round(
        np.random.default_rng(2).normal(size=(size, size, 2)), 1
    )  # ties, and zeros of both signs
    return mesh.lattice_sites(_MESH, *_FIRST, size, size)[2], height, _empty(size + 1, size + 1)


def _mesh_vertices(size: int) -> tuple[Any, ...]:
    sites = mesh.lattice_sites(_MESH, *_FIRST, size, size)
    return *_FIRST, *sites, _integers(size, size, 2, 2), _integers(size, size, 2, 2)


def _mesh_receivers(size: int) -> tuple[Any, ...]:
    _, _, diagonal, _, probe, relief = _vertices(size, size)
    shape = size, size, 2
    return _MESH, diagonal, probe, relief, _empty(*shape), _integers(*shape), _empty(*shape)


def _mesh_vertex_heights(size: int) -> tuple[Any, ...]:
    _, _, diagonal, centre, probe, relief = _vertices(size, size)
    level, course = mesh_vertices.receivers(_MESH, diagonal, probe, relief)
    count, order = level.size, np.argsort(-level.ravel(), kind="stable")
    given = diagonal, centre, level.ravel(), order, course, relief.ravel(), *_SLOPES, 32
    return *given, _empty(count), _integers(count), _integers(count), _empty(2, count)


def _captured_heights(size: int) -> tuple[Any, ...]:
    x, y, diagonal, centre, _, relief = _vertices(size, size)
    height, shape = np.round(np.random.default_rng(3).normal(0.0, 90.0, (size, size, 2)), -1), (size, size, 2)
    given = diagonal, centre, height, relief, relief_fields.site_relief(_FIELDS, *_FIRST, x, y), *_SLOPES, 6
    return *given, _empty(*shape), _integers(*shape), _empty(*shape)


def _raised_heights(size: int) -> tuple[Any, ...]:
    table = _table(size, size)
    centre = _vertices(size, size)[3]
    height, count = table.height.ravel(), table.height.size
    rise = np.maximum(np.random.default_rng(4).normal(0.0, 90.0, count), 0.0)
    given = table.diagonal, centre, height, np.argsort(-height, kind="stable"), table.receiver, 1.875, rise
    return *given, _empty(count), _integers(size, size, 2), _integers(count), _empty(count)


def _relief_at_points(size: int) -> tuple[Any, ...]:
    return _FIELDS, _vertices(size, size)[3].reshape(-1, 2), *_empty(3, 2 * size * size)


def _interpolated_nodes(size: int) -> tuple[Any, ...]:
    coarse = np.random.default_rng(5).normal(size=(size // 8 + 3, size // 8 + 3))
    return 3, -5, 11, coarse, _empty(size, size)


def _roughened_uplift(size: int) -> tuple[Any, ...]:
    relief = np.abs(np.random.default_rng(6).normal(0.0, 50.0, (size, size)))
    return _FIELDS, 1, -7, 9, relief, _empty(size, size), _empty(size)


def _mean_ground(size: int) -> tuple[Any, ...]:
    return _MESH, _FIELDS, 6, -3, -size // 2, _empty(size, size), _empty(size, size)


def _node_places(size: int) -> tuple[Any, ...]:
    table, window = _window(size)
    place, coordinates = np.empty((size, size, 5), np.int32), (_empty(size, size), _empty(size, size))
    return _MESH, table, *window[:3], place, *coordinates, _empty(2, size)


def _cell_bounds(size: int) -> tuple[Any, ...]:
    return _table(size, size), _empty(size, size, 4)


def _mesh_heights(size: int) -> tuple[Any, ...]:
    table, *places = _places(size)
    return table, _RULE, 1.2, *places, _empty(size, size)


def _cell_borders(size: int) -> tuple[Any, ...]:
    table, place, third, _ = _places(size)
    number = np.arange(table.site_x.size, dtype=np.int32).reshape(table.site_x.shape)
    number[number % 5 == 0] = -1
    owner, boxes = np.empty((size, size), np.int32), _integers(number.size, 4)
    return table, _RULE, place, third, number, owner, _empty(size, size), _empty(size, size), boxes


def _drain_cells(size: int) -> tuple[Any, ...]:
    """Return a disc after a cell without nodes; small ones are drained as the coarsest level."""
    random, side = np.random.default_rng(7), size + 2
    away = np.hypot(*np.indices((side, side)) - side // 2) / (size / 2)
    owner = np.where(away < 0.9, 1, -1).astype(np.int32)
    base = np.where((away > 0.75) & (away < 0.9), np.round(random.normal(0.0, 9.0, (side, side))), np.nan)
    uplift, inflow = random.uniform(0.0, 0.5, (side, side)), np.zeros((side, side))
    boxes = np.array([[0, 0, 0, 0], [1, 1, size + 1, size + 1]])
    cells = CellNodes(2, -20, 30, owner, base, uplift, uplift / (2.7 + uplift), inflow, boxes)
    half = size // 2 if size > 8 else 0
    start = random.uniform(0.0, 90.0, half * half)
    start[random.random(start.shape) < 0.2] = np.nan
    starts = np.array([[0, 0, 0, 0], [half, half, 16, -10]])
    given = cells, start, starts, 30.0, np.array([5, 5]), 16, 0.3, 1.5
    heights, others = (np.empty((2, size * size), kind) for kind in (np.float64, np.float32))
    return *given, *heights, *others, np.zeros(19 * side * side)


def _paste_cell(size: int) -> tuple[Any, ...]:
    random = np.random.default_rng(8)
    height, (area, wet) = random.normal(size=(size, size)), random.random((2, size, size), np.float32)
    height[random.random((size, size)) < 0.3] = np.nan
    return height, area, wet, -2, size // 3, np.zeros((size, size)), *np.zeros((2, size, size), np.float32)


def _features(size: int) -> tuple[Any, ...]:
    """Return x, y and radius of features, pairs of which are as deep somewhere."""
    random = np.random.default_rng(9)
    x, y = np.round(random.uniform(-0.1, 1.1, (2, 16)) * size)
    return np.append(x, x[:4] + 2.0), np.append(y, y[:4]), np.append(random.integers(1, 12, 16), [6.0] * 4)


def _numbers(size: int) -> tuple[Any, Any]:
    """Return the numbers of the shapes of features, and of those at nodes."""
    random = np.random.default_rng(10)
    return random.integers(-1, 3, 20), random.integers(-1, 3, (size, size), np.int32)


def _features_at(size: int) -> tuple[Any, ...]:
    values, shape = np.random.default_rng(11).normal(size=(20, 5)), (size, size)
    found = _empty(*shape), _integers(*shape), np.zeros((*shape, 5))
    return *_features(size), values, *_numbers(size), -9.0, *found, np.zeros((4, *shape))


def _mean_factors(size: int) -> tuple[Any, ...]:
    factors, half = np.random.default_rng(12).uniform(0.1, 8.0, 20), size // 2
    place = 1, 0, 2, np.zeros((half, half)), np.zeros((half, half))
    return *_features(size), factors, *_numbers(size), *place


def _adjust_factors(size: int) -> tuple[Any, ...]:
    random, half = np.random.default_rng(13), size // 2
    effect, below = random.normal(0.0, 40.0, (half, half)), random.normal(0.0, 10.0, (half, half))
    target, owner = random.uniform(0.0, 90.0, (size, size)), random.integers(-1, 20, (size, size))
    group = random.integers(0, 7, 20)
    return effect, below, target, owner, group, 1e-3, 1, 0, 2, 0.7, random.uniform(0.1, 8.0, 20), _empty(7)


SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    "value_noise_row": _value_noise_row,
    "lattice_sites": _lattice_sites,
    "edge_height": _edge_height,
    "lowest_around_sites": _lowest_around_sites,
    "mesh_vertices": _mesh_vertices,
    "mesh_receivers": _mesh_receivers,
    "mesh_vertex_heights": _mesh_vertex_heights,
    "captured_heights": _captured_heights,
    "raised_heights": _raised_heights,
    "relief_at_points": _relief_at_points,
    "interpolated_nodes": _interpolated_nodes,
    "roughened_uplift": _roughened_uplift,
    "mean_ground": _mean_ground,
    "node_places": _node_places,
    "cell_bounds": _cell_bounds,
    "mesh_heights": _mesh_heights,
    "cell_borders": _cell_borders,
    "drain_cells": _drain_cells,
    "paste_cell": _paste_cell,
    "uneven_noise": lambda size: (-9, 4, 31, 9, 0.6, np.zeros((size, size))),
    "feature_nearness": lambda size: (*_features(size), 1.2, np.full((size, size), -9.0)),
    "features_at": _features_at,
    "mean_factors": _mean_factors,
    "adjust_factors": _adjust_factors,
}
"""Functions of fresh arguments by the side of a raster, of quads or of nodes."""
