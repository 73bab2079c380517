"""Sums over vertices that are put together window by window, and what follows from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Sums", "horn_slopes"]

_FINEST: Final = 2.0**-12  # m: no bin of heights is narrower
_MOST_BINS: Final = 1 << 17
_SLOPE_BINS: Final = 100  # a degree
_RIGHT_ANGLE: Final = 90
_AT_ONCE: Final = 64  # rows: what is computed at once stays in a processor's caches


class Sums:
    """Counts, sums and histograms of heights, slopes and weights.

    Parameters
    ----------
    cell
        Metres between vertices.
    materials
        How many there are.
    """

    def __init__(self, cell: float, materials: int) -> None:
        self.cell = cell
        self.count = self.slope_count = 0
        self.lowest, self.highest, self.steepest = np.inf, -np.inf, 0.0
        self.mean = self._squares = 0.0
        self._slope_sum = self._surface_sum = 0.0
        # Bin k holds heights from k·width on. Widths are powers of two, so that two bins become one exactly.
        self._first, self._width = 0, _FINEST
        self._bins = np.zeros(0, np.int64)
        self._slopes = np.zeros(_RIGHT_ANGLE * _SLOPE_BINS, np.int64)
        self._weights = np.zeros(materials, np.int64)

    def add_heights(self, height: npt.NDArray[np.float32]) -> None:
        """Count vertices' heights: any shape, m."""
        for top in range(0, len(height), _AT_ONCE):
            part = height[top : top + _AT_ONCE].astype(np.float64)
            low, high = float(part.min()), float(part.max())
            self.lowest, self.highest = min(self.lowest, low), max(self.highest, high)
            self._widen(max(self._width, _width_for(self.highest - self.lowest)))
            mean = float(part.mean())
            self._merge(part.size, mean, float(np.square(part - mean).sum()))
            number = np.floor(part * (1.0 / self._width)).astype(np.int64).ravel()
            first = int(number.min())
            self._merge_bins(first, np.bincount(number - first))

    def add_slopes(self, height: npt.NDArray[np.float32]) -> None:
        """Count the slopes of a grid of heights, of the vertices inside: (rows, columns), m."""
        if min(height.shape) < 3:
            return
        for top in range(0, len(height) - 2, _AT_ONCE):
            tangent = horn_slopes(height[top : top + _AT_ONCE + 2], self.cell)
            degrees = np.degrees(np.arctan(tangent))
            self.slope_count += tangent.size
            self.steepest = max(self.steepest, float(degrees.max()))
            self._slope_sum += float(degrees.sum())
            self._surface_sum += float(np.sqrt(1.0 + np.square(tangent)).sum())
            number = np.minimum((degrees * _SLOPE_BINS).astype(np.int64), len(self._slopes) - 1)
            self._slopes += np.bincount(number.ravel(), minlength=len(self._slopes))

    def add_materials(self, weights: npt.NDArray[np.uint8]) -> None:
        """Add up weights: (materials, rows, columns)."""
        self._weights += weights.sum(axis=(1, 2), dtype=np.int64)

    def add(self, other: Sums) -> None:
        """Add all that another part has."""
        self.lowest, self.highest = min(self.lowest, other.lowest), max(self.highest, other.highest)
        self.steepest = max(self.steepest, other.steepest)
        self._merge(other.count, other.mean, other._squares)
        self._widen(max(self._width, other._width, _width_for(self.highest - self.lowest)))
        self._merge_bins(*_folded(other._first, other._bins, round(self._width / other._width)))
        self.slope_count += other.slope_count
        self._slope_sum += other._slope_sum
        self._surface_sum += other._surface_sum
        self._slopes += other._slopes
        self._weights += other._weights

    def _merge(self, count: int, mean: float, squares: float) -> None:
        """Add a part's count, mean and sum of squared deviations (Chan, Golub and LeVeque 1979)."""
        both = self.count + count
        apart = mean - self.mean
        self.mean += apart * count / both
        self._squares += squares + apart * apart * self.count * count / both
        self.count = both

    def _widen(self, width: float) -> None:
        self._first, self._bins = _folded(self._first, self._bins, round(width / self._width))
        self._width = width

    def _merge_bins(self, first: int, bins: npt.NDArray[Any]) -> None:
        if not len(self._bins):
            self._first = first
        lowest = min(first, self._first)
        last = max(first + len(bins), self._first + len(self._bins))
        if lowest < self._first or last > self._first + len(self._bins):
            wider = np.zeros(last - lowest, np.int64)
            wider[self._first - lowest :][: len(self._bins)] = self._bins
            self._first, self._bins = lowest, wider
        self._bins[first - self._first :][: len(bins)] += bins

    @property
    def deviation(self) -> float:
        """Standard deviation of the heights, m."""
        return float(np.sqrt(self._squares / self.count))

    @property
    def slope_mean(self) -> float:
        """Degrees."""
        return self._slope_sum / self.slope_count

    @property
    def surface(self) -> float:
        """The surface's area for that of its map."""
        return self._surface_sum / self.slope_count

    @property
    def material_shares(self) -> list[float]:
        """Of all weights."""
        return [float(each) for each in self._weights / max(int(self._weights.sum()), 1)]

    def share_below(self, height: float) -> float:
        """Return the share of vertices that lie lower; inside a bin they lie evenly."""
        if height <= self.lowest:
            return 0.0
        if height >= self.highest:
            return 1.0
        return float(np.interp(height, self._edges, self._below(self._bins)))

    def height_at(self, share: float) -> float:
        """Return the height that a share of the vertices lies under, m."""
        return _where(self._below(self._bins), self._edges, share)

    def slope_at(self, share: float) -> float:
        """Return the slope that a share of the vertices is flatter than, degrees."""
        return _where(self._below(self._slopes), np.arange(len(self._slopes) + 1) / _SLOPE_BINS, share)

    def slope_shares(self, degrees: int) -> tuple[float, ...]:
        """Return the shares of vertices in classes of so many whole degrees."""
        classes = self._slopes.reshape(-1, degrees * _SLOPE_BINS).sum(axis=1)
        return tuple(float(each) for each in classes / self.slope_count)

    @property
    def _edges(self) -> npt.NDArray[np.float64]:
        """Of the bins of heights; the outermost are where the heights really end."""
        edges = (self._first + np.arange(len(self._bins) + 1)) * self._width
        edges[0], edges[-1] = self.lowest, self.highest
        return np.asarray(edges, np.float64)

    @staticmethod
    def _below(bins: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        return np.asarray(np.concatenate([[0], np.cumsum(bins)]) / bins.sum(), np.float64)


def horn_slopes(height: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.float64]:
    """Return the tangents of a grid's slopes, by differences over eight neighbours.

    Horn (1981), "Hill shading and the reflectance map", as `gdaldem slope` has it by default: exact on a
    plane, and half as much disturbed by noise as plain central differences.

    Parameters
    ----------
    height
        (rows, columns), m; 3 × 3 at least.
    cell
        Metres between vertices.

    Returns
    -------
    (rows − 2, columns − 2) float64
    """
    z = height.astype(np.float64)
    across = z[:, 2:] - z[:, :-2]
    down = z[2:] - z[:-2]
    east = across[:-2] + 2.0 * across[1:-1] + across[2:]
    north = down[:, :-2] + 2.0 * down[:, 1:-1] + down[:, 2:]
    return np.asarray(np.sqrt(np.square(east) + np.square(north)) / (8.0 * cell))


def _width_for(reach: float) -> float:
    """Return how wide bins must be that not too many reach so far, m."""
    width = _FINEST
    while reach > _MOST_BINS * width:
        width *= 2.0
    return width


def _folded(first: int, bins: npt.NDArray[np.int64], times: int) -> tuple[int, npt.NDArray[np.int64]]:
    """Return bins so many times as wide, a power of two, and the number of the first one."""
    start = first // times
    if times == 1 or not len(bins):
        return start, bins
    padded = np.zeros(-(-(first + len(bins)) // times) * times - start * times, np.int64)
    padded[first - start * times :][: len(bins)] = bins
    return start, np.asarray(padded.reshape(-1, times).sum(axis=1))


def _where(below: npt.NDArray[np.float64], edges: npt.NDArray[np.float64], share: float) -> float:
    """Return where a rising curve reaches a share; on a level stretch, its middle's start."""
    bin_ = int(np.searchsorted(below, share, side="left"))
    bin_ = min(max(bin_, 1), len(edges) - 1)
    low, high = below[bin_ - 1], below[bin_]
    part = 0.0 if high <= low else (share - low) / (high - low)
    return float(edges[bin_ - 1] + part * (edges[bin_] - edges[bin_ - 1]))
