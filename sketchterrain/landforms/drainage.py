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
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array
from sketchterrain.landforms import drainage_levels, drainage_rounds


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
    least = drainage_levels.ramps(source.base, source.repose, source.domain, cell * 2.0**source.level)
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
    names = "uplift", "repose", "rain", "base", "domain", "course"
    fields = drainage_levels.coarsened(*(getattr(source, name) for name in names), start, (rows, columns))
    origin, level = (first_row, first_column), source.level + 1
    return DrainageInput(**dict(zip(names, fields, strict=True)), origin=origin, level=level)


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


class LevelSolver:
    """The state of one level between rounds, on rasters with a margin of one node outside of the domain."""

    def __init__(
        self,
        source: DrainageInput,
        cell: float,
        coarser: DrainageInput | None = None,
        drained: Drained | None = None,
        onto: Float64Array | None = None,
    ) -> None:
        self._shape = rows, columns = source.base.shape
        self._width = rows + 2, columns + 2
        size = (rows + 2) * (columns + 2)
        self._spacing = cell * 2.0**source.level
        self._kind = np.zeros(size, np.int8)
        self._forced = np.full(size, -1, np.int32)
        self._uplift, self._repose, self._rain = np.zeros(size), np.zeros(size), np.zeros(size)
        self._state = drainage_rounds.new_state(size)
        self._height, self._area, self._receiver = self._state[:3]
        if drained is None or coarser is None:
            start, start_origin = np.empty((0, 0)), (0, 0)
        else:
            start, start_origin = drained.height, coarser.origin
        drainage_levels.pack(
            (source.uplift, source.repose, source.rain, source.base),
            (source.domain, source.course, source.origin, source.level),
            (start, start_origin, self._spacing, np.empty((0, 0)) if onto is None else onto),
            (self._uplift, self._repose, self._rain, self._height),
            (self._kind, self._forced),
        )
        self._topology = self._kind, self._forced
        least = np.full(self._shape, -np.inf) if source.least is None else source.least
        least = np.pad(least, 1, constant_values=-np.inf)
        strata = np.pad(np.zeros(self._shape) if source.strata is None else source.strata, 1)
        self._fields = self._uplift, self._repose, self._rain, least.ravel(), strata.ravel()
        self._ground: Float64Array | None = None
        if source.ground is not None:
            self._ground = np.pad(np.where(source.domain, source.ground, 0.0), 1).ravel()
        self._geometry = self._shape[1] + 2, self._spacing, 1.0 / (cell * cell)
        self._count = 0

    def run(self, rounds: int) -> None:
        """Route and integrate some times."""
        drainage_rounds.run(self._topology, self._fields, self._state, self._geometry, rounds)

    def route(self) -> None:
        """Find receivers and drainage areas."""
        if self._ground is not None:
            self._height += self._ground
        self._count = drainage_rounds.route(self._topology, self._fields, self._state, self._geometry)
        if self._ground is not None:
            self._height -= self._ground
            self._state[-1][:] = self._height

    def follow(self, receiver: Int32Array) -> None:
        """Take receivers as they are, instead of finding them."""
        row, column = np.divmod(receiver, self._shape[1])
        packed = np.where(receiver >= 0, (row + 1) * self._width[1] + column + 1, -1)
        self._receiver.reshape(self._width)[1:-1, 1:-1] = packed
        self._count = drainage_rounds.accumulate(self._topology, self._fields, self._state)

    def integrate(self) -> None:
        """Build heights on the present network, none much above a neighbour."""
        drainage_rounds.integrate(self._topology, self._fields, self._state, self._geometry, self._count)
        drainage_rounds.limit_slopes(self._topology, self._fields, self._state, self._geometry)

    def settle(self) -> None:
        """Build the heights that belong to the receivers as they are after the last round."""
        drainage_rounds.settle(self._topology, self._fields, self._state, self._geometry)

    def carve(self) -> None:
        """Cut through what stands above the nodes that drain to it, down to the ground if there is one."""
        drainage_rounds.sink_courses(self._topology, self._height, self._geometry[0])
        floor = np.full(self._height.size, -np.inf)
        if self._ground is not None:
            floor = self._ground
            self._height += self._ground
        drainage_rounds.carve(self._kind, floor, self._state, self._geometry, self._count)
        if self._ground is not None:
            self._height -= self._ground
        drainage_rounds.limit_slopes(self._topology, self._fields, self._state, self._geometry)
        self._count = drainage_rounds.accumulate(self._topology, self._fields, self._state)

    def heights(self, uplift: Float64Array) -> Float64Array:
        """Return the heights (m) of nodes on the present network with an uplift."""
        self.set_uplift(uplift)
        drainage_rounds.integrate(self._topology, self._fields, self._state, self._geometry, self._count)
        height = self._height.reshape(self._width)[1:-1, 1:-1]
        return np.where(np.isinf(height), np.nan, height)

    def shares_from(self, inside: Float64Array) -> Float64Array:
        """Return the share of each node's drainage area that lies inside a region, (rows, columns)."""
        weight = np.zeros(self._width)
        weight[1:-1, 1:-1] = inside
        drainage_rounds.accumulate_inside(weight.ravel(), self._rain, self._area, self._state, self._count)
        return weight[1:-1, 1:-1]

    def relax(self) -> None:
        """Move heights back towards those before the last routing."""
        drainage_rounds.relax(self._kind, self._height, self._state[-1])

    def set_uplift(self, uplift: Float64Array) -> None:
        """Take another uplift."""
        self._uplift.reshape(self._width)[1:-1, 1:-1] = uplift

    def result(self) -> Drained:
        """Return the level as it is."""
        kind, height, area, receiver = (
            each.reshape(self._width)[1:-1, 1:-1]
            for each in (self._kind, self._height, self._area, self._receiver)
        )
        inside = kind != drainage_rounds.OUTSIDE
        row, column = np.divmod(receiver, self._width[1])
        to = np.where(inside & (receiver >= 0), (row - 1) * self._shape[1] + column - 1, -1)
        return Drained(np.where(inside, height, np.nan), np.where(inside, area, 0.0), to.astype(np.int32))
