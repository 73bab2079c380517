"""What each part of the terrain costs a vertex: tiles with it against the same tiles without it."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, spread
from sketchterrain.document.store import load_sketch
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.building import build
from sketchterrain.terrain.lattice import QUADS
from sketchterrain.terrain.recipe import NoFill
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.grounds import TileKey
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.terrain.surfaces import Tile

_LEVEL = 4
_GROUNDS = ("valley_river", "desert_mountains")
_FEATURES = ("mountain", "hill", "dune", "forest")

_COLUMNS = (
    Column("part", "part"),
    Column("ground", "ground"),
    Column("tiles", "tiles that it changes"),
    Column("with_ns", "with it, ns a vertex"),
    Column("without_ns", "without, ns a vertex"),
    Column("adds_ns", "adds, ns a vertex"),
    Column("share", "share of the time"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Device time of tiles with and without one part of the terrain, by profiling events.

    Measured on tiles of level 4 that the part changes, in one batch: all kernels of a tile, with normals,
    weights and parent's values. Unpainted ground has no features. `rules` are those that lay materials.
    """
    rows: list[Row] = []
    for ground in (name for name in _GROUNDS if name in effort.presets):
        whole = build(load_sketch(ground), device=context).recipe
        whole = dataclasses.replace(whole, fill=NoFill())
        for part, without in _without(whole):
            rows += _rows(context, effort, ground, part, (whole, without))
    return Outcome((Table("Parts of the terrain", _COLUMNS, tuple(rows)),))


def _without(whole: TerrainRecipe) -> Iterator[tuple[str, TerrainRecipe]]:
    """Yield each part that a recipe has, and the recipe without it."""
    for name in _FEATURES:
        others = whole.painted["type"] != FEATURE_TYPES.index(name)
        if not others.all():
            yield name, dataclasses.replace(whole, painted=whole.painted[others])
    if (whole.painted["erosion"] > 0).any():
        smooth = whole.painted.copy()
        smooth["erosion"] = 0.0
        yield "erosion", dataclasses.replace(whole, painted=smooth)
    if whole.lakes:
        yield "lakes", dataclasses.replace(whole, lakes=())
    if whole.rivers:
        yield "rivers", dataclasses.replace(whole, rivers=(), valley_radii=())
    yield "rules", dataclasses.replace(whole, material_rules=())


def _rows(
    context: TimedContext,
    effort: Effort,
    ground: str,
    part: str,
    recipes: tuple[TerrainRecipe, TerrainRecipe],
) -> Iterator[Row]:
    sketch = load_sketch(ground)
    whole, less = (Terrain(sketch, recipe, context) for recipe in recipes)
    keys = _changed(whole, less, effort.kernel_tiles)
    if not keys:
        return
    works = {
        "with": partial(context.lap, partial(whole.tiles, keys)),
        "without": partial(context.lap, partial(less.tiles, keys)),
    }
    laps = alternate(works, rounds=effort.rounds)
    vertices = len(keys) * (QUADS + 1) ** 2
    times = [[lap.device / vertices * 1e9 for lap in done] for done in laps.values()]
    having, lacking = (spread(each).median for each in times)
    # Round by round, as what slows the machine slows both.
    adds = spread([one - other for one, other in zip(*times, strict=True)]).median
    yield {
        "part": part,
        "ground": ground,
        "tiles": len(keys),
        "with_ns": having,
        "without_ns": lacking,
        "adds_ns": adds,
        "share": adds / having,
        "seconds": [lap.device for lap in laps["with"]],
    }


def _changed(whole: Terrain, less: Terrain, most: int) -> list[TileKey]:
    """Return the tiles, row by row, that are not the same in both; at most so many, spread over all."""
    columns, rows = (int(np.ceil(length / whole.extent * 2**_LEVEL)) for length in whole.size)
    keys = [(_LEVEL, column, row) for row in range(rows) for column in range(columns)]
    pairs = zip(keys, whole.tiles(keys), less.tiles(keys), strict=True)
    changed = [key for key, one, other in pairs if _differ(one, other)]
    return changed[:: max(len(changed) // most, 1)][:most]


def _differ(one: Tile, other: Tile) -> bool:
    return not all(np.array_equal(getattr(one, n), getattr(other, n)) for n in ("height", "materials"))
