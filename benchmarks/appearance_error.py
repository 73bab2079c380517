"""Appearance tiles: their error against the mean of many samples a texel, and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import open_ground
from sketchterrain.benchmarks.report import Column, Row, Table
from sketchterrain.benchmarks.synthetic_land import EXTENT, synthetic_land
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.landuse.areas import FOREST, MEADOW, land_use
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.layers.landuse import LandUseLayer

GROUND = "mountain_pass"
_TEXELS = (0.06, 0.25, 1.0, 4.0, 16.0)  # m
_SIDE = 190  # texels of a square
_SAMPLES = 8  # along a texel, of the reference
AT = (3060.0, 1172.0)  # m: a junction

_COLUMNS = (
    Column("texel", "texel, m"),
    Column("method", "method"),
    Column("ms", "ms a tile"),
    Column("share", "share, largest"),
    Column("share_p99", "99 %"),
    Column("albedo", "albedo, largest"),
    Column("albedo_rms", "rms"),
)


def open_appearance(context: TimedContext) -> Appearance:
    """Return the roads of `GROUND` among fields of the synthetic country."""
    terrain = open_ground(GROUND, context)
    fields = land_use(synthetic_land(20))
    edges = fields.edges + np.tile(np.array(AT) - 0.5 * EXTENT, 2)
    use = np.where(fields.use == FOREST, MEADOW, fields.use).astype(np.uint8)  # crowns depend on the texel
    areas = replace(fields, use=use, edges=edges)
    recipe = terrain.recipe.with_layers([LandUseLayer(terrain.recipe.materials.names, areas)])
    return Appearance(recipe, context, terrain.heights)


def appearance_table(context: TimedContext, exact: TimedContext | None, effort: Effort) -> Table:
    """Compare a texel, over which the kernel integrates patterns, with the means of more and smaller ones.

    The reference is the mean of 64 texels of the kernel in doubles.
    """
    rows: list[Row] = []
    if exact is not None:
        ours, truth = open_appearance(context), open_appearance(exact)
        for texel in _TEXELS:
            rows += _rows(ours, truth, texel, context, effort)
    return Table("Appearance", _COLUMNS, tuple(rows))


def _rows(
    ours: Appearance, truth: Appearance, texel: float, context: TimedContext, effort: Effort
) -> Iterator[Row]:
    reference = _supersampled(truth, texel, _SAMPLES)
    found = {
        "kernel": _linear(_window(ours, texel, 1)),
        **{f"{n * n} texels": _supersampled(ours, texel, n) for n in (2, 4)},
    }
    works = {
        "kernel": partial(context.lap, partial(_window, ours, texel, 1)),
        **{f"{n * n} texels": partial(context.lap, partial(_window, ours, texel, n)) for n in (2, 4)},
    }
    laps = alternate(works, rounds=effort.rounds)
    for method, values in found.items():
        error = np.abs(values - reference)
        seconds = [sum(one.seconds for one in lap.launches) for lap in laps[method]]
        yield {
            "texel": texel,
            "method": method,
            "ms": spread(seconds).median * 1e3,
            "share": float(error[..., 3].max()),
            "share_p99": float(np.quantile(error[..., 3], 0.99)),
            "albedo": float(error[..., :3].max()),
            "albedo_rms": float(np.sqrt((error[..., :3] ** 2).mean())),
            "seconds": seconds,
        }


def _window(paint: Appearance, texel: float, many: int) -> npt.NDArray[np.uint8]:
    """Return a square of so many times more texels."""
    cell = texel / many
    half = 0.5 * _SIDE * texel
    west, north = AT[0] - half + 0.5 * cell, AT[1] + half - 0.5 * cell
    return paint.window(west, north, cell=(cell, cell), columns=many * _SIDE, rows=many * _SIDE)


def _linear(texels: npt.NDArray[np.uint8]) -> Float64Array:
    """Return albedo times share, and share."""
    values = texels / 255.0
    return np.concatenate([values[..., :3] ** 2 * values[..., 3:], values[..., 3:]], axis=-1)


def _supersampled(paint: Appearance, texel: float, many: int) -> Float64Array:
    values = _linear(_window(paint, texel, many))
    return np.asarray(values.reshape(_SIDE, many, _SIDE, many, 4).mean(axis=(1, 3)))
