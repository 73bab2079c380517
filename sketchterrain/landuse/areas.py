"""Areas of land use as arrays: what each is, and its borders."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array, Int64Array
from sketchterrain.features.table import FeatureTable, InPieces, starts
from sketchterrain.geometry.hashing import hash_unit
from sketchterrain.schema.layers import CROPS, LAND_USES
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

FIELD, MEADOW, FOREST, BUILT_UP = range(len(LAND_USES))
_COMMON: Final = ("wheat", "wheat", "wheat", "wheat", "maize", "maize", "rapeseed", "ploughed")
_STEEP: Final = 0.06  # slope from which on rows of crops follow the contours
_SLOPE_CELL: Final = 16.0  # m: of the ground whose slope they follow
_CROSS: Final = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
_MANY_PIECES = 64  # from which on edges are joined: that takes longer than to search as many
AUTOMATIC: Final = 0
"""Crop of fields whose crop follows from their ids."""


@dataclass(frozen=True, eq=False)
class LandUse(InPieces):
    """Areas by ascending id. Where areas overlap, the one of the higher id is on top.

    Neighbours share their borders vertex by vertex: the shares of a square that they cover add up to 1.
    Those of a large layer consist of `pieces`, those of pieces of the layer, and share with those before an
    edit what did not change.
    """

    ids: Int64Array = field(default_factory=lambda: np.zeros(0, np.int64))  # (n,) of the vectors
    use: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))  # (n,) of `LAND_USES`
    crop: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))  # (n,) of `CROPS`
    # (n,) ° of its rows, 0 north, 90 east; -1: along the contours
    direction: Float64Array = field(default_factory=lambda: np.zeros(0))
    density: Float64Array = field(default_factory=lambda: np.zeros(0))  # (n,) share of a full stand of trees
    conifers: Float64Array = field(default_factory=lambda: np.zeros(0))  # (n,) share; -1: by elevation
    parcels: Float64Array = field(default_factory=lambda: np.zeros(0))  # (n,) m, width of strips; 0: one
    # (n + 1,) area i has the edges first[i] … first[i + 1]: it lies to their left
    first: Int64Array = field(default_factory=lambda: np.zeros(1, np.int64))
    edges: Float64Array = field(default_factory=lambda: np.zeros((0, 4)))  # (m, 4) x and y of both ends, m

    def __len__(self) -> int:
        return len(self.ids)

    def edges_of(self, areas: Int64Array) -> tuple[Int64Array, Int64Array]:
        """Return for each edge of some areas, in their order, the area's place among them and its number."""
        counts = self.counts[areas]
        area = np.repeat(np.arange(len(areas)), counts)
        start = self.first[areas] - (np.cumsum(counts) - counts)
        return area, np.arange(len(area)) + start[area]

    def outlines(self, areas: Int64Array) -> tuple[Int64Array, Float64Array]:
        """Return for each edge of some areas the area's place among them, and its ends, (m, 4)."""
        area, edge = self.edges_of(areas)
        bounds = starts([int(piece.first[-1]) for piece in self.pieces])
        of = np.searchsorted(bounds, edge, side="right") - 1
        used = np.flatnonzero(np.bincount(of))
        if len(used) > _MANY_PIECES or len(self.pieces) == 1:
            return area, self.edges[edge]
        edges = np.empty((len(edge), 4))
        for piece in used.tolist():
            own = np.flatnonzero(of == piece)
            edges[own] = self.pieces[piece].edges[edge[own] - bounds[piece]]
        return area, edges

    def crops(self, areas: Int64Array) -> npt.NDArray[np.uint8]:
        """Return the crops of areas; those of automatic ones by their ids: much wheat, some of the others."""
        common = np.array([CROPS.index(name) for name in _COMMON], np.uint8)
        draw = hash_unit(0, "crop of a field", self.ids[areas])
        own = common[np.minimum((draw * len(common)).astype(np.int64), len(common) - 1)]
        return np.where(self.crop[areas] == AUTOMATIC, own, self.crop[areas])

    def bearings(self, areas: Int64Array, heights: Callable[..., Float32Array]) -> Float64Array:
        """Return the directions (°) of rows of crops: as given, along contours, or along the longest side.

        ``heights`` are those (m) of the ground at positions x and y (m), given a ``cell_size`` (m).
        """
        found = self.direction[areas].copy()
        own = np.flatnonzero((found < 0.0) & (self.use[areas] != FOREST))
        if not len(own):
            return found
        area, edges = self.outlines(areas[own])
        first = starts(np.bincount(area))
        low, high = (reduce.reduceat(edges[:, :2], first[:-1]) for reduce in (np.minimum, np.maximum))
        step = np.maximum(0.25 * (high - low).max(axis=1), _SLOPE_CELL)
        places = np.concatenate([0.5 * (low + high) + step[:, None] * np.array(way) for way in _CROSS])
        z = heights(*places.T, cell_size=_SLOPE_CELL).reshape(4, -1)
        east, north = (z[0] - z[1]) / (2.0 * step), (z[2] - z[3]) / (2.0 * step)
        contour = np.degrees(np.arctan2(-north, east)) % 180.0
        ways = edges[:, 2:] - edges[:, :2]
        # The longest edge of each: the last one by length.
        longest = ways[np.lexsort(((ways**2).sum(axis=1), area))[first[1:] - 1]]
        side = np.degrees(np.arctan2(*longest.T)) % 180.0
        found[own] = np.where(np.hypot(east, north) > _STEEP, contour, side)
        return found

    def difference(self, old: LandUse) -> tuple[Int64Array, Int64Array]:
        """Return the areas that only the old and only this one has, bit for bit, ascending."""
        if self is old:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        if shared := set(self.pieces) & set(old.pieces):
            (mine_left, rows), (old_left, old_rows) = self._without(shared), old._without(shared)
            removed, added = mine_left.difference(old_left)
            return old_rows[removed], rows[added]
        place = np.minimum(np.searchsorted(old.ids, self.ids), max(len(old) - 1, 0))
        mine = np.flatnonzero(old.ids[place] == self.ids) if len(old) else np.zeros(0, np.int64)
        theirs = place[mine]
        same = self.counts[mine] == old.counts[theirs]
        for name in _COLUMNS[1:]:
            same &= getattr(self, name)[mine] == getattr(old, name)[theirs]
        mine, theirs = mine[same], theirs[same]
        of, rows = self.edges_of(mine)
        differ = (self.edges[rows] != old.edges[old.edges_of(theirs)[1]]).any(axis=1)
        differs = np.bincount(of[differ], minlength=len(mine)) > 0
        left = np.ones(len(old), np.bool_), np.ones(len(self), np.bool_)
        left[0][theirs[~differs]] = left[1][mine[~differs]] = False
        return np.flatnonzero(left[0]), np.flatnonzero(left[1])

    def _without(self, pieces: Collection[LandUse]) -> tuple[LandUse, Int64Array]:
        """Return the areas of all pieces but some, and their rows."""
        first = starts([len(piece) for piece in self.pieces]).tolist()
        rest = [(piece, row) for piece, row in zip(self.pieces, first, strict=False) if piece not in pieces]
        rows = [np.arange(row, row + len(piece)) for piece, row in rest]
        return _joined([piece for piece, _ in rest]), np.concatenate([np.zeros(0, np.int64), *rows])

    @cached_property
    def counts(self) -> Int64Array:
        """Number of edges of each area, (n,)."""
        return np.diff(self.first)


NO_LAND_USE: Final = LandUse()


def land_use(sketch: Sketch, run: Runner | None = None) -> LandUse:
    """Return the areas of a sketch's land use; unchanged pieces of an edited layer keep theirs."""
    layer, labels = sketch.vectors["landuse"], part_of(sketch, "labels.landuse")
    run = Runner() if run is None else run
    if not len(layer):
        return NO_LAND_USE
    pieces = [run(_areas_of, labels, piece, hashed=False) for piece in layer.pieces]
    if any(before.ids[-1] >= after.ids[0] for before, after in pairwise(pieces)):
        return _by_id(_joined(pieces))
    return pieces[0] if len(pieces) == 1 else LandUse.of_pieces(pieces)


def _areas_of(sketch: Sketch, layer: FeatureTable) -> LandUse:
    after = np.arange(1, len(layer.vertices) + 1)
    after[layer.rings[1:] - 1] = layer.rings[:-1]

    def indices(name: str, choices: tuple[str, ...]) -> npt.NDArray[np.uint8]:
        return np.array(
            [choices.index(text) for text in sketch.vector_texts("landuse", name, layer)], np.uint8
        )

    direction, density, conifers, parcels = (
        sketch.vector_values("landuse", name, layer) for name in _COLUMNS[3:]
    )
    use, crop = indices("use", LAND_USES), indices("crop", CROPS)
    edges = np.concatenate([layer.vertices, layer.vertices[after]], axis=1)
    # Borders run counter-clockwise, those of holes clockwise: kernels add up signed areas.
    x, y, to_x, to_y = (edges - np.tile(layer.vertices[layer.rings[:-1]], 2)[layer.ring_of_vertex]).T
    cross = x * to_y - y * to_x
    is_border = np.isin(np.arange(len(layer.rings) - 1), layer.parts[:-1])
    turned = ((np.add.reduceat(cross, layer.rings[:-1]) > 0.0) != is_border)[layer.ring_of_vertex]
    edges[turned] = np.roll(edges[turned], 2, axis=1)
    return _by_id(
        LandUse(layer.ids, use, crop, direction, density, conifers, parcels, layer.rings[layer.parts], edges)
    )


def _by_id(areas: LandUse) -> LandUse:
    """Return areas by ascending id."""
    order = np.argsort(areas.ids, kind="stable")
    columns: dict[str, Any] = {name: getattr(areas, name)[order] for name in _COLUMNS}
    first = starts(np.diff(areas.first)[order])
    return LandUse(**columns, first=first, edges=areas.edges[areas.edges_of(order)[1]])


_COLUMNS: Final = tuple(each.name for each in fields(LandUse))[:-2]


def _joined(pieces: Sequence[LandUse]) -> LandUse:
    """Return the areas of all pieces as one."""
    whole = LandUse.of_pieces([NO_LAND_USE, *pieces])
    return LandUse(*(getattr(whole, each.name) for each in fields(LandUse)))
