"""Where someone could stand on a terrain: dry, not too steep, in the open."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from sketchterrain.render.relief import HeightMap
from sketchterrain.render.scene import visible_rectangle

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import BoolArray, Float64Array
    from sketchterrain.render.scene import TerrainSource


MOST: Final = 220
"""Stands that are looked from."""
GRID: Final = 22
"""Stands along each side of the sketch, wherever they are …"""
RISES: Final = 40
"""… and for a rise, of which only the `TALL` highest over their surroundings are taken."""
TALL: Final = 130
SHORE: Final = (9.0, 30.0)
"""m from the water to those at its shores."""
SHORE_EVERY: Final = 1.0 / 50.0
"""Extents along a river between them."""
STEEPEST: Final = 0.3
AROUND: Final = 0.09
"""Extents: over how wide surroundings a rise rises."""
FOREST: Final = 3  # code of forests among the types of point features
WIDE: Final = 0.6  # rad to each side of a view in which plants are in the way
ROUND: Final = 5.0  # m around the eye in which they always are


class Cover:
    """Where water and forests are."""

    def __init__(self, terrain: TerrainSource, relief: HeightMap) -> None:
        features = terrain.features
        forests = features.points[features.points["type"] == FOREST]
        places = np.stack([forests["x"], forests["y"]], axis=1)
        self._woods = relief.rasterized_mask([places], [1.8 * forests["radius"].astype(np.float64)])
        lines = [np.asarray(river.centreline) for river in features.rivers]
        self._rivers = cKDTree(np.concatenate(lines)[:, :2]) if lines else None
        self._half = (
            np.concatenate([river.centreline_width for river in features.rivers]) / 2.0 if lines else None
        )
        self._lakes = [
            HeightMap(
                lake.shape.west - lake.shape.spacing / 2,
                lake.shape.south - lake.shape.spacing / 2,
                lake.shape.spacing * max(lake.shape.inside.shape),
                _squared(lake.shape.inside),
            )
            for lake in features.lakes
        ]

    def woods(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return 1 in forests, 0 elsewhere, at places (m)."""
        return self._woods.at(x, y)

    def wet(self, x: Float64Array, y: Float64Array) -> BoolArray:
        """Tell which places (m) are on a river or a lake."""
        return self.shore(x, y) <= 0.0

    def shore(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return about how far places are from water (m), up to 60; negative on it."""
        far = np.full(np.shape(x), 60.0)
        for lake in self._lakes:
            far = np.minimum(far, -lake.at(x, y))
        if self._rivers is not None and self._half is not None:
            places = np.stack([np.ravel(x), np.ravel(y)], axis=-1)
            bound = 60.0 + float(self._half.max())
            found = self._rivers.query(places, distance_upper_bound=bound)
            distance, nearest = np.asarray(found[0]), np.asarray(found[1])
            half = np.append(self._half, 0.0)[nearest]
            far = np.minimum(far, np.where(np.isfinite(distance), distance - half, 60.0).reshape(far.shape))
        return far


def find_viewpoints(terrain: TerrainSource, relief: HeightMap, cover: Cover, *, raised: bool) -> Float64Array:
    """Return places (n, 2) x, y (m) where one could stand, at least one."""
    west, south, east, north = visible_rectangle(terrain)
    side = RISES if raised else GRID
    along = (np.arange(side) + 0.5) / side
    grid = np.stack(
        [each.ravel() for each in np.meshgrid(west + along * (east - west), south + along * (north - south))],
        axis=-1,
    )
    if raised:
        places = grid[np.argsort(-topographic_position(terrain, relief, grid), kind="stable")]
    else:
        places = np.concatenate([_shores(terrain), grid])
    kept = places[_stands_well(terrain, cover, places)]
    if not len(kept):
        return np.array([[(west + east) / 2.0, (south + north) / 2.0]])
    if raised:
        return np.asarray(kept[:TALL])
    few = np.unique(np.linspace(0, len(kept) - 1, MOST).round().astype(int))
    return np.asarray(kept[few])


def topographic_position(terrain: TerrainSource, relief: HeightMap, places: Float64Array) -> Float64Array:
    """Return how high places (n, 2) lie over the mean of what surrounds them (m)."""
    texels = max(round(AROUND * terrain.extent / relief.texel), 3)
    mean = HeightMap(relief.west, relief.south, relief.width, uniform_filter(relief.heights, texels))
    return relief.at(*places.T) - mean.at(*places.T)


def unobstructed_distance(
    terrain: TerrainSource, eye: Float64Array, bearing: float, *, reach: float
) -> float:
    """Return how far ahead the nearest plant is in a view (m), `reach` at most; 0 for one around the eye."""
    x, y = float(eye[0]), float(eye[1])
    plants = terrain.foliage(x - reach, y - reach, x + reach, y + reach)
    east, north = plants["x"] - x, plants["y"] - y
    distance = np.hypot(east, north)
    off = np.abs((np.arctan2(east, north) - bearing + np.pi) % (2.0 * np.pi) - np.pi)
    if (distance < ROUND).any():
        return 0.0
    ahead = distance[off < WIDE]
    return float(min(ahead.min(initial=reach), reach))


def _shores(terrain: TerrainSource) -> Float64Array:
    """Return places beside rivers and lakes."""
    found = [np.zeros((0, 2))]
    for river in terrain.features.rivers:
        line = np.asarray(river.centreline)[:, :2]
        step = np.diff(line, axis=0)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        at = np.arange(0.0, arc[-1], SHORE_EVERY * terrain.extent)
        index = np.searchsorted(arc, at).clip(0, len(step) - 1)
        along = step[index] / np.maximum(np.hypot(*step[index].T), 1e-9)[:, None]
        aside = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        half = river.centreline_width[index, None] / 2.0
        found += [line[index] + sign * (half + off) * aside for off in SHORE for sign in (-1.0, 1.0)]
    for lake in terrain.features.lakes:
        field = lake.shape
        row, column = np.nonzero(
            (field.inside < -SHORE[0]) & (field.inside > -SHORE[0] - 1.5 * field.spacing)
        )
        few = slice(None, None, max(len(row) // 60, 1))
        found.append(np.stack([column[few], row[few]], axis=-1) * field.spacing + [field.west, field.south])
    return np.concatenate(found)


def _stands_well(terrain: TerrainSource, cover: Cover, places: Float64Array) -> BoolArray:
    """Tell where one stands well."""
    x, y = places.T
    west, south, east, north = visible_rectangle(terrain)
    margin = 0.02 * terrain.extent
    here = (x > west + margin) & (x < east - margin) & (y > south + margin) & (y < north - margin)
    z = [terrain.heights(x + dx, y + dy) for dx, dy in ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))]
    even = np.hypot(z[1] - z[0], z[2] - z[0]) / 4.0 < STEEPEST
    return np.asarray(here & even & (cover.shore(x, y) > 3.0) & (cover.woods(x, y) < 0.5))


def _squared(field: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return a field as a square one; what is added lies as far outside as its farthest sample."""
    side = max(field.shape)
    result = np.full((side, side), float(field.min()), np.float32)
    result[: field.shape[0], : field.shape[1]] = field
    return result
