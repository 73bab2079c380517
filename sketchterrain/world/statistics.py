"""Statistics of a level of a stored world: relief, slopes, hypsometry and shares of materials."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.world.grid import CHUNK, GridLevel
from sketchterrain.world.stored_world import StoredWorld

QUANTILES: Final = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
_STRIPE: Final = 16 * CHUNK  # columns read together, plus one on either side
_CLASSES: Final = 20
_SLOPE_CLASS: Final = 5  # degrees
_THREADS: Final = 4
_BINS: Final = 1 << 16  # over the range of the coarsest level
_SLOPE_BINS: Final = 100  # a degree
_BLOCK: Final = 64  # rows computed at once, for the processor's caches


@dataclass(frozen=True)
class HeightStatistics:
    """Heights, m; quantiles (by the share below) are accurate to 1/65,536 of the range."""

    minimum: float
    maximum: float
    range: float
    mean: float
    standard_deviation: float
    quantiles: dict[str, float]


@dataclass(frozen=True)
class Slopes:
    """Slopes, degrees, of interior vertices; quantiles (by the share below) are accurate to 0.01°.

    `shares` are of classes from 0°; `surface_ratio` is the ratio of surface area to map area.
    """

    mean: float
    maximum: float
    quantiles: dict[str, float]
    shares: tuple[float, ...]
    surface_ratio: float
    unit: str = "degrees"
    method: str = "Horn 1981"
    class_width: int = _SLOPE_CLASS


@dataclass(frozen=True)
class Hypsometry:
    """Share of the area above each of 21 heights (Strahler 1952).

    `integral` is (mean − lowest) / range, the area under the curve (Pike and Wilson 1971); 0.5 if flat.
    """

    integral: float
    heights: tuple[float, ...]
    share_above: tuple[float, ...]


@dataclass(frozen=True)
class Statistics:
    """Statistics of one level of a world; slopes are None without interior vertices.

    `sea_share` is the share of the area below the sea's level, None without a sea.
    """

    level: int
    cell: float
    columns: int
    rows: int
    area: float
    relief: HeightStatistics
    slopes: Slopes | None
    hypsometry: Hypsometry
    sea_share: float | None
    materials: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics as JSON data."""
        found = asdict(self)
        if found["slopes"] is not None:
            found["slopes"]["class"] = found["slopes"].pop("class_width")
        return found


def compute_statistics(
    stored: StoredWorld,
    *,
    level: int = 0,
    sea_level: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Statistics:
    """Return statistics of a level, the same on every machine; raise InputError for missing or broken files.

    `sea_level` (m) is that of the world's sketch.
    Threads measure stripes, which are merged in order; `progress` receives the share done, 0 … 1.
    """
    if not 0 <= level < len(stored.levels):
        raise InputError(f"no level {level}: expected 0 to {len(stored.levels) - 1}")
    selected, coarsest = stored.levels[level], stored.levels[-1]  # at most a chunk
    whole = {"top": 0, "left": 0, "rows": coarsest.rows, "columns": coarsest.columns}
    height = stored.read("height", coarsest.number, **whole)
    names = stored.material_names if "materials" in stored.layers else ()
    new_sums = partial(_Sums, float(height.min()), float(height.max()), selected.cell, len(names))
    total = new_sums()
    with ThreadPoolExecutor(min(_THREADS, os.cpu_count() or 1), thread_name_prefix="statistics") as pool:
        stripes = range(0, selected.columns, _STRIPE)
        parts = [pool.submit(_stripe, stored, selected, left, new_sums()) for left in stripes]
        try:
            for number, part in enumerate(parts, start=1):
                total.add(part.result())
                if progress is not None:
                    progress(number / len(parts))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    shares = total.weights / max(int(total.weights.sum()), 1)
    materials = {name: float(share) for name, share in zip(names, shares, strict=True)}
    columns, rows, cell = selected.columns, selected.rows, selected.cell
    area, relief = (columns - 1) * (rows - 1) * cell**2, total.relief()
    slopes, hypsometry = total.slopes(), total.hypsometry(relief.mean)
    sea = None if sea_level is None else total.share_below(sea_level)
    return Statistics(level, cell, columns, rows, area, relief, slopes, hypsometry, sea, materials)


def _stripe(stored: StoredWorld, level: GridLevel, left: int, sums: _Sums) -> _Sums:
    """Add the statistics of a stripe of columns, by rows of chunks with two overlapping rows."""
    columns = min(_STRIPE, level.columns - left)
    first, last = max(left - 1, 0), min(left + columns + 1, level.columns)
    before = np.empty((0, last - first), np.float32)
    for top in range(0, level.rows, CHUNK):
        window = {"top": top, "rows": min(CHUNK, level.rows - top)}
        height = stored.read("height", level.number, left=first, columns=last - first, **window)
        sums.add_heights(height[:, left - first : left - first + columns])
        joined = np.concatenate([before, height])
        sums.add_slopes(joined)
        before = joined[-2:]
        if len(sums.weights):
            weights = stored.read("materials", level.number, left=left, columns=columns, **window)
            sums.weights += weights.sum(axis=(1, 2), dtype=np.int64)
    return sums


class _Sums:
    """Counts, sums and histograms, accumulated by windows."""

    def __init__(self, low: float, high: float, cell: float, materials: int) -> None:
        span = max(high - low, 1.0)
        self._cell, self._start, self._width = cell, low - span, span / _BINS
        self._centre = (low + high) / 2
        self.lowest, self.highest, self.steepest = np.inf, -np.inf, 0.0
        self._sums = np.zeros(4)  # of heights from the centre, their squares, slopes, surfaces
        self._heights = np.zeros(3 * _BINS, np.int64)  # the outermost bins count heights beyond
        self._slopes = np.zeros(90 * _SLOPE_BINS, np.int64)
        self.weights = np.zeros(materials, np.int64)

    def add_heights(self, height: npt.NDArray[np.float32]) -> None:
        for top in range(0, len(height), _BLOCK):
            part = height[top : top + _BLOCK].astype(np.float64)
            self.lowest = min(self.lowest, float(part.min()))
            self.highest = max(self.highest, float(part.max()))
            number = ((part - self._start) / self._width).clip(0, len(self._heights) - 1).astype(np.int64)
            self._heights += np.bincount(number.ravel(), minlength=len(self._heights))
            part -= self._centre
            self._sums[:2] += part.sum(), np.square(part).sum()

    def add_slopes(self, height: npt.NDArray[np.float32]) -> None:
        """Add slopes of the interior vertices of a grid of heights, m."""
        for top in range(0, len(height) - 2 if height.shape[1] > 2 else 0, _BLOCK):
            tangent = _horn_slopes(height[top : top + _BLOCK + 2], self._cell)
            degrees = np.degrees(np.arctan(tangent))
            self.steepest = max(self.steepest, float(degrees.max()))
            self._sums[2:] += degrees.sum(), np.sqrt(1.0 + np.square(tangent)).sum()
            number = np.minimum((degrees * _SLOPE_BINS).astype(np.int64), len(self._slopes) - 1)
            self._slopes += np.bincount(number.ravel(), minlength=len(self._slopes))

    def add(self, other: _Sums) -> None:
        self.lowest, self.highest = min(self.lowest, other.lowest), max(self.highest, other.highest)
        self.steepest = max(self.steepest, other.steepest)
        self._sums += other._sums
        self._heights += other._heights
        self._slopes += other._slopes
        self.weights += other.weights

    def relief(self) -> HeightStatistics:
        mean, square = self._sums[:2] / self._heights.sum()
        deviation = float(np.sqrt(max(square - mean * mean, 0.0)))
        low, high, quantiles = self.lowest, self.highest, _quantiles(*self._curve())
        return HeightStatistics(low, high, high - low, float(self._centre + mean), deviation, quantiles)

    def slopes(self) -> Slopes | None:
        count = int(self._slopes.sum())
        if not count:
            return None
        mean, surface = (float(each) for each in self._sums[2:] / count)
        classes = self._slopes.reshape(-1, _SLOPE_CLASS * _SLOPE_BINS).sum(axis=1) / count
        below = np.concatenate([[0], np.cumsum(self._slopes)]) / count
        quantiles = _quantiles(np.arange(len(below)) / _SLOPE_BINS, below)
        return Slopes(mean, self.steepest, quantiles, tuple(map(float, classes)), surface)

    def hypsometry(self, mean: float) -> Hypsometry:
        edges, below = self._curve()
        span = self.highest - self.lowest
        steps = np.linspace(self.lowest, self.highest, _CLASSES + 1)
        above = 1.0 - np.interp(steps, edges, below) if span > 0 else np.ones(_CLASSES + 1)
        integral = (mean - self.lowest) / span if span > 0 else 0.5
        return Hypsometry(integral, tuple(map(float, steps)), tuple(map(float, above)))

    def share_below(self, height: float) -> float:
        return float(np.interp(height, *self._curve(), left=0.0, right=1.0))

    def _curve(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return edges of bins, clamped to the extreme heights, and the share below each."""
        filled = np.flatnonzero(self._heights)
        first, last = int(filled[0]), int(filled[-1]) + 1
        edges = self._start + np.arange(first, last + 1) * self._width
        edges[0], edges[-1] = self.lowest, self.highest
        counts = np.concatenate([[0], np.cumsum(self._heights[first:last])])
        return np.asarray(edges, np.float64), np.asarray(counts / counts[-1])


def _horn_slopes(height: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.float64]:
    """Return slope tangents (rows − 2, columns − 2) by Horn (1981), the default of `gdaldem slope`."""
    z = height.astype(np.float64)
    across = z[:, 2:] - z[:, :-2]
    down = z[2:] - z[:-2]
    east = across[:-2] + 2.0 * across[1:-1] + across[2:]
    north = down[:, :-2] + 2.0 * down[:, 1:-1] + down[:, 2:]
    return np.asarray(np.sqrt(np.square(east) + np.square(north)) / (8.0 * cell))


def _quantiles(edges: npt.NDArray[np.float64], below: npt.NDArray[np.float64]) -> dict[str, float]:
    """Return where a rising curve first reaches each of `QUANTILES`."""
    first = np.searchsorted(below, QUANTILES, side="left").clip(1, len(below) - 1)
    low, high = below[first - 1], below[first]
    part = (np.asarray(QUANTILES) - low) / np.where(high > low, high - low, 1.0)
    found = edges[first - 1] + part * (edges[first] - edges[first - 1])
    return {f"{share:g}": float(value) for share, value in zip(QUANTILES, found, strict=True)}
