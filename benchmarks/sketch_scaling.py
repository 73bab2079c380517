"""From a sketch to placed features: how the time grows with its pixels and its shapes, and what takes it."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, lap, spread
from sketchterrain.document.sketch import Sketch
from sketchterrain.hydrology.rivers import trace_rivers
from sketchterrain.placement.cache import PlacementCache
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.placement.placement import place
from sketchterrain.placement.shapes import find_regions, measure_shape
from sketchterrain.placement.user_features import user_features

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.placement.shapes import Region


SEED = 5
STAGES = ("labelling", "distance maps", "darts", "placement", "rivers")

_SIDE, _SHAPES = 512, 20
_FILLED = 0.38  # of a shape's cell is its radius
_STROKE = 9  # px
_ROUGHNESS = ((2, 0.15), (3, 0.1), (5, 0.05))  # lobes of an outline and how deep they are

_COLUMNS = (
    Column("growing", "growing"),
    Column("side", "side, px"),
    Column("shapes", "shapes"),
    Column("features", "features"),
    Column("rounds", "rounds"),
    *(Column(f"{stage} ms".replace(" ", "_"), f"{stage}, ms") for stage in STAGES),
    Column("whole_ms", "whole, ms"),
    Column("again_ms", "after a stroke, ms"),
    Column("ratio", "of the whole"),
)
_SLOPE_COLUMNS = (Column("growing", "growing"), Column("slope", "slope"), Column("last", "last step"))


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Milliseconds from a sketch to its placed features and rivers, by the clock; no device is used.

    Sketches of blobs in rows, a fourth of them in each layer of point features, and one winding river.
    `pixels`: 20 shapes, growing sides. `shapes`: 512 px, growing numbers. `labelling` finds the connected
    regions, `distance maps` measures them, `darts` breaks them into user features, `placement` is what
    `place` does beyond that (rules and densities), `rivers` is `trace_rivers` on flat ground; the whole is
    `place` and `trace_rivers`. `after a stroke` is `place` again with its `PlacementCache` after a dab on one
    layer, set against `place` alone: rivers are traced when a river is painted. The slope is that of a line
    through all points of the whole on logarithmic axes (time against pixels, or shapes; 1 is linear), the
    last step that between the last two.
    """
    sizes = [("pixels", side, _SHAPES) for side in effort.sketch_sides]
    sizes += [("shapes", _SIDE, count) for count in effort.sketch_shapes]
    rows = [_row(growing, side, count, effort.sketch_rounds) for growing, side, count in sizes]
    return Outcome(
        (
            Table(f"From sketch to placed features, seed {SEED}", _COLUMNS, tuple(rows)),
            Table("How the time grows", _SLOPE_COLUMNS, tuple(_slopes(rows))),
        )
    )


def sketch_of(side: int, shapes: int) -> Sketch:
    """Blobs in rows, a fourth of them in each layer of point features, and a winding river.

    Parameters
    ----------
    side : int
        Pixels along either side.
    shapes : int
        Number of blobs. They do not touch while they have room to be apart.
    """
    rng = np.random.default_rng(SEED)
    layers = {name: np.zeros((side, side), np.uint8) for name in (*FEATURE_TYPES, "river")}
    columns = math.ceil(math.sqrt(shapes))
    cell = side / columns
    for number in range(shapes):
        row, column = divmod(number, columns)
        image = layers[FEATURE_TYPES[number % len(FEATURE_TYPES)]]
        _paint_blob(image, ((row + 0.5) * cell, (column + 0.5) * cell), _FILLED * cell, rng)
    across = np.arange(side)
    down = (side * (0.5 + 0.2 * np.sin(9.0 * across / side))).astype(int)
    for offset in range(-(side // 256), side // 256 + 1):
        layers["river"][np.clip(down + offset, 0, side - 1), across] = 1
    return Sketch(layers=layers)


def _paint_blob(
    image: npt.NDArray[np.uint8], at: tuple[float, float], radius: float, rng: np.random.Generator
) -> None:
    top, left = (max(int(middle - radius), 0) for middle in at)
    bottom, right = (math.ceil(middle + radius) + 1 for middle in at)
    window = image[top:bottom, left:right]
    down, across = np.ogrid[: window.shape[0], : window.shape[1]]
    down, across = down + top + 0.5 - at[0], across + left + 0.5 - at[1]
    angle = np.arctan2(down, across)
    outline = 0.7 + sum(depth * np.cos(k * angle + rng.uniform(0, 2 * math.pi)) for k, depth in _ROUGHNESS)
    window[down**2 + across**2 <= np.maximum(radius * outline, 0.8) ** 2] = 1


def _dabbed(sketch: Sketch) -> Sketch:
    """One more stroke on one layer, in the middle."""
    layer = FEATURE_TYPES[1]
    image = sketch.layers[layer].copy()
    middle = slice(image.shape[0] // 2, image.shape[0] // 2 + _STROKE)
    image[middle, middle] = 1
    return sketch.replace(layers={**sketch.layers, layer: image})


def _row(growing: str, side: int, count: int, rounds: int) -> Row:
    sketch = sketch_of(side, count)
    works = _works(sketch)
    laps = alternate(works, rounds=rounds)
    median = {name: spread([one.wall for one in of]).median * 1e3 for name, of in laps.items()}
    median["placement"] = median["place"] - sum(median[stage] for stage in STAGES[:3])
    whole = median["place"] + median["rivers"]
    return {
        "growing": growing,
        "side": side,
        "shapes": count,
        "features": len(place(sketch, seed=SEED)),
        "rounds": rounds,
        **{f"{stage} ms".replace(" ", "_"): max(median[stage], 0.0) for stage in STAGES},
        "whole_ms": whole,
        "again_ms": median["again"],
        "ratio": median["again"] / median["place"],
        "seconds": [one.wall for one in laps["place"]],
    }


def _works(sketch: Sketch) -> dict[str, Callable[[], Lap]]:
    found: list[tuple[str, Region]] = _regions(sketch)
    shapes = [measure_shape(layer, sketch.layers[layer], region) for layer, region in found]
    memory, turns = PlacementCache(), [sketch, _dabbed(sketch)]

    def darts() -> None:
        for shape in shapes:
            multitude = int(sketch.properties(shape.layer, shape.label)["multitude"])
            user_features(shape, multitude=multitude, fidelity=sketch.fidelity, seed=SEED)

    def again() -> Lap:
        """Place what is remembered, untimed, and time what the stroke costs; what it made is forgotten."""
        nonlocal memory
        memory = PlacementCache()
        place(turns[0], seed=SEED, cache=memory)
        return lap(lambda: place(turns[1], seed=SEED, cache=memory))

    works: dict[str, Callable[[], object]] = {
        "labelling": lambda: _regions(sketch),
        "distance maps": lambda: [
            measure_shape(layer, sketch.layers[layer], region) for layer, region in found
        ],
        "darts": darts,
        "place": lambda: place(sketch, seed=SEED),
        "rivers": lambda: trace_rivers(sketch, seed=SEED, ground=_flat),
    }
    return {**{name: partial(lap, work) for name, work in works.items()}, "again": again}


def _regions(sketch: Sketch) -> list[tuple[str, Region]]:
    return [(layer, region) for layer in FEATURE_TYPES for region in find_regions(sketch.layers[layer])]


def _flat(x: Float64Array, y: Float64Array) -> Float64Array:
    return np.zeros(np.broadcast(x, y).shape)


def _slopes(rows: list[Row]) -> list[Row]:
    """Slopes on logarithmic axes."""
    result: list[Row] = []
    for growing in ("pixels", "shapes"):
        points = np.array([_point(row, growing) for row in rows if row["growing"] == growing])
        x, y = np.log(points).T
        slope = float(np.polyfit(x, y, 1)[0])
        result.append({"growing": growing, "slope": slope, "last": float((y[-1] - y[-2]) / (x[-1] - x[-2]))})
    return result


def _point(row: Row, growing: str) -> tuple[float, float]:
    side, shapes, whole = (float(str(row[key])) for key in ("side", "shapes", "whole_ms"))
    return (side * side if growing == "pixels" else shapes), whole
