"""Measured inputs: preset or bare terrain, tiles of it, and a grid of simplex fBm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.baselines.noise import NoiseProblem
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.io.resources import kernel_struct
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.terrain.layers import layer_stack
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.noise import NoiseStack, corner_table, octave_table

OCTAVES = 8
SEED = 7

_EXTENT = 4096.0
_LONGEST = 1024.0  # m: wavelength of the first octave; the last is 8 m
_GAIN = 0.5
_STEP_BITS = 12  # vertices 4096 lattice units apart: 1 m
_STACK = "bench"


class NoiseGrid:
    """fBm on a square grid, by ``kernels/bench.cl``."""

    def __init__(self, context: TimedContext, side: int) -> None:
        self._context = context
        self._side = side
        self._octaves = octave_table(
            [NoiseStack(_STACK, _LONGEST, _GAIN, most=OCTAVES)], extent=_EXTENT, seed=SEED
        )
        table, real = self._octaves, context.real_dtype
        self._corner = corner_table(table, np.zeros((1, 2), np.int64), _STEP_BITS)
        self._arguments: tuple[Any, ...] = (
            context.upload(table.form),
            context.upload(table.offset),
            context.upload(table.scale.astype(real)),
            context.upload(self._corner),
            np.int32(len(table.form)),
            np.int32(side),
        )
        self._sum, self._east, self._north = (context.empty(side * side, real) for _ in range(3))

    def launch(self) -> None:
        """Enqueue the kernel once."""
        self._context.launch(
            "baselines/bench.cl", "bench_fbm", (self._side, self._side), *self._arguments, self._sum
        )

    def finish(self) -> None:
        """Wait for what was enqueued."""
        self._context.download(self._sum, 1, self._context.real_dtype)

    def launch_slope(self) -> None:
        """Enqueue the kernel that gives slopes too, once."""
        out = self._sum, self._east, self._north
        size = (self._side, self._side)
        self._context.launch("baselines/bench.cl", "bench_fbm_slope", size, *self._arguments, *out)

    def detail_launcher(self) -> Callable[[], None]:
        """Return what enqueues the kernel of detail below a DEM once, as many octaves deep."""
        real, unit = self._context.real_dtype, metres_per_unit(_EXTENT)
        world = np.array([(unit, 1 / unit, 1.0, 0, 0)], kernel_struct("world.clh", "World", real))
        header, octaves = "layers/base_detail.clh", len(self._octaves.form)
        params = np.array([(1, 1, 1, 0.25, 0, octaves)], kernel_struct(header, "BaseDetailParams", real))
        rows = np.stack([np.ones(octaves), unit / self._octaves.scale[:, 1]], axis=-1).astype(real)
        given = [self._context.upload(each) for each in (world, params, rows)]
        work = "baselines/bench.cl", "bench_base_detail", (self._side, self._side)
        return partial(self._context.launch, *work, *self._arguments, *given, self._sum)

    def download(self) -> npt.NDArray[Any]:
        """Return what the kernel computed last, shape (side, side)."""
        return self._context.download(self._sum, (self._side, self._side), self._context.real_dtype)

    def problem(self, threads: int) -> NoiseProblem:
        """Return the same sum as plain arrays, for rivals that use so many threads."""
        return NoiseProblem(
            self._corner[0],
            self._octaves.form[:, 2].astype(np.uint32),
            self._octaves.scale[:, 0].astype(np.float32),
            self._side,
            threads,
        )


BARE = "bare"
"""Ground of the default relief over 4096 m, without paint."""
RELIEF = "relief of "
"""Before the name of a preset: its drained relief without all other layers."""
BARE_SEED = 7

TileKey = tuple[int, int, int]


def open_ground(name: str, context: ComputeContext) -> Terrain:
    """Return the terrain of a preset with its own seed, or of bare ground with :data:`BARE_SEED`.

    With `RELIEF` before its name, a preset has its relief alone.
    """
    if name == BARE:
        return build(Sketch(name=BARE, seed=BARE_SEED), device=context)
    terrain = build(load_sketch(name.removeprefix(RELIEF)), device=context)
    if not name.startswith(RELIEF):
        return terrain
    recipe = terrain.recipe
    layers = layer_stack(
        extent=recipe.extent,
        relief=recipe[ReliefLayer],
        painted=recipe.points.painted[:0],
        fill=Fill.from_sketch(Sketch(), recipe.points.painted[:0], seed=0),
    )
    return Terrain(terrain.sketch, replace(recipe, layers=layers), terrain.context)


def central_keys(level: int, count: int) -> list[TileKey]:
    """Return ``count`` tiles that lie together around the middle of a square sketch."""
    side = int(np.ceil(np.sqrt(count)))
    first = 2**level // 2 - side // 2 if level > 0 else 0
    return [(level, first + i % side, first + i // side) for i in range(count)]


def scattered_keys(level: int, count: int, terrain: Terrain, *, seed: int) -> list[TileKey]:
    """Return up to ``count`` different tiles that lie anywhere within the sketch, drawn with the seed."""
    width = terrain.extent / 2.0**level
    columns, rows = (max(int(length / width), 1) for length in terrain.size)
    draw = np.random.default_rng(seed)
    wanted = min(count, columns * rows)
    keys: dict[TileKey, None] = {}
    while len(keys) < wanted:
        keys[level, int(draw.integers(columns)), int(draw.integers(rows))] = None
    return list(keys)
