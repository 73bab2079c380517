"""Rasters: rectangles and windows evaluated as adjacent patches, in bands of rows, also quantized."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, FloatArray, LatticeArray, UInt8Array
from sketchterrain.errors import DeviceError, InputError
from sketchterrain.geometry.lattice import QUADS, to_lattice
from sketchterrain.terrain.materials import material_defines
from sketchterrain.terrain.surfaces import Band, SurfaceStore, non_finite

if TYPE_CHECKING:
    from sketchterrain.terrain.evaluator import Evaluator

# The patches of one launch: fewer would leave a device idle, more would only need memory.
_PATCHES_PER_BAND = 256

_FILE = "ground_bytes.cl"


def bands(
    evaluator: Evaluator,
    area: tuple[float, float, float, float],
    columns: int,
    rows: int,
    *,
    cell_size: float,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Band]:
    """Evaluate a grid over a rectangle (west, south, east, north, m) in bands of rows from the north.

    The outermost vertices are on the rectangle's border; ``columns``, ``rows`` ≥ 2. Positions depend only on
    the index in the whole grid, so no bit depends on the bands.
    """
    west, south, east, north = area
    if columns < 2 or rows < 2:
        raise InputError(f"expected at least 2 × 2 vertices, got {columns} × {rows}")
    if not (np.isfinite(area).all() and west < east and south < north):
        raise InputError(f"expected a rectangle west < east, south < north, got {area}")
    extent = evaluator.recipe.extent
    axis_x, axis_y = _axis_of(west, east, columns, extent), _axis_of(south, north, rows, extent)[::-1]
    return _bands(evaluator, axis_x, axis_y, cell_size, progress)


class GridWindow(NamedTuple):
    """A window of an unbounded grid, from column `left` and row `top`.

    Vertex (row j, column i) is at (west + i·cell, north − j·cell), m: positions depend on j and i alone, so a
    vertex has the same bits in every window.
    """

    west: float  # of the grid's vertex (0, 0), m
    north: float
    cell: float
    left: int
    top: int
    columns: int
    rows: int

    def axes(self, extent: float) -> tuple[LatticeArray, LatticeArray]:
        """Return lattice coordinates of the columns and rows, with one more beyond each end."""
        if self.columns < 1 or self.rows < 1:
            raise InputError(f"expected at least 1 × 1 vertices, got {self.columns} × {self.rows}")
        axis_x = to_lattice(
            self.west + np.arange(self.left - 1, self.left + self.columns + 1) * self.cell, extent
        )
        axis_y = to_lattice(
            self.north - np.arange(self.top - 1, self.top + self.rows + 1) * self.cell, extent
        )
        return axis_x, axis_y


def window_bands(evaluator: Evaluator, window: GridWindow) -> Iterator[Band]:
    """Evaluate a window of an unbounded grid in bands of rows from the north."""
    return _bands(evaluator, *window.axes(evaluator.recipe.extent), window.cell, None)


class Strip(NamedTuple):
    """Some rows of a grid as adjacent patches, row by row."""

    top: int  # its first row in the grid
    rows: int
    shape: tuple[int, int]  # rows and columns of patches
    axis_x: LatticeArray  # (patches, QUADS + 3)
    axis_y: LatticeArray
    share: tuple[float, float]  # its part of the grid's patches, 0 … 1


def strips(axis_x: LatticeArray, axis_y: LatticeArray) -> Iterator[Strip]:
    """Cut the vertices of two axes, each with one more beyond its ends; y runs from north to south."""
    across, down = _windows_of(axis_x), _windows_of(axis_y)
    at_once = max(_PATCHES_PER_BAND // len(across), 1)
    for first in range(0, len(down), at_once):
        part = down[first : first + at_once]
        shape = (len(part), len(across))
        top = QUADS * first
        # A strip's last row is the next one's first, except in the last strip.
        rows = len(axis_y) - 2 - top if first + len(part) == len(down) else QUADS * len(part)
        yield Strip(
            top,
            rows,
            shape,
            np.broadcast_to(across[None], (*shape, QUADS + 3)).reshape(-1, QUADS + 3),
            np.broadcast_to(part[:, None], (*shape, QUADS + 3)).reshape(-1, QUADS + 3),
            (first / len(down), (first + len(part)) / len(down)),
        )


def _bands(
    evaluator: Evaluator,
    axis_x: LatticeArray,
    axis_y: LatticeArray,
    cell_size: float,
    progress: Callable[[float], None] | None,
) -> Iterator[Band]:
    """Evaluate the vertices of two axes, each with one more beyond its ends; y runs from north to south."""
    columns = len(axis_x) - 2
    for strip in strips(axis_x, axis_y):
        surface = evaluator.surface(
            strip.axis_x,
            strip.axis_y,
            cell_size=cell_size,
            progress=_partial_progress(progress, *strip.share),
        )
        parts = (surface.height, surface.normal, surface.materials)
        yield Band(strip.top, *(_join(each, strip.shape, strip.rows, columns) for each in parts))


def _axis_of(first: float, last: float, count: int, extent: float) -> LatticeArray:
    """Return lattice coordinates of ``count`` vertices from first to last (m), plus one beyond each end."""
    return to_lattice(first + np.arange(-1, count + 1) * ((last - first) / (count - 1)), extent)


def _windows_of(axis: LatticeArray) -> LatticeArray:
    """Cut an axis into overlapping windows of QUADS + 3; the last is padded with its last vertex."""
    inner = len(axis) - 2
    starts = range(0, max(inner - 1, 1), QUADS)
    index = np.minimum(np.array(starts)[:, None] + np.arange(QUADS + 3), len(axis) - 1)
    return axis[index]


def _join(patches: FloatArray, shape: tuple[int, int], rows: int, columns: int) -> Float32Array:
    """Join adjacent patches, which share rows and columns of vertices."""
    result = np.empty((rows, columns, *patches.shape[3:]), np.float32)
    for number, patch in enumerate(patches):
        top, left = (QUADS * place for place in divmod(number, shape[1]))
        part = result[top : top + QUADS + 1, left : left + QUADS + 1]
        part[...] = patch[: part.shape[0], : part.shape[1]]
    return result


def _partial_progress(
    progress: Callable[[float], None] | None, first: float, last: float
) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress(first + share * (last - first))


@dataclass(frozen=True, eq=False)
class QuantizedBand:
    """Some rows of a grid of vertices; row 0 is its north edge."""

    top: int  # the first row's index in the whole grid
    height: Float32Array  # (rows, columns), m
    normal: UInt8Array  # (3, rows, columns) east, north, up; 0 is −1, 255 is 1
    materials: UInt8Array  # (materials, rows, columns); weights sum to 255 at each vertex


def quantized_bands(evaluator: Evaluator, window: GridWindow) -> Iterator[QuantizedBand]:
    """Evaluate a window of an unbounded grid as `window_bands` does, and quantize it on the device.

    Bytes equal the host's rounding of `window_bands`. While a band is consumed, the device computes the next
    one. DeviceError is raised without 64-bit floats, DeviceFailedError for non-finite values.
    """
    if not evaluator.context.device.has_double:
        raise DeviceError(f"{evaluator.context.device.name} has no 64-bit floats, needed to round weights")
    return _quantized_strips(evaluator, strips(*window.axes(evaluator.recipe.extent)), window)


def _quantized_strips(
    evaluator: Evaluator, grid: Iterator[Strip], window: GridWindow
) -> Iterator[QuantizedBand]:
    packer, pending = _Packer(evaluator, window.cell, window.columns), None
    for strip in chain(grid, [None]):
        following = None if strip is None else packer.enqueue(strip)
        if pending is not None:
            yield packer.finish(pending)
        pending = following


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
            np.empty((len(self._evaluator.recipe.materials), *shape), np.uint8),
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
            defines=material_defines(self._evaluator.recipe.materials),
        )
