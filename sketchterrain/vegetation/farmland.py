"""Plants on land use: where none grow wild, and the rows of orchards and vineyards."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int64Array, LatticeArray
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landuse.areas import BUILT_UP, FIELD, FOREST
from sketchterrain.schema.layers import CROPS
from sketchterrain.terrain.layers.landuse import LandUseLayer

if TYPE_CHECKING:
    from sketchterrain.terrain.evaluator import Evaluator

_GRASSY: Final = tuple(CROPS.index(name) for name in ("orchard", "vineyard"))


class PlantedRows(NamedTuple):
    """How a crop stands in rows, as appearance tiles paint them."""

    species: str
    scale: float
    apart: float  # m between rows
    along: float  # m between plants of a row
    first: float  # middle of the first row, of `apart`


ROWS: Final = {
    CROPS.index("orchard"): PlantedRows("oak", 0.4, 5.0, 5.0, 0.225),
    CROPS.index("vineyard"): PlantedRows("shrub", 0.5, 2.2, 1.8, 0.19),
}
"""Crops that are woody plants."""


class Farmland:
    """Land use as plants of one storey find it."""

    def __init__(self, evaluator: Evaluator, storey: str) -> None:
        self._evaluator = evaluator
        self._layer = evaluator.recipe[LandUseLayer]
        self._world = evaluator.recipe.world
        self._woody = storey == "woody"

    def is_bare(self, x: LatticeArray, y: LatticeArray) -> BoolArray:
        """Return at which positions (n,), lattice units, no plant of the storey grows wild."""
        use = self._layer.areas
        if not len(use):
            return np.zeros(len(x), np.bool_)
        area = self._layer.areas_at(x, y, self._world)
        own = np.maximum(area, 0)
        if self._woody:
            bare = use.use[own] != FOREST
        else:
            crops = (use.use[own] == FIELD) & ~np.isin(use.crops(own), _GRASSY)
            bare = (use.use[own] == BUILT_UP) | crops
        return np.asarray((area >= 0) & bare)

    def _heights(self, x: Float64Array, y: Float64Array, *, cell_size: float) -> Float32Array:
        at = (to_lattice(each, self._world.extent) for each in (x, y))
        return self._evaluator.points(*at, cell_size=cell_size)[0].astype(np.float32)

    def rows_in(self, box: tuple[int, int, int, int]) -> tuple[LatticeArray, Int64Array]:
        """Return plants (n, 2) of `ROWS` in a rectangle without its east and north sides; their crops."""
        layer, use, unit = self._layer, self._layer.areas, self._world.unit
        places, owners = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
        if self._woody and np.isin(use.crop, list(ROWS)).any():
            _, near = layer.listed(np.array([box]), 0.0, self._world)
            orchards = np.sort(near[(use.use[near] == FIELD) & np.isin(use.crop[near], list(ROWS))])
            boxes = layer.index(self._world).boxes.boxes_of(orchards)
            low, high = np.maximum(boxes[:, :2], box[:2]) * unit, np.minimum(boxes[:, 2:], box[2:]) * unit
            bearings = np.radians(use.bearings(orchards, self._heights))
            area, edges = use.outlines(orchards)
            corners = edges[np.searchsorted(area, np.arange(len(orchards))), :2]
            for number, bearing in enumerate(bearings.tolist()):
                rows = ROWS[int(use.crop[orchards[number]])]
                plants = _grid(rows, corners[number], bearing, low[number], high[number])
                places.append(to_lattice(plants, self._world.extent))
                owners.append(np.full(len(plants), orchards[number]))
        at, owner = np.concatenate(places), np.concatenate(owners)
        west, south, east, north = box
        inside = (at >= (west, south)).all(axis=1) & (at < (east, north)).all(axis=1)
        at, owner = at[inside], owner[inside]
        own = layer.areas_at(at[:, 0], at[:, 1], self._world) == owner
        return at[own], use.crop[owner[own]].astype(np.int64)


def _grid(
    rows: PlantedRows, corner: Float64Array, bearing: float, low: Float64Array, high: Float64Array
) -> Float64Array:
    """Return the plants (n, 2), m, of rows of a direction (rad) in and around a rectangle."""
    along = np.array([np.sin(bearing), np.cos(bearing)])
    axes = np.stack([along, [along[1], -along[0]]])
    rectangle = np.array([low, (high[0], low[1]), high, (low[0], high[1])]) - corner
    place = rectangle @ axes.T / (rows.along, rows.apart)
    first, last = np.floor(place.min(axis=0)).astype(int) - 1, np.ceil(place.max(axis=0)).astype(int) + 1
    tree, row = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1))
    u, v = rows.along * tree.ravel(), rows.apart * (row.ravel() + rows.first)
    # Products one by one: a library's may differ with their number.
    return np.stack([corner[k] + u * axes[0, k] + v * axes[1, k] for k in (0, 1)], axis=1)
