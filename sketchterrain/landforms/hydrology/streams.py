"""Streams: channels of the drained ground that nobody painted, as courses that join painted water."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array, Int64Array
from sketchterrain.geometry.hashing import rounded, value_noise
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.landforms.hydrology.courses import RiverCourse, course_through, smoothed
from sketchterrain.landforms.hydrology.drainage_constraints import NodeRaster
from sketchterrain.landforms.placement.feature_types import LAYER_CODES
from sketchterrain.stages.runner import Runner

_UNPAINTED_BIT = 1 << 47  # in the ids of streams
_LEAST_AREA, _LEAST_SHARE = 0.5e6, 0.02  # m², and of the extent's square: what a spring drains
_LEAST_RUNOFF = 0.1  # of a humid climate's
_WIDTH, _DEPTH = 2.2e-3, 0.22  # m: width = 0.0022 √A, depth = 0.22 width^¾ (Leopold & Maddock 1953)
_TORRENT = 1.1 / 1.2  # depths over a width that a slope asks for: see `gradient_limit`
_DEEPEST = 0.6  # widths
_LEAST_NODES = 8
_SHORE = 4  # nodes around lakes
_SMOOTH = 1.5  # nodes
_SEEPING, _SEEPED = 12, 0.3  # nodes over which a stream without mouth narrows, to a share of its width
_INTERVAL = 3.0  # nodes between control points where a stream runs straight
_WAVE = 11.0  # widths of a meander (Leopold & Wolman 1960) …
_LEAST_WAVE = 1.0  # … and nodes
_SWING, _LEAST_SWING = 0.2, 0.08  # waves to each side
_STEPS = 6  # control points of a meander
_RESOLVED = 2.0  # widths
_LEVEL, _STEEP = 0.02, 0.05  # slopes up to which streams meander, and from which on they run straight
_STEP = 2.0**-10  # m, of control points


def is_stream(name: int) -> bool:
    """Return whether a river's id is that of a stream."""
    return bool(name & _UNPAINTED_BIT)


@dataclass(frozen=True, eq=False)
class Flow:
    """How a raster of nodes drains; arrays of shape (rows, columns)."""

    raster: NodeRaster
    height: Float64Array  # m
    area: Float64Array  # m²
    receiver: Int32Array  # flat indices, −1 at outlets
    water: BoolArray  # nodes of painted rivers, of lakes and of the sea
    barred: BoolArray  # nodes where there is no stream
    lake: BoolArray  # nodes of lakes: streams begin at their outlets, and none nearby


def stream_courses(
    flow: Flow,
    courses: Sequence[RiverCourse],
    *,
    size: tuple[float, float],
    runoff: float,
    seed: int,
    displaced: Callable[[Float64Array], Float64Array],
    run: Runner,
) -> list[RiverCourse]:
    """Return the streams of a drained raster, parents first.

    Parameters
    ----------
    flow : level 0 of the painted region
    courses : painted rivers, which streams may join
    size : of the sketch, m
    runoff : share of a humid climate's, 0 … 1
    displaced : where nodes (n, 2), m, appear on the terrain
    """
    runoff = max(runoff, _LEAST_RUNOFF)
    least = max(_LEAST_AREA, _LEAST_SHARE * max(size) ** 2) / runoff
    outlets = _lake_outlets(flow) if runoff > _LEAST_RUNOFF else {}
    raster, paths = flow.raster, _paths(flow, least, outlets)
    if not paths:
        return []
    at = raster.positions()
    used = np.unique(np.concatenate([path for path, _ in paths]))
    used = used[used >= 0]
    inside: BoolArray = np.all((at >= 0.0) & (at <= np.array(size)), axis=1)
    nodes = np.zeros_like(at)
    nodes[used] = displaced(at[used])
    area, height = flow.area.ravel(), flow.height.ravel()
    wet, barred = flow.water.ravel(), flow.barred.ravel()
    shore = maximum_filter(flow.lake, 2 * _SHORE + 1).ravel()
    rivers = cKDTree(np.concatenate([each.line for each in courses])) if courses else None
    owner = np.repeat(np.arange(len(courses)), [len(each.line) for each in courses])
    # No stream joins a river where that ends on land.
    left = [
        arc_length(each.line[::-1])[::-1] + raster.spacing * (each.parent is not None) for each in courses
    ]
    is_end = np.concatenate([*left, np.zeros(0)]) < raster.spacing
    # At the bank of a river that is a line: it may be far from its nodes.
    reach = [np.maximum(raster.spacing, (each.given is not None) * 0.5 * each.width) for each in courses]
    joins_within = np.concatenate([*reach, np.zeros(0)])
    found: list[RiverCourse | None] = []
    for path, number in run.steps(paths):
        parent = found[number] if number >= 0 else None
        if (number >= 0 and parent is None) or not inside[path].any():
            found.append(None)
            continue
        if path[0] not in outlets.values():
            path = path[int(np.argmin(shore[path[:-1]])) :]
        own = path[:-1] if path[-1] < 0 or barred[path[-1]] else path
        width = _WIDTH * np.sqrt(runoff * area[np.append(path[:-1], path[-2])])[: len(own)]
        line = np.column_stack([nodes[own], width, height[own]])
        ends_dry = parent is None and not wet[path[-1]]
        if rivers is not None:
            away, nearest = (np.asarray(each) for each in rivers.query(line[:, :2]))
            beside = np.flatnonzero(away < joins_within[nearest])
            if len(beside):
                first = beside[0]
                ends_dry = bool(is_end[nearest[first]])
                parent = None if ends_dry else courses[int(owner[nearest[first]])]
                line = line[: first + 1 - ends_dry]
        if ends_dry:
            line[:, 2] *= _seeping(len(line))
        name = LAYER_CODES["river"] << 48 | _UNPAINTED_BIT | int(path[0])
        found.append(run(_course, line, parent, raster.spacing, name, seed))
    return [each for each in found if each is not None]


def joined_streams(streams: Sequence[RiverCourse], courses: Sequence[RiverCourse]) -> list[RiverCourse]:
    """Return those of some streams, parents first, that join some courses, each other or nothing."""
    known = {id(None), *map(id, courses)}
    for each in streams:
        if id(each.parent) in known:
            known.add(id(each))
    return [each for each in streams if id(each) in known]


def _lake_outlets(flow: Flow) -> dict[int, int]:
    """Return the first node below each lake that no painted river leaves, with the lake's last one."""
    receiver, lake = flow.receiver.ravel(), flow.lake.ravel()
    last = np.flatnonzero(lake & (receiver >= 0))
    last = last[~(flow.water | flow.barred).ravel()[receiver[last]]]
    return dict(zip(receiver[last].tolist(), last.tolist(), strict=True))


def _paths(flow: Flow, least: float, outlets: Mapping[int, int]) -> list[tuple[Int64Array, int]]:
    """Return nodes of streams, upstream first, with the one that they drain to; and the stream they join.

    Where streams meet, the one with the larger drainage area goes on. What flows out of lakes is a stream.
    """
    area, receiver = flow.area.ravel(), flow.receiver.ravel()
    free = ~(flow.water | flow.barred).ravel()
    channel = (area > least) & free
    for node in outlets:
        while node >= 0 and free[node] and not channel[node]:
            channel[node] = True
            node = int(receiver[node])
    nodes = np.flatnonzero(channel)
    nodes = nodes[np.lexsort((nodes, -area[nodes]))]
    main = np.full(area.size, -1, np.int64)
    for at in nodes[::-1]:  # the largest last
        if receiver[at] >= 0:
            main[receiver[at]] = at
    stream = np.full(area.size, -1, np.int64)
    paths: list[tuple[Int64Array, int]] = []
    for at in nodes:
        to = receiver[at]
        if stream[at] >= 0:
            continue
        path = [int(to), int(at)]
        while main[path[-1]] >= 0:
            path.append(int(main[path[-1]]))
        stream[path[1:]] = len(paths)
        if path[-1] in outlets:
            path.append(outlets[path[-1]])
        paths.append((np.array(path[::-1]), int(stream[to]) if to >= 0 and channel[to] else -1))
    return paths


def _seeping(count: int) -> Float64Array:
    """Return the share of its width that a stream has left at each node before it seeps away."""
    left = np.arange(count - 1, -1, -1) / _SEEPING
    return np.asarray(_SEEPED + (1.0 - _SEEPED) * np.minimum(left, 1.0))


def _course(
    line: Float64Array, parent: RiverCourse | None, spacing: float, name: int, seed: int
) -> RiverCourse | None:
    """Return the course along nodes with their widths and heights (m); None if it is too short or lost."""
    if len(line) < _LEAST_NODES:
        return None
    joint = -1
    if parent is not None:
        joint = parent.joint_near(line[-1, :2])
        if joint == len(parent.line) - 1:
            return None  # the stem ends before
        line[-1, :2] = parent.line[joint]
    line = smoothed(line, _SMOOTH)
    arc = arc_length(line)
    slope = smoothed(np.maximum(-np.gradient(line[:, 3], arc), 0.0)[:, None], _SMOOTH)[:, 0]
    width = line[:, 2]
    depth = np.maximum(_DEPTH * np.sqrt(width * np.sqrt(width)), _TORRENT * slope * width)
    depth = np.minimum(depth, _DEEPEST * width)
    points = _meandering(np.column_stack([line[:, :2], width, depth]), slope, spacing, seed=seed, name=name)
    points[:-1, :2] = rounded(points[:-1, :2], _STEP)
    resolved = _RESOLVED * float(np.median(width))
    return course_through(points, name, 0, parent=parent, joint=joint, taper=0.0, resolved=resolved)


def _meandering(
    path: Float64Array, slope: Float64Array, spacing: float, *, seed: int, name: int
) -> Float64Array:
    """Return control points along a path of x, y, width and depth: meanders where it is nearly level."""
    arc = arc_length(path)
    level = np.clip((_STEEP - slope) / (_STEEP - _LEVEL), 0.0, 1.0)
    wave = np.maximum(_WAVE * path[:, 2], _LEAST_WAVE * spacing)
    # Steps are as long as bends need; longer ones do for straight reaches.
    step = np.where(level > 0.0, wave / _STEPS, _INTERVAL * spacing)
    number = np.concatenate([[0.0], np.cumsum(np.diff(arc) / np.minimum(step[1:], step[:-1]))])
    s = np.interp(np.linspace(0.0, number[-1], max(math.ceil(number[-1]), 2) + 1), number, arc)
    points = at_lengths(path, arc, s)
    wave = np.interp(s, arc, wave)
    which = np.full_like(s, name % 2**40)
    turns = np.concatenate([[0.0], np.cumsum(np.diff(s) / (0.5 * (wave[1:] + wave[:-1])))])
    wander = value_noise(seed, "meander phase", turns / 2.0, which)
    swing = _LEAST_SWING + (_SWING - _LEAST_SWING) * value_noise(seed, "meander swing", turns / 1.5, which)
    swing *= wave * np.interp(s, arc, level)
    ends = 2.0 * np.minimum(s, s[-1] - s) / wave  # none at springs and confluences
    phase = 2.0 * math.pi * (turns + 0.6 * wander)
    offset = swing * np.clip(ends, 0.0, 1.0) * np.sin(phase)
    ahead = np.gradient(points[:, :2], axis=0)
    ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    points[:, :2] += offset[:, None] * np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    points[[0, -1]] = path[[0, -1]]
    return points
