"""Device time of the kernels that make tiles: over the tile's size, its level and the device."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.grounds import BARE, open_ground
from sketchterrain.benchmarks.outcome import Column, Row, Table
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.compute.device import list_devices
from sketchterrain.compute.device_check import is_usable
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.lattice import QUADS, level_step, metres_per_unit
from sketchterrain.terrain.patch_layout import Patches
from sketchterrain.terrain.patches import PatchLauncher
from sketchterrain.terrain.surfaces import SurfaceStore

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap
    from sketchterrain.terrain.recipe import TerrainRecipe

SIZES = (16, 32, 64, 128)
"""Quads along a tile's side; tiles have 64."""

# Bytes that each writes a vertex: height, four masks and mottle; height, normal and eight weights.
_WRITTEN = {"patches": 24, "surfaces": 48}

_COLUMNS = (
    Column("device", "device"),
    Column("kernel", "kernel"),
    Column("ground", "ground"),
    Column("level", "level"),
    Column("quads", "quads a side"),
    Column("tiles", "tiles"),
    Column("launches", "launches"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("million_vertices_per_s", "M vertices/s"),
    Column("gigabytes_per_s", "GB/s written"),
)


def table(context: TimedContext, effort: Effort) -> Table:
    """Measure squares of the same ground cut into tiles of each size, on every device there is."""
    rows: list[Row] = []
    for device in filter(is_usable, list_devices()):
        same = device.index == context.device.index
        opened = context if same else TimedContext(str(device.index), fast=context.fast)
        rows += _rows(opened, effort)
    return Table("Tiles' kernels by size, level and device", _COLUMNS, tuple(rows))


def _rows(context: TimedContext, effort: Effort) -> list[Row]:
    works: dict[tuple[str, int, int], _Square] = {}
    for ground in (BARE, *effort.presets[-1:]):
        recipe = open_ground(ground, context).recipe
        works |= {
            (ground, level, quads): _Square(recipe, context, level, quads, effort.kernel_tiles)
            for level in effort.kernel_levels
            for quads in SIZES
        }
    laps = alternate({key: square.lap for key, square in works.items()}, rounds=effort.rounds)
    return [_row(context, key, works[key], kernel, laps[key]) for kernel in _WRITTEN for key in works]


class _Square:
    """The middle of a sketch, as large as so many tiles of a level, cut into tiles of so many quads."""

    def __init__(
        self, recipe: TerrainRecipe, context: TimedContext, level: int, quads: int, tiles: int
    ) -> None:
        step = level_step(level)
        along = max(int(np.sqrt(tiles)) * QUADS // quads, 1)
        number = np.arange(along * along)
        middle = (2**level * QUADS // 2 - along * quads // 2) * step
        offset = np.arange(-1, quads + 2) * step
        column, row = middle + number % along * quads * step, middle + number // along * quads * step
        cell = step * metres_per_unit(recipe.extent)
        self._patches = Patches(column[:, None] + offset, row[:, None] + offset[::-1], cell)
        self._context = context
        self._launcher = PatchLauncher(KernelArguments(recipe, context))
        self._store = SurfaceStore(context, quads + 1, self._patches.count)
        self.tiles = self._patches.count
        self.vertices = self._patches.count * (quads + 1) ** 2

    def lap(self) -> Lap:
        """Evaluate it once."""
        slots = np.arange(self.tiles)
        return self._context.lap(lambda: self._launcher.surfaces(self._patches, self._store, slots))


def _row(
    context: TimedContext, key: tuple[str, int, int], square: _Square, kernel: str, laps: Sequence[Lap]
) -> Row:
    ground, level, quads = key
    seconds = [one.seconds for lap in laps for one in lap.launches if one.kernel == kernel]
    times = spread(seconds)
    return {
        "device": f"{context.device.index}: {context.device.platform}",
        "kernel": kernel,
        "ground": ground,
        "level": level,
        "quads": quads,
        "tiles": square.tiles,
        "launches": times.count,
        "median_ms": times.median * 1e3,
        "p95_ms": times.p95 * 1e3,
        "million_vertices_per_s": square.vertices / times.median * 1e-6,
        "gigabytes_per_s": square.vertices * _WRITTEN[kernel] / times.median * 1e-9,
        "seconds": seconds,
    }
