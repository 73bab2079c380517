"""Rows of a grid quantized on the device, as raster files store them: a third of the bytes to download."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import DeviceError
from sketchterrain.terrain.finite import non_finite
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.raster_windows import strips, window_axes

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator
    from sketchterrain.terrain.raster_windows import Strip
    from sketchterrain.terrain.surfaces import SurfaceStore

_FILE = "ground_bytes.cl"


@dataclass(frozen=True, eq=False)
class QuantizedBand:
    """Some rows of a grid of vertices; row 0 is its north edge."""

    top: int  # the first row's index in the whole grid
    height: npt.NDArray[np.float32]  # (rows, columns), m
    normal: npt.NDArray[np.uint8]  # (3, rows, columns) east, north, up; 0 is −1, 255 is 1
    materials: npt.NDArray[np.uint8]  # (materials, rows, columns); weights sum to 255 at each vertex


def quantized_bands(
    evaluator: Evaluator,
    corner: tuple[float, float],
    cell: float,
    left: int,
    top: int,
    columns: int,
    rows: int,
) -> Iterator[QuantizedBand]:
    """Evaluate a window of an unbounded grid as :func:`~raster_windows.window_bands` does, and quantize it.

    Bytes equal the host's rounding of `window_bands`. While a band is consumed, the device computes the next
    one. DeviceError is raised without 64-bit floats, DeviceFailedError for non-finite values.
    """
    if not evaluator.context.device.has_double:
        raise DeviceError(f"{evaluator.context.device.name} has no 64-bit floats, needed to round weights")
    axes = window_axes(evaluator.recipe.extent, corner, cell, left, top, columns, rows)
    return _bands(evaluator, axes, cell, columns)


def _bands(
    evaluator: Evaluator, axes: tuple[npt.NDArray[np.int64], ...], cell: float, columns: int
) -> Iterator[QuantizedBand]:
    packer, pending = _Packer(evaluator, cell, columns), None
    for strip in strips(*axes):
        following = packer.enqueue(strip)
        if pending is not None:
            yield packer.finish(pending)
        pending = following
    if pending is not None:
        yield packer.finish(pending)


@dataclass(frozen=True, eq=False)
class _PendingBand:
    """A band being computed: its arrays, the count of non-finite values, and the events to wait for."""

    band: QuantizedBand
    nonfinite: npt.NDArray[np.int32]
    events: list[Any]


class _Packer:
    """Quantizes bands of one window; the queue is in order, so all of them share the same buffers."""

    def __init__(self, evaluator: Evaluator, cell: float, columns: int) -> None:
        self._evaluator, self._context = evaluator, evaluator.context
        self._cell, self._columns = cell, columns
        self._rows = 0
        self._planes: list[Any] = []

    def enqueue(self, strip: Strip) -> _PendingBand:
        """Enqueue a band and its download."""
        context, shape = self._context, (strip.rows, self._columns)
        band = QuantizedBand(
            strip.top,
            np.empty(shape, context.real_dtype),
            np.empty((3, *shape), np.uint8),
            np.empty((len(MATERIALS), *shape), np.uint8),
        )
        arrays: tuple[npt.NDArray[Any], ...] = (band.height, band.normal, band.materials)
        if strip.rows > self._rows:
            self._planes = [context.empty(array.size, array.dtype) for array in arrays]
            self._rows = strip.rows
        nonfinite = np.zeros(1, np.int32)
        counter = context.upload(nonfinite, writable=True)
        self._evaluator.enqueue_surfaces(
            strip.axis_x,
            strip.axis_y,
            cell_size=self._cell,
            consume=partial(self._pack, strip=strip, counter=counter),
        )
        events = [context.read(*pair) for pair in zip(self._planes, arrays, strict=True)]
        events.append(context.read(counter, nonfinite))
        return _PendingBand(band, nonfinite, events)

    def finish(self, pending: _PendingBand) -> QuantizedBand:
        """Wait for a band."""
        for event in pending.events:
            self._context.wait(event, action="downloading")
        if pending.nonfinite[0]:
            raise non_finite("values", self._context.device, str(pending.nonfinite[0]))
        return pending.band

    def _pack(self, store: SurfaceStore, part: slice, *, strip: Strip, counter: Any) -> None:
        self._context.launch(
            _FILE,
            "ground_bytes",
            (store.inner, store.inner, part.stop - part.start),
            np.int32(part.start),
            np.int32(strip.shape[1]),
            np.int32(strip.rows),
            np.int32(self._columns),
            store.ground,
            store.materials,
            *self._planes,
            counter,
        )
