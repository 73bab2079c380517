"""Tiles in the way of Zaaijer 2013, chapters 3 and 7 (``thesis.cl``): what the program's are compared with.

Noise from a permutation table, all octaves at every level, iterated sampling of splines with square roots,
one launch of each kernel a tile, normals by finite differences. Where the thesis leaves a choice it gets the
cheaper one: features and pieces of rivers that can't reach a tile are left out on the host, before the clock
starts; a hill's own fractal has six octaves (it says "several"); there are no dunes, lakes, materials and
parents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import FloatArray
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.noise import FINEST_WAVELENGTH
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext


_FILE = "baselines/thesis.cl"
_RISING = ("hill", "mountain")
_DEPTH = 2.0  # m, of a river's bed
_WAVELENGTH, _ROUGHNESS, _RELIEF = 1600.0, 0.45, 40.0  # of the ground's noise: m, ratio, m


@dataclass(frozen=True)
class SplineSampling:
    """How the nearest place on a piece of spline is found: so many samples, again in so many rounds."""

    samples: int
    rounds: int


class ThesisTiles:
    """Tiles of one level of a terrain's ground, hills, mountains and rivers."""

    def __init__(
        self,
        recipe: TerrainRecipe,
        context: ComputeContext,
        keys: Sequence[tuple[int, int, int]],
        *,
        quads: int = QUADS,
    ) -> None:
        self._context = context
        self._inner_side, self._side = quads + 1, quads + 3
        real = context.real_dtype
        width = recipe.extent / 2.0 ** keys[0][0]
        self.spacing = width / quads
        octaves = int(np.log2(_WAVELENGTH / FINEST_WAVELENGTH)) + 1
        permutation = np.random.default_rng(recipe.seed).permutation(256).astype(np.int32)
        self._noise = (
            context.upload(np.tile(permutation, 2)),
            np.int32(octaves),
            *(real.type(each) for each in (_WAVELENGTH, _ROUGHNESS)),
            real.type(_RELIEF / 2),
        )
        (features, hill), segments = _rising(recipe), _segments(recipe)
        reach = _reaches(recipe)
        self._tiles: list[tuple[Any, ...]] = []
        for _, column, row in keys:
            west, south = column * width, row * width
            near = _reaching(features[:, :2], features[:, 2], west, south, width, self.spacing)
            f = features[near]
            middle = segments[:, 1:3, :2].mean(axis=1)
            # A piece stays within its control points' spread of its middle.
            spread = np.ptp(segments[:, :, :2], axis=1).max(axis=1, initial=0.0)
            along = _reaching(middle, spread + reach, west, south, width, self.spacing)
            s = segments[along]
            self._tiles.append(
                (
                    *(context.upload(f.astype(real)), np.int32(np.sum(hill[near])), np.int32(len(f))),
                    *(context.upload(s.astype(real)), np.int32(len(s))),
                    *(context.upload(reach[along].astype(real)), real.type(_DEPTH)),
                    *(real.type(west), real.type(south + width)),
                )
            )
        self._height = context.empty(self._side**2, real)
        self._inner = context.empty(len(keys) * self._inner_side**2, real)
        self._normal = context.empty(3 * len(keys) * self._inner_side**2, real)

    def launch(self, sampling: SplineSampling) -> None:
        """Enqueue the tiles one by one and wait for the last."""
        context, real = self._context, self._context.real_dtype
        spacing, side = real.type(self.spacing), np.int32(self._side)
        looking = np.int32(sampling.samples), np.int32(sampling.rounds)
        inner = (self._inner_side, self._inner_side)
        for number, (*near, west, north) in enumerate(self._tiles):
            place = (west, north, spacing, side)
            heights = (*self._noise, *near, *looking, *place, self._height)
            normals = (self._height, side, spacing, np.int32(number), self._inner, self._normal)
            context.launch(_FILE, "thesis_heights", (self._side, self._side), *heights)
            context.launch(_FILE, "thesis_normals", inner, *normals)
        context.download(self._inner, 1, real)

    def heights(self) -> FloatArray:
        """Return the heights of the last launch, m, shape (tiles, quads + 1, quads + 1)."""
        shape = (len(self._tiles), self._inner_side, self._inner_side)
        return self._context.download(self._inner, shape, self._context.real_dtype)


def _rising(recipe: TerrainRecipe) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return x, y, radius and height of hills, then of mountains, shape (n, 4), and which are hills."""
    parts = [
        recipe.points.painted[recipe.points.painted["type"] == FEATURE_TYPES.index(name)] for name in _RISING
    ]
    rising = np.concatenate(parts)
    numbers = np.stack([rising[name] for name in ("x", "y", "radius", "strength")], axis=-1).astype(
        np.float64
    )
    return numbers, np.arange(len(rising)) < len(parts[0])


def _segments(recipe: TerrainRecipe) -> FloatArray:
    """Return the rivers' control points, four for each piece: x, y, water, half width; shape (n, 4, 4)."""
    pieces = [np.empty((0, 4, 4))]
    for river in recipe.rivers:
        points = np.column_stack([river.points, river.width / 2])
        ends = 2 * points[[0, -1]] - points[[1, -2]]
        padded = np.concatenate([ends[:1], points, ends[1:]])
        padded[:, 3] = np.maximum(padded[:, 3], points[:, 3].min())
        pieces.append(np.stack([padded[i : i + 4] for i in range(len(points) - 1)]))
    return np.concatenate(pieces)


def _reaches(recipe: TerrainRecipe) -> FloatArray:
    """Return how far the rivers' valleys reach, m, for each piece: as far as this program's."""
    parts = [np.empty(0)]
    for course in recipe[CorridorsLayer].courses:
        river, reach = course.river, course.valley_radius
        apart = river.points[:, None, :2] - river.centreline[None, :, :2]
        far = reach[np.argmin(np.linalg.norm(apart, axis=-1), axis=1)]
        parts.append(np.maximum(far[1:], far[:-1]))
    return np.concatenate(parts)


def _reaching(
    centre: FloatArray, radius: FloatArray, west: float, south: float, width: float, border: float
) -> npt.NDArray[np.bool_]:
    """Return which discs reach a square tile and the border around it."""
    low = np.array([west, south]) - border
    nearest = np.clip(centre, low, low + width + 2 * border)
    return np.asarray(np.linalg.norm(nearest - centre, axis=1) < radius)
