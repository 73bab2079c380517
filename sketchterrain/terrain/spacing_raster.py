"""The distance between points over the ground, as a raster of the world, and its ranges."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

_POOLED: Final = 4  # quads of the raster along the squares whose ranges are kept


class SpacingRaster(NamedTuple):
    """The distance between points, bilinear between the vertices of a raster of the world.

    Attributes
    ----------
    west, south : int
        Of the first vertex, lattice units; multiples of ``step``.
    step : int
        Lattice units between vertices, a power of two.
    spacing : float32 (rows, columns)
        Lattice units, row 0 southernmost; over the greatest distance where nothing stands.
    """

    west: int
    south: int
    step: int
    spacing: npt.NDArray[np.float32]


class SpacingRanges(NamedTuple):
    """The least and the greatest distance in squares of a raster, ``_POOLED`` of its steps wide.

    Attributes
    ----------
    west, south : int
        Of the first square, lattice units.
    side : int
        Of a square, lattice units.
    low, high : float32 (rows, columns)
        Lattice units, row 0 southernmost; what is between a square's vertices lies between them.
    """

    west: int
    south: int
    side: int
    low: npt.NDArray[np.float32]
    high: npt.NDArray[np.float32]

    @classmethod
    def from_raster(cls, raster: SpacingRaster) -> SpacingRanges:
        """Return those of a raster."""
        low, high = (_pooled(best, raster.spacing) for best in (np.minimum, np.maximum))
        return cls(raster.west, raster.south, raster.step * _POOLED, low, high)

    def over(
        self, start: list[npt.NDArray[np.int64]], sides: list[int]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Return the ranges over rectangles.

        Parameters
        ----------
        start
            First rows (n,) and columns (m,), lattice units.
        sides
            Height and width of all, lattice units.

        Returns
        -------
        low, high : float32 (n, m)
        """
        spans = []
        for origin, from_, side, many in zip(
            (self.south, self.west), start, sides, self.low.shape, strict=True
        ):
            first = ((from_ - origin) // self.side).clip(0, many - 1)
            last = ((from_ + side - 1 - origin) // self.side + 1).clip(first + 1, many)
            spans.append(np.stack([first, last], axis=-1).ravel())
        return _reduced(np.minimum, self.low, spans), _reduced(np.maximum, self.high, spans)


def _pooled(best: np.ufunc, values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Reduce squares of a raster's quads to one value each."""
    for axis in (0, 1):
        squares = -(-(values.shape[axis] - 1) // _POOLED)
        missing = squares * _POOLED + 1 - values.shape[axis]
        values = np.concatenate([values, *[values.take([-1], axis)] * missing], axis).swapaxes(0, axis)
        parts = [values[k : len(values) - _POOLED + k : _POOLED] for k in range(_POOLED)]
        result = values[_POOLED::_POOLED].copy()
        for part in parts:
            best(result, part, out=result)
        values = result.swapaxes(0, axis)
    return values


def _reduced(
    best: np.ufunc, values: npt.NDArray[np.float32], spans: list[npt.NDArray[np.int64]]
) -> npt.NDArray[np.float32]:
    """Reduce the values in spans of rows and of columns, given as starts and ends in turn."""
    for axis, span in enumerate(spans):
        values = np.concatenate([values, values.take([-1], axis)], axis)  # a span may end after the last
        values = best.reduceat(values, span, axis).take(range(0, len(span), 2), axis)
    return values
