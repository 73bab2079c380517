"""Ways of measuring the distance to a spline, ready to launch on a device."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.hydrology.splines import cubics
from sketchterrain.terrain.centrelines import flatten, position

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext


__all__ = ["ARCS", "FLATTENED", "KERNELS", "SEGMENTS", "SplineQueries", "pieces_of"]

SEGMENTS, ARCS = "straight pieces", "arcs"

FLATTENED = (SEGMENTS, ARCS)
"""Methods that flatten the splines first, for one cell size; the others work on the cubics themselves."""

KERNELS = {
    "Newton": "spline_newton_distances",
    "two steps": "spline_two_step_distances",
    "iterated sampling": "spline_sampling_distances",
    "all roots": "spline_roots_distances",
    SEGMENTS: "spline_segments_distances",
    ARCS: "spline_arcs_distances",
}
"""Kernels in ``kernels/splines.cl`` by the method's name."""


class SplineQueries:
    """Splines and places on a device."""

    def __init__(self, context: ComputeContext, controls: Float64Array, places: Float64Array) -> None:
        self._context = context
        self.shape = places.shape[:2]
        # As the kernels get them: the error is then the method's and its arithmetic's.
        self.cubics = cubics(controls).astype(context.real_dtype).astype(np.float64)
        self.places = places.astype(context.real_dtype).astype(np.float64)
        self._cubic = context.upload(self.cubics.astype(context.real_dtype))
        self._place = context.upload(self.places.astype(context.real_dtype))
        self._out = context.empty(self.shape, context.real_dtype)

    def work(self, method: str, cell_size: float) -> Callable[[], None]:
        """Return what launches one of `KERNELS`, for a cell size (m)."""
        size, each = (int(np.prod(self.shape)),), np.int32(self.shape[1])
        launch = partial(self._context.launch, "baselines/splines.cl", KERNELS[method], size)
        if method not in FLATTENED:
            count = np.int32(self.cubics.shape[1])
            return partial(launch, self._cubic, count, self._place, each, self._out)
        starts, *pieces = pieces_of(self.cubics, 0.01 * cell_size, arcs=method == ARCS)
        upload, real = self._context.upload, self._context.real_dtype
        buffers = (upload(starts), *(upload(part.astype(real)) for part in pieces))
        return partial(launch, *buffers, self._place, each, self._out)

    def distances(self, method: str, cell_size: float) -> npt.NDArray[Any]:
        """Return the distances (m) by a method, shape (count, each)."""
        self.work(method, cell_size)()
        return self._context.download(self._out, self.shape, self._context.real_dtype)


def pieces_of(
    cubic: Float64Array, tolerance: float, *, arcs: bool
) -> tuple[npt.NDArray[np.int32], Float64Array, Float64Array]:
    """Return flattened splines as ``spline_arcs_distances`` in ``kernels/splines.cl`` reads them."""
    flat = cubic.reshape(-1, 2, 4)
    found = flatten(flat, tolerance, arcs=arcs)
    ends = position(flat[found.cubic], np.stack([found.first, found.last], axis=-1))
    chord = ends[:, 1] - ends[:, 0]
    length2 = (chord**2).sum(axis=-1)
    inverse = np.where(length2 > 0.0, 1.0 / np.where(length2 > 0.0, length2, 1.0), 0.0)
    counts = np.bincount(found.cubic // cubic.shape[1], minlength=len(cubic))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return starts, ends[:, 0], np.column_stack([chord, inverse, found.bend])
