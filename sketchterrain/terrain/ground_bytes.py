"""Ground as files hold it, packed on the device: a third of the bytes come back, a host rounds nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import DeviceError, DeviceFailedError
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
class GroundBytes:
    """Some rows of a grid of vertices; row 0 is its north edge.

    Attributes
    ----------
    top : int
        The first row's place in the whole grid.
    height : (rows, columns) float32
        m.
    normal : (3, rows, columns) uint8
        East, north, up; 0 is −1, 255 is 1.
    materials : (materials, rows, columns) uint8
        Weights in the order of ``MATERIALS``, that sum to 255 at each vertex.
    """

    top: int
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    materials: npt.NDArray[np.uint8]


def byte_bands(
    evaluator: Evaluator,
    corner: tuple[float, float],
    cell: float,
    left: int,
    top: int,
    columns: int,
    rows: int,
) -> Iterator[GroundBytes]:
    """Evaluate a window of a grid without ends as :func:`~raster_windows.window_bands` does, and pack it.

    A byte is the one that the values of `window_bands` are rounded to on a host. While a band is taken, the
    device is at work on the next one.

    Raises
    ------
    DeviceError
        If the device has no 64-bit floats.
    DeviceFailedError
        If it computed what is no number.
    InputError
        If there are no vertices, or positions are too far away.
    """
    if not evaluator.context.device.has_double:
        raise DeviceError(f"{evaluator.context.device.name} has no 64-bit floats to round weights in")
    axes = window_axes(evaluator.recipe.extent, corner, cell, left, top, columns, rows)
    return _bands(evaluator, axes, cell, columns)


def _bands(
    evaluator: Evaluator, axes: tuple[npt.NDArray[np.int64], ...], cell: float, columns: int
) -> Iterator[GroundBytes]:
    packer, before = _Packer(evaluator, cell, columns), None
    for strip in strips(*axes):
        coming = packer.begun(strip)
        if before is not None:
            yield packer.ended(before)
        before = coming
    if before is not None:
        yield packer.ended(before)


@dataclass(frozen=True, eq=False)
class _Coming:
    """A band on its way from the device: what it will be, how many odd values it has, what to wait for."""

    band: GroundBytes
    odd: npt.NDArray[np.int32]
    events: list[Any]


class _Packer:
    """Packs bands of one window; the queue is in order, so all of them go through the same buffers."""

    def __init__(self, evaluator: Evaluator, cell: float, columns: int) -> None:
        self._evaluator, self._context = evaluator, evaluator.context
        self._cell, self._columns = cell, columns
        self._rows = 0
        self._planes: list[Any] = []

    def begun(self, strip: Strip) -> _Coming:
        """Enqueue a band, and that it is read."""
        context, shape = self._context, (strip.rows, self._columns)
        band = GroundBytes(
            strip.top,
            np.empty(shape, context.real_dtype),
            np.empty((3, *shape), np.uint8),
            np.empty((len(MATERIALS), *shape), np.uint8),
        )
        arrays: tuple[npt.NDArray[Any], ...] = (band.height, band.normal, band.materials)
        if strip.rows > self._rows:
            self._planes = [context.empty(array.size, array.dtype) for array in arrays]
            self._rows = strip.rows
        odd = np.zeros(1, np.int32)
        counter = context.upload(odd, writable=True)
        self._evaluator.stored(
            strip.axis_x,
            strip.axis_y,
            cell_size=self._cell,
            take=partial(self._pack, strip=strip, counter=counter),
        )
        events = [context.read(*pair) for pair in zip(self._planes, arrays, strict=True)]
        events.append(context.read(counter, odd))
        return _Coming(band, odd, events)

    def ended(self, coming: _Coming) -> GroundBytes:
        """Wait for a band."""
        for event in coming.events:
            self._context.wait(event, action="downloading")
        if coming.odd[0]:
            device = self._context.device
            raise DeviceFailedError(
                f"{device.name} ({device.platform}) computed ground, {coming.odd[0]} values of it no numbers"
            )
        return coming.band

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
