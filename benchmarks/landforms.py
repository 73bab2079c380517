"""Landforms: realism, adherence and time of the drained ground, by its parameters and beside others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.landform_grounds import (
    BRUSH,
    CELL,
    CELLS,
    EXTENT,
    PAINTED,
    PIXELS,
    SEED,
    DrainedSketch,
    dab,
    drained,
    eroded,
    painted_sketch,
    timed,
)
from sketchterrain.benchmarks.plotting import (
    BarPanel,
    Curves,
    draw_bars,
    draw_curves,
)
from sketchterrain.benchmarks.report import Cell, Row, Table, Tables, value_of
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError
from sketchterrain.generation.building import build, make_recipe
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landforms.drainage import ROUNDS
from sketchterrain.landforms.placement.heights import shape_height
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.measure.adherence import agreement
from sketchterrain.measure.realism import Realism, measure_realism, measure_terrain_realism
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.noise import NoiseStack, fbm, octave_table
from sketchterrain.terrain.recipe import TerrainRecipe

_FAR = 3.0  # widths of the changed shape, beyond which ground should stay
_MOVED = 1.0  # m
_AWAY = 20_000.0  # m
_COARSE = 2  # level that is shown while a stroke goes on
_MARGIN = 192  # nodes around the sketch
_BAR = 1.63  # distance of 95 % of real windows
_DESERTS = dict.fromkeys(("canyon_mesa", "desert_mountains"), ("desert mountains 90 m",))
_RASTER, _ROUNDS, _LIMIT, _PEER = "raster", "rounds", "height limit", "others"

_TRADE = {
    "distance": "distance to real land",
    "passes": "windows that pass, %",
    "iou": "adherence, mean IoU",
    "steepest": "steepest 5 %, °",
    "hollows": "hollows, %",
}
_TERRAINS = {"distance": "distance to real land", "passes": "pass, %"}
_STABILITY = {
    "far": "far ground moved, %",
    "moved": "all ground moved, %",
    "rms": "rms, % of relief",
    "summits": "summits moved, cells",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Realism against time and adherence; realism of whole terrains; what changes move.

    First table: random painted sketches of 7680 m (a range, two mountains, three hills; fidelity 0.8),
    without rivers; means over the sketches. Varied are the raster's nodes along the sketch's side (257: 30 m
    apart; the mesh scales with them), the rounds of drainage.ROUNDS, and the height limit of labels (inradii)
    whose height is five brush radii; elsewhere it is one, of hills a quarter. Time is the processor's for
    draining all levels with and without paint, the median of three. Windows have 192² cells of 30 m,
    evaluated with all detail. Adherence: mean IoU of the shapes and where ground without their layer is lower
    by a quarter of their height. Others: fBm of the same deviation; fastscapelib's eroder from the same
    uplift on 257² nodes (25 steps of 200,000 years, K = 2e-5, m = 0.375, n = 1, slopes without limit), scaled
    once to the heights asked for, barriers cut as in ours.

    Second table: whole terrains in windows of 192² cells, around the sketch and 20 km east of it; medians of
    distances, share of windows that pass all gates. A window passes up to a distance of 1.63.

    Third table: nodes of the painted region that move by more than 1 m; far ground is more than three widths
    away from the shape that a random stroke changes; medians and worst. Rows of other rasters compare the
    first table's ground; coarse ground is level 2: from each shape's summit to the nearest peak of it there,
    among those that stand within a tenth of the shape's relief of the highest.
    """
    sketches = [painted_sketch(number) for number in range(effort.landform_sketches)]
    trade, usual, others = _trade_offs(context, sketches, effort)
    return (
        Table("Realism, adherence, time", tuple(trade), _TRADE),
        Table("Realism of terrains", tuple(_terrains(context, sketches, effort)), _TERRAINS),
        Table("Stability", tuple(_stability(sketches, usual, others, effort)), _STABILITY),
    )


# Realism against time and adherence -----------------------------------------------------------------------


def _trade_offs(
    context: TimedContext, sketches: Sequence[Sketch], effort: Effort
) -> tuple[list[Row], list[DrainedSketch], dict[int, list[Float64Array]]]:
    """Return the rows of the first table, the grounds as they are by default, and heights by other nodes."""
    standard = CELLS + 1
    drained(sketches[0], effort.landform_nodes[0], ROUNDS)  # compiles
    usual = [drained(each, standard, ROUNDS) for each in sketches]
    rows, others = [], {}
    for nodes in effort.landform_nodes:
        grounds = usual if nodes == standard else [drained(each, nodes, ROUNDS) for each in sketches]
        rows.append(_mean_row(context, _RASTER, f"{nodes}²", grounds))
        if nodes != standard:
            others[nodes] = [each.heights() for each in grounds]
    for rounds in effort.landform_rounds:
        grounds = usual if rounds == ROUNDS else [drained(each, standard, rounds) for each in sketches]
        rows.append(_mean_row(context, _ROUNDS, ", ".join(map(str, rounds)), grounds))
    for limit in effort.landform_limits:
        grounds = [drained(_limited(each, limit), standard, ROUNDS) for each in sketches]
        rows.append(_mean_row(context, _LIMIT, f"{limit:g}", grounds))
    rows += [_noise(usual, context), _simulated(usual, context)]
    return rows, usual, others


def _limited(sketch: Sketch, limit: float) -> Sketch:
    """Return a sketch whose mountains and hills ask for more than a height limit."""
    high = 5.0 * BRUSH * EXTENT / PIXELS
    labels = {key: {"height": high, "height_limit": limit} for key in sketch.labels}
    return sketch.replace(labels=labels)


def _mean_row(context: TimedContext, varied: str, value: str, grounds: Sequence[DrainedSketch]) -> Row:
    cells = []
    for each in grounds:
        iou = _adherence(each.sketch, {layer: each.effect(layer) for layer in PAINTED})
        cells.append({"ms": 1e3 * each.seconds, "iou": iou, **_land(each.evaluated(context))})
    return {"varied": varied, "value": value, **_means(cells)}


def _means(cells: Sequence[Row]) -> dict[str, Cell]:
    return {key: float(np.mean([value_of(row, key) for row in cells])) for key in cells[0]}


def _adherence(sketch: Sketch, effects: Mapping[str, Float64Array]) -> float:
    found: list[float] = []
    for layer, effect in effects.items():
        shapes = label_shapes(layer, sketch.layers[layer])
        inradii = [float(each.depth.max()) * sketch.pixel_size for each in shapes]
        heights = [
            shape_height(sketch.properties(layer, each.label), inradius, sketch.fidelity)
            for each, inradius in zip(shapes, inradii, strict=True)
        ]
        built = np.array([each.built for each in heights])
        measured, _ = agreement(shapes, effect.astype(np.float32), built, heights)
        found += [each.iou for each in measured if each.iou is not None]
    return float(np.mean(found))


def _land(height: Float64Array) -> dict[str, float]:
    found = measure_realism(height, CELL)
    return {
        "distance": found.distance,
        "passes": _passing(found),
        "steepest": found.metrics["slope_p95"],
        "hollows": 100.0 * found.metrics["sink_share"],
    }


def _passing(found: Realism) -> float:
    return 100.0 * float(np.mean([window.comparison.passes for window in found.windows]))


def _noise(grounds: Sequence[DrainedSketch], context: TimedContext) -> Row:
    """Return the row of fBm whose deviation is that of the drained ground."""
    middle = (np.arange(CELLS) + 0.5) * CELL
    x, y = (to_lattice(each, EXTENT) for each in np.meshgrid(middle, middle))
    stack, cells = NoiseStack("plain", 4096.0, 0.5), []
    for ground in grounds:
        table = octave_table([stack], extent=EXTENT, seed=ground.sketch.seed, cell_size=CELL)
        z, seconds = timed(partial(fbm, table, "plain", x, y))
        cells.append({"ms": 1e3 * seconds, **_land(z / z.std() * ground.evaluated(context).std())})
    return {"varied": _PEER, "value": "fBm", **_means(cells)}


def _simulated(grounds: Sequence[DrainedSketch], context: TimedContext) -> Row:
    row: dict[str, Cell] = {"varied": _PEER, "value": "fastscapelib", "ms": None}
    if find_spec("fastscapelib") is None:
        return row | {"absent": "pip install fastscapelib"}
    cells = []
    for ground in grounds:
        peer = eroded(ground)
        iou = _adherence(ground.sketch, peer.effects)
        cells.append({"ms": 1e3 * peer.seconds, "iou": iou, **_land(ground.evaluated(context, peer.height))})
    return row | _means(cells)


# Realism of terrains --------------------------------------------------------------------------------------


def _terrains(context: TimedContext, sketches: Sequence[Sketch], effort: Effort) -> list[Row]:
    named = {name: load_sketch(name) for name in effort.landform_presets}
    named |= {f"painted {number + 1}": sketch for number, sketch in enumerate(sketches)}
    rows: list[Row] = []
    for name, sketch in named.items():
        terrain = build(sketch, device=context)
        for cell in (30.0, 90.0):
            for where, east in (("sketch", 0.0), ("20 km away", _AWAY)):
                row: dict[str, Cell] = {"terrain": name, "where": where, "cell": cell}
                try:
                    found = measure_terrain_realism(
                        terrain, cell=cell, kinds=_DESERTS.get(name, ()), offset=(east, 0.0)
                    )
                except InputError:  # most of it is sea
                    rows.append(row | {"windows": 0})
                    continue
                failed = Counter(gate for each in found.windows for gate in each.comparison.failed)
                row |= {"windows": len(found.windows), "distance": found.distance, "kind": found.kind}
                rows.append(row | {"passes": _passing(found), "failed": ", ".join(failed)})
    return rows


# Stability ------------------------------------------------------------------------------------------------


def _stability(
    sketches: Sequence[Sketch],
    usual: Sequence[DrainedSketch],
    others: Mapping[int, Sequence[Float64Array]],
    effort: Effort,
) -> list[Row]:
    memory = Results()
    before = [_nodes(make_recipe(each, memory=memory)) for each in sketches]
    strokes: list[dict[str, float]] = []
    for number in range(effort.landform_strokes):
        index = number % len(sketches)
        changed, shape = _stroked(sketches[index], number)
        after = _nodes(make_recipe(changed, memory=memory))
        strokes.append(_difference(before[index], after, _far_nodes(shape)))
    seeds, shifts = [], []
    for sketch, nodes in zip(sketches, before, strict=True):
        seeds.append(_difference(nodes, _nodes(make_recipe(sketch.replace(seed=sketch.seed + 1000)))))
        moved = {name: np.roll(image, 1, axis=1) for name, image in sketch.layers.items()}
        shifts.append(_difference(nodes, _nodes(make_recipe(sketch.replace(layers=moved), memory=memory))))
    rows = [
        _stability_row("a random stroke", strokes),
        _stability_row("another seed", seeds),
        _stability_row("paint shifted by a pixel", shifts),
    ]
    for count, heights in others.items():
        found = [_difference(each.heights(), other) for each, other in zip(usual, heights, strict=True)]
        rows.append(_stability_row(f"{count}² nodes, not {CELLS + 1}²", found))
    coarse = [
        _difference(each.heights(), each.heights(level=_COARSE)) | {"summits": _summits(each)}
        for each in usual
    ]
    worst = max(max(each["summits"]) for each in coarse)
    row = _stability_row("coarse ground, not final", coarse)
    median = float(np.median(np.concatenate([each["summits"] for each in coarse])))
    return [*rows, row | {"summits": median, "summits_worst": float(worst)}]


def _nodes(recipe: TerrainRecipe) -> Float64Array:
    """Return heights (m) of the painted region's nodes around the sketch, row 0 in the south, NaN beyond."""
    painted = recipe[ReliefLayer].painted
    result = np.full((CELLS + 2 * _MARGIN,) * 2, np.nan)
    if painted is not None:
        nodes = painted.levels[0]
        row, column = nodes.row + _MARGIN, nodes.column + _MARGIN
        rows, columns = nodes.height.shape
        result[row : row + rows, column : column + columns] = nodes.height
    return result


def _stroked(sketch: Sketch, number: int) -> tuple[Sketch, BoolArray]:
    """Return a sketch with a random stroke, and the shape that it belongs to."""
    rng = np.random.default_rng([SEED, number, 1])
    layer = PAINTED[number % 2]
    image = sketch.layers[layer].copy()
    radius, flat = PIXELS * rng.uniform(0.02, 0.06), rng.uniform(1.0, 2.0)
    stroke = dab(rng.uniform(0.1, 0.9, 2) * PIXELS, radius, flat=flat)
    image[stroke] = 1
    shapes, _ = ndimage.label(image == 1, np.ones((3, 3)))
    return sketch.replace(layers={**sketch.layers, layer: image}), np.isin(shapes, np.unique(shapes[stroke]))


def _far_nodes(shape: BoolArray) -> BoolArray:
    """Return which of `_nodes` are more than three widths away from a shape."""
    side = PIXELS // CELLS
    wide = np.pad(shape[side // 2 :: side, side // 2 :: side][::-1], _MARGIN)
    width = 2.0 * ndimage.distance_transform_edt(wide).max()
    return np.asarray(ndimage.distance_transform_edt(~wide) > _FAR * width)


def _difference(before: Float64Array, after: Float64Array, far: BoolArray | None = None) -> dict[str, Any]:
    """Return shares of ground that moved (%), and its rms over the relief (%)."""
    known = np.isfinite(before) & np.isfinite(after)
    apart = np.where(known, np.abs(before - after), 0.0)
    relief = float(np.ptp(before[known]))
    result = {
        "moved": 100.0 * float((apart[known] > _MOVED).mean()),
        "rms": 100.0 * float(np.sqrt((apart[known] ** 2).mean())) / relief,
    }
    if far is not None and (far & known).any():
        result["far"] = 100.0 * float((apart[far & known] > _MOVED).mean())
    return result


def _stability_row(change: str, cases: Sequence[dict[str, Any]]) -> dict[str, Cell]:
    row: dict[str, Cell] = {"change": change, "cases": len(cases)}
    row |= {key: float(np.median([each[key] for each in cases])) for key in ("moved", "rms")}
    far = [each["far"] for each in cases if "far" in each]
    if far:
        row |= {"far": float(np.median(far)), "far_worst": max(far)}
    samples: dict[str, Cell] = {"moved_samples": [each["moved"] for each in cases], "far_samples": far}
    return row | {key: each for key, each in samples.items() if isinstance(each, list) and len(each) > 1}


def _summits(ground: DrainedSketch) -> list[float]:
    """Return how far each shape's summit is from the nearest high peak of coarse ground, in its cells."""
    side, cell = EXTENT / PIXELS, ground.spacing * 2**_COARSE
    final, coarse = ground.heights(side), ground.heights(side, _COARSE)
    peaks = coarse == ndimage.maximum_filter(coarse, 2 * round(cell / side) + 1)
    result = []
    for layer in PAINTED:
        for shape in label_shapes(layer, ground.sketch.layers[layer]):
            rows, columns = shape.pixels(shape.mask)
            summit = int(np.argmax(final[rows, columns]))
            z = coarse[rows, columns]
            high = (z == z.max()) | (peaks[rows, columns] & (z > z.max() - 0.1 * np.ptp(z)))
            away = np.hypot(rows[high] - rows[summit], columns[high] - columns[summit])
            result.append(float(away.min() * side / cell))
    return result


# Charts ---------------------------------------------------------------------------------------------------


_TRADES = [
    Curves(
        "",
        "ms",
        {"": "distance"},
        by="varied",
        text="value",
        units=("ms", "distance to real land"),
        asked=(_BAR,),
    ),
    Curves(
        "",
        "iou",
        {"": "distance"},
        by="varied",
        text="value",
        units=("mean IoU of shapes", ""),
        asked=(_BAR,),
    ),
]
draw_trade_offs = partial(draw_curves, "Realism against time and adherence: down is better", _TRADES)
_DISTANCES = [BarPanel("", "distance to real land, median of windows", {"": "distance"}, asked=(_BAR,))]
draw_terrains = partial(draw_bars, "Terrains", _DISTANCES, ("terrain", "where", "cell"))
_MOVES = [
    BarPanel("Ground moved by over 1 m", "%, median", {"all": "moved", "far from the change": "far"}),
    BarPanel("rms", "% of the relief", {"rms": "rms"}),
]
draw_stability = partial(draw_bars, "What a change moves", _MOVES, ("change",))
