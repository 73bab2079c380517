"""Roads, railways, paths, buildings, walls and hedges of a map, in the manner of topographic map series."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.export.map.drawing import Colour, Points, Polygons, Polylines, Shape, rectangle
from sketchterrain.export.map.features import along, arc_lengths
from sketchterrain.export.map.relief import MapFrame
from sketchterrain.roads.road_shapes import axis_points
from sketchterrain.roads.road_types import BRIDGE, GROUND, STRUCTURES, TUNNEL, Pad, Road, RoadNetwork, Wall

INK: Final[Colour] = (52, 46, 44)
BUILDING: Final[Colour] = (92, 78, 74)
YARD: Final[Colour] = (214, 200, 186)  # pads without a building
WALL, HEDGE = (112, 106, 102), (74, 122, 66)
CASING: Final = 0.12  # mm on each side of a road
TIE_SPACING, TIE = 3.0, 0.6  # mm between a railway's ties; their half length
PARAPET: Final = 0.3  # mm from the edge of a bridge's symbol to its side lines
DASHES: Final = (0.9, 0.9)  # mm of tunnels
TOLERANCE: Final = 0.01  # mm


class WaySymbol(NamedTuple):
    """How a class of ways is drawn."""

    title: str
    layer: str
    least: float  # m of carriageway and shoulders from which on a way is of this class
    width: float  # mm at least; wider where the map's scale shows it wider
    fill: Colour | None  # between casings; None: a line
    dashes: tuple[float, ...] = ()


SYMBOLS: Final = (
    WaySymbol("Railway", "railway", 0.0, 0.3, None),
    WaySymbol("Main road", "road", 8.5, 0.85, (232, 120, 92)),
    WaySymbol("Road", "road", 7.0, 0.7, (250, 208, 104)),
    WaySymbol("Minor road", "road", 4.0, 0.5, (255, 255, 255)),
    WaySymbol("Track", "road", 0.0, 0.24, None),
    WaySymbol("Path", "path", 0.0, 0.2, None, (1.1, 0.6)),
)
"""Classes of ways, the topmost first; a way is of the first that fits."""


class _Line(NamedTuple):
    """A way on the sheet."""

    path: Points  # mm
    left: Points  # unit normals
    half: Float64Array  # mm


def draw_roads(network: RoadNetwork, frame: MapFrame) -> list[Shape]:
    """Return yards, walls and ways from the lowest to the highest, then buildings."""
    lines: dict[tuple[int, WaySymbol], list[_Line]] = {}
    for road in network.roads:
        points = axis_points(road, TOLERANCE / frame.mm_per_metre)
        symbol = symbol_of(road)
        half = np.maximum(points.half_width * frame.mm_per_metre, 0.5 * symbol.width)
        line = _Line(frame.to_sheet(points.position), points.left * (1.0, -1.0), half)
        lines.setdefault((road.structure, symbol), []).append(line)
    shapes = [*_pads(network.pads, frame, built=False), *_walls(network.walls, frame)]
    for structure in (TUNNEL, GROUND, BRIDGE):
        drawn = [_way(symbol, structure, lines.get((structure, symbol), ())) for symbol in reversed(SYMBOLS)]
        shapes += [shape for below, _ in drawn for shape in below]
        shapes += [shape for _, above in drawn for shape in above]
    return [*shapes, *_pads(network.pads, frame, built=True)]


def road_legend(network: RoadNetwork, width: float, height: float) -> list[tuple[str, list[Shape]]]:
    """Return title and symbol, of a width and height (mm), of all that is drawn of a network."""
    x = np.linspace(0.0, width, 9)
    path = np.stack([x, np.zeros(9)], axis=-1)
    left = np.array([[0.0, -1.0]] * 9)
    found = {(road.structure, symbol_of(road)) for road in network.roads}

    def sample(symbol: WaySymbol, structure: int) -> list[Shape]:
        below, above = _way(symbol, structure, [_Line(path, left, np.full(9, 0.5 * symbol.width))])
        return [*below, *above]

    entries = [(each.title, sample(each, GROUND)) for each in SYMBOLS if any(each is of for _, of in found)]
    for structure in (BRIDGE, TUNNEL):
        own = [each for each in SYMBOLS if (structure, each) in found]
        entries += [(STRUCTURES[structure].capitalize(), sample(own[0], structure))] if own else []
    patch = rectangle(0.3 * width, -0.3 * height, 0.4 * width, 0.6 * height)
    for built, title in ((True, "Building"), (False, "Level ground")):
        if any((pad.building > 0.0) == built for pad in network.pads):
            entries.append((title, _pad_shapes([patch[:-1]], built=built)))
    for material, title in (("stone", "Wall"), ("hedge", "Hedge")):
        if any(wall.material == material for wall in network.walls):
            entries.append((title, [_wall_shape([path], material)]))
    return entries


def symbol_of(road: Road) -> WaySymbol:
    """Return the class of a way by its layer and its width with shoulders."""
    width = 2.0 * float(road.whole_half.mean())
    return next(each for each in SYMBOLS if each.layer == road.layer and width >= each.least)


def _way(symbol: WaySymbol, structure: int, lines: Sequence[_Line]) -> tuple[list[Shape], list[Shape]]:
    """Return the shapes of ways of one class on one structure: those below all fills, and those above."""
    below: list[Shape] = []
    above: list[Shape] = []
    if structure == BRIDGE:
        for line in lines:
            sides = _beside(line, line.half + PARAPET)
            deck = np.concatenate([sides[0], sides[1][::-1]])  # no round caps
            below += [Polygons([deck], (255, 255, 255)), Polylines(sides, INK, 0.2)]
            if symbol.fill is not None:
                below.append(Polylines(_beside(line, line.half), INK, 2.0 * CASING))
    if structure == TUNNEL and symbol.fill is not None:
        sides = [side for line in lines for side in _beside(line, line.half)]
        return [Polylines(sides, INK, CASING, dashes=DASHES)] if sides else [], []
    if symbol.fill is None:
        dashes = symbol.dashes or (DASHES if structure == TUNNEL else ())
        above += [Polylines([line.path for line in lines], INK, symbol.width, dashes=dashes)] if lines else []
    else:
        widths: dict[float, list[Points]] = {}
        for line in lines:
            widths.setdefault(round(2.0 * float(line.half.mean()), 2), []).append(line.path)
        for width, paths in widths.items():
            if structure == GROUND:
                below.append(Polylines(paths, INK, width + 2.0 * CASING))
            above.append(Polylines(paths, symbol.fill, width))
    if symbol.layer == "railway" and structure != TUNNEL and lines:
        above.append(Polylines([tie for line in lines for tie in _ties(line)], INK, 0.16))
    return below, above


def _beside(line: _Line, off: Float64Array) -> list[Points]:
    return [line.path + side * off[:, None] * line.left for side in (1.0, -1.0)]


def _ties(line: _Line) -> list[Points]:
    """Return short lines across a railway."""
    arc = arc_lengths(line.path)
    lengths = np.arange(0.5 * TIE_SPACING, arc[-1], TIE_SPACING)
    middle, left = (along(values, arc, lengths) for values in (line.path, line.left))
    return list(np.stack([middle - TIE * left, middle + TIE * left], axis=1))


def _pads(pads: Sequence[Pad], frame: MapFrame, *, built: bool) -> list[Shape]:
    rings = [frame.to_sheet(pad.outline) for pad in pads if (pad.building > 0.0) == built]
    return _pad_shapes(rings, built=built) if rings else []


def _pad_shapes(rings: list[Points], *, built: bool) -> list[Shape]:
    outlines = [np.concatenate([ring, ring[:1]]) for ring in rings]
    colour = BUILDING if built else YARD
    return [Polygons(rings, colour), Polylines(outlines, colour if built else WALL, 0.1)]


def _walls(walls: Sequence[Wall], frame: MapFrame) -> list[Shape]:
    lines: dict[str, list[Points]] = {}
    for wall in walls:
        lines.setdefault(wall.material, []).append(frame.to_sheet(wall.line))
    return [_wall_shape(paths, material) for material, paths in lines.items()]


def _wall_shape(paths: list[Points], material: str) -> Shape:
    if material == "hedge":
        return Polylines(paths, HEDGE, 0.42, dashes=(0.01, 0.55))  # round dots
    return Polylines(paths, WALL, 0.18)
