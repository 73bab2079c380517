"""Samples of arguments for flow routing."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.host.library import host_function


def ground(size: int) -> Float64Array:
    """Return heights (size, size) in m with hollows, equal heights and a negative zero."""
    random = np.random.default_rng(1)
    steps = random.normal(size=(2, size, size))
    height: Float64Array = np.round(np.cumsum(steps[0], 0) + np.cumsum(steps[1], 1), 1)
    height[size // 2, size // 2] = -0.0
    return height


def _flooded(size: int) -> tuple[Float64Array, Any]:
    height = ground(size)
    filled, parent = np.empty_like(height), np.empty(height.size, np.int64)
    host_function("fill_depressions")(height, 1e-5, filled, parent, np.empty(2 * height.size))
    return filled, parent


def _routed(size: int) -> tuple[Any, Any, Any]:
    filled, parent = _flooded(size)
    receiver, step = np.empty(filled.size, np.int64), np.empty(filled.size)
    host_function("steepest_descent")(filled, parent, receiver, step)
    return np.argsort(filled.ravel(), kind="stable"), receiver, step


def _fill_depressions(size: int) -> tuple[Any, ...]:
    cells = size * size
    return ground(size), 1e-5, np.empty((size, size)), np.empty(cells, np.int64), np.zeros(2 * cells)


def _steepest_descent(size: int) -> tuple[Any, ...]:
    return *_flooded(size), np.empty(size * size, np.int64), np.empty(size * size)


def _accumulate_flow(size: int) -> tuple[Any, ...]:
    return *_routed(size), np.empty(size * size), np.empty(size * size)


def _stream_orders(size: int) -> tuple[Any, ...]:
    arguments = _accumulate_flow(size)
    host_function("accumulate_flow")(*arguments)
    order, receiver, _, area, _ = arguments
    return order, receiver, area, 20.0, np.empty(size * size, np.int64), np.zeros(size * size, np.int64)


def _sinuosities(size: int) -> tuple[Any, ...]:
    _, receiver, step = _routed(size)
    starts = np.arange(0, size * size, 7)
    return starts, receiver, step, size, 10.0, np.zeros(starts.size)


SAMPLES: Final[dict[str, Callable[[int], tuple[Any, ...]]]] = {
    "fill_depressions": _fill_depressions,
    "steepest_descent": _steepest_descent,
    "accumulate_flow": _accumulate_flow,
    "stream_orders": _stream_orders,
    "sinuosities": _sinuosities,
}
"""Functions of fresh arguments by the side of a raster; scratch comes last."""
