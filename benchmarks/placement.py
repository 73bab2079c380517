"""From a sketch to a recipe: what placing features costs, stage by stage."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, lap, spread
from sketchterrain.document.store import load_sketch
from sketchterrain.hydrology.rivers import trace_rivers
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.placement.placement import place
from sketchterrain.placement.shapes import label_shapes
from sketchterrain.placement.user_features import user_features
from sketchterrain.terrain.building import make_recipe
from sketchterrain.terrain.host_heights import host_heights

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.placement.shapes import Shape
    from sketchterrain.terrain.recipe import TerrainRecipe


_RIVER_CELLS_PER_EXTENT = 256  # as make_recipe shows the ground to rivers

_COLUMNS = (
    Column("preset", "preset"),
    Column("stage", "stage"),
    Column("found", "found"),
    Column("rounds", "rounds"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Milliseconds from a sketch to its recipe, and of the stages of it, by the clock; no device is used.

    `shapes` labels the painted regions and measures their distance maps; `darts` throws each shape's user
    features; `place` is both and finds every feature's final place; `rivers` traces the rivers on the ground
    that the features make, in the NumPy reference; `recipe` is the whole. `found` counts shapes, features or
    rivers. Rounds alternate between the stages.
    """
    rows: list[Row] = []
    for name in effort.presets:
        stages = _stages(load_sketch(name))
        works = {stage: partial(lap, work) for stage, (work, _) in stages.items()}
        laps = alternate(works, rounds=effort.rounds)
        for stage, (_, found) in stages.items():
            samples = [one.wall for one in laps[stage]]
            times = spread(samples)
            rows.append(
                {
                    "preset": name,
                    "stage": stage,
                    "found": found,
                    "rounds": times.count,
                    "median_ms": times.median * 1e3,
                    "p95_ms": times.p95 * 1e3,
                    "seconds": samples,
                }
            )
    return Outcome((Table("From sketch to recipe", _COLUMNS, tuple(rows)),))


def _stages(sketch: Sketch) -> dict[str, tuple[Callable[[], object], int]]:
    """Work of each stage and how much it finds."""
    shapes, recipe = _shapes(sketch), make_recipe(sketch)
    ground = _ground(recipe)
    return {
        "shapes": (lambda: _shapes(sketch), len(shapes)),
        "darts": (lambda: _darts(sketch, shapes), sum(map(len, _darts(sketch, shapes)))),
        "place": (lambda: place(sketch, seed=sketch.seed), len(recipe.painted)),
        "rivers": (lambda: trace_rivers(sketch, seed=sketch.seed, ground=ground), len(recipe.rivers)),
        "recipe": (lambda: make_recipe(sketch), len(recipe.painted) + len(recipe.rivers)),
    }


def _shapes(sketch: Sketch) -> list[Shape]:
    return [shape for layer in FEATURE_TYPES for shape in label_shapes(layer, sketch.layers[layer])]


def _darts(sketch: Sketch, shapes: list[Shape]) -> list[npt.NDArray[np.void]]:
    return [
        user_features(
            shape,
            multitude=max(int(sketch.properties(shape.layer, shape.label)["multitude"]), 1),
            fidelity=sketch.fidelity,
            seed=sketch.seed,
        )
        for shape in shapes
    ]


def _ground(recipe: TerrainRecipe) -> Callable[[Float64Array, Float64Array], Float64Array]:
    dry = replace(recipe, rivers=(), valley_radii=())
    cell = recipe.extent / _RIVER_CELLS_PER_EXTENT
    return lambda x, y: host_heights(dry, x, y, cell_size=cell)
