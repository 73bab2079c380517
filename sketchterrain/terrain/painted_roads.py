"""Roads as appearance tiles paint them: pieces with widths, surfaces and markings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array, LatticeArray
from sketchterrain.geometry.box_index import BoxIndex
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.io.resources import kernel_columns
from sketchterrain.roads.road_types import BRIDGE, GROUND, Road, RoadNetwork
from sketchterrain.schema.layers import LANE_WIDTHS
from sketchterrain.terrain.centrelines import arc_boxes

_PIECE: Final = kernel_columns("appearance.clh", "PaintedRoad")
_SURFACES: Final = {"asphalt": 0, "gravel": 1, "soil": 2, "rock": 3}
_RAILS: Final = 4
_MARKED: Final = 5.0  # m: carriageways of asphalt have marks from this width on
_FRAY: Final = 0.5  # m by which noise widens roads
_UNDER: Final = 3.0  # m that roads continue under bridges


_Pieces = tuple[LatticeArray, Float64Array, Float64Array, LatticeArray]
"""Pieces of a road: the first three fields of `PaintedRoads`, and boxes."""
_NO_PIECES: Final = np.zeros((0, 2), np.int64), np.zeros((0, 16)), np.zeros(0), np.zeros((0, 4), np.int64)


class PaintedRoads(NamedTuple):
    """Pieces as the kernel reads them, the index of their boxes, and those of each road."""

    at: LatticeArray  # (n, 2) starts, lattice units
    row: Float64Array  # (n, 16) columns of `_PIECE`
    half_width: Float64Array  # (n,) half the greatest width with shoulders, m
    boxes: BoxIndex
    roads: Mapping[tuple[Any, ...], _Pieces]  # by what they depend on, see `_pieces`

    def without(self, other: PaintedRoads) -> Int64Array:
        """Return the numbers of pieces of roads that the other ones lack."""
        own = [key not in other.roads for key in self.roads]
        return np.flatnonzero(np.repeat(own, [len(at) for at, *_ in self.roads.values()]))

    def as_bytes(self, numbers: Int64Array) -> npt.NDArray[np.void]:
        """Return each of some pieces as one value."""
        rows = np.column_stack([self.at[numbers].view(np.float64), self.row[numbers]])
        return np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()


def painted_roads(network: RoadNetwork, extent: float, before: PaintedRoads | None = None) -> PaintedRoads:
    """Return the pieces of all roads on the ground; what is the same as before is shared."""
    known = {} if before is None else before.roads
    others = {(road.leg, road.part): road.structure for road in network.roads if road.structure != GROUND}
    lengths: dict[int, float] = defaultdict(float)
    for road in network.roads:
        lengths[road.leg] = max(lengths[road.leg], float(road.along[-1]))
    ends, roads = _junctions(network), dict[tuple[Any, ...], _Pieces]()
    for road in network.roads:
        if road.structure == GROUND:
            beside = tuple(others.get((road.leg, road.part + step), GROUND) for step in (-1, 1))
            key = road, tuple(ends[road.leg]), lengths[road.leg], beside
            roads[key] = known.get(key) or _pieces(key, extent)
    at, row, half_width, boxes = map(np.concatenate, zip(_NO_PIECES, *roads.values(), strict=True))
    found = PaintedRoads(at, row, half_width, BoxIndex(boxes), roads)
    if before is None or [key for key in roads if key in known] != [key for key in known if key in roads]:
        return found
    added = found.without(before)
    return found._replace(boxes=before.boxes.updated(before.without(found), added, boxes[added]))


def _pieces(key: tuple[Any, ...], extent: float) -> _Pieces:
    """Return the pieces of a road by its `_junctions`, its leg's length (m) and the structures beside it."""
    road, ((clear, gives_way), (clear_end, gives_way_end)), length, beside = key
    count = len(road.bend)
    row = np.zeros((count, 16))
    chord = np.diff(road.axis[:, :2], axis=0)
    row[:, :2], row[:, 2] = chord, 1.0 / np.maximum((chord**2).sum(axis=1), 1e-12)
    row[:, _PIECE["piece_bend"]] = road.bend
    for name, values in (("half", road.half_width), ("whole", road.whole_half)):
        row[:, _PIECE[f"piece_from_{name}"]] = values[:-1]
        row[:, _PIECE[f"piece_to_{name}"]] = values[1:]
    row[:, _PIECE["piece_start"]] = road.along[:-1]
    row[:, _PIECE["piece_length"]] = np.diff(road.along)
    row[:, _PIECE["piece_clear"]] = clear
    row[:, _PIECE["piece_marked"]] = length - clear_end
    lane = LANE_WIDTHS[road.layer]
    row[:, _PIECE["piece_lanes"]] = max(round(2.0 * float(road.half_width.mean()) / lane), 1)
    surface = _RAILS if road.layer == "railway" else _SURFACES.get(road.works.surface, 1)
    row[:, _PIECE["piece_surface"]] = surface
    row[:, _PIECE["piece_ends"]] = 4 * gives_way + 8 * gives_way_end
    row[0, _PIECE["piece_ends"]] += beside[0] != GROUND
    row[-1, _PIECE["piece_ends"]] += 2 * (beside[1] != GROUND)
    marked = surface == 0 and 2.0 * float(road.half_width.min()) >= _MARKED
    row[:, _PIECE["piece_marks"]] = marked
    starts, rows = [road.axis[:-1, :2]], [row]
    for structure, end, step in zip(beside, (0, -1), (-1, 1), strict=True):
        if structure == BRIDGE:
            place, beyond = _under_bridge(road, row[end], end, step)
            starts.append(place)
            rows.append(beyond)
    at, row = to_lattice(np.concatenate(starts), extent), np.concatenate(rows)
    wide = row[:, [_PIECE["piece_from_whole"], _PIECE["piece_to_whole"]]].max(axis=1)
    boxes = arc_boxes(at, row[:, :2], row[:, _PIECE["piece_bend"]], wide + _FRAY, metres_per_unit(extent))
    return at, row, wide, boxes


def _under_bridge(road: Road, row: Float64Array, end: int, step: int) -> tuple[Float64Array, Float64Array]:
    """Return the start (1, 2) and row (1, 16) of a straight piece from an end of a road under a bridge."""
    turn = -2.0 * step * np.arctan(road.bend[end])
    cos, sin = _UNDER * np.cos(turn), _UNDER * np.sin(turn)
    chord = np.array([[cos, -sin], [sin, cos]]) @ row[:2] * np.sqrt(row[2])
    beyond = row[None].copy()
    beyond[0, :2], beyond[0, 2] = chord, 1.0 / _UNDER**2
    for name, values in (("half", road.half_width), ("whole", road.whole_half)):
        beyond[0, [_PIECE[f"piece_from_{name}"], _PIECE[f"piece_to_{name}"]]] = values[end]
    beyond[0, _PIECE["piece_bend"]] = 0.0
    beyond[0, _PIECE["piece_start"]] = road.along[end] - _UNDER * (step < 0)
    beyond[0, _PIECE["piece_length"]] = _UNDER
    beyond[0, _PIECE["piece_ends"]] = row[_PIECE["piece_ends"]] // 4 * 4 + (1 if step < 0 else 2)
    return (road.axis[end, :2] - chord * (step < 0))[None], beyond


def _junctions(network: RoadNetwork) -> dict[int, list[tuple[float, bool]]]:
    """Return how far (m) marks stay away from each leg's start and end, and whether traffic stops there.

    At a junction of three the two legs that are most nearly straight have the right of way; at larger ones
    none has.
    """
    at_node: dict[tuple[float, float], list[tuple[int, int, float, Float64Array, bool]]] = defaultdict(list)
    found: dict[int, list[tuple[float, bool]]] = {}
    for road in network.roads:
        found.setdefault(road.leg, [(0.0, False), (0.0, False)])
        for end, (place, inward, ways) in enumerate(((0, 1, road.ends[0]), (-1, -2, road.ends[1]))):
            if ways < 3:
                continue
            ahead = road.axis[inward, :2] - road.axis[place, :2]
            node = road.axis[place, 0].item(), road.axis[place, 1].item()
            width = float(road.whole_half[place]) if road.layer == "road" else 0.0
            at_node[node].append((road.leg, end, width, ahead / np.hypot(*ahead), road.layer == "road"))
    for arms in at_node.values():
        through = _through([arm[3] for arm in arms]) if len(arms) == 3 else ()
        for number, (leg, end, width, _, is_road) in enumerate(arms):
            others = [arm[2] for k, arm in enumerate(arms) if k != number]
            gives_way = is_road and number not in through and max(others) > 0.0
            found[leg][end] = max(*others, width) + 1.0 if max(others) > 0.0 else 0.0, gives_way
    return found


def _through(ways: Sequence[Float64Array]) -> tuple[int, int]:
    """Return the two of three unit vectors that are most nearly opposite."""
    pairs = ((0, 1), (0, 2), (1, 2))
    return min(pairs, key=lambda pair: float(ways[pair[0]] @ ways[pair[1]]))
