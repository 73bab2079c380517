"""Drained relief on rasters: the steady state of stream power with slopes below repose.

Every node drains to one of its eight neighbours. Its height is ``z = z_receiver + S d`` with the slope
``S = (s⁻⁴ + repose⁻⁴)^(−1/4)``, ``s = u / (A / r0²)^(3/8)`` of the drainage area A at its middle, where u is
the uplift over the erodibility and r0 the spacing of level 0: straight hillslopes pass smoothly into
channels. Courses have the lesser of the two. Slopes of layered rock are steeper in hard layers than in soft
ones.
Routing and integrating alternate for a fixed number of rounds, coarse to fine, as in Tzathas et al. 2024,
"Physically-based analytical erosion for fast terrain generation".
Depressions are routed through their lowest pass, after Cordonnier et al. 2019, "A versatile, linear
complexity algorithm for flow routing in topographies with depressions".

Only + − × / and sqrt in float64 in a fixed order, and ties by position: the result depends on nothing but the
input, and not on the rectangle that a domain is cut out with.

Rasters are indexed (row, column), row 0 southernmost. Node (i, j) of level k stands at the global index
``origin + (i, j)`` of that level, which is node 2 (i, j) of level k − 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_constants

LEAST_SLOPE, LEAST_RISE = kernel_constants("host/drainage.h", "LEAST_SLOPE", "LEAST_RISE")
"""Least slope of a node to its receiver, where nothing is uplifted, and least rise of a course, m."""


@dataclass(frozen=True, eq=False)
class DrainageInput:
    """What one level of a raster is drained from; arrays of shape (rows, columns).

    Parameters
    ----------
    uplift : slope (m/m) at a drainage area of one node of level 0
    repose : greatest slope (m/m) at level 0; coarse levels take less, so that levels agree
    rain : drainage area (m²) that each node adds
    base : heights (m) of outlets, NaN at other nodes
    domain : nodes that are drained; the others are as if they did not exist
    course : int32, flat index of the neighbour that a node must drain to, −1 where it is free; a course that
        ends on land flows on as the land falls
    origin : global index (row, column) of the first node, at this level
    level : the spacing is r0 · 2^level
    least : heights (m) that nodes have at least
    strata : how far layers of rock stand out as cliffs and benches, 0 … 1; coarser levels have none
    ground : heights (m) that all others are counted from, while water flows over the sum of both
    """

    uplift: Float64Array
    repose: Float64Array
    rain: Float64Array
    base: Float64Array
    domain: BoolArray
    course: Int32Array
    origin: tuple[int, int] = (0, 0)
    level: int = 0
    least: Float64Array | None = None
    strata: Float64Array | None = None
    ground: Float64Array | None = None


@dataclass(frozen=True, eq=False)
class Drained:
    """A drained level: heights (m), drainage areas (m²), receivers; arrays of shape (rows, columns).

    Heights are NaN and areas 0 outside of the domain. A receiver is a flat index; outlets have −1.
    """

    height: Float64Array
    area: Float64Array
    receiver: Int32Array


ROUNDS = (8, 3, 3, 3)  # of levels 3 to 0, in zones around painted features
BARE_ROUNDS = (20, 10, 6, 5)  # of all ground without painted features
FIRST_ROUNDS = 16  # of the coarsest level before, under even uplift
FIRST_UPLIFT = 0.3

_INNER = np.s_[1:-1, 1:-1]  # of rasters with a margin

RaiseGround = Callable[[int, "LevelSolver"], Float64Array]


def drain(
    levels: Sequence[DrainageInput],
    cell: float,
    rounds: Sequence[int],
    *,
    onto: Sequence[Drained] = (),
    raise_ground: RaiseGround | None = None,
) -> list[Drained]:
    """Drain the levels of one raster, coarsest first; each starts from the one before.

    The coarsest level starts from a network of valleys under even uplift.

    Parameters
    ----------
    onto : the same levels drained before; each level starts from that, and from what the coarser one changed
    cell : spacing r0 of level 0 (m), whichever levels are given
    rounds : rounds of routing and integrating of each level
    raise_ground : called as ``raise_ground(index, solver)`` each time that a level has been routed; returns
        its uplift
    """
    results: list[Drained] = []
    for index, (source, count) in enumerate(zip(levels, rounds, strict=True)):
        before = results[-1] if index else None
        if before is not None and onto:
            before = replace(before, height=before.height - onto[index - 1].height)
        first = onto[index].height if onto else None
        solver = LevelSolver(source, cell, levels[index - 1] if index else None, before, first)
        if not index and not onto:
            solver.set_uplift(np.full(source.base.shape, FIRST_UPLIFT))
            solver.run(FIRST_ROUNDS)
            solver.set_uplift(source.uplift)
        if raise_ground is None:
            solver.run(count)
        else:
            for number in range(count):
                if number:
                    solver.relax()
                solver.route()
                solver.set_uplift(raise_ground(index, solver))
                solver.integrate()
            solver.settle()
        results.append(solver.result())
    return results


def confined(source: DrainageInput, drained: Drained, zone: BoolArray) -> DrainageInput:
    """Return a level where only a zone drains anew, to the heights around it and to lakes in it.

    Parameters
    ----------
    drained : the level before
    zone : (rows, columns)
    """
    fixed = source.domain & (~zone | (source.repose <= 0.0) | ~np.isnan(source.base))
    inside, to = (zone & ~fixed).ravel(), drained.receiver.ravel()
    enters = (to >= 0) & ~inside & inside[to]
    inflow = np.bincount(to[enters], drained.area.ravel()[enters], minlength=to.size)
    rain = source.rain + inflow.reshape(zone.shape)
    course = np.where(fixed, -1, source.course).astype(np.int32)
    return replace(source, base=np.where(fixed, drained.height, np.nan), rain=rain, course=course)


def ramped(source: DrainageInput, cell: float) -> DrainageInput:
    """Return a level whose ground falls from high outlets no steeper than repose, instead of as a wall."""
    least = np.empty(source.base.shape)
    given = _double(source.base), _double(source.repose), np.ascontiguousarray(source.domain)
    host_function("outlet_ramps")(*given, cell * 2.0**source.level, least)
    return replace(source, least=least)


def carved(source: DrainageInput, cell: float, height: Float64Array) -> Drained:
    """Return a level with heights (m) as they are, but for barriers, which are cut through."""
    solver = LevelSolver(source, cell, onto=height)
    solver.route()
    solver.carve()
    return solver.result()


def routed(source: DrainageInput, cell: float, height: Float64Array) -> Drained:
    """Return how water flows over heights (m) as they are, out of depressions through their lowest pass."""
    outlets = np.where(np.isnan(source.base), np.nan, height)
    solver = LevelSolver(replace(source, base=outlets), cell, onto=height)
    solver.route()
    return replace(solver.result(), height=height)


def on_network(source: DrainageInput, cell: float, network: Drained) -> LevelSolver:
    """Return a solver of a level on a network of flow that was found with other uplift."""
    solver = LevelSolver(source, cell)
    solver.follow(network.receiver)
    return solver


def coarsened(source: DrainageInput) -> DrainageInput:
    """Return the input of the next coarser level: every second node of the global raster.

    Uplift and repose are averages over 3 × 3 nodes of the domain, rain is four times the average. A node is
    an outlet if one of these nine is: at its own height, else at the lowest one.
    """
    rows, first_row = _halved(source.origin[0], source.base.shape[0])
    columns, first_column = _halved(source.origin[1], source.base.shape[1])
    start = (2 * first_row - source.origin[0], 2 * first_column - source.origin[1])
    fields = np.empty((4, rows, columns))
    domain, course = np.empty((rows, columns), np.bool_), np.empty(rows * columns, np.int32)
    scratch = np.empty((3, source.base.size), np.int32)
    if not host_function("coarsen_drainage")(*_packed(source), *start, fields, domain, course, scratch):
        raise ValueError("a course runs in a circle")
    origin = first_row, first_column
    uplift, repose, rain, base = fields
    course = course.reshape(domain.shape)
    return DrainageInput(uplift, repose, rain, base, domain, course, origin, source.level + 1)


def _double(values: npt.NDArray[Any]) -> Float64Array:
    return np.ascontiguousarray(values, np.float64)


def _packed(source: DrainageInput) -> tuple[npt.NDArray[Any], ...]:
    """Return uplift, repose, rain, base, domain and (flat) course as the host's loops take them."""
    fields = map(_double, (source.uplift, source.repose, source.rain, source.base))
    course = np.ascontiguousarray(source.course.ravel(), np.int32)
    return *fields, np.ascontiguousarray(source.domain), course


def at_level(values: npt.NDArray[Any], level: DrainageInput, finest: DrainageInput) -> npt.NDArray[Any]:
    """Return values at nodes of a level by those at nodes of the finest one."""
    step = 1 << (level.level - finest.level)
    south, west = (step * a - b for a, b in zip(level.origin, finest.origin, strict=True))
    rows, columns = level.base.shape
    return values[south::step, west::step][:rows, :columns]


def _halved(first: int, count: int) -> tuple[int, int]:
    """Return the number of even global indices from ``first`` on, and half of the first one."""
    half = -(-first // 2)
    return max((first + count - 1) // 2 - half + 1, 0), half


class DrainageRasters(NamedTuple):
    """A level with a margin of one node; ``kernels/host/drainage.h`` says what the planes hold."""

    spacing: float
    per_area: float
    reals: Float64Array
    integers: Int32Array
    bytes: npt.NDArray[np.int8]


class LevelSolver:
    """The state of one level between rounds."""

    def __init__(
        self,
        source: DrainageInput,
        cell: float,
        coarser: DrainageInput | None = None,
        drained: Drained | None = None,
        onto: Float64Array | None = None,
    ) -> None:
        shape = source.base.shape[0] + 2, source.base.shape[1] + 2
        planes = np.empty((11, *shape)), np.empty((6, *shape), np.int32), np.empty((2, *shape), np.int8)
        self._rasters = DrainageRasters(cell * 2.0**source.level, 1.0 / (cell * cell), *planes)
        reals, integers, bytes_ = planes
        self._uplift, self._height, self._area, self._previous = reals[0], *reals[5:8]
        self._receiver, self._kind = integers[1], bytes_[0]
        if drained is None or coarser is None:
            start, start_origin = np.full((1, 1), np.nan), (0, 0)
        else:
            start, start_origin = _double(drained.height), coarser.origin
        packed = _packed(source)
        place = *source.origin, source.level, *start_origin
        first = packed[3] if onto is None else _double(onto)
        if not host_function("pack_drainage")(self._rasters, *packed, first, start, *place):
            raise ValueError("a course must lead to one of a node's eight neighbours")
        if source.least is not None:
            reals[3][_INNER] = source.least
        if source.strata is not None:
            reals[4][_INNER] = source.strata
        self._ground: Float64Array | None = None
        if source.ground is not None:
            self._ground = np.pad(np.where(source.domain, source.ground, 0.0), 1)
        self._count = 0

    def run(self, rounds: int) -> None:
        """Route and integrate some times."""
        host_function("run_drainage")(self._rasters, rounds)

    def route(self) -> None:
        """Find receivers and drainage areas."""
        if self._ground is not None:
            self._height += self._ground
        self._count = host_function("route_drainage")(self._rasters)
        if self._ground is not None:
            self._height -= self._ground
            self._previous[:] = self._height

    def follow(self, receiver: Int32Array) -> None:
        """Take receivers as they are, instead of finding them."""
        row, column = np.divmod(receiver, receiver.shape[1])
        packed = np.where(receiver >= 0, (row + 1) * self._height.shape[1] + column + 1, -1)
        self._receiver[_INNER] = packed
        self._count = host_function("accumulate_drainage")(self._rasters)

    def integrate(self) -> None:
        """Build heights on the present network, none much above a neighbour."""
        self._build()
        host_function("limit_slopes")(self._rasters)

    def _build(self) -> None:
        host_function("integrate_drainage")(self._rasters, self._count)

    def settle(self) -> None:
        """Build the heights that belong to the receivers as they are after the last round."""
        self._count = host_function("accumulate_drainage")(self._rasters)
        self._build()

    def carve(self) -> None:
        """Cut through what stands above the nodes that drain to it, down to the ground if there is one."""
        host_function("sink_courses")(self._rasters)
        floor = np.full(self._height.shape, -np.inf)
        if self._ground is not None:
            floor = self._ground
            self._height += self._ground
        host_function("carve_barriers")(self._rasters, self._count, floor)
        if self._ground is not None:
            self._height -= self._ground
        host_function("limit_slopes")(self._rasters)
        self._count = host_function("accumulate_drainage")(self._rasters)

    def heights(self, uplift: Float64Array) -> Float64Array:
        """Return the heights (m) of nodes on the present network with an uplift."""
        self.set_uplift(uplift)
        self._build()
        height: Float64Array = self._height[_INNER].copy()
        height[np.isinf(height)] = np.nan
        return height

    def shares_from(self, inside: Float64Array) -> Float64Array:
        """Return the share of each node's drainage area that lies inside a region, (rows, columns)."""
        weight = np.pad(_double(inside), 1)
        host_function("drainage_shares")(self._rasters, self._count, weight)
        return weight[_INNER]

    def relax(self) -> None:
        """Move heights back towards those before the last routing."""
        host_function("relax_heights")(self._rasters)

    def set_uplift(self, uplift: Float64Array) -> None:
        """Take another uplift."""
        self._uplift[_INNER] = uplift

    def result(self) -> Drained:
        """Return the level as it is."""
        arrays = self._kind, self._height, self._area, self._receiver
        kind, height, area, receiver = (each[_INNER] for each in arrays)
        inside = kind != 0
        row, column = np.divmod(receiver, self._height.shape[1])
        to = np.where(inside & (receiver >= 0), (row - 1) * kind.shape[1] + column - 1, -1)
        return Drained(np.where(inside, height, np.nan), np.where(inside, area, 0.0), to.astype(np.int32))
