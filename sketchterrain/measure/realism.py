"""Realism: how far a terrain's landforms are from those of real land.

Windows of heights are measured (:mod:`~sketchterrain.measure.realism_metrics`) and compared with windows of
real DEMs by kind of land (``real_land.json``). A window passes if its distance to the nearest kind is at most
that of 95 % of real windows, and no gate fails.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from sketchterrain.array_types import BoolArray, Float64Array, UInt8Array
from sketchterrain.errors import InputError
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.measure.adherence_rivers import standing_water
from sketchterrain.measure.realism_metrics import (
    FORMS,
    MIN_WINDOW,
    WindowMaps,
    measure_window_maps,
    median_metrics,
)
from sketchterrain.schema.layers import LAYERS
from sketchterrain.terrain.layers.layer import MASKS

if TYPE_CHECKING:
    from sketchterrain.generation.terrain import Terrain

WINDOW: Final = 192
"""Cells along a side of a window."""

DEFAULT_CELL: Final = 30.0
"""Cell size (m) at which terrains are judged."""

DUNES: Final = "dunes 90 m"
"""The kind of land that windows of dunes are compared with."""

FAULTS: Final = ("", "wall", "hollow", "rising")
"""Faults that maps show: ground steeper than real land, closed hollows, channels that rise."""

TITLES: Final = {
    "slope_p95": "steepest 5 % of slopes, degrees",
    "level_share": "nearly level ground, share",
    "middle_share": "medium slopes, share",
    "high_low_slope": "slopes high above slopes low down, log2",
    "hypsometric": "hypsometric integral",
    "spectrum_fine": "spectral slope, 3 to 12 cells",
    "curvature_skew": "skew of curvature",
    "sink_share": "closed hollows, share",
    "uphill": "channels that rise, share",
    "channel_in_valley": "channels in valleys, share",
    "valley_depth": "depth of valleys",
    "ridge_extent": "extent of ridges",
    "valley_extent": "extent of valleys",
    "concavity": "concavity of channels",
    "concavity_r2": "fit of slope to drainage area, r²",
    "saddle_height": "saddles over summits",
    "reopened_hollows": "hollows under narrow trenches, share",
    "level_steps": "level reaches above steep ones, share",
    "network": "ridges and valleys as a network",
}
"""What each compared metric is."""

# Metrics of which only more (1) or only less (-1) than real land has is a fault.
_FAULT_SIDE = {"sink_share": 1, "uphill": 1, "slope_p95": 1} | dict.fromkeys(
    ("ridge_extent", "valley_extent", "channel_in_valley", "concavity_r2", "saddle_height", "valley_depth"),
    -1,
)
_NETWORK = ("ridge_extent", "valley_extent", "channel_in_valley", "valley_depth", "concavity_r2")
_QUANTILE = (
    1.645  # standard deviations from the median to the 5th or 95th percentile of a normal distribution
)
_UNKNOWN = 3.0  # deviation of a metric that cannot be measured
_MOST = 6.0  # deviation from which on a metric counts no more
_MASKED = 0.5  # share of water (or dunes) above which a window is not judged (or judged as dunes)


@dataclass(frozen=True)
class Comparison:
    """A window, or the medians of several, beside a kind of real land."""

    kind: str
    distance: float
    forms: float  # Jensen-Shannon distance of the shares of landforms over real windows' 95th percentile
    score: float  # root mean square of the deviations
    deviations: dict[str, float]  # in robust standard deviations, 0 on the side that is no fault
    failed: tuple[str, ...]  # gates
    passes: bool

    @property
    def out_of_range(self) -> tuple[str, ...]:
        """Metrics outside of real land's 5 to 95 %, the worst first."""
        far = [name for name, value in self.deviations.items() if abs(value) > _QUANTILE]
        return tuple(sorted(far, key=lambda name: -abs(self.deviations[name])))


@dataclass(frozen=True, eq=False)
class MeasuredWindow:
    """A measured window: its first row and column, metrics, comparison and maps."""

    row: int
    column: int
    metrics: dict[str, float]
    comparison: Comparison
    maps: WindowMaps


@dataclass(frozen=True, eq=False)
class Realism:
    """Result of :func:`measure_realism`."""

    cell: float
    height: Float64Array  # (rows, columns) as it was measured, m
    metrics: dict[str, float]  # medians over the windows
    comparison: Comparison  # of the medians
    windows: tuple[MeasuredWindow, ...]
    corner: tuple[float, float] = (0.0, 0.0)  # x and y of the north-westernmost height, m

    @property
    def distance(self) -> float:
        """Median of the windows' distances."""
        return float(np.median([window.comparison.distance for window in self.windows]))

    @property
    def kind(self) -> str:
        """The kind of land that most windows are nearest to."""
        return Counter(window.comparison.kind for window in self.windows).most_common(1)[0][0]

    def fault_maps(self) -> dict[str, BoolArray]:
        """Return maps (rows, columns) of hollows, rising channels, walls (steeper than real land's 95 %)."""
        found = {name: np.zeros(self.height.shape, np.bool_) for name in ("hollow", "rising", "wall")}
        steepest = kinds_of_land()[self.kind]["metrics"]["slope_p95"][2]
        for window in self.windows:
            rows, columns = window.maps.slope.shape
            part = (slice(window.row, window.row + rows), slice(window.column, window.column + columns))
            found["hollow"][part] |= window.maps.hollow
            found["rising"][part] |= window.maps.rising
            found["wall"][part] |= window.maps.slope > steepest
        return found

    def faults_at(self, x: Float64Array, y: Float64Array) -> UInt8Array:
        """Return the fault, an index into `FAULTS`, at positions (m from the sketch's south-west corner)."""
        west, north = self.corner
        rows, columns = self.height.shape
        row = np.clip(np.rint((north - y) / self.cell).astype(np.int64), 0, rows - 1)
        column = np.clip(np.rint((x - west) / self.cell).astype(np.int64), 0, columns - 1)
        maps, faults = self.fault_maps(), np.zeros(self.height.shape, np.uint8)
        for code, name in enumerate(FAULTS[1:], start=1):
            faults[maps[name]] = code
        return faults[row, column]

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the maps, JSON-serialisable; None for what cannot be measured."""
        ranges = kinds_of_land()[self.kind]["metrics"]
        beside = compare(self.metrics, self.kind)
        passing = sum(window.comparison.passes for window in self.windows)
        gates = Counter(name for window in self.windows for name in window.comparison.failed)
        return {
            "cell": self.cell,
            "windows": len(self.windows),
            "distance": round(self.distance, 4),
            "kind": self.kind,
            "passes": passing / len(self.windows),
            "failed": dict(gates.most_common()),
            "out_of_range": {
                name: {
                    "title": TITLES[name],
                    "value": _json_number(self.metrics[name]),
                    "real": ranges[name],
                }
                for name in beside.out_of_range
            },
            "metrics": {name: _json_number(value) for name, value in self.metrics.items()},
        }


@cache
def _reference() -> dict[str, Any]:
    text = files("sketchterrain.measure").joinpath("real_land.json").read_text(encoding="utf-8")
    content: dict[str, Any] = json.loads(text)
    return content


def kinds_of_land() -> dict[str, Any]:
    """Return the kinds of real land: regions, windows, 5, 50 and 95 % of each metric, mean landforms."""
    kinds: dict[str, Any] = _reference()["kinds"]
    return kinds


def compare(metrics: dict[str, float], kind: str) -> Comparison:
    """Compare a window's metrics with one kind of real land."""
    reference, land = _reference(), kinds_of_land()[kind]
    shares = np.array([metrics[f"g_{name}"] for name in FORMS])
    forms = _jensen_shannon(shares, np.array(land["forms"])) / land["forms_p95"]
    deviations = {}
    for name in reference["accept"]:
        deviation = _deviation(
            metrics[name], land["metrics"][name], reference["least_spread"].get(name, 1e-6)
        )
        side = _FAULT_SIDE.get(name, 0)
        if math.isnan(deviation):
            deviations[name] = _UNKNOWN
        else:
            deviations[name] = deviation if side == 0 or deviation * side > 0.0 else 0.0
    # Noise may reach some of these, not all at once: ridges and valleys that continue, with water in them.
    network = [_deviation(metrics[name], land["metrics"][name], 1e-9) for name in _NETWORK]
    connected = np.mean([-2.0 if math.isnan(each) else min(max(each, -3.0), 1.0) for each in network])
    score = math.sqrt(np.mean([min(abs(each), _MOST) ** 2 for each in deviations.values()]))
    failed = [name for name in reference["gates"] if abs(deviations[name]) > reference["gate"]]
    failed += ["network"] * bool(connected < land["network_least"])
    failed += [name for name in land["own_gates"] if metrics[name] > reference["own_gates"][name]]
    distance = math.hypot(forms, score)
    passes = distance <= reference["bar"] and not failed
    return Comparison(kind, distance, forms, score, deviations, tuple(failed), passes)


def nearest_land(metrics: dict[str, float], kinds: Sequence[str] = ()) -> Comparison:
    """Compare a window's metrics with the nearest of some kinds; by default mountains, valleys and hills.

    Raises
    ------
    InputError
        If there is no such kind.
    """
    land = kinds_of_land()
    for kind in kinds:
        if kind not in land:
            raise InputError(f"no kind of land {kind!r}: expected {', '.join(land)}")
    chosen = kinds or [name for name, each in land.items() if each["usual"]]
    return min((compare(metrics, name) for name in chosen), key=lambda each: each.distance)


def measure_realism(
    height: Float64Array, cell: float, *, kinds: Sequence[str] = (), masked: BoolArray | None = None
) -> Realism:
    """Measure windows of 192 cells that cover a raster, overlapping evenly; the whole if it is smaller.

    Parameters
    ----------
    height
        Heights (rows, columns), m, row 0 in the north; NaN where unknown.
    cell
        Side of a cell, m.
    kinds
        Kinds of land to compare with; by default mountains, valleys and hills.
    masked
        Cells that are no ground, such as water: interpolated across for the flow of water. Windows with more
        than half of them are left out.

    Raises
    ------
    InputError
        If no window can be judged.
    """
    if height.ndim != 2 or min(height.shape) < MIN_WINDOW:
        raise InputError(f"expected heights of at least {MIN_WINDOW}² cells, got {height.shape}")
    windows = []
    for row, column, part in _windows(height.shape):
        z = np.asarray(height[part], np.float64)
        hidden = np.zeros(z.shape, np.bool_) if masked is None else masked[part]
        if not np.isfinite(z).all() or hidden.mean() > _MASKED or np.ptp(z) <= 1.0:
            continue
        metrics, maps = measure_window_maps(interpolate_across(z, hidden), cell, hidden)
        windows.append(MeasuredWindow(row, column, metrics, nearest_land(metrics, kinds), maps))
    if not windows:
        raise InputError(
            "no window can be judged: expected finite heights, over 1 m of relief, half of it dry"
        )
    medians = median_metrics(window.metrics for window in windows)
    return Realism(cell, height, medians, nearest_land(medians, kinds), tuple(windows))


def measure_terrain_realism(
    terrain: Terrain,
    *,
    cell: float = DEFAULT_CELL,
    size: int = WINDOW,
    kinds: Sequence[str] = (),
    offset: tuple[float, float] = (0.0, 0.0),
) -> Realism:
    """Measure a terrain's sketch and its surroundings, of at least ``size``² cells around its middle.

    With an ``offset`` (m, eastward and northward) ground away from the sketch is measured instead.

    Lakes, the sea and dunes are interpolated across, rivers keep their beds; if most of the ground is dunes,
    it is compared with real dunes.
    """
    columns, rows = (max(size, math.ceil(side / cell)) for side in terrain.size)
    x = terrain.size[0] / 2.0 + offset[0] + (np.arange(columns) - (columns - 1) / 2.0) * cell
    y = terrain.size[1] / 2.0 + offset[1] - (np.arange(rows) - (rows - 1) / 2.0) * cell
    east, north = np.broadcast_arrays(
        to_lattice(x[None, :], terrain.extent), to_lattice(y[:, None], terrain.extent)
    )
    height, masks = terrain.evaluator.points(east.ravel(), north.ravel(), cell_size=cell)
    z = np.asarray(height, np.float64).reshape(rows, columns)
    dune = np.asarray(masks[:, MASKS.index("dune")]).reshape(rows, columns) >= 0.5
    water = np.zeros(z.shape, np.bool_)
    place_x, place_y = np.broadcast_arrays(x[None, :], y[:, None])
    for name, layer in LAYERS.items():
        if layer.is_water and layer.kind != "course":
            water |= standing_water(terrain.recipe, name, place_x, place_y, z.astype(np.float32))
    if dune.mean() > _MASKED:
        found = measure_realism(z, cell, kinds=kinds or (DUNES,), masked=water)
    else:
        found = measure_realism(z, cell, kinds=kinds, masked=water | dune)
    return replace(found, corner=(float(x[0]), float(y[0])))


def realism_entry(terrain: Terrain) -> dict[str, Any] | None:
    """Return the realism of a terrain for its report; None if no window can be judged, as of open sea."""
    try:
        return measure_terrain_realism(terrain).as_dict()
    except InputError:
        return None


def interpolate_across(z: Float64Array, masked: BoolArray) -> Float64Array:
    """Return heights with Laplace's equation solved over masked cells: no hollow, no summit of their own."""
    if not masked.any():
        return z
    number = np.full(z.shape, -1)
    count = int(masked.sum())
    number[masked] = np.arange(count)
    row, column = np.nonzero(masked)
    degree, right = np.zeros(count), np.zeros(count)
    entries: list[tuple[Any, Any]] = []
    for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        p, q = row + a, column + b
        inside = (p >= 0) & (q >= 0) & (p < z.shape[0]) & (q < z.shape[1])
        own, other = np.flatnonzero(inside), number[p[inside], q[inside]]
        degree[own] += 1.0
        known = other < 0
        right[own[known]] += z[p[inside][known], q[inside][known]]
        entries.append((own[~known], other[~known]))
    i, j = (np.concatenate([entry[side] for entry in entries]) for side in (0, 1))
    matrix = sparse.diags(degree) - sparse.coo_matrix((np.ones(i.size), (i, j)), shape=(count, count))
    # A masked area without any shore cannot occur: at most half of a window is masked.
    result = z.copy()
    result[masked] = spsolve(sparse.csc_matrix(matrix), right)
    return result


def _windows(shape: tuple[int, ...]) -> Iterator[tuple[int, int, tuple[slice, slice]]]:
    sides = [min(WINDOW, cells) for cells in shape]
    starts = [
        [round(each) for each in np.linspace(0, cells - side, -(-cells // side))]
        for cells, side in zip(shape, sides, strict=True)
    ]
    for row in starts[0]:
        for column in starts[1]:
            yield row, column, (slice(row, row + sides[0]), slice(column, column + sides[1]))


def _deviation(value: float, quantiles: Sequence[float], least_spread: float) -> float:
    low, middle, high = quantiles
    spread = max((high - middle if value > middle else middle - low) / _QUANTILE, least_spread)
    return (value - middle) / spread


def _jensen_shannon(p: Float64Array, q: Float64Array) -> float:
    """Return the square root of the Jensen-Shannon divergence, base 2, of two histograms."""
    p, q = p / p.sum(), q / q.sum()
    middle = 0.5 * (p + q)
    parts = [each[each > 0.0] * np.log2(each[each > 0.0] / middle[each > 0.0]) for each in (p, q)]
    return math.sqrt(max(0.5 * sum(float(part.sum()) for part in parts), 0.0))


def _json_number(value: float) -> float | None:
    return None if math.isnan(value) else float(f"{value:.5g}")
