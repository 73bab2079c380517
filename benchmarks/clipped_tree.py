"""Quadtree of clipped pieces (Bruneton & Neyret 2008), as a rival of the index of boxes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeAlias

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array, LatticeArray
from sketchterrain.benchmarks.plotting import Curves, draw_curves
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.benchmarks.synthetic_land import EXTENT, SEED, synthetic_land
from sketchterrain.benchmarks.timing import lap
from sketchterrain.geometry.box_index import BoxIndex
from sketchterrain.geometry.lattice import LATTICE_BITS, to_lattice
from sketchterrain.landuse.areas import land_use

_NONE = np.zeros(0, np.int64)
_DELTA = 16  # a quad's changes are merged with its pieces once they are this share of them
_Key: TypeAlias = tuple[int, int, int]
"""Level, column and row of a quad."""


@dataclass(frozen=True, eq=False)
class _Quad:
    """Pieces of a quad by ascending id: those that it was made with, and changes since."""

    made: Int64Array
    removed: Int64Array  # of these
    added: Int64Array  # later ids are greater

    def pieces(self) -> Int64Array:
        if not len(self.removed) and not len(self.added):
            return self.made
        left = np.delete(self.made, np.searchsorted(self.made, self.removed))
        return np.concatenate([left, self.added])

    def present(self, ids: Int64Array) -> Int64Array:
        """Return those of some ids that are pieces of it."""
        made = _is_in(ids, self.made) & ~_is_in(ids, self.removed)
        return np.asarray(ids[made | _is_in(ids, self.added)])

    def updated(self, removed: Int64Array, added: Int64Array) -> _Quad:
        was_added = _is_in(removed, self.added)
        left = np.delete(self.added, np.searchsorted(self.added, removed[was_added]))
        gone = np.union1d(self.removed, removed[~was_added])
        changed = _Quad(self.made, gone, np.concatenate([left, added]))
        if _DELTA * (len(gone) + len(changed.added)) <= len(self.made):
            return changed
        return _Quad(changed.pieces(), _NONE, _NONE)


def _is_in(ids: Int64Array, among: Int64Array) -> Any:
    if not len(among):
        return np.zeros(len(ids), np.bool_)
    place = np.searchsorted(among, ids)
    return among[np.minimum(place, len(among) - 1)] == ids


class ClippedTree:
    """Quads that hold the pieces whose boxes touch them, each made from its parent's when it is asked for.

    A piece keeps its id in all quads, so that what a quad has created from a parent's piece (B10) is found by
    a binary search in its own ids. The least recently used quads are dropped, none before its children.

    Parameters
    ----------
    boxes : (n, 4) west, south, east, north of pieces, lattice units; their ids count from 0
    capacity : quads that are kept
    """

    def __init__(self, boxes: LatticeArray, *, capacity: int = 1 << 13) -> None:
        self.boxes, self.count = boxes, len(boxes)
        self.visited = 0  # pieces that the update that made it has visited
        self._capacity = capacity
        self._quads: dict[_Key, _Quad] = {}  # the least recently used first

    @property
    def nbytes(self) -> int:
        """Bytes of the quads' pieces, without the boxes."""
        return sum(q.made.nbytes + q.removed.nbytes + q.added.nbytes for q in self._quads.values())

    def pieces(self, level: int, column: int, row: int) -> Int64Array:
        """Return the ids, ascending, of the pieces that touch a quad, borders included."""
        return self._quad((level, column, row)).pieces()

    def updated(self, removed: Int64Array, boxes: LatticeArray) -> ClippedTree:
        """Return the tree without some pieces and with others of the next ids; only quads they touch differ.

        Algorithm 6.1 of the paper: from the root down, where something is removed or added.
        """
        total = self.count + len(boxes)
        if total > len(self.boxes) or self.boxes.base is None:
            room = np.empty((total + (total >> 3), 4), np.int64)
            room[: self.count] = self.boxes[: self.count]
            self.boxes = room[:]
        self.boxes[self.count : total] = boxes
        tree = ClippedTree(self.boxes, capacity=self._capacity)
        tree.count, tree._quads = total, self._quads.copy()
        added = np.arange(self.count, total)
        changed = np.concatenate([self.boxes[removed], boxes])
        low, high = changed[:, :2].min(axis=0).tolist(), changed[:, 2:].max(axis=0).tolist()
        pending: list[tuple[_Key, Int64Array, Int64Array]] = [((0, 0, 0), np.sort(removed), added)]
        while pending:
            key, gone, new = pending.pop()
            quad, place = tree._quads.get(key), [each << (LATTICE_BITS - key[0]) for each in key[1:]]
            width = 1 << (LATTICE_BITS - key[0])
            if quad is None or any(
                at > most or at + width < least for at, least, most in zip(place, low, high, strict=True)
            ):
                continue
            gone, new = quad.present(gone), new[tree._touching(key, new)]
            if len(gone) or len(new):
                tree.visited += len(gone) + len(new)
                tree._quads[key] = quad.updated(gone, new)
                level, column, row = key
                children = [(level + 1, 2 * column + i, 2 * row + j) for i in (0, 1) for j in (0, 1)]
                pending += [(child, gone, new) for child in children]
        return tree

    def _quad(self, key: _Key) -> _Quad:
        level, column, row = key
        quad = self._quads.get(key)
        if quad is None:
            parent = (level - 1, column >> 1, row >> 1)
            above = self._quad(parent).pieces() if level else np.arange(self.count)
            quad = self._quads[key] = _Quad(above[self._touching(key, above)], _NONE, _NONE)
            if len(self._quads) > self._capacity:
                del self._quads[next(iter(self._quads))]
        for up in range(level + 1):
            each = (level - up, column >> up, row >> up)
            if each in self._quads:
                self._quads[each] = self._quads.pop(each)
        return quad

    def _touching(self, key: _Key, ids: Int64Array) -> Any:
        level, column, row = key
        width, box = 1 << (LATTICE_BITS - level), self.boxes[ids]
        west, south = column * width, row * width
        return (
            (box[:, 0] <= west + width)
            & (box[:, 2] >= west)
            & (box[:, 1] <= south + width)
            & (box[:, 3] >= south)
        )


SIDE: Final = 16
"""Tiles along a side of a view."""
_MOVED = 20.0  # m by which a corner is moved at most
_LEVELS = (7, 9)
_MIDDLE = ((1 << _LEVELS[-1]) - SIDE) // 2, ((1 << _LEVELS[-1]) - SIDE) // 2

_HEADINGS = {"again9_ms": "level 9 again, ms", "changed": "pieces changed an edit"}


class BoxRival:
    """The index of boxes that layers use, with changes of boxes of pieces by their numbers."""

    name = "boxes, base and changes"

    def __init__(self, boxes: LatticeArray) -> None:
        self.index, self.visited = BoxIndex(boxes), 0

    def view(self, level: int, column: int, row: int) -> list[Int64Array]:
        """Return the pieces that touch each of the tiles of a view."""
        low = np.array(_view(column, row)) << (LATTICE_BITS - level)
        blocks = np.concatenate([low, low + (1 << (LATTICE_BITS - level))], axis=1)
        block, item = self.index.touching(blocks)
        return np.split(item, np.searchsorted(block, np.arange(1, len(blocks))))

    def edit(self, numbers: Int64Array, boxes: LatticeArray) -> None:
        """Change the boxes of some pieces, by ascending numbers."""
        self.index = self.index.updated(numbers, numbers, boxes)
        edits = self.index._edits
        self.visited = 0 if edits is None else len(edits.removed) + len(edits.added)

    @property
    def nbytes(self) -> int:
        """Bytes of the cells, without the boxes."""
        return sum(each.nbytes for each in self.index._cells or ())


class TreeRival:
    """The clipped tree, and which of its ids each piece has."""

    name = "clipped tree"

    def __init__(self, boxes: LatticeArray) -> None:
        self.tree, self.ids = ClippedTree(boxes), np.arange(len(boxes))
        self._numbers = np.arange(len(boxes))

    def view(self, level: int, column: int, row: int) -> list[Int64Array]:
        """Return the pieces that touch each of the tiles of a view, ascending by id."""
        return [self._numbers[self.tree.pieces(level, *place)] for place in _view(column, row)]

    def edit(self, numbers: Int64Array, boxes: LatticeArray) -> None:
        """Change the boxes of some pieces, by ascending numbers."""
        before = self.tree.count
        self.tree = self.tree.updated(self.ids[numbers], boxes)
        self.ids[numbers] = np.arange(before, self.tree.count)
        if self.tree.count > len(self._numbers):
            self._numbers = np.append(self._numbers, np.empty(len(self._numbers) >> 3 | 64, np.int64))
        self._numbers[before : self.tree.count] = numbers

    @property
    def visited(self) -> int:
        """Pieces that the last edit visited."""
        return self.tree.visited

    @property
    def nbytes(self) -> int:
        """Bytes of the quads' pieces, without the boxes."""
        return self.tree.nbytes


def _view(column: int, row: int) -> list[tuple[int, int]]:
    return [(column + i, row + j) for j in range(SIDE) for i in range(SIDE)]


def piece_boxes(side: int) -> LatticeArray:
    """Return boxes (n, 4) of the pieces of borders of a synthetic country, lattice units."""
    edges = land_use(synthetic_land(side)).edges
    ends: Float64Array = edges.reshape(-1, 2, 2)
    return to_lattice(np.concatenate([ends.min(axis=1), ends.max(axis=1)], axis=1), EXTENT)


def random_edit(index: BoxIndex, rng: np.random.Generator) -> tuple[Int64Array, LatticeArray]:
    """Return the pieces at a corner, as one that is dragged, and their boxes afterwards."""
    corner = index.boxes_of(rng.integers(0, len(index), 1))[0, :2]
    _, numbers = index.touching(np.concatenate([corner, corner])[None])
    way = to_lattice(rng.uniform(-_MOVED, _MOVED, 2), EXTENT)
    return numbers, index.boxes_of(numbers) + np.tile(way, 2)


def index_table(sides: Sequence[int], *, views: int, edits: int) -> Table:
    """Compare both, from few pieces to many, at one density."""
    rows = [row for side in sides for row in _rows(piece_boxes(side), views, edits)]
    return Table("Index of pieces", tuple(rows), _HEADINGS)


def _rows(boxes: LatticeArray, views: int, edits: int) -> Iterator[Row]:
    rng, plain = np.random.default_rng(SEED), BoxRival(boxes)
    rivals: tuple[BoxRival | TreeRival, ...] = (plain, TreeRival(boxes))
    build = [lap(partial(rival.view, _LEVELS[-1], *_MIDDLE)).wall for rival in rivals]
    looks: dict[tuple[int, str, int], list[float]] = {}
    for level in _LEVELS:
        for corner in _corners(boxes, level, rng, views):
            for which, rival in enumerate(rivals):
                for when in ("new", "again"):
                    looks.setdefault((which, when, level), []).append(
                        lap(partial(rival.view, level, *corner)).wall
                    )
    changing, viewing, visited, changed = np.zeros((4, len(rivals), edits))
    for number in range(edits):
        pieces, moved = random_edit(plain.index, rng)
        place = ((moved[0, :2] >> (LATTICE_BITS - _LEVELS[-1])) - SIDE // 2).tolist()
        for which, rival in enumerate(rivals):
            rival.view(_LEVELS[-1], *place)  # it is what one looks at
            changing[which, number] = lap(partial(rival.edit, pieces, moved)).wall
            viewing[which, number] = lap(partial(rival.view, _LEVELS[-1], *place)).wall
            visited[which, number] = rival.visited
            changed[which, number] = 2 * len(pieces)
    for which, rival in enumerate(rivals):
        row: dict[str, Any] = {"pieces": len(boxes), "index": rival.name, "build_ms": 1e3 * build[which]}
        for (of, when, level), seconds in looks.items():
            if of == which:
                row[f"{when}{level}_ms"] = 1e3 * float(np.median(seconds))
        for name, seconds in (("edit", changing[which]), ("view", viewing[which])):
            median, p95, most = (1e3 * np.percentile(seconds, (50, 95, 100))).tolist()
            row |= {f"{name}_ms": median, f"{name}_p95_ms": p95, f"{name}_most_ms": most}
        row["changed"] = float(np.mean(changed[which]))
        row["visited"] = float(np.median(visited[which]))
        yield row | {"memory_mb": rival.nbytes * 1e-6}


def _corners(boxes: LatticeArray, level: int, rng: np.random.Generator, count: int) -> list[tuple[int, int]]:
    """Return south-west tiles of views within the country."""
    bits = LATTICE_BITS - level
    low, high = boxes[:, :2].min(axis=0) >> bits, (boxes[:, 2:].max(axis=0) >> bits) - SIDE
    places = low + np.rint(rng.random((count, 2)) * np.maximum(high - low, 0)).astype(np.int64)
    return [(int(column), int(row)) for column, row in places]


_LINES = {
    "first view from nothing": "build_ms",
    f"{SIDE**2} new tiles": "new9_ms",
    "edit, 95 %": "edit_p95_ms",
    "its view after it, 95 %": "view_p95_ms",
}
_PANEL = Curves("", "pieces", _LINES, by="index", units=("pieces", "ms"))
draw_index = partial(draw_curves, "Index of pieces at one density: boxes and a clipped tree", [_PANEL])
