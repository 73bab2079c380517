"""Error against time: float32 and float64 kernels and the NumPy reference."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.appearance_error import appearance_table, drape_table
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import open_ground, scattered_keys
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap, spread
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import QUADS, level_step, metres_per_unit
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.surfaces import Surface

__all__ = ["DOUBLE", "FLOAT", "NUMPY", "TILE_SEED", "measure"]

FLOAT, DOUBLE, NUMPY = "float32 kernels", "float64 kernels", "NumPy float64"
TILE_SEED = 11
"""Seed of the draw of tiles."""


@dataclass(frozen=True)
class _Sample:
    """Tiles of one level with their border: lattice axes of shape (tiles, 67)."""

    recipe: TerrainRecipe
    x: npt.NDArray[np.int64]
    y: npt.NDArray[np.int64]
    cell_size: float

    @property
    def vertices(self) -> int:
        return len(self.x) * (QUADS + 1) ** 2

    def kernels(self, evaluator: Evaluator) -> Surface:
        return evaluator.surface(self.x, self.y, cell_size=self.cell_size)

    def reference(self) -> tuple[Float64Array, Float64Array]:
        """Heights and normals in NumPy: central differences of heights that have a border."""
        side = self.x.shape[1]
        x = np.broadcast_to(self.x[:, None, :], (len(self.x), side, side))
        y = np.broadcast_to(self.y[:, :, None], x.shape)
        height = np.stack(
            [
                HostTerrain(self.recipe)
                .samples(a.ravel(), b.ravel(), cell_size=self.cell_size)
                .height.reshape(side, side)
                for a, b in zip(x, y, strict=True)
            ]
        )
        span = 2 * self.cell_size
        slope_x = (height[:, 1:-1, 2:] - height[:, 1:-1, :-2]) / span
        slope_y = (height[:, :-2, 1:-1] - height[:, 2:, 1:-1]) / span
        normal = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
        return height[:, 1:-1, 1:-1], normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Error of heights, normals and material weights against nanoseconds a vertex, for several cell sizes.

    The float32 kernels and the same source built with `REAL=double` evaluate the same random tiles, timed by
    profiling events. Their errors are differences from the NumPy float64 reference (by the clock): heights in
    millimetres, normals in degrees. Material weights (0 … 1) have no NumPy reference: float32 is compared
    with the float64 kernels. Errors are the largest of all vertices, and the 99th percentile. Both builds
    store 24 bits of a position within a noise cell, NumPy all: that is the float64 kernels' remaining error.

    "relief of" a preset is its drained relief alone, whose reference is `layers/relief.py`.

    The second table is of appearance tiles: albedo (times the share) and the share that roads and land use
    cover, for several sizes of texels, against the mean of 64 smaller texels of the float64 kernels; and the
    same of means of 4 and 16 smaller ones. The last one is of draped areas and lines, against the exact areas
    of texels inside them.
    """
    exact = TimedContext(str(context.device.index), real="double") if context.device.has_double else None
    rows: list[Row] = []
    for ground in effort.accuracy_grounds:
        terrain = open_ground(ground, context)
        for level in effort.accuracy_levels:
            sample = _sample(terrain, level, effort.accuracy_tiles)
            shared: dict[str, Any] = {"ground": ground, "level": level, "cell_size": sample.cell_size}
            rows += [shared | row for row in _compare(sample, context, exact, effort.rounds)]
    errors = Table("Error against time", tuple(rows))
    painted = appearance_table(context, exact, effort)
    return (errors, painted, drape_table(context, effort))


def _sample(terrain: Terrain, level: int, count: int) -> _Sample:
    axes = [_tile_axes(*key) for key in scattered_keys(level, count, terrain, seed=TILE_SEED)]
    cell = level_step(level) * metres_per_unit(terrain.extent)
    return _Sample(terrain.recipe, np.stack([x for x, _ in axes]), np.stack([y for _, y in axes]), cell)


def _compare(
    sample: _Sample, context: TimedContext, exact: TimedContext | None, rounds: int
) -> Iterator[dict[str, Any]]:
    contexts = {FLOAT: context} | ({DOUBLE: exact} if exact is not None else {})
    evaluators = {method: Evaluator(sample.recipe, opened) for method, opened in contexts.items()}
    works: dict[str, Callable[[], Lap]] = {
        method: partial(opened.lap, partial(sample.kernels, evaluators[method]))
        for method, opened in contexts.items()
    }
    works[NUMPY] = lambda: lap(sample.reference)
    laps = alternate(works, rounds=rounds)
    height, normal = sample.reference()
    surfaces = {method: sample.kernels(evaluator) for method, evaluator in evaluators.items()}
    for method in works:
        seconds = [one.device if method in surfaces else one.wall for one in laps[method]]
        times = spread(seconds)
        row: dict[str, Any] = {
            "method": method,
            "rounds": times.count,
            "ns_per_vertex": times.median / sample.vertices * 1e9,
            "p95_ns_per_vertex": times.p95 / sample.vertices * 1e9,
            "seconds": seconds,
        }
        if method in surfaces:
            row |= _height_errors(surfaces[method].height, height)
            row |= _normal_errors(surfaces[method].normal, normal)
        if method == FLOAT and DOUBLE in surfaces:
            difference = surfaces[FLOAT].materials - surfaces[DOUBLE].materials
            row["material"] = float(np.max(np.abs(difference)))
        yield row


def _height_errors(height: npt.NDArray[Any], truth: Float64Array) -> dict[str, float]:
    error = np.abs(height - truth) * 1e3
    return {"height_mm": float(error.max()), "height_p99_mm": float(np.percentile(error, 99))}


def _normal_errors(normal: npt.NDArray[Any], truth: Float64Array) -> dict[str, float]:
    # The chord, not the dot product: the angle's cosine loses what is below 1e-8 of it.
    chord = np.linalg.norm(normal.astype(np.float64) - truth, axis=-1)
    angle = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))
    return {"normal_deg": float(angle.max()), "normal_p99_deg": float(np.percentile(angle, 99))}


def _tile_axes(level: int, column: int, row: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the lattice coordinates of a tile's vertices and of one more vertex beyond each border."""
    step = level_step(level)
    offsets = np.arange(-1, QUADS + 2, dtype=np.int64) * step
    return column * QUADS * step + offsets, (row + 1) * QUADS * step - offsets
