"""Erosion: slopes, normals and their cost, beside noise and a simulation of the stream power law."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import RELIEF, open_ground
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    PURPLE,
    SMALL,
    VERMILION,
    Curves,
    draw_curves,
    new_figure,
)
from sketchterrain.benchmarks.report import Row, Table, Tables, samples_of, value_of
from sketchterrain.benchmarks.timing import TimedContext, lap, spread
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain, host_heights
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.relief import ReliefLayer, ReliefScale
from sketchterrain.terrain.noise import NoiseStack, fbm, octave_table
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    Integers = npt.NDArray[np.int64]

PRESET = "alpine_range"

_CELL = 8.0  # m
_NOISE, _PLAIN, _ERODED, _PEER = "fBm", "drained", "drained, gullies", "fastscapelib"
_PEER_STEPS = 20
_PEER_YEARS = 2500.0
_PEER_K, _PEER_AREA, _PEER_SLOPE = 2e-5, 0.4, 1.0  # m^0.2 a year; exponents of area and slope
_SLOPES = np.arange(0.0, 91.0, 3.0)  # degrees
_AREA_BINS = 4  # a decade
_CHANNEL = 1e5  # m²: from which on slopes are those of channels
_NORMAL_CELLS = (4.0, 16.0, 64.0)
_NORMAL_PLACES = 4000

_SHAPES = {
    "slope_50": "slope, median, °",
    "slope_90": "90 %, °",
    "slope_99": "99 %, °",
    "pits": "pits, % of cells",
    "largest": "largest catchment, % of the ground",
    "concavity": "slope falls with area^",
    "integral": "hypsometric integral",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Slopes, drainage and heights of drained mountains, beside plain noise and beside a simulation.

    The ground is the middle of alpine_range in cells of 8 m, its relief alone: with its gullies, without
    them, as fBm of the same mean and deviation, and that fBm eroded by the stream power law (fastscapelib: 20
    steps of 2500 years, K = 2e-5, m = 0.4, n = 1, sinks routed by a spanning tree, borders fixed). Water runs
    to the lowest of eight neighbours and ends in pits. Slopes are central differences; the exponent is fitted
    to the mean slopes of channels, catchments above 0.1 km², by quarters of a decade. Milliseconds are
    medians of rounds: evaluating the ground (fBm in NumPy), and for fastscapelib, once, its steps alone;
    draining the whole sketch, once, comes before. Normals: the angle to the gradient of float64 heights over
    0.02 m, of central differences over one cell and of the slope that the filter steers by, which holds each
    wave's direction.
    """
    side = effort.noise_side // 2
    eroded = open_ground(f"{RELIEF}{PRESET}", context).recipe
    smooth = _NoGullies(*(getattr(eroded[ReliefLayer], each.name) for each in fields(ReliefLayer)))
    plain = replace(
        eroded, layers=tuple(smooth if isinstance(each, ReliefLayer) else each for each in eroded.layers)
    )
    start = time.perf_counter()
    make_recipe(load_sketch(PRESET))  # what drains is compiled by now
    solved = 1e3 * (time.perf_counter() - start)
    axis: Float64Array = 0.5 * eroded.extent + _CELL * (np.arange(side, dtype=np.float64) - 0.5 * side)
    heights = {}
    rows: list[Row] = []
    for name, recipe in ((_PLAIN, plain), (_ERODED, eroded)):
        evaluator = Evaluator(recipe, context)
        x, y = (to_lattice(each.ravel(), recipe.extent) for each in np.meshgrid(axis, axis))
        evaluate = partial(evaluator.points, x, y, cell_size=_CELL)
        laps = [lap(evaluate) for _ in range(effort.rounds + 1)]
        height, _ = evaluate()
        heights[name] = height.reshape(side, side).astype(np.float64)
        rows.append({**_shape(name, heights[name], [each.wall for each in laps[1:]]), "solve_ms": solved})
    start = time.perf_counter()
    noise = _noise(eroded, axis)
    seconds = time.perf_counter() - start
    noise = (noise - noise.mean()) / noise.std() * heights[_PLAIN].std() + heights[_PLAIN].mean()
    rows.insert(0, _shape(_NOISE, noise, [seconds]))
    rows.append(_simulated(noise))
    return (
        Table("What comes out", tuple(rows), _SHAPES),
        Table("Normals", tuple(_normals({_PLAIN: plain, _ERODED: eroded}, axis))),
    )


class _NoGullies(ReliefLayer):
    """The drained ground without gullies below its raster."""

    def scale(self, world: WorldSettings) -> ReliefScale:
        """Return the strengths of the noises."""
        return replace(super().scale(world), gully_depth=0.0)


def _noise(recipe: TerrainRecipe, axis: Float64Array) -> Float64Array:
    stack = NoiseStack("plain", 4096.0, 0.5)
    table = octave_table([stack], extent=recipe.extent, seed=recipe.seed, cell_size=_CELL)
    x, y = (to_lattice(each, recipe.extent) for each in np.meshgrid(axis, axis))
    return fbm(table, "plain", x, y)


def _simulated(base: Float64Array) -> Row:
    if find_spec("fastscapelib") is None:
        return {"method": _PEER, "ms": None, "absent": "pip install fastscapelib"}
    peer: Any = import_module("fastscapelib")
    grid = peer.RasterGrid(list(base.shape), [_CELL, _CELL], peer.NodeStatus.FIXED_VALUE)
    graph = peer.FlowGraph(grid, [peer.SingleFlowRouter(), peer.MSTSinkResolver()])
    eroder = peer.SPLEroder(graph, _PEER_K, _PEER_AREA, _PEER_SLOPE, 1e-5)
    height = base.copy()
    start = time.perf_counter()
    for _ in range(_PEER_STEPS):
        graph.update_routes(height)
        height -= eroder.erode(height, graph.accumulate(1.0), _PEER_YEARS)
    return _shape(_PEER, height, [time.perf_counter() - start])


def _shape(name: str, height: Float64Array, seconds: list[float]) -> Row:
    north, east = np.gradient(height, _CELL)
    slope = np.hypot(north, east)
    degrees = np.degrees(np.arctan(slope))
    down = receivers(height)
    area = catchments(down) * _CELL**2
    inner = np.zeros(height.shape, bool)
    inner[1:-1, 1:-1] = True
    pits = (down == np.arange(height.size)) & inner.ravel()
    centre, mean = _by_area(area[inner.ravel()], slope[inner])
    channel = centre > _CHANNEL
    concavity = None
    if channel.sum() > 1:
        concavity = float(np.polyfit(np.log(centre[channel]), np.log(mean[channel]), 1)[0])
    low, high = float(height.min()), float(height.max())
    return {
        "method": name,
        "side": height.shape[0],
        "ms": float(1e3 * spread(seconds).median),
        "slope_50": float(np.percentile(degrees, 50)),
        "slope_90": float(np.percentile(degrees, 90)),
        "slope_99": float(np.percentile(degrees, 99)),
        "pits": float(100 * pits.sum() / inner.sum()),
        "largest": float(100 * area.max() / (height.size * _CELL**2)),
        "concavity": concavity,
        "integral": float((height.mean() - low) / (high - low)),
        "slope_share": [float(n) / height.size for n in np.histogram(degrees, _SLOPES)[0]],
        "area_m2": [float(each) for each in centre],
        "area_slope": [float(each) for each in mean],
        "hypsometry": [float(each) for each in np.percentile((height - low) / (high - low), np.arange(101))],
    }


def receivers(height: Float64Array) -> Integers:
    """Return for each cell of a grid, row by row, which neighbour its water runs to: itself in a pit."""
    rows, columns = height.shape
    number = np.arange(height.size).reshape(height.shape)
    best, steepest = number.copy(), np.zeros(height.shape)
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: rows - row, max(-column, 0) : columns - max(column, 0)]
        there = np.s_[row:, max(column, 0) : columns - max(-column, 0)]
        fall = (height[here] - height[there]) / np.hypot(row, column)
        for one, other, drop in ((here, there, fall), (there, here, -fall)):
            better = drop > steepest[one]
            steepest[one] = np.where(better, drop, steepest[one])
            best[one] = np.where(better, number[other], best[one])
    return best.ravel()


def catchments(down: Integers) -> Float64Array:
    """Return how many cells drain through each cell, itself included, given where each one's water runs to.

    By doubling: after k rounds a cell has counted what lies less than 2^k steps upstream.
    """
    count = down.size
    # Beyond a pit lies one more cell, which nobody looks at.
    reach = np.append(np.where(down == np.arange(count), count, down), count)
    area = np.append(np.ones(count), 0.0)
    while np.any(reach[:-1] != count):
        area = area + np.bincount(reach, weights=area, minlength=count + 1)
        area[-1] = 0.0
        reach = reach[reach]
    return area[:-1]


def _by_area(area: Float64Array, slope: Float64Array) -> tuple[Float64Array, Float64Array]:
    bins = np.floor(_AREA_BINS * np.log10(area)).astype(np.int64)
    first = bins.min()
    count = np.bincount(bins - first)
    total = np.bincount(bins - first, weights=slope)
    kept = count > 9
    return 10.0 ** ((np.flatnonzero(kept) + first + 0.5) / _AREA_BINS), total[kept] / count[kept]


def _normals(recipes: dict[str, TerrainRecipe], axis: Float64Array) -> list[Row]:
    rows: list[Row] = []
    places = np.random.default_rng(11).uniform(axis[0], axis[-1], (2, _NORMAL_PLACES))
    for name, recipe in recipes.items():
        unit = metres_per_unit(recipe.extent)
        x, y = (np.round(part / unit) * unit for part in places)
        for cell in _NORMAL_CELLS:
            true = _differences(recipe, x, y, cell, 0.02)
            lattice = (to_lattice(part, recipe.extent) for part in (x, y))
            found = {
                "finite differences": _differences(recipe, x, y, cell, cell),
                "analytic": np.stack(HostTerrain(recipe).slopes(*lattice, cell_size=cell)[1:]),
            }
            for method, slope in found.items():
                angle = _angles(slope, true)
                rows.append(
                    {
                        "ground": name,
                        "cell_size": cell,
                        "method": method,
                        "median_deg": float(np.median(angle)),
                        "p95_deg": float(np.percentile(angle, 95)),
                    }
                )
    return rows


def _differences(
    recipe: TerrainRecipe, x: Float64Array, y: Float64Array, cell: float, step: float
) -> Float64Array:
    step = max(round(step / metres_per_unit(recipe.extent)), 1) * metres_per_unit(recipe.extent)
    ahead = [host_heights(recipe, x + step * e, y + step * n, cell_size=cell) for e, n in ((1, 0), (0, 1))]
    behind = [host_heights(recipe, x - step * e, y - step * n, cell_size=cell) for e, n in ((1, 0), (0, 1))]
    return (np.stack(ahead) - np.stack(behind)) / (2 * step)


def _angles(a: Float64Array, b: Float64Array) -> Float64Array:
    """Angles (degrees) between the normals of slopes of shape (2, n)."""
    one, other = (np.vstack([-each, np.ones(each.shape[1])]) for each in (a, b))
    across = np.linalg.norm(np.cross(one, other, axis=0), axis=0)
    return np.asarray(np.degrees(np.arctan2(across, (one * other).sum(axis=0))))


_COLOURS = {_NOISE: PURPLE, _PLAIN: GREEN, _ERODED: VERMILION, _PEER: BLUE}
_BIN = 3.0  # degrees


def draw_erosion(rows: Sequence[Row]) -> Any:
    """Shares of slopes, mean slope against drainage area, hypsometry, and times, one line a ground."""
    figure = new_figure(12.0, 3.8)
    slopes, drainage, heights, times = figure.subplots(1, 4)
    kept = [row for row in rows if row.get("slope_share")]
    for row in kept:
        name = str(row["method"])
        style = {"color": _COLOURS[name], "label": name, "linewidth": 1.4}
        share = samples_of(row, "slope_share")
        slopes.plot([_BIN * (i + 0.5) for i in range(len(share))], [100 * each for each in share], **style)
        area = [each / 1e6 for each in samples_of(row, "area_m2")]
        drainage.plot(area, samples_of(row, "area_slope"), "o-", markersize=2.5, **style)
        heights.plot(range(101), samples_of(row, "hypsometry"), **style)
    slopes.set(xlabel="slope, degrees", ylabel="% of the ground", title="Slopes")
    drainage.set(xlabel="drainage area, km²", ylabel="mean slope", title="Slope against area")
    drainage.set(xscale="log", yscale="log")
    heights.set(xlabel="% of the ground below", ylabel="relative height", title="Hypsometry")
    names = [str(row["method"]) for row in kept]
    times.barh(names, [value_of(row, "ms") for row in kept], color=[_COLOURS[name] for name in names])
    times.set(xscale="log", xlabel="ms", title=f"Time for {value_of(kept[0], 'side'):g}² cells")
    times.invert_yaxis()
    slopes.legend(fontsize=SMALL)
    return figure


_ERRORS = {"median": "median_deg", "95 %": "p95_deg"}
_PANEL = Curves("", "cell_size", _ERRORS, by="method", units=("cell, m", "error of normals, degrees"))
draw_normals = partial(draw_curves, "Normals", [_PANEL], each="ground")
