"""Areas of land use as arrays: what each is, and its borders."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.document.layers import CROPS, LAND_USES

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

FIELD, MEADOW, FOREST, BUILT_UP = range(len(LAND_USES))
AUTOMATIC: Final = 0
"""Crop of fields whose crop follows from their ids."""


@dataclass(frozen=True, eq=False)
class LandUse:
    """Areas by ascending id. Where areas overlap, the one of the higher id is on top.

    Neighbours share their borders vertex by vertex: the shares of a square that they cover add up to 1.
    """

    ids: Int64Array = field(default_factory=lambda: np.zeros(0, np.int64))  # (n,) of the vectors
    use: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))  # (n,) of `LAND_USES`
    crop: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))  # (n,) of `CROPS`
    # (n,) ° of its rows, 0 north, 90 east; -1: along the contours
    direction: Float64Array = field(default_factory=lambda: np.zeros(0))
    density: Float64Array = field(default_factory=lambda: np.zeros(0))  # (n,) share of a full stand of trees
    conifers: Float64Array = field(default_factory=lambda: np.zeros(0))  # (n,) share; -1: by elevation
    # (n + 1,) area i has the edges first[i] … first[i + 1]: it lies to their left
    first: Int64Array = field(default_factory=lambda: np.zeros(1, np.int64))
    edges: Float64Array = field(default_factory=lambda: np.zeros((0, 4)))  # (m, 4) x and y of both ends, m

    def __len__(self) -> int:
        return len(self.ids)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without cached properties."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def boxes(self) -> Float64Array:
        """West, south, east and north of each area, (n, 4), m."""
        if not len(self):
            return np.zeros((0, 4))
        low = np.minimum.reduceat(np.minimum(self.edges[:, :2], self.edges[:, 2:]), self.first[:-1])
        high = np.maximum.reduceat(np.maximum(self.edges[:, :2], self.edges[:, 2:]), self.first[:-1])
        return np.concatenate([low, high], axis=1)


NO_LAND_USE: Final = LandUse()


def land_use(sketch: Sketch) -> LandUse:
    """Return the areas of a sketch's land use."""
    layer = sketch.vectors["landuse"]
    if not len(layer):
        return NO_LAND_USE
    ring = layer.ring_of_vertex
    after = np.arange(1, len(layer.vertices) + 1)
    after[layer.rings[1:] - 1] = layer.rings[:-1]
    edges = np.concatenate([layer.vertices, layer.vertices[after]], axis=1)
    # Borders run counter-clockwise, those of holes clockwise.
    cross = edges[:, 0] * edges[:, 3] - edges[:, 1] * edges[:, 2]
    is_border = np.isin(np.arange(len(layer.rings) - 1), layer.parts[:-1])
    turned = ((np.add.reduceat(cross, layer.rings[:-1]) > 0.0) != is_border)[ring]
    edges[turned] = np.roll(edges[turned], 2, axis=1)
    area = layer.feature_of_ring[ring]
    order = np.argsort(layer.ids, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    own = np.argsort(rank[area], kind="stable")
    counts = np.bincount(rank[area], minlength=len(order))

    def indices(name: str, choices: tuple[str, ...]) -> npt.NDArray[np.uint8]:
        values, number = np.unique(sketch.vector_texts("landuse", name), return_inverse=True)
        return np.array([choices.index(value) for value in values.tolist()], np.uint8)[number][order]

    direction, density, conifers = (
        sketch.vector_values("landuse", name)[order] for name in ("direction", "density", "conifers")
    )
    return LandUse(
        layer.ids[order],
        indices("use", LAND_USES),
        indices("crop", CROPS),
        direction,
        density,
        conifers,
        np.append(0, np.cumsum(counts)),
        edges[own],
    )
