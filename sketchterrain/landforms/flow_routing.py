"""Flow routing on measured heights: depressions, receivers, drainage areas, stream order, channels.

Priority flood after Barnes, Lehman & Mulla, "Priority-flood: an optimal depression-filling and
watershed-labeling algorithm for digital elevation models" (2014), with a small gradient across fills;
steepest descent (D8) after O'Callaghan & Mark (1984). It measures given heights, whatever made them.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array

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
    filled, parent = _priority_flood(height, GRADIENT * cell)
    receiver, step = _steepest_descent(filled, parent)
    flat = filled.ravel()
    order = np.argsort(flat, kind="stable")
    area, length = _accumulate(order, receiver, step)
    return FlowNetwork((rows, columns), flat, receiver, step, order, area, length)


@njit(cache=True)
def _priority_flood(height, gradient):  # type: ignore[no-untyped-def]
    """Return heights without depressions, and from which cell the flood reached each one."""
    rows, columns = height.shape
    filled = height.copy()
    reached = np.zeros((rows, columns), np.bool_)
    parent = np.full(rows * columns, -1, np.int64)
    heap = [(height[0, 0], 0)]
    reached[0, 0] = True
    for i, j in np.ndindex(rows, columns):
        if (i == 0 or j == 0 or i == rows - 1 or j == columns - 1) and not reached[i, j]:
            heapq.heappush(heap, (height[i, j], i * columns + j))
            reached[i, j] = True
    while len(heap) > 0:
        level, cell = heapq.heappop(heap)
        i, j = cell // columns, cell % columns
        for p in range(max(i - 1, 0), min(i + 2, rows)):
            for q in range(max(j - 1, 0), min(j + 2, columns)):
                if reached[p, q]:
                    continue
                reached[p, q] = True
                parent[p * columns + q] = cell
                filled[p, q] = max(height[p, q], level + gradient)
                heapq.heappush(heap, (filled[p, q], p * columns + q))
    return filled, parent


@njit(cache=True)
def _steepest_descent(filled, parent):  # type: ignore[no-untyped-def]
    """Return receivers and the way to them (cells); where nothing is lower, back along the flood."""
    rows, columns = filled.shape
    receiver = np.full(rows * columns, -1, np.int64)
    step = np.zeros(rows * columns)
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            cell = i * columns + j
            steepest = 0.0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    if a == 0 and b == 0:
                        continue
                    way = math.sqrt(a * a + b * b)
                    slope = (filled[i, j] - filled[i + a, j + b]) / way
                    if slope > steepest:
                        steepest = slope
                        receiver[cell] = cell + a * columns + b
                        step[cell] = way
            if receiver[cell] < 0:
                receiver[cell] = parent[cell]
                step[cell] = math.hypot(parent[cell] // columns - i, parent[cell] % columns - j)
    return receiver, step


@njit(cache=True)
def _accumulate(order, receiver, step):  # type: ignore[no-untyped-def]
    area = np.ones(order.size)
    length = np.zeros(order.size)
    for k in range(order.size - 1, -1, -1):
        cell = order[k]
        to = receiver[cell]
        if to >= 0:
            area[to] += area[cell]
            length[to] = max(length[to], length[cell] + step[cell])
    return area, length


def stream_orders(flow: FlowNetwork, least_area: float) -> Int64Array:
    """Return Strahler's stream order of each cell that drains at least so many cells, 0 elsewhere."""
    return np.asarray(_stream_orders(flow.order, flow.receiver, flow.area, float(least_area)))


@njit(cache=True)
def _stream_orders(order, receiver, area, least_area):  # type: ignore[no-untyped-def]
    stream = np.zeros(order.size, np.int64)
    tributaries = np.zeros(order.size, np.int64)  # of the highest order so far
    for k in range(order.size - 1, -1, -1):
        cell = order[k]
        if area[cell] < least_area:
            continue
        if stream[cell] == 0:
            stream[cell] = 1
        elif tributaries[cell] >= 2:
            stream[cell] += 1
        to = receiver[cell]
        if to < 0:
            continue
        if stream[cell] > stream[to]:
            stream[to], tributaries[to] = stream[cell], 1
        elif stream[cell] == stream[to]:
            tributaries[to] += 1
    return stream


def sinuosities(flow: FlowNetwork, least_area: float, reach: float, *, every: int = 7) -> Float64Array:
    """Return the way along the flow over the straight distance, from each n-th cell of channels on.

    Reaches that leave the window within ``reach`` cells are left out.
    """
    columns = flow.shape[1]
    starts = flow.channels(least_area)
    starts = starts[starts % every == 0]
    return np.asarray(_sinuosities(starts, flow.receiver, flow.step, columns, reach))


@njit(cache=True)
def _sinuosities(starts, receiver, step, columns, reach):  # type: ignore[no-untyped-def]
    found = np.empty(starts.size)
    count = 0
    for start in starts:
        cell, way = start, 0.0
        while receiver[cell] >= 0 and way < reach:
            way += step[cell]
            cell = receiver[cell]
        straight = math.hypot(cell // columns - start // columns, cell % columns - start % columns)
        if way >= reach and straight > 1.0:
            found[count] = way / straight
            count += 1
    return found[:count]


def rise_share(flow: FlowNetwork, height: Float64Array, least_area: float) -> float:
    """Return how much heights (cells,) rise along channels, over all that they rise and descend."""
    channel = flow.channels(least_area)
    drop = height[channel] - height[flow.receiver[channel]]
    return float(-drop[drop < 0.0].sum() / max(np.abs(drop).sum(), 1e-9))


def closed_hollows(flow: FlowNetwork, height: Float64Array, least_depth: float) -> BoolArray:
    """Return which cells lie more than a depth (m) below the level at which their water spills."""
    return np.asarray(flow.filled - height > least_depth)
