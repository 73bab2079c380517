"""While one paints: from a stroke to the changed terrain in the view, and whether the window stalls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.benchmarks.latency_probe import LatencyProbe
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import spread
from sketchterrain.document.sketch import Sketch
from sketchterrain.placement.feature_types import FEATURE_TYPES

if TYPE_CHECKING:
    from sketchterrain.array_types import UInt8Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.latency_probe import Painted
    from sketchterrain.benchmarks.timing import TimedContext

SEED: Final = 11
STAGES: Final = ("waiting", "placing", "areas", "handing over", "tiles")
_SIDE, _BLOBS = 512, 18
_SKETCH_SEED = 5
_RADIUS_SHARE = 0.38  # of a shape's cell
_ROUGHNESS = ((2, 0.15), (3, 0.1), (5, 0.05))  # lobes of an outline and their depths
_LAYERS: Final = ("mountain", "hill", "dune", "forest", "river", "lake")

_COLUMNS = (
    Column("painting", "painting"),
    Column("updates", "sketches"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("most_ms", "most, ms"),
    *(Column(f"{stage}_ms".replace(" ", "_"), f"{stage}, ms") for stage in STAGES),
    Column("stall_ms", "longest stall, ms"),
    Column("stall_p95_ms", "95 % of stalls, ms"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Milliseconds from a stroke to changed terrain, and the window's longest stall, by the clock.

    A sketch of 512 px with 20 shapes (18 blobs, a lake, a river) in the program's own window, with the real
    processes behind it on the device that they choose. Two ways of painting, in turns through six layers,
    radii from 8 to 40 px: `strokes` of 60 to 120 places 8 ms apart, as a mouse tells them; `dabs`, each after
    the one before is there; each is undone after. The time begins when the window makes the sketch that it
    sends, and ends when the view's tiles hold the heights of that sketch or a newer one; drawing them comes
    after. It is made of `waiting` (for what is being placed; on its way), `placing`, `areas` (what changed,
    and packing it), `handing over` (the engine ends a frame that it draws) and `tiles`: their means. A stall
    is how much later than 5 ms after the one before the window's event loop gets to a timer, while one
    paints.
    """
    del context  # the processes open devices of their own
    probe = LatencyProbe(sketch_with_twenty_shapes())
    try:
        _row(probe, "dabs", len(_LAYERS))  # what is made once is made before
        counts = {"strokes": effort.live_strokes, "dabs": effort.live_dabs}
        rows = [_row(probe, painting, count) for painting, count in counts.items()]
    finally:
        probe.end()
    return Outcome((Table(f"From a stroke to changed terrain, seed {SEED}", _COLUMNS, tuple(rows)),))


def sketch_with_twenty_shapes() -> Sketch:
    """Eighteen blobs in four layers, a lake and a winding river on 512 px."""
    sketch = sketch_of(_SIDE, _BLOBS)
    lake = np.zeros((_SIDE, _SIDE), np.uint8)
    down, across = np.ogrid[:_SIDE, :_SIDE]
    lake[(down - 0.86 * _SIDE) ** 2 + 0.5 * (across - 0.62 * _SIDE) ** 2 < (0.06 * _SIDE) ** 2] = 1
    return sketch.replace(layers={**sketch.layers, "lake": lake})


def _row(probe: LatencyProbe, painting: str, count: int) -> Row:
    """Paint so many strokes or dabs, and return what was found."""
    rng = np.random.default_rng(SEED)
    times: list[tuple[float, ...]] = []
    stalls: list[float] = []
    for number in range(count):
        places = int(rng.integers(60, 121)) if painting == "strokes" else 1
        seen = _stroke(probe, rng, _LAYERS[number % len(_LAYERS)], places=places)
        times += seen.times
        stalls += seen.stalls
    return _found(painting, times, stalls)


def _stroke(probe: LatencyProbe, rng: np.random.Generator, layer: str, *, places: int) -> Painted:
    ways = rng.normal(0.0, 2.5, 2) + np.cumsum(rng.normal(0.0, 0.6, (places, 2)), axis=0)
    path = rng.uniform(0.1, 0.9, 2) * _SIDE + np.cumsum(np.clip(ways, -6.0, 6.0), axis=0)
    radius = float(rng.uniform(8.0, 40.0)) * (0.3 if layer == "river" else 1.0)
    label = int(rng.integers(0, 3) > 0)
    return probe.paint(layer, label, [(x, y) for x, y in path.tolist()], radius)


def _found(painting: str, times: list[tuple[float, ...]], stalls: list[float]) -> Row:
    stages = np.diff(times, axis=1)
    samples = stages.sum(axis=1).tolist()
    whole, means = spread(samples), stages.mean(axis=0)
    return {
        "painting": painting,
        "updates": len(samples),
        "median_ms": whole.median * 1e3,
        "p95_ms": whole.p95 * 1e3,
        "most_ms": max(samples) * 1e3,
        **{
            f"{name}_ms".replace(" ", "_"): float(mean) * 1e3
            for name, mean in zip(STAGES, means, strict=True)
        },
        "stall_ms": max(stalls, default=0.0) * 1e3,
        "stall_p95_ms": float(np.percentile(stalls or [0.0], 95)) * 1e3,
        "seconds": samples,
    }


def sketch_of(side: int, shapes: int) -> Sketch:
    """Return blobs in rows, a fourth of them in each layer of point features, and a winding river."""
    rng = np.random.default_rng(_SKETCH_SEED)
    layers = {name: np.zeros((side, side), np.uint8) for name in (*FEATURE_TYPES, "river")}
    columns = math.ceil(math.sqrt(shapes))
    cell = side / columns
    for number in range(shapes):
        row, column = divmod(number, columns)
        image = layers[FEATURE_TYPES[number % len(FEATURE_TYPES)]]
        _paint_blob(image, ((row + 0.5) * cell, (column + 0.5) * cell), _RADIUS_SHARE * cell, rng)
    across = np.arange(side)
    down = (side * (0.5 + 0.2 * np.sin(9.0 * across / side))).astype(int)
    for offset in range(-(side // 256), side // 256 + 1):
        layers["river"][np.clip(down + offset, 0, side - 1), across] = 1
    return Sketch(layers=layers)


def _paint_blob(image: UInt8Array, at: tuple[float, float], radius: float, rng: np.random.Generator) -> None:
    top, left = (max(int(middle - radius), 0) for middle in at)
    bottom, right = (math.ceil(middle + radius) + 1 for middle in at)
    window = image[top:bottom, left:right]
    down, across = np.ogrid[: window.shape[0], : window.shape[1]]
    down, across = down + top + 0.5 - at[0], across + left + 0.5 - at[1]
    angle = np.arctan2(down, across)
    outline = 0.7 + sum(depth * np.cos(k * angle + rng.uniform(0, 2 * math.pi)) for k, depth in _ROUGHNESS)
    window[down**2 + across**2 <= np.maximum(radius * outline, 0.8) ** 2] = 1
