"""Roads, railways, paths, buildings and what stands along lines on a map, in their layers' styles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.export.map.drawing import Points, Polygons, Polylines, Shape, rectangle, styled
from sketchterrain.export.map.relief import MapFrame
from sketchterrain.roads.road_types import BRIDGE, GROUND, STRUCTURES, TUNNEL, Road, RoadNetwork, axis_points
from sketchterrain.schema.layers import INK, LAYERS, WAY_LAYERS
from sketchterrain.schema.parameters import Properties
from sketchterrain.schema.styles import PIXEL, StyleClass, rgb_from_hex

PARAPET: Final = 0.3  # mm from the edge of a bridge's symbol to its side lines
DASHES: Final = "4.5 4.5"  # px, of tunnels
TOLERANCE: Final = 0.01  # mm

_INK: Final = rgb_from_hex(INK)
_WAYS: Final = [each for name in WAY_LAYERS for each in LAYERS[name].classes]  # the topmost first


class _Group(NamedTuple):
    """Lines and closed rings on the sheet (mm) in one style."""

    style: Properties
    lines: list[Points]
    rings: list[Points]


class _Line(NamedTuple):
    """A way on the sheet."""

    path: Points  # mm
    left: Points  # unit normals
    half: Float64Array  # mm


def draw_roads(network: RoadNetwork, frame: MapFrame) -> list[Shape]:
    """Return level ground, ways from the lowest to the highest, what stands along lines, and buildings."""
    lines: dict[tuple[int, str], list[_Line]] = {}
    for road in network.roads:
        points, drawn = axis_points(road, TOLERANCE / frame.mm_per_metre), class_of_road(road)
        half = np.maximum(points.half_width * frame.mm_per_metre, 0.5 * PIXEL * drawn.style["width"])
        line = _Line(frame.to_sheet(points.position), points.left * (1.0, -1.0), half)
        lines.setdefault((road.structure, drawn.title), []).append(line)
    ways: list[Shape] = []
    for structure in (TUNNEL, GROUND, BRIDGE):
        pairs = [
            _way(each.style, structure, lines[structure, each.title])
            for each in reversed(_WAYS)
            if (structure, each.title) in lines
        ]
        ways += [shape for below, _ in pairs for shape in below]
        ways += [shape for _, above in pairs for shape in above]
    others = _others(network, frame.to_sheet)
    beneath = _styled([others.pop("Level ground")]) if "Level ground" in others else []
    return [*beneath, *ways, *_styled(others.values())]


def _styled(groups: Iterable[_Group]) -> list[Shape]:
    """Return lines and rings of areas in the styles of their classes."""
    return [
        shape for style, lines, rings in groups for shape in styled(style, PIXEL, lines=lines, rings=rings)[1]
    ]


def _others(network: RoadNetwork, to_sheet: Callable[[Float64Array], Points]) -> dict[str, _Group]:
    """Return the rings of pads, and what stands along lines, by the titles of their classes."""
    found = dict[str, _Group]()
    for pad in sorted(network.pads, key=lambda each: each.building > 0.0):
        drawn = LAYERS["pad"].class_of(pad.building)
        ring = to_sheet(np.concatenate([pad.outline, pad.outline[:1]]))
        found.setdefault(drawn.title, _Group(drawn.style, [], [])).rings.append(ring)
    for each in network.standing:
        drawn = LAYERS[each.layer].class_of(each.values.get(LAYERS[each.layer].by, 0.0))
        found.setdefault(drawn.title, _Group(drawn.style, [], [])).lines.append(to_sheet(each.line))
    return found


def road_legend(network: RoadNetwork, width: float, height: float) -> list[tuple[str, list[Shape]]]:
    """Return title and symbol, of a width and height (mm), of all that is drawn of a network."""
    x = np.linspace(0.0, width, 9)
    path = np.stack([x, np.zeros(9)], axis=-1)
    left = np.array([[0.0, -1.0]] * 9)
    found = {(road.structure, class_of_road(road).title) for road in network.roads}

    def sample(drawn: StyleClass, structure: int) -> list[Shape]:
        line = _Line(path, left, np.full(9, 0.5 * PIXEL * drawn.style["width"]))
        below, above = _way(drawn.style, structure, [line])
        return [*below, *above]

    entries = [
        (each.title, sample(each, GROUND)) for each in _WAYS if any(each.title == title for _, title in found)
    ]
    for structure in (BRIDGE, TUNNEL):
        own = [each for each in _WAYS if (structure, each.title) in found]
        entries += [(STRUCTURES[structure].capitalize(), sample(own[0], structure))] if own else []
    patch = rectangle(0.3 * width, -0.3 * height, 0.4 * width, 0.6 * height)
    for title, (style, lines, _) in _others(network, lambda points: points).items():
        entries.append((title, _styled([_Group(style, *(([path], []) if lines else ([], [patch])))])))
    return entries


def class_of_road(road: Road) -> StyleClass:
    """Return the class of a way by its layer and its width with shoulders."""
    return LAYERS[road.layer].class_of(2.0 * float(road.whole_half.mean()))


def _way(style: Properties, structure: int, lines: Sequence[_Line]) -> tuple[list[Shape], list[Shape]]:
    """Return the shapes of ways of one class on one structure: those below all fills, and those above."""
    below, above = list[Shape](), list[Shape]()
    edge = PIXEL * style["casing_width"] if style["casing"] else 0.0
    if structure == BRIDGE:
        for line in lines:
            sides = _beside(line, line.half + PARAPET)
            deck = np.concatenate([sides[0], sides[1][::-1]])  # no round caps
            below += [Polygons([deck], (255, 255, 255)), Polylines(sides, _INK, 0.2)]
            below += [Polylines(_beside(line, line.half), _INK, 2.0 * edge)] if edge else []
    if structure == TUNNEL and edge:
        sides = [side for line in lines for side in _beside(line, line.half)]
        dashes = tuple(PIXEL * float(each) for each in DASHES.split())
        return [Polylines(sides, _INK, edge, dashes=dashes)], []
    if structure == TUNNEL and not style["dash"]:
        style = {**style, "dash": DASHES}
    widths: dict[float, list[Points]] = {}
    for line in lines:
        widths.setdefault(round(2.0 * float(line.half.mean()), 2) if edge else 0.0, []).append(line.path)
    for width, paths in widths.items():
        casings, strokes = styled(style, PIXEL, lines=paths, width=width)
        below += casings if structure == GROUND else []
        above += strokes
    return below, above


def _beside(line: _Line, off: Float64Array) -> list[Points]:
    return [line.path + side * off[:, None] * line.left for side in (1.0, -1.0)]
