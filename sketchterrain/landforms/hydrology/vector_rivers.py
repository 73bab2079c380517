"""Rivers drawn or imported as lines: networks of their vertices, and courses that follow them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.features.table import AREA, LINE, STEP, FeatureTable
from sketchterrain.geometry.hashing import rounded
from sketchterrain.geometry.splines import arc_length, at_lengths, sample_catmull_rom
from sketchterrain.landforms.hydrology.courses import EXTENSION_SHARE, RiverCourse, extend_path, smoothed
from sketchterrain.landforms.hydrology.network import (
    EDGE_GAP,
    Reach,
    edge_normal,
    split_paths,
    weighted_lengths,
)
from sketchterrain.schema.layers import LAYERS, id_of_vector

if TYPE_CHECKING:
    import shapely

    from sketchterrain.document.sketch import Sketch

_CURVE_ERROR, _CURVE_SAMPLES = 0.05, 64  # m of chords from smooth curves, and their number between vertices
_TOLERANCE, _LOOSE_PIXELS = 0.25, 2.0  # m at fidelity 1, and px more at fidelity 0
_CORNER_STEP = 0.2  # of the sine of half a corner's angle
_STRAIGHT = 1e-3  # the same of a vertex that is no corner
_AGAINST = 1e3  # a way against the direction of a line counts as so many times its length
_SPUR = 0.25  # widths; a shorter branch lies in the bed that it joins
_WIDTH_BLUR = 3.0  # widths over which a width changes
_WIDEST_BANK = 1000.0  # m from an axis
_BANK_BLUR = 1.0  # widths over which the banks of areas are smoothed


def line_tolerance(sketch: Sketch) -> float:
    """Return how far (m) a river's course may be from its line."""
    return _TOLERANCE + _LOOSE_PIXELS * (1.0 - sketch.fidelity) * sketch.pixel_size


def line_path(layer: FeatureTable, index: int) -> Float64Array:
    """Return the curve of a line, (n, 2) m: its vertices, or samples of the smooth curve through them."""
    points = layer.ring(int(layer.parts[index]))
    if "smooth" not in layer.columns or layer.columns["smooth"][index] != 1:
        return points
    return sample_catmull_rom(points, math.inf, sagitta=_CURVE_ERROR, most=_CURVE_SAMPLES)[0]


@dataclass(frozen=True, eq=False)
class LineNetwork:
    """Connected lines as a graph of their vertices."""

    at: Float64Array  # (n, 2) m
    is_vertex: BoolArray  # (n,) not only a sample of a smooth curve
    # (k, 2) nodes of each piece of a line, in its direction; none twice
    pieces: Int64Array
    line: Int64Array  # (k,) index of each piece's feature
    directed: BoolArray  # (k,)
    lengths: Float64Array  # (k,) m

    def ends(self) -> Int64Array:
        """Return the nodes with one neighbour; all of a loop."""
        degree = np.bincount(self.pieces.ravel(), minlength=len(self.at))
        ends = np.flatnonzero(degree == 1)
        return ends if len(ends) else np.arange(len(self.at))

    def mouths(self) -> Int64Array:
        """Return the nodes where lines with a direction end; none without such lines."""
        up, down = self.pieces[self.directed].T
        others = self.pieces[~self.directed].ravel()
        return np.setdiff1d(np.setdiff1d(down, up), others)

    def reaches(
        self, mouths: Int64Array, widths: Float64Array, spur: float
    ) -> tuple[Int64Array, tuple[Reach, ...]]:
        """Return nodes, and paths of their indices to mouths, upstream first; parents come first.

        A loop is cut, and becomes two arms; so is a line that leads to another mouth: the node where an arm
        begins occurs twice. `widths` (m) are those of the pieces.
        """
        up, down = self.pieces.T
        count = len(self.at)
        back = np.where(self.directed, _AGAINST, 1.0) * self.lengths
        graph = sparse.csr_array(
            (np.append(self.lengths, back), (np.append(down, up), np.append(up, down))), shape=(count, count)
        )
        length, predecessor, _ = dijkstra(graph, indices=mouths, min_only=True, return_predecessors=True)
        next_node = np.asarray(predecessor, dtype=np.int64)
        forward = ~self.directed & (length[up] < length[down])
        source, target = np.where(forward, down, up), np.where(forward, up, down)
        is_cut = (next_node[up] != down) & (next_node[down] != up)
        nodes = np.append(np.arange(count), source[is_cut])
        length = np.append(length, length[target[is_cut]] + self.lengths[is_cut])
        next_node = np.append(next_node, target[is_cut])
        weight = np.ones(len(nodes))
        for a, b in ((up, down), (down, up)):
            own = next_node[a] == b
            weight[a[own]] = widths[own]
        weight[count:] = widths[is_cut]
        weighted = weighted_lengths(length, next_node, weight)
        return nodes, split_paths(length, next_node, weighted, np.full(len(nodes), spur))


def line_networks(layer: FeatureTable, widths: Float64Array) -> list[LineNetwork]:
    """Return the networks of a layer's lines, in the order of their first ones; `widths` are of features, m.

    Lines that share a vertex are connected, and so is an end in the bed of another line.
    """
    lines = np.flatnonzero(layer.kinds == LINE)
    if not len(lines):
        return []
    paths = _with_joints([line_path(layer, int(index)) for index in lines], widths[lines])
    at, node = np.unique(np.concatenate(paths), axis=0, return_inverse=True)
    node = node.reshape(-1)
    counts = np.array([len(path) for path in paths])
    inner = np.ones(len(node), np.bool_)
    inner[np.cumsum(counts) - 1] = False
    start = np.flatnonzero(inner)
    pieces = np.stack([node[start], node[start + 1]], axis=-1)
    of = np.repeat(np.arange(len(lines)), counts)[start]
    _, first = np.unique(np.sort(pieces, axis=1), axis=0, return_index=True)
    first = np.sort(first[pieces[first, 0] != pieces[first, 1]])
    pieces, of = pieces[first], of[first]
    column = layer.columns.get("directed")
    directed = np.zeros(len(lines), np.bool_) if column is None else np.asarray(column)[lines] == 1
    graph = sparse.coo_array((np.ones(len(pieces)), pieces.T), shape=(len(at), len(at)))
    _, component = connected_components(graph, directed=False)
    vertices = {tuple(each) for each in layer.vertices.tolist()}
    is_vertex = np.array([tuple(each) in vertices for each in at.tolist()])
    of_piece = component[pieces[:, 0]]
    order = np.argsort(of_piece, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(of_piece[order])) + 1)
    found = []
    for own in sorted(groups, key=lambda group: int(group[0])):
        nodes, number = np.unique(pieces[own], return_inverse=True)
        number = number.reshape(-1, 2)
        tail, head = (at[nodes[side]] for side in number.T)
        lengths = np.sqrt(((head - tail) ** 2).sum(axis=-1))
        found.append(
            LineNetwork(at[nodes], is_vertex[nodes], number, lines[of[own]], directed[of[own]], lengths)
        )
    return found


def _with_joints(paths: list[Float64Array], widths: Float64Array) -> list[Float64Array]:
    """Return paths that share a vertex where one ends in another one's bed."""
    import shapely

    shapes = shapely.linestrings(
        np.concatenate(paths), indices=np.repeat(np.arange(len(paths)), [*map(len, paths)])
    )
    ends = np.concatenate([path[[0, -1]] for path in paths])
    points = shapely.points(ends)
    tree = shapely.STRtree(shapes)
    end, other = tree.query(points, predicate="dwithin", distance=0.5 * widths.max())
    away = shapely.distance(points[end], shapes[other])
    near = (other != end // 2) & (away <= 0.5 * widths[other])
    end, other, away = end[near], other[near], away[near]
    order = np.lexsort((away, end))
    nearest = order[np.unique(end[order], return_index=True)[1]]
    inserted: dict[int, list[tuple[float, Float64Array]]] = {}
    longer = list(paths)
    for number, line, distance in zip(end[nearest], other[nearest], away[nearest], strict=True):
        if (paths[line] == ends[number]).all(axis=1).any():
            continue
        arc = float(shapely.line_locate_point(shapes[line], points[number]))
        joint = shapely.get_coordinates(shapely.line_interpolate_point(shapes[line], arc))
        if distance < STEP:  # it is on the line but for rounding
            joint = ends[[number]]
        inserted.setdefault(int(line), []).append((arc, joint))
        own = longer[number // 2]
        longer[number // 2] = np.concatenate([joint, own] if number % 2 == 0 else [own, joint])
    for line, joints in inserted.items():
        offset = int((longer[line][0] != paths[line][0]).any())  # an end of its own was added
        after = np.searchsorted(arc_length(paths[line]), [arc for arc, _ in joints], side="left") + offset
        places = np.concatenate([joint for _, joint in joints])
        by_arc = np.argsort([arc for arc, _ in joints], kind="stable")
        longer[line] = np.insert(longer[line], after[by_arc], places[by_arc], axis=0)
    return [path[np.append(True, (np.diff(path, axis=0) != 0.0).any(axis=1))] for path in longer]


def rounded_corners(path: Float64Array, tolerance: float, step: float) -> tuple[Float64Array, Int64Array]:
    """Return points (m, 2) at most `step` apart along a path with round corners, and those of its vertices.

    A corner is a quadratic Bézier curve that stays within the `tolerance` (m) of the path.
    """
    ahead = np.diff(path, axis=0)
    length = np.sqrt((ahead**2).sum(axis=1))
    heading = ahead / length[:, None]
    half = np.sqrt(np.maximum(0.5 - 0.5 * (heading[1:] * heading[:-1]).sum(axis=1), 0.0))
    cut = np.minimum(2.0 * tolerance / np.maximum(half, 1e-9), 0.5 * np.minimum(length[1:], length[:-1]))
    cut = np.concatenate([[0.0], np.where(half < _STRAIGHT, 0.0, cut), [0.0]])
    halves = np.ceil(np.maximum(np.concatenate([[0.0], half, [0.0]]) / _CORNER_STEP, cut / step)).astype(
        np.int64
    )
    parts, vertices, count = [path[:1]], [0], 1
    for number in range(len(length)):
        before, after = cut[number], cut[number + 1]
        straight = length[number] - before - after
        if straight > 0.0:
            # Samples are no farther apart than a corner is long beside it, so that curves through them fit.
            arcs = np.arange(1, math.ceil(straight / step)) * step
            guards = [min(before, straight / 3.0), straight - min(after, straight / 3.0)]
            arcs = np.unique(np.concatenate([[0.0], arcs, guards, [straight]]))
            arcs = arcs[np.append(True, np.diff(arcs) > 1e-3)] if before > 0.0 else arcs[1:]
            parts.append(path[number] + (before + arcs)[:, None] * heading[number])
            count += len(arcs)
        if after > 0.0:
            samples = 2 * int(halves[number + 1])
            t = np.arange(1, samples)[:, None] / samples
            a, v = path[number + 1] - after * heading[number], path[number + 1]
            b = path[number + 1] + after * heading[number + 1]
            parts.append((1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * v + t * t * b)
            vertices.append(count + samples // 2 - 1)
            count += samples - 1
        else:
            vertices.append(count - 1)
    line = np.concatenate(parts)
    line[-1] = path[-1]
    return line, np.array(vertices, dtype=np.int64)


def network_courses(
    sketch: Sketch,
    network: LineNetwork,
    mouths: Int64Array,
    sizes: tuple[Float64Array, Float64Array],
    areas: shapely.STRtree,
    *,
    seed: int,
    taken: set[int],
) -> list[RiverCourse]:
    """Return the courses of a network that flows to some of its nodes, parents first.

    Parameters
    ----------
    sizes : widths and depths of all features, m
    areas : those of the layer
    taken : ids of courses, to which theirs are added
    """
    layer = sketch.vectors["river"]
    own_widths = sizes[0][network.line]
    found, reaches = network.reaches(mouths, own_widths, _SPUR * float(own_widths.max()))
    piece_of = {
        pair: number for number, (a, b) in enumerate(network.pieces.tolist()) for pair in ((a, b), (b, a))
    }
    courses: list[RiverCourse] = []
    for reach in reaches:
        nodes = found[reach.pixels]
        lines = network.line[[piece_of[pair] for pair in pairwise(nodes.tolist())]]
        own = np.stack([each[lines] for each in sizes], axis=-1)
        parent = courses[reach.parent] if reach.parent >= 0 else None
        name = _course_id(layer, lines, taken)
        course = _course(sketch, network.at[nodes], network.is_vertex[nodes], own, parent, name, seed)
        course = replace(course, label=int(layer.labels[lines[0]]), grows=_grows(layer, lines))
        courses.append(with_banks(course, areas) if len(areas) else course)
    return courses


def line_sizes(sketch: Sketch) -> tuple[Float64Array, Float64Array]:
    """Return the width and the depth (m) of each river of the vector layer."""
    widths, depths = (sketch.vector_values("river", name) for name in ("width", "depth"))
    default = float(LAYERS["river"].parameters["width"].default)
    return np.where(widths > 0.0, np.maximum(widths, 0.5), default), depths


def _course_id(layer: FeatureTable, lines: Int64Array, taken: set[int]) -> int:
    """Return the id of a course: that of its first line, with a number if another one has it."""
    name = id_of_vector("river", int(layer.ids[lines[0]]))
    while name in taken:
        name += 1 << 31
    taken.add(name)
    return name


def _grows(layer: FeatureTable, lines: Int64Array) -> bool:
    """Return whether a river widens downstream: none of its lines has a width of its own."""
    column = layer.columns.get("width")
    return column is None or bool(np.isnan(np.asarray(column, dtype=np.float64)[lines]).all())


def _course(
    sketch: Sketch,
    path: Float64Array,
    is_control: BoolArray,
    sizes: Float64Array,
    parent: RiverCourse | None,
    name: int,
    seed: int,
) -> RiverCourse:
    """Return a course along a path (n, 2), m; its pieces have sizes (n - 1, 2): width and depth, m."""
    joint = -1
    if parent is not None:
        joint = parent.joint_near(path[-1])
        path = np.concatenate([path[:-1], parent.line[joint : joint + 1]])
    taper, added = float(arc_length(path)[-1]) / 3.0, [0, 0]
    # Its end, then its spring: each leaves the sketch or not.
    for is_spring in (False, True):
        if is_spring:
            path, sizes, is_control = path[::-1], sizes[::-1], is_control[::-1]
        normal = _exit(sketch, path, float(sizes[-1, 0]))
        if normal is not None and (is_spring or parent is None):
            beyond = EXTENSION_SHARE * sketch.extent
            interval = (4.0 + 4.0 * (1.0 - sketch.fidelity)) * sketch.pixel_size
            key = 2 * name + is_spring
            more = extend_path(path, normal, length=beyond, interval=interval, seed=seed, name=key)
            path, added[is_spring] = np.concatenate([path, more]), len(more)
            is_control = np.append(is_control, np.ones(len(more), np.bool_))
            sizes = np.concatenate([sizes, np.repeat(sizes[-1:], len(more), axis=0)])
            taper = beyond if is_spring else taper
    path, sizes, is_control = path[::-1], sizes[::-1], is_control[::-1].copy()
    is_control[[0, -1]] = True
    step = float(np.clip(0.5 * sizes[:, 0].min(), 2.0, 12.0))
    line, vertices = rounded_corners(path, line_tolerance(sketch), step)
    own = len(line) - (parent is not None)
    line[:own] = rounded(line[:own])
    keep = np.append((np.diff(line, axis=0) != 0.0).any(axis=1), True)
    piece = np.clip(np.searchsorted(vertices, np.flatnonzero(keep), side="right") - 1, 0, len(sizes) - 1)
    vertices = (np.cumsum(keep) - keep)[vertices]
    given = int(vertices[added[1]]), int(vertices[len(path) - 1 - added[0]]) + 1
    width, depth = _smooth_sizes(sizes[piece], arc_length(line[keep]))
    controls = np.unique(vertices[is_control])
    return RiverCourse(
        name, 1, parent, joint, line[keep], controls, width, depth, taper, grows=True, given=given
    )


def _smooth_sizes(sizes: Float64Array, arc: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return widths and depths along a course, (m,) each, without steps."""
    if (sizes == sizes[0]).all():
        return sizes[:, 0].copy(), sizes[:, 1].copy()
    width, depth = _blurred_along(sizes, arc, _WIDTH_BLUR * float(sizes[:, 0].mean()))
    return width, depth


def _blurred_along(values: Float64Array, arc: Float64Array, distance: float) -> list[Float64Array]:
    """Return columns of values (m, c) at some lengths along a course, blurred over a distance (m)."""
    even = np.linspace(0.0, arc[-1], len(arc))
    blurred = smoothed(at_lengths(values, arc, even), distance / max(float(even[1]), 1e-9))
    return [np.interp(arc, even, column) for column in blurred.T]


def _exit(sketch: Sketch, path: Float64Array, width: float) -> tuple[float, float] | None:
    """Return the unit vector (east, north) out of the sketch where a path leaves it; None if it does not."""
    end = path[-1]
    back = path[np.searchsorted(-arc_length(path[::-1])[::-1], -8.0 * sketch.pixel_size)]
    run = end - (back if (back != end).any() else path[-2])
    east, north = sketch.size
    gaps = end[1], east - end[0], north - end[1], end[0]
    return edge_normal(gaps, run[0], run[1], 0.5 * width + EDGE_GAP * sketch.pixel_size)


def areas_without_axes(layer: FeatureTable) -> BoolArray:
    """Return which features are areas of rivers without an axis: a line that runs through them."""
    import shapely

    found: BoolArray = layer.kinds == AREA
    shapes = layer.shapes()
    lines = shapes[layer.kinds == LINE]
    if found.any() and len(lines):
        tree = shapely.STRtree(lines)
        crossed, within = (tree.query(shapes[found], predicate=each)[0] for each in ("crosses", "contains"))
        found[np.flatnonzero(found)[np.union1d(crossed, within)]] = False
    return found


def with_banks(course: RiverCourse, areas: shapely.STRtree) -> RiverCourse:
    """Return a course in the middle of the areas that it runs through, as wide as they are.

    The line is the axis that carries the river's profile, the area bounds its surface (Bruneton & Neyret
    2008, section 3.1).
    """
    import shapely

    here = areas.query(shapely.linestrings(course.line), predicate="intersects")
    area = shapely.union_all(areas.geometries[here])
    points = shapely.points(course.line)
    inside = shapely.contains_xy(area, *course.line.T)
    if not inside.any():
        return course
    ahead = np.gradient(course.line, axis=0)
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    across /= np.maximum(np.sqrt((ahead**2).sum(axis=1)), 1e-9)[:, None]
    sides = np.empty((len(points), 2))
    for side, sign in enumerate((1.0, -1.0)):
        far = course.line + sign * _WIDEST_BANK * across
        rays = shapely.linestrings(np.stack([course.line, far], axis=1))
        sides[:, side] = shapely.distance(points, shapely.intersection(rays, area.boundary))
    sides = np.where(inside[:, None] & np.isfinite(sides), sides, 0.5 * course.width[:, None])
    distance = _BANK_BLUR * float(sides.sum(axis=1).mean())
    left, right = _blurred_along(sides, arc_length(course.line), distance)
    moved = rounded(course.line + (0.5 * (left - right))[:, None] * across)
    if course.parent is not None:
        moved[-1] = course.line[-1]
    distinct = np.append((np.diff(moved, axis=0) != 0.0).any(axis=1), True)
    number = np.cumsum(distinct) - distinct
    first, end = course.given or (0, len(course.line))
    return replace(
        course,
        line=moved[distinct],
        controls=np.unique(number[course.controls]),
        given=(int(number[first]), int(number[end - 1]) + 1),
        width=(left + right)[distinct],
        depth=course.depth[distinct],
        grows=False,
    )
