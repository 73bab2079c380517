"""The terrain at the sketch's pixels, with its shading: only what changed anew, a little at a time."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.ui.engine.protocol import Relief

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.changes import Box

LARGEST: Final = 1024
"""Samples along the longer side, at most."""
_POINTS: Final = 16384  # samples that are asked for at once
_BAND: Final = 32  # rows
_WAITS: Final = 0.4
"""s from one relief to the next while one paints."""
_SUN: Final = np.array([-0.5, 0.5, 0.75]) / np.linalg.norm([-0.5, 0.5, 0.75])
_STEEPER: Final = 1.6  # times the true slopes: gentle ground shows its shape too


class ReliefBuilder:
    """Follows a terrain; each relief that it hands out is of one version, never of two."""

    def __init__(self) -> None:
        self._terrain: Terrain | None = None
        self._version = -1
        self._step = 0
        self._height = np.zeros((0, 0), np.float32)
        self._shade = np.zeros((0, 0), np.uint8)
        self._stale = np.zeros((0, 0), np.bool_)
        self._work: Iterator[bool] | None = None
        self._made: Relief | None = None
        self._handed_out = 0.0

    def follow(self, terrain: Terrain, version: int, areas: list[Box]) -> None:
        """Make the relief of a terrain next, which differs from the one before in some areas only (m)."""
        sketch = terrain.sketch
        step = max(-(-max(sketch.width_px, sketch.height_px) // LARGEST), 1)
        shape = (-(-sketch.height_px // step), -(-sketch.width_px // step))
        other = self._terrain is None or self._terrain.sketch.pixel_size != sketch.pixel_size
        if other or shape != self._height.shape:
            self._height, self._shade = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
            self._stale = np.ones(shape, np.bool_)
            self._work = None
        self._terrain, self._version, self._step = terrain, version, step
        cell = step * sketch.pixel_size
        north = sketch.height_px * sketch.pixel_size
        for west, south, east, top in areas:
            rows = _span((north - top) / cell, (north - south) / cell, shape[0])
            self._stale[rows, _span(west / cell, east / cell, shape[1])] = True

    @property
    def busy(self) -> bool:
        """Whether there is something to make."""
        return self._work is not None or bool(self._stale.any())

    def due(self, *, coming: bool) -> float | None:
        """Return in how many s it goes on; None: it is as new as the terrain.

        It waits for a terrain that is `coming`, but not for long: tiles in view come first.
        """
        if not self.busy:
            return None
        return max(_WAITS - (time.monotonic() - self._handed_out), 0.0) if coming else 0.0

    def work(self, seconds: float) -> Relief | None:
        """Go on for about so long; return a relief when it is whole."""
        until = time.perf_counter() + seconds
        while self.busy:
            if self._work is None:
                assert self._terrain is not None  # noqa: S101 # else nothing were stale
                stale, self._stale = self._stale, np.zeros_like(self._stale)
                self._work = self._steps(self._terrain, self._version, stale)
            if next(self._work, True):
                self._work, self._handed_out = None, time.monotonic()
                return self._made
            if time.perf_counter() >= until:
                break
        return None

    def _steps(self, terrain: Terrain, version: int, stale: npt.NDArray[np.bool_]) -> Iterator[bool]:
        """Make what is stale, of this terrain, whatever comes meanwhile."""
        cell, height = self._step * terrain.sketch.pixel_size, self._height
        north = terrain.sketch.height_px * terrain.sketch.pixel_size
        for top in range(0, len(stale), _BAND):
            columns = np.flatnonzero(stale[top : top + _BAND].any(axis=0))
            if not columns.size:
                continue
            left, right = int(columns[0]), int(columns[-1]) + 1
            x = (np.arange(left, right) + 0.5) * cell
            deep = max(_POINTS // len(x), 1)
            for row in range(top, min(top + _BAND, len(stale)), deep):
                end = min(row + deep, top + _BAND, len(stale))
                y = north - (np.arange(row, end) + 0.5) * cell
                height[row:end, left:right] = terrain.heights(x[None, :], y[:, None], cell_size=cell)
                yield False
        rows = np.flatnonzero(stale.any(axis=1))
        first, last = (int(rows[0]), int(rows[-1]) + 1) if rows.size else (0, 0)
        for top in range(max(first - 1, 0), last + 1, 4 * _BAND):
            end = min(top + 4 * _BAND, last + 1, len(stale))
            above, below = max(top - 1, 0), min(end + 1, len(stale))
            self._shade[top:end] = hill_shade(height[above:below], cell)[top - above : end - above]
            yield False
        if not self._stale.any():  # what came meanwhile differs nowhere
            version = self._version
        self._made = Relief(version, self._step, height.copy(), self._shade.copy())


def hill_shade(height: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.uint8]:
    """Return the light on a ground from the north-west, 0 … 255; level ground has about 185."""
    east = np.gradient(height, cell / _STEEPER, axis=1) if height.shape[1] > 1 else np.zeros_like(height)
    south = np.gradient(height, cell / _STEEPER, axis=0) if height.shape[0] > 1 else np.zeros_like(height)
    light = (_SUN[2] - east * _SUN[0] + south * _SUN[1]) / np.sqrt(1.0 + east**2 + south**2)
    return np.asarray(np.clip(light, 0.0, 1.0) * 255.0, np.uint8)


def _span(low: float, high: float, most: int) -> slice:
    """Return the samples whose middles lie between two places, in samples from the first one's border."""
    first = 0 if low < 0 else min(math.floor(low), most)
    last = most if high > most else max(math.ceil(high), 0)
    return slice(first, last)
