"""Flow routing on measured heights: depressions, receivers, drainage areas, stream order, channels.

Priority flood after Barnes, Lehman & Mulla, "Priority-flood: an optimal depression-filling and
watershed-labeling algorithm for digital elevation models" (2014), with a small gradient across fills;
steepest descent (D8) after O'Callaghan & Mark (1984). It measures given heights, whatever made them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.host.library import host_function

GRADIENT = 1e-6
"""Rise per cell (cells) that filled depressions get towards the place where they spill."""


@dataclass(frozen=True, eq=False)
class FlowNetwork:
    """Where the water of each cell of a window goes. Flat indices; border cells are outlets."""

    shape: tuple[int, int]
    filled: Float64Array  # (cells,) heights with depressions filled, m
    receiver: Int64Array  # (cells,) index of the cell that it drains to, -1 at outlets
    step: Float64Array  # (cells,) way to the receiver, cells
    order: Int64Array  # (cells,) receivers before their donors
    area: Float64Array  # (cells,) drainage area with the cell itself, cells
    length: Float64Array  # (cells,) longest way that water takes to here, cells

    def channels(self, least_area: float) -> Int64Array:
        """Return the cells, but outlets, that drain at least so many cells."""
        return np.flatnonzero((self.area >= least_area) & (self.receiver >= 0))

    def downstream(self, chosen: Int64Array, steps: int) -> tuple[Int64Array, BoolArray]:
        """Return the cells so many steps of flow farther, or the outlets before, and which are that far."""
        at, whole = chosen.copy(), np.ones(chosen.size, np.bool_)
        for _ in range(steps):
            whole &= self.receiver[at] >= 0
            at = np.where(self.receiver[at] >= 0, self.receiver[at], at)
        return at, whole

    def slope(self, height: Float64Array, chosen: Int64Array, cell: float, steps: int) -> Float64Array:
        """Return the mean descent (m/m) of ``height`` (cells,) along so many steps of flow from each cell."""
        at, way = chosen.copy(), np.zeros(chosen.size)
        for _ in range(steps):
            flows = self.receiver[at] >= 0
            way[flows] += self.step[at[flows]] * cell
            at[flows] = self.receiver[at[flows]]
        return np.where(way > 0.0, (height[chosen] - height[at]) / np.maximum(way, 1e-9), 0.0)


def route_flow(height: Float64Array, cell: float) -> FlowNetwork:
    """Fill the depressions of finite heights (m) of cells (m), and route their water to the border."""
    rows, columns = height.shape
    height = np.ascontiguousarray(height, np.float64)
    filled, parent = np.empty_like(height), np.empty(height.size, np.int64)
    host_function("fill_depressions")(height, GRADIENT * cell, filled, parent, np.empty(2 * height.size))
    receiver, step = np.empty(height.size, np.int64), np.empty(height.size)
    host_function("steepest_descent")(filled, parent, receiver, step)
    flat = filled.ravel()
    order = np.argsort(flat, kind="stable")
    area, length = np.empty(height.size), np.empty(height.size)
    host_function("accumulate_flow")(order, receiver, step, area, length)
    return FlowNetwork((rows, columns), flat, receiver, step, order, area, length)


def stream_orders(flow: FlowNetwork, least_area: float) -> Int64Array:
    """Return Strahler's stream order of each cell that drains at least so many cells, 0 elsewhere."""
    stream, tributaries = np.empty((2, flow.order.size), np.int64)
    host_function("stream_orders")(flow.order, flow.receiver, flow.area, least_area, stream, tributaries)
    return stream


def sinuosities(flow: FlowNetwork, least_area: float, reach: float, *, every: int = 7) -> Float64Array:
    """Return the way along the flow over the straight distance, from each n-th cell of channels on.

    Reaches that leave the window within ``reach`` cells are left out.
    """
    columns = flow.shape[1]
    starts = flow.channels(least_area)
    starts = starts[starts % every == 0]
    found = np.empty(starts.size)
    count = host_function("sinuosities")(starts, flow.receiver, flow.step, columns, reach, found)
    return found[:count]


def rise_share(flow: FlowNetwork, height: Float64Array, least_area: float) -> float:
    """Return how much heights (cells,) rise along channels, over all that they rise and descend."""
    channel = flow.channels(least_area)
    drop = height[channel] - height[flow.receiver[channel]]
    return float(-drop[drop < 0.0].sum() / max(np.abs(drop).sum(), 1e-9))


def closed_hollows(flow: FlowNetwork, height: Float64Array, least_depth: float) -> BoolArray:
    """Return which cells lie more than a depth (m) below the level at which their water spills."""
    return np.asarray(flow.filled - height > least_depth)
