"""Meshes of roads: surfaces on the ground, bridges and tunnels; trees along roads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.look.built_meshes import (
    MOUTH,
    BuiltObject,
    BuiltPart,
    extruded,
    flat_quads,
    house,
    prism_quads,
    rectangle,
    standing,
    swept,
)
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, AxisPoints, Road, RoadNetwork, axis_points
from sketchterrain.schema.layers import feature_name

if TYPE_CHECKING:
    from sketchterrain.landforms.placement.feature_types import River

CHORD: Final = 0.02  # m, deviation of meshes from arcs and vertical curves
SHOULDER: Final = "gravel"
MARKED: Final = 5.0  # m, least width of carriageways of asphalt with marks
TRACK: Final = 4.4  # m between the middles of railway tracks
_JUNCTION: Final = 40.0  # m along a leg from a junction where the ground may differ from the road's section
_MARGIN: Final = 40.0  # m about roads and rivers where bridges may be over them
_STEP: Final = 2.0  # m between places where a bridge looks for ground and obstacles
_DECK: Final = {"road": (20.0, 0.5, 2.6), "railway": (14.0, 0.7, 3.2), "path": (28.0, 0.16, 0.7)}
"""Span over thickness of a deck, its least and greatest thickness (m)."""
_SPANS: Final = {"road": (16.0, 42.0), "railway": (12.0, 32.0), "path": (10.0, 24.0)}
"""Shortest and longest spans (m); about 1.3 times the height between."""
_PARAPET: Final = {"road": (0.85, 0.28), "railway": (0.45, 0.30), "path": (1.05, 0.08)}
"""Height and thickness (m)."""
_SLAB: Final = 0.35  # m, thickness of a deck beside its girder
_ROOM: Final = {"road": 5.2, "railway": 6.2, "path": 2.6}  # m, clear height of tunnels in their middle
_DARK: Final = 30.0  # m of a tunnel that are seen
_GLOOM: Final = 7.0  # m over which light falls to 1/e in it
_BEFORE: Final = 1.0  # m that a portal stands before the tunnel's end


def built_objects(network: RoadNetwork, rivers: Sequence[River] = ()) -> list[BuiltObject]:
    """Return bridges, tunnels, houses, walls and the like."""
    bridges = [road for road in network.roads if road.structure == BRIDGE]
    return [
        *_bridges(bridges, [each for each in network.roads if each.structure == GROUND], rivers),
        *(_tunnel(road) for road in network.roads if road.structure == TUNNEL),
        *(house(pad) for pad in network.pads if pad.building > 0.0 and len(pad.outline) > 2),
        *(standing(each) for each in network.standing if len(each.line) > 1),
    ]


def road_surfaces(network: RoadNetwork) -> Iterator[BuiltObject]:
    """Yield the surfaces of roads on the ground."""
    return (_surface(road) for road in network.roads if road.structure == GROUND)


def road_content(road: Road) -> tuple[object, ...]:
    """Return what the meshes of a road depend on."""
    values = (road.axis, road.bend, road.slope, road.half_width, road.shoulder, road.crossfall)
    return (road.id, road.structure, road.works, road.ends, *(each.tobytes() for each in values))


def track_spacing(road: Road) -> float:
    """Return the distance (m) between the middles of a railway's tracks, 0 for other roads."""
    width = 2.0 * float(road.half_width[0])
    return width / max(round(width / TRACK), 1) if road.layer == "railway" else 0.0


def _name(road: Road) -> str:
    parts = {GROUND: "", BRIDGE: " bridge", TUNNEL: " tunnel"}[road.structure]
    return feature_name(road.id) + parts


def _surface(road: Road) -> BuiltObject:
    points = axis_points(road, CHORD)
    half, whole = points.half_width, points.half_width + points.shoulder
    lines = [points.beside(offset) for offset in (whole, half, -half, -whole)]
    ends = zip(road.ends, (points.along[0], points.along[-1]), strict=True)
    distances = [np.abs(points.along - end) for ways, end in ends if ways > 2]
    near = np.min(distances, axis=0) < _JUNCTION if distances else np.zeros(len(half), bool)

    def parts(ground: Float64Array) -> list[BuiltPart]:
        for line, heights in zip(lines, ground.reshape(4, -1), strict=True):
            line[near, 2] = heights
        return _carriageway(road, points.along, lines, SHOULDER)

    places = np.concatenate([line[near, :2] for line in lines])
    return BuiltObject(_name(road), road_content(road), places, parts)


def _carriageway(
    road: Road,
    along: Float64Array,
    lines: Sequence[Float64Array],
    beside: str,
    tone: Float64Array | float = 1.0,
) -> list[BuiltPart]:
    """Return the surface between the edges of the shoulders and carriageway, from left to right."""
    width = 2.0 * float(road.half_width.min())
    is_marked = road.layer == "road" and road.works.surface == "asphalt" and width >= MARKED
    track = -1.0 - width if is_marked else track_spacing(road)
    middle = swept(road.works.surface, lines[1:3], along, tone=tone, track=track)
    if not road.shoulder.any():
        return [middle]
    return [middle, *(swept(beside, pair, along, tone=tone) for pair in (lines[:2], lines[2:]))]


@lru_cache(maxsize=1 << 13)
def _around(each: Road | River) -> Float64Array:
    """Return the box (west, south, east, north; m) of bridges that a road or river may be under."""
    if isinstance(each, Road):
        line, wide = each.axis, float(np.abs(each.bend).max() * np.ptp(each.along))
    else:
        line, wide = each.centreline, 0.5 * float(each.centreline_width.mean())
    margin = _MARGIN + wide
    return np.concatenate([line[:, :2].min(axis=0) - margin, line[:, :2].max(axis=0) + margin])


@lru_cache(maxsize=1 << 12)
def _obstacle(each: Road | River) -> Float64Array:
    """Return points of a road on the ground or of a river (n, 5): position, reach (m), as of `_blocked`."""
    if isinstance(each, Road):
        line, reach, kind = axis_points(each, 0.5).position, float(each.whole_half.max()) + 1.0, 2.0
    else:
        line, reach, kind = each.centreline, 0.5 * float(each.centreline_width.mean()), 1.0
    points = _resampled(line, _STEP)
    return np.column_stack([points, np.tile((reach, kind), (len(points), 1))])


@lru_cache(maxsize=1 << 12)
def _blocked(bridge: Road, obstacles: tuple[Road | River, ...]) -> Float64Array:
    """Return what is below a bridge, off which piers keep: 0 ground, 1 a river, 2 a road."""
    places = _deck(bridge)[1].position
    rows = np.concatenate([np.zeros((0, 5)), *map(_obstacle, obstacles)])
    for axis, values in enumerate(places[:, :2].T):
        near = (rows[:, axis] >= values.min() - rows[:, 3]) & (rows[:, axis] <= values.max() + rows[:, 3])
        rows = rows[near]
    away = np.hypot(*(rows[:, :2].T[:, :, None] - places[:, :2].T[:, None]))
    blocks = (away < rows[:, 3:4]) & (rows[:, 2:3] < places[:, 2] - 2.0)
    return np.asarray(np.where(blocks, rows[:, 4:], 0.0).max(axis=0, initial=0.0))


def _resampled(line: Float64Array, step: float) -> Float64Array:
    """Return points of a line (n, k) about `step` m apart, both ends included."""
    along = arc_length(line)
    at = np.linspace(0.0, along[-1], max(round(along[-1] / step), 1) + 1)
    return at_lengths(line, along, at)


@lru_cache(maxsize=1 << 12)
def _deck(road: Road) -> tuple[AxisPoints, AxisPoints]:
    """Return the stations of a bridge for its meshes, and those about `_STEP` m apart."""
    points = axis_points(road, CHORD)
    count = max(round((points.along[-1] - points.along[0]) / _STEP), 2)
    return points, points.at_distances(np.linspace(points.along[0], points.along[-1], count + 1))


def _bridges(
    bridges: Sequence[Road], roads: Sequence[Road], rivers: Sequence[River]
) -> Iterator[BuiltObject]:
    """Yield bridges over roads and rivers."""
    others = [*roads, *(river for river in rivers if len(river.centreline) > 1)] if bridges else []
    boxes = np.array([_around(each) for each in others]).reshape(-1, 4)
    for road in bridges:
        points, sampled = _deck(road)
        places = sampled.position[:, :2]
        near = (boxes[:, :2] <= places.max(axis=0)) & (boxes[:, 2:] >= places.min(axis=0))
        own = _blocked(road, tuple(others[number] for number in np.flatnonzero(near.all(axis=1)).tolist()))
        content = (*road_content(road), own.tobytes())
        parts = partial(_bridge_parts, road, points, sampled, own)
        yield BuiltObject(_name(road), content, places, parts)


def _bridge_parts(
    road: Road, points: AxisPoints, sampled: AxisPoints, blocked: Float64Array, ground: Float64Array
) -> list[BuiltPart]:
    ratio, thinnest, thickest = _DECK[road.layer]
    height, length = sampled.position[:, 2] - ground, float(np.ptp(points.along))
    shortest, longest = _SPANS[road.layer]
    span = float(np.clip(1.3 * np.median(height), shortest, longest))
    piers = _pier_places(length, span, blocked)
    stops = np.concatenate([[0], piers, [len(ground) - 1]]) / (len(ground) - 1) * length
    depth = float(np.clip(np.diff(stops).max() / ratio, thinnest, thickest))
    slab = min(_SLAB, depth)
    rail, thick = _PARAPET[road.layer]
    # Ends at a junction that is in the air: parapets stop before it, and a pier replaces the abutment.
    joints = [ways > 2 and height[end] > depth + 2.0 for ways, end in zip(road.ends, (0, -1), strict=True)]
    room = 1.3 * float(points.half_width.max() + points.shoulder.max()) + 2.0
    stops_at = [points.along[0] + room * joints[0], points.along[-1] - room * joints[1]]
    extra = [stops_at[0] - 0.01, *stops_at, stops_at[1] + 0.01]
    points = points.at_distances(np.unique(np.clip([*points.along, *extra], *points.along[[0, -1]])))
    rail = rail * ((points.along >= stops_at[0]) & (points.along <= stops_at[1]))
    half, whole = points.half_width, points.half_width + points.shoulder
    outer, girder = whole + thick, 0.62 * whole
    edges = [points.beside(offset) for offset in (whole, half, -half, -whole)]
    right = [
        (whole, 0.0),
        (whole, rail),
        (outer, rail),
        (outer, -slab),
        (girder, -slab),
        (0.85 * girder, -depth),
    ]
    section = [(-offset, z) for offset, z in right] + right[::-1]
    up = np.array([0.0, 0.0, 1.0])
    lines = [points.beside(offset) + np.outer(np.zeros(len(half)) + z, up) for offset, z in section]
    parts = [*_carriageway(road, points.along, edges, "concrete"), swept("concrete", lines, points.along)]
    for end, outward in ((0, -1.0), (-1, 1.0)):
        if joints[end]:
            piers = np.append(piers, end % len(ground))
            continue
        at = sampled.position[end]
        ahead = outward * np.array([sampled.left[end, 1], -sampled.left[end, 0]])
        wide = 2.0 * float(outer[end])
        foot = float(ground[end]) - 1.5
        low = min(foot, at[2] - depth - 1.0)
        parts.append(
            extruded("concrete", rectangle(at[:2] - 0.4 * ahead, ahead, 1.4, wide), low, at[2] - 0.15)
        )
        wing = min(1.0 + 1.5 * depth, 6.0) if road.layer != "path" else 0.6
        for side in (-1.0, 1.0):
            middle = at[:2] + ahead * 0.5 * wing + side * (0.5 * wide - 0.5 * thick) * sampled.left[end]
            top = at[2] + float(rail.max())
            parts.append(extruded("concrete", rectangle(middle, ahead, wing, thick), low, top))
    slender = road.layer == "path"
    for pier in piers:
        (*place, top), left = sampled.position[pier], sampled.left[pier]
        below, foot, ahead = top - depth, float(ground[pier]), np.array([left[1], -left[0]])
        if below - foot < 0.8:
            continue
        wide = 2.0 * float(np.interp(sampled.along[pier], points.along, whole))
        long = float(np.clip((below - foot) / 14.0, 0.25 if slender else 0.7, 2.6))
        cap = below - (0.2 if slender else min(0.9, 0.35 * (below - foot)))
        shaft = rectangle(np.array(place), ahead, long, (0.8 if slender else 0.42) * wide)
        head = rectangle(np.array(place), ahead, long + 0.3, 0.78 * wide)
        parts += [extruded("concrete", shaft, foot - 1.5, cap), extruded("concrete", head, cap, below + 0.1)]
    return parts


def _pier_places(length: float, span: float, blocked: Float64Array) -> np.ndarray:
    """Return indices of samples with piers: evenly spaced, moved off roads, and off rivers if near."""
    last = len(blocked) - 1
    spans = max(round(length / span), 1)
    places = []
    for wished in np.arange(1, spans) * last / spans:
        cost = np.abs(np.arange(last + 1) - wished) + 0.6 * last / spans * (blocked == 1.0)
        cost[(blocked == 2.0) | (np.arange(last + 1) < 2) | (np.arange(last + 1) > last - 2)] = np.inf
        best = int(np.argmin(cost))
        if cost[best] < 0.7 * last / spans:
            places.append(best)
    return np.unique(np.array(places, np.intp))


def _tunnel(road: Road) -> BuiltObject:
    points = axis_points(road, CHORD)
    return BuiltObject(
        _name(road), road_content(road), np.zeros((0, 2)), lambda _: _tunnel_parts(road, points)
    )


def _tunnel_parts(road: Road, points: AxisPoints) -> list[BuiltPart]:
    start, end = points.along[0], points.along[-1]
    is_short = end - start < 2.0 * _DARK
    parts = []
    for first, inward in ((start, 1.0), (end, -1.0)):
        deep = end - start + _BEFORE if is_short else _DARK
        inside = np.linspace(-_BEFORE, deep, max(round(deep / 2.0), 2) + 1)
        if is_short and inward < 0.0:
            parts += _portal(road, points.at_distances(np.array([first + _BEFORE, first])), inward)
            continue
        tube = points.at_distances(first + inward * inside)
        away = np.minimum(inside, end - start - inside) if is_short else inside
        tone = 0.6 * np.exp(-np.maximum(away, 0.0) / _GLOOM)
        arch = _arch(road, tube, inward)
        parts.append(swept("concrete", arch[::-1], inside, tone=tone))
        half, outer = inward * tube.half_width, inward * (tube.half_width + tube.shoulder + 0.2)
        floor = [tube.beside(offset) for offset in (outer, half, -half, -outer)]
        parts += _carriageway(road, tube.along, floor, "concrete", tone)
        if not is_short:
            parts.append(flat_quads("concrete", _across([line[-1] for line in arch]), tone=0.0))
        parts += _portal(road, points.at_distances(np.array([first - inward * _BEFORE, first])), inward)
    return parts


def _across(arch: Sequence[Float64Array]) -> list[list[Float64Array]]:
    """Return the opening of an arch as quads that face a viewer to whom it begins on the left."""
    return [[arch[k], arch[-1 - k], arch[-2 - k], arch[k + 1]] for k in range(len(arch) // 2)]


def _arch(road: Road, points: AxisPoints, inward: float) -> list[Float64Array]:
    """Return lines (n, 3) of a tunnel's wall, from the left foot over its crown, seen inward."""
    room = _ROOM[road.layer]
    wide = points.half_width + points.shoulder + 0.15
    upright = 0.45 * room
    angle = np.linspace(0.0, np.pi, 13)
    section = [
        (1.0, -0.3),
        *((np.cos(a), upright + (room - upright) * np.sin(a)) for a in angle),
        (-1.0, -0.3),
    ]
    lines = []
    for across, height in section:
        line = points.position.copy()
        line[:, :2] += (inward * across * wide)[:, None] * points.left
        line[:, 2] += height
        lines.append(line)
    return lines


def _portal(road: Road, points: AxisPoints, inward: float) -> list[BuiltPart]:
    """Return a tunnel's front, with the walls and roof that lead back into the hill, and its opening."""
    material = "stone" if road.layer == "railway" else "concrete"
    arch = np.array([line[0] for line in _arch(road, points, inward)])
    room, at = _ROOM[road.layer], points.position[0]
    left = inward * points.left[0]
    wide = float(points.half_width[0] + points.shoulder[0]) + 1.6
    top = at[2] + room + 1.4
    # Points of the front's outline that face those of the arch.
    side = (arch[:, :2] - at[:2]) @ left
    rise = arch[:, 2] - at[2]
    reach = np.minimum(wide / np.maximum(np.abs(side), 1e-6), (room + 1.4) / np.maximum(rise, 1e-6))
    reach[[0, -1]] = wide / np.abs(side[[0, -1]])
    frame = np.column_stack([at[:2] + (side * reach)[:, None] * left, at[2] + rise * reach])
    for sign in (1.0, -1.0):
        corner = np.array([*(at[:2] + sign * wide * left), top])
        frame[np.argmin(np.linalg.norm(frame - corner, axis=1))] = corner
    front = [[arch[k], arch[k + 1], frame[k + 1], frame[k]] for k in range(len(arch) - 1)]
    back = (room + 1.4) / road.works.cut + 2.0 + _BEFORE
    ahead = np.array([left[1], -left[0]])
    ends = ((1.0, 0.0), (-1.0, 0.0), (-1.0, back), (1.0, back))
    hood = np.array([at[:2] + s * wide * left + d * ahead for s, d in ends])
    roof = np.column_stack([hood, np.full(4, top)])[None]
    coping = rectangle(at[:2] + 0.1 * ahead, ahead, 0.7, 2.0 * wide + 0.4)
    return [
        flat_quads(material, front),
        flat_quads(material, np.concatenate([prism_quads(hood, at[2] - 1.0, top)[1::2], roof])),
        extruded(material, coping, top - 0.1, top + 0.4),
        flat_quads(MOUTH, _across(list(arch))),
    ]
