"""Painted rivers, lakes and the sea as constraints on drainage: receivers, outlets, greatest slopes."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.geometry.hashing import value_noise
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.hydrology.courses import RiverCourse, smoothed
from sketchterrain.landforms.hydrology.lakes import runs_inside
from sketchterrain.landforms.hydrology.layout import heights_at
from sketchterrain.landforms.hydrology.river_shape import gradient_limit
from sketchterrain.landforms.placement.covers import shore_positions
from sketchterrain.landforms.placement.feature_types import GroundHeight, Lake, ShapeField, is_inside

Path = list[int]
"""Flat indices of nodes, upstream first; each is an 8-neighbour of the one before."""

_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
_SAMPLES = 8  # of a course, in the spacing of nodes
_PROFILE_POINTS, _PROFILE_BLUR = 65, 3.0  # of the ground along a course
_LEAST_SLOPE, _STEEPER = 0.001, 1.1  # slope that any river may have, and over that of the ground
_FLOOR, _FLOOR_WAVE = 4.0, 14.0  # of valleys: half its width, and distance over which it varies, river widths
_NARROWEST_FLOOR, _WIDEST_FLOOR = 0.3, 2.0  # of that
_FLOOR_SLOPE, _FLOOR_EDGE = 0.02, 0.5  # across, and how much steeper at twice its half width
_NO_FLOOR = 0.06  # slope of a river from which on its valley is a V


@dataclass(frozen=True)
class NodeRaster:
    """Nodes: (row, column) stands at `west` + column · `spacing`, `south` + row · `spacing`."""

    west: float
    south: float
    spacing: float
    shape: tuple[int, int]

    def positions(self) -> Float64Array:
        """Return the nodes' positions (m), (rows · columns, 2)."""
        rows, columns = np.indices(self.shape).reshape(2, -1)
        return np.stack([self.west + self.spacing * columns, self.south + self.spacing * rows], axis=-1)

    def nearest(self, at: Float64Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], BoolArray]:
        """Return rows and columns of the nodes nearest to positions (n, 2), m, and which exist."""
        row = np.floor((at[:, 1] - self.south) / self.spacing + 0.5).astype(np.int64)
        column = np.floor((at[:, 0] - self.west) / self.spacing + 0.5).astype(np.int64)
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return row, column, inside


@dataclass(frozen=True, eq=False)
class DrainageConstraints:
    """What water demands of drained ground; arrays of shape (rows, columns).

    Parameters
    ----------
    course : int32, flat index of the neighbour that a node must drain to, −1 where it is free
    base : heights (m) of outlets, NaN at other nodes
    slope : greatest slope (m/m): 0 in lakes, infinite away from water
    floor : the same on valley floors beside rivers, where nothing is painted
    point : number of the nearest of the points of all courses on nodes of their paths, −1 elsewhere
    """

    course: npt.NDArray[np.int32]
    base: Float64Array
    slope: Float64Array
    floor: Float64Array
    point: npt.NDArray[np.int32]

    def limited(self, slopes: Sequence[Float64Array]) -> DrainageConstraints:
        """Return them with the greatest slope at each point of each course: see `course_slopes`."""
        if not slopes:
            return self
        limit = np.concatenate(slopes)[self.point]
        return replace(self, slope=np.where(self.point >= 0, limit, self.slope))


def lake_outlets(lakes: Sequence[Lake], courses: Sequence[RiverCourse], ground: GroundHeight) -> Float64Array:
    """Return where (m) each lake overflows, (n, 2).

    It is where a river last leaves it, stems first, else the lowest point of its shore.
    """
    outlets = np.full((len(lakes), 2), np.nan)
    for course in courses:
        for _, last, number in runs_inside(lakes, course.line)[::-1]:
            if np.isnan(outlets[number, 0]) and last < len(course.line) - 1:
                outlets[number] = course.line[last]
    for number, lake in enumerate(lakes):
        if np.isnan(outlets[number, 0]):
            shore = shore_positions(lake.shape)
            outlets[number] = shore[np.argmin(ground(shore[:, 0].copy(), shore[:, 1].copy()))]
    return outlets


def course_slopes(
    courses: Sequence[RiverCourse], ground: GroundHeight, raised: Callable[[Float64Array], BoolArray]
) -> tuple[tuple[Float64Array, ...], tuple[Float64Array, ...]]:
    """Return the greatest slope of the ground along each course, at its points: without features, and with.

    It is nowhere steeper than water may be, and little steeper than the `ground` without features falls along
    the course: a river must not lie above the land beside it, and it was there before the features that it
    crosses. Only where its source stands on features may it be as steep as water.

    Parameters
    ----------
    raised : whether positions (n, 2), m, are on features
    """
    if not courses:
        return (), ()
    bare, found = [], []
    for course, own in zip(courses, heights_at(ground, [each.line for each in courses]), strict=True):
        arc = arc_length(course.line)
        falling = np.minimum.accumulate(own)
        even = np.linspace(0.0, arc[-1], _PROFILE_POINTS)
        fall = -np.diff(smoothed(np.interp(even, arc, falling)[:, None], _PROFILE_BLUR)[:, 0])
        slope = np.interp(arc, 0.5 * (even[1:] + even[:-1]), fall / np.diff(even))
        limit = gradient_limit(course.width, course.depth)
        bare.append(np.minimum(limit, _LEAST_SLOPE + _STEEPER * np.maximum(slope, 0.0)))
        is_source = np.minimum.accumulate(raised(course.line))
        found.append(np.where(is_source, limit, bare[-1]))
    return tuple(bare), tuple(found)


def drainage_constraints(
    raster: NodeRaster,
    base: Float64Array,
    domain: BoolArray,
    courses: Sequence[RiverCourse],
    *,
    floors: Sequence[Float64Array] = (),
    lakes: Sequence[Lake] = (),
    outlets: Float64Array | None = None,
    coast: ShapeField | None = None,
    sea_level: float = 0.0,
) -> DrainageConstraints:
    """Return what rivers, lakes and the sea demand of the nodes of a raster.

    A course drains node by node to its parent's path, a lake, the sea or an outlet of `base`; where it ends
    on land it is free to flow on. Its nodes beyond the raster's `domain` are left out. A lake is level and
    overflows at one node. No node drains to itself.

    Parameters
    ----------
    base : heights (m) of outlets, NaN at other nodes
    courses : parents first
    floors : at each point of each course: see `valley_floors`
    lakes, outlets : lakes, and where they overflow: see `lake_outlets`
    coast : distance inside the painted sea, whose nodes are outlets at `sea_level` (m)
    """
    base = base.copy()
    if coast is not None:
        base[_inside(raster, coast) & domain] = sea_level
    closed = (~domain | ~np.isnan(base)).ravel()
    rows = _Receivers(raster.shape, closed)
    slope = np.full(raster.shape, np.inf)
    water = [np.flatnonzero(_inside(raster, lake.shape).ravel() & ~closed) for lake in lakes]
    for number, nodes in enumerate(water):
        rows.lake[nodes] = number
        slope.flat[nodes] = 0.0
    point = np.full(raster.shape, -1, np.int32)
    first = np.cumsum([0, *(len(course.line) for course in courses)])
    paths: list[Path] = []
    number_of = {course.id: number for number, course in enumerate(courses)}
    for number, course in enumerate(courses):
        path, at = course_path(raster, course.line)
        if course.parent is not None and path:
            stem = paths[number_of[course.parent.id]]
            path = _joined(raster, path, stem, course.parent.line[course.joint])
        paths.append(path)
        rows.force(path)
        if path:
            own = np.array(path)
            free = np.isinf(slope.flat[own]) & (point.flat[own] < 0)
            nearest = np.minimum(np.searchsorted(at, np.arange(len(path))), len(at) - 1)
            point.flat[own[free]] = first[number] + nearest[free]
    floor = np.full(raster.shape, np.inf)
    if floors:
        _level_floors(raster, courses, floors, floor)
    for number, nodes in enumerate(water):
        if len(nodes) and outlets is not None:
            rows.drain_lake(number, nodes, _nearest_of(raster, nodes, outlets[number]), paths)
    receiver = rows.receiver.reshape(raster.shape).astype(np.int32)
    return DrainageConstraints(receiver, base, slope, floor, point)


def valley_floors(courses: Sequence[RiverCourse], slopes: Sequence[Float64Array]) -> list[Float64Array]:
    """Return half the width (m) of the valley's floor at each point of each course.

    It is wide beside wide and gentle rivers; steep ones have none.
    """
    return [
        _FLOOR * course.width * np.clip(1.0 - slope / _NO_FLOOR, 0.0, 1.0)
        for course, slope in zip(courses, slopes, strict=True)
    ]


def _level_floors(
    raster: NodeRaster, courses: Sequence[RiverCourse], floors: Sequence[Float64Array], slope: Float64Array
) -> None:
    """Limit slopes on valley floors, which are uneven on both sides."""
    line, floor = np.concatenate([each.line for each in courses]), np.concatenate(floors)
    reach = math.ceil(2.0 * _WIDEST_FLOOR * floor.max() / raster.spacing)
    near = np.zeros(raster.shape, np.bool_)
    row, column, inside = raster.nearest(line[floor > 0.0])
    near[row[inside], column[inside]] = True
    near = maximum_filter(near, 2 * reach + 1)
    nodes = np.flatnonzero(near)
    if not len(nodes):
        return
    at = raster.positions()[nodes]
    result = cKDTree(line).query(at, distance_upper_bound=reach * raster.spacing)
    distance, nearest = (np.asarray(each) for each in result)
    found = np.isfinite(distance)
    nodes, at, distance, nearest = nodes[found], at[found], distance[found], nearest[found]
    wave = _FLOOR_WAVE * np.concatenate([each.width for each in courses])[nearest]
    uneven = value_noise(0, "valley floor", *(at / wave[:, None]).T)
    wide = floor[nearest] * (_NARROWEST_FLOOR + (_WIDEST_FLOOR - _NARROWEST_FLOOR) * uneven)
    limit = _FLOOR_SLOPE + _FLOOR_EDGE * np.maximum(distance / np.maximum(wide, 1e-9) - 1.0, 0.0)
    slope.flat[nodes] = np.where(distance < 2.0 * wide, limit, np.inf)


def course_path(raster: NodeRaster, line: Float64Array) -> tuple[Path, npt.NDArray[np.int64]]:
    """Return the nodes along a centreline (m, 2), without loops, and the number of the node at each point.

    Nodes outside of the raster are left out where the centreline begins or ends there; it may not return.
    """
    arc = arc_length(line)
    count = max(int(np.ceil(_SAMPLES * arc[-1] / raster.spacing)), 1) + 1
    along = np.linspace(0.0, arc[-1], count)
    at = np.stack([np.interp(along, arc, line[:, i]) for i in (0, 1)], axis=-1)
    row, column, inside = raster.nearest(at)
    if not inside.any():
        return [], np.zeros(len(line), np.int64)
    first = int(np.argmax(inside))
    last = first + int(np.argmin(np.append(inside[first:], False)))
    path: Path = []
    place: dict[int, int] = {}
    for node in (row * raster.shape[1] + column)[first:last].tolist():
        if node in place:  # a loop, or the same node again
            for other in path[place[node] + 1 :]:
                del place[other]
            del path[place[node] + 1 :]
            continue
        while len(path) >= 2 and _steps(path[-2], node, raster.shape[1]) <= 1:
            del place[path.pop()]  # the corner of a staircase
        place[node] = len(path)
        path.append(node)
    position = np.array([divmod(node, raster.shape[1]) for node in path], np.float64)
    steps = np.hypot(*np.diff(position, axis=0).T) if len(path) > 1 else np.zeros(0)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    share = np.clip((arc - along[first]) / max(along[last - 1] - along[first], 1e-9), 0.0, 1.0)
    return path, np.searchsorted(length, share * length[-1] - 1e-9).astype(np.int64)


def _steps(one: int, other: int, columns: int) -> int:
    """Return the least number of steps between neighbours from one node to another."""
    (a, b), (c, d) = divmod(one, columns), divmod(other, columns)
    return max(abs(a - c), abs(b - d))


def _joined(raster: NodeRaster, path: Path, stem: Path, joint: Float64Array) -> Path:
    """Continue a path in a straight line to its stem's node nearest to the joint, or end it at the stem."""
    if not stem:
        return path
    known = set(stem)
    for k, node in enumerate(path):
        if node in known:
            return path[: k + 1]
    end = _nearest_of(raster, np.array(stem), joint)
    (row, column), (to_row, to_column) = divmod(path[-1], raster.shape[1]), divmod(end, raster.shape[1])
    own = set(path)
    while (row, column) != (to_row, to_column):
        row, column = row + int(np.sign(to_row - row)), column + int(np.sign(to_column - column))
        node = row * raster.shape[1] + column
        if node in own:
            path = path[: path.index(node) + 1]
            own = set(path)
            continue
        path.append(node)
        own.add(node)
        if node in known:
            break
    return path


def _nearest_of(raster: NodeRaster, nodes: npt.NDArray[np.int64], at: Float64Array) -> int:
    """Return the node nearest to a position (m)."""
    rows, columns = np.divmod(nodes, raster.shape[1])
    east, north = (at[0] - raster.west) / raster.spacing, (at[1] - raster.south) / raster.spacing
    return int(nodes[np.argmin((rows - north) ** 2 + (columns - east) ** 2)])


def _inside(raster: NodeRaster, field: ShapeField) -> BoolArray:
    """Return which nodes lie in a shape; beyond its field, none do."""
    return is_inside(field, raster.positions()).reshape(raster.shape)


class _Receivers:
    """Forced receivers of nodes; none drains to itself."""

    def __init__(self, shape: tuple[int, int], closed: BoolArray) -> None:
        self._shape = shape
        self._closed = closed  # outlets, and nodes outside of the domain
        self.receiver = np.full(closed.size, -1, np.int64)
        self.lake = np.full(closed.size, -1, np.int64)

    def force(self, path: Path) -> None:
        """Let the nodes of a path drain along it, unless they are closed, taken, or lake."""
        for node, to in itertools.pairwise(path):
            free = not self._closed[node] and self.lake[node] < 0 and self.receiver[node] < 0
            if free and node not in self._downstream(to):
                self.receiver[node] = to

    def drain_lake(
        self, number: int, nodes: npt.NDArray[np.int64], outlet: int, paths: Sequence[Path]
    ) -> None:
        """Let the nodes of a lake drain to its outlet, and that one along the course that leaves there."""
        for path in paths:
            for node, to in itertools.pairwise(path):
                if self.lake[node] == number and self.lake[to] != number:
                    if _steps(node, outlet, self._shape[1]) <= 2:
                        outlet = node
                    enters = (self.lake[each] == number for each in self._downstream(to))
                    if node == outlet and self.receiver[node] < 0 and not any(enters):
                        self.receiver[node] = to
        rows, columns = self._shape
        queue, reached = deque([outlet]), {outlet}
        while queue:
            node = queue.popleft()
            row, column = divmod(node, columns)
            for down, across in _NEIGHBOURS:
                p, q = row + down, column + across
                other = p * columns + q
                if not (0 <= p < rows and 0 <= q < columns) or other in reached:
                    continue
                if self.lake[other] == number:
                    reached.add(other)
                    self.receiver[other] = node
                    queue.append(other)

    def _downstream(self, node: int) -> Iterator[int]:
        """Return a node and those that forced receivers lead to from there."""
        while node >= 0:
            yield node
            node = int(self.receiver[node])
