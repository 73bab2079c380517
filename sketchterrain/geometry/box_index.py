"""Boxes on the lattice: an index that can be updated, lists of what affects blocks, differences of sets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import (
    BoolArray,
    Bounds,
    Float64Array,
    Int64Array,
    LatticeArray,
    StructuredArray,
    UInt8Array,
)

Lists: TypeAlias = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]
"""``starts`` into a ``list`` of items, as kernels read them."""

ITEM: Final = np.dtype([("id", "u8"), ("digest", "u8"), ("low", "i8", 2), ("high", "i8", 2)])
"""An item by its content: a hash of 128 bits, and the corners of the box that it affects, lattice units."""

# Blocks times items up to which brute force is quicker.
_FEW = 1 << 14
_PAIRS = 1 << 20  # at once
# Ratio of successive cell sizes, as a power of two.
_SIZE_BITS = 2
# An index is rebuilt after each change up to so many items, and then once a share of them has changed.
_FEW_ITEMS, _EDITED_SHARE = 1024, 16
_POINT_BITS = 2  # squares of points are smaller than boxes by this power of two
_NONE = np.zeros(0, np.int64)
_NO_BOXES = np.zeros((0, 4), np.int64)


@dataclass(frozen=True, eq=False)
class _Edits:
    """Changes since an index was built."""

    removed: LatticeArray  # items of the index, ascending
    added: LatticeArray  # numbers of added items among all that are left, ascending
    boxes: BoxIndex  # of the added ones

    def updated(self, removed: LatticeArray, added: LatticeArray, boxes: LatticeArray) -> _Edits:
        """Return the changes with further ones."""
        was_added = np.isin(removed, self.added)
        gone = np.union1d(self.removed, _original(removed[~was_added], self.removed, self.added))
        kept = ~np.isin(self.added, removed)
        numbers = np.sort(np.concatenate([_renumbered(self.added[kept], removed, added), added]))
        places = np.searchsorted(numbers, added)
        return _Edits(gone, numbers, self.boxes.updated(np.flatnonzero(~kept), places, boxes))

    def pairs(
        self, block: LatticeArray, item: LatticeArray, blocks: LatticeArray, least: int
    ) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs of the index without removed items, renumbered, and pairs with added ones."""
        left = ~np.isin(item, self.removed)
        more, which = self.boxes.touching(blocks, least)
        items = _renumbered(item[left], self.removed, self.added)
        return np.concatenate([block[left], more]), np.concatenate([items, self.added[which]])

    def applied(self, boxes: LatticeArray) -> LatticeArray:
        """Return the boxes of all items, given those of the index."""
        return _edited(boxes, self.removed, self.added, self.boxes.boxes)

    def boxes_of(self, items: LatticeArray, boxes: LatticeArray) -> LatticeArray:
        """Return the boxes of some items, given those of the index."""
        place = np.searchsorted(self.added, items)
        is_added = np.append(self.added, -1)[place] == items
        result = np.empty((len(items), 4), np.int64)
        result[~is_added] = boxes[_original(items[~is_added], self.removed, self.added)]
        result[is_added] = self.boxes.boxes_of(place[is_added])
        return result


def _edited(
    boxes: LatticeArray, removed: LatticeArray, added: LatticeArray, others: LatticeArray
) -> LatticeArray:
    """Return boxes without some items, and with others at given numbers."""
    left = np.delete(boxes, removed, axis=0)
    result = np.empty((len(left) + len(added), 4), np.int64)
    result[_renumbered(np.arange(len(left)), _NONE, added)] = left
    result[added] = others
    return result


def _renumbered(items: LatticeArray, removed: LatticeArray, added: LatticeArray) -> LatticeArray:
    """Return the numbers of items after some (ascending) are removed, and others have taken given numbers."""
    rank = items - np.searchsorted(removed, items)
    return np.asarray(rank + np.searchsorted(added - np.arange(len(added)), rank, side="right"))


def _original(items: LatticeArray, removed: LatticeArray, added: LatticeArray) -> LatticeArray:
    """Return the items that have these numbers after `_renumbered`."""
    rank = items - np.searchsorted(added, items)
    return np.asarray(rank + np.searchsorted(removed - np.arange(len(removed)), rank, side="right"))


class BoxIndex:
    """Index of boxes (n, 4) on the lattice: west, south, east, north.

    Each box is stored in the cell of its south-west corner, in a grid whose cells are at least as large as
    the box: boxes that touch a block are in its cells or in those just west and south of them. Cells of one
    row are adjacent in one sorted array, so that a row of a block is a pair of binary searches.
    """

    def __init__(
        self,
        boxes: LatticeArray,
        *,
        cells: tuple[LatticeArray, ...] | None = None,
        edits: _Edits | None = None,
    ) -> None:
        self._boxes = boxes
        self._low, self._high = boxes[:, :2], boxes[:, 2:]
        self._cells = cells
        self._edits = edits

    def __len__(self) -> int:
        edits = self._edits
        return len(self._low) + (0 if edits is None else len(edits.added) - len(edits.removed))

    @property
    def boxes(self) -> LatticeArray:
        """The boxes of all items, (n, 4)."""
        return self._boxes if self._edits is None else self._edits.applied(self._boxes)

    def boxes_of(self, items: LatticeArray) -> LatticeArray:
        """Return the boxes of some items, (n, 4)."""
        return self._boxes[items] if self._edits is None else self._edits.boxes_of(items, self._boxes)

    def updated(self, removed: LatticeArray, added: LatticeArray, boxes: LatticeArray) -> BoxIndex:
        """Return the index without some items, and with others (their numbers in the result) and their boxes.

        The cells are shared, and rebuilt once there have been many changes: a change of k among n items costs
        O(k log n) on average.
        """
        if len(self._low) <= _FEW_ITEMS:
            return BoxIndex(_edited(self._boxes, removed, added, boxes))
        edits = self._edits or _Edits(_NONE, _NONE, BoxIndex(_NO_BOXES))
        edits = edits.updated(removed, added, boxes)
        if len(edits.removed) + len(edits.added) > len(self._low) // _EDITED_SHARE:
            return BoxIndex(edits.applied(self._boxes))
        if self._cells is None:
            self._cells = self._build()
        return BoxIndex(self._boxes, cells=self._cells, edits=edits)

    def touching(self, blocks: LatticeArray, least: int = 0) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs (block, item) that touch blocks (m, 4), borders included, by block, then by item.

        Items whose boxes are narrower than ``least`` both ways may be left out.
        """
        if len(self._low) * len(blocks) <= _FEW:
            block, item = np.nonzero(_overlap(blocks[:, None], self._low, self._high))
        else:
            block, item = self._candidates(blocks, least)
            touch = _overlap(blocks[block], self._low[item], self._high[item])
            block, item = block[touch], item[touch]
        if self._edits is not None:
            block, item = self._edits.pairs(block, item, blocks, least)
        bits = (len(self) + 1).bit_length()
        order = np.sort(block << bits | item)
        return order >> bits, order & ((1 << bits) - 1)

    def at_points(self, x: LatticeArray, y: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs (point, item) of points (n,) in boxes, by point, then by item.

        Points are asked for by squares as large as most boxes.
        """
        if not len(self) or not len(x):
            return _NONE, _NONE
        bits = max(self._median.bit_length() - _POINT_BITS, 0)
        row = y >> bits
        cells, square = np.unique((x >> bits << 32) + (row - row.min()), return_inverse=True)
        low = np.stack([cells >> 32, (cells & 0xFFFFFFFF) + row.min()], axis=1) << bits
        block, item = self.touching(np.concatenate([low, low + ((1 << bits) - 1)], axis=1))
        starts = np.searchsorted(block, np.arange(len(cells) + 1))
        point, offset = expanded(np.diff(starts)[square])
        item = item[starts[square[point]] + offset]
        at = np.stack([x[point], y[point]], axis=1)
        boxes = self.boxes_of(item)
        inside = ((at >= boxes[:, :2]) & (at <= boxes[:, 2:])).all(axis=1)
        return point[inside], item[inside]

    @cached_property
    def _median(self) -> int:
        """Side of most boxes."""
        return int(np.median(self._high - self._low)) if len(self._low) else 0

    def _candidates(self, blocks: LatticeArray, least: int) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs of blocks and items in cells near them."""
        if self._cells is None:
            self._cells = self._build()
        bits, origin, width, rows, base, keys, items = self._cells
        # One row of this for every size of cell and block.
        size, block = (np.ravel(part) for part in np.indices((len(bits), len(blocks))))
        shift, area = bits[size][:, None], blocks[block]
        first = np.maximum(((area[:, :2] - origin) >> shift) - 1, 0)
        last = np.minimum((area[:, 2:] - origin) >> shift, np.stack([width, rows], axis=-1)[size] - 1)
        wide = (last[:, 0] >= first[:, 0]) & (bits[size] >= least.bit_length() - 1)
        count = np.where(wide, np.maximum(last[:, 1] - first[:, 1] + 1, 0), 0)
        part, offset = expanded(count)
        row = base[size[part]] + (first[part, 1] + offset) * width[size[part]]
        start = np.searchsorted(keys, row + first[part, 0])
        end = np.searchsorted(keys, row + last[part, 0], side="right")
        row_of, place = expanded(end - start)
        return block[part[row_of]], items[start[row_of] + place]

    def _build(self) -> tuple[LatticeArray, ...]:
        """Return for each cell size bits, columns, rows and first key; then sorted keys and their items."""
        low, span = self._low, np.max(self._high - self._low, axis=1)
        origin = low.min(axis=0)
        whole = int((low.max(axis=0) - origin).max()) + 1
        # Limit the number of rows, however small the items.
        least = max(whole // (2 * int(np.sqrt(len(low))) + 1), 1).bit_length()
        needed = np.maximum(np.ceil(np.log2(span + 1.0)).astype(np.int64), least)
        needed = -(-needed // _SIZE_BITS) * _SIZE_BITS
        bits, size = np.unique(needed, return_inverse=True)
        cell = (low - origin) >> needed[:, None]
        columns, rows = (np.full(len(bits), 0) for _ in range(2))
        np.maximum.at(columns, size, cell[:, 0] + 1)
        np.maximum.at(rows, size, cell[:, 1] + 1)
        base = np.cumsum(columns * rows) - columns * rows
        keys = base[size] + cell[:, 1] * columns[size] + cell[:, 0]
        items = np.argsort(keys, kind="stable")
        return bits, origin, columns, rows, base, keys[items], items


def touch_any(blocks: LatticeArray, boxes: LatticeArray) -> BoolArray:
    """Return which blocks (m, 4) touch any of some boxes (n, 4), borders included."""
    step = max(_PAIRS // max(len(boxes), 1), 1)
    parts = [
        _overlap(blocks[first : first + step, None], boxes[:, :2], boxes[:, 2:]).any(axis=1)
        for first in range(0, len(blocks), step)
    ]
    return np.concatenate([np.zeros(0, np.bool_), *parts])


def _overlap(blocks: LatticeArray, low: LatticeArray, high: LatticeArray) -> BoolArray:
    """Return whether blocks (…, 4) and boxes (…, 2) have a point in common."""
    return np.asarray(
        (blocks[..., 0] <= high[..., 0])
        & (blocks[..., 2] >= low[..., 0])
        & (blocks[..., 1] <= high[..., 1])
        & (blocks[..., 3] >= low[..., 1])
    )


def expanded(count: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
    """Return, for concatenated runs of these lengths, each element's run and its index in the run."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def slot_lists(
    index: BoxIndex, blocks: LatticeArray, slot: LatticeArray, slots: int, order: LatticeArray
) -> Lists:
    """Return ``starts`` (blocks × (slots + 1)) and ``list`` of items in lists by slot.

    The index holds the items in this order, by slot and then by number; ``slot`` is each item's.
    """
    block, position = index.touching(blocks)
    member = order[position]
    # Pairs are sorted by block, then by slot, so that each list is one run.
    counts = np.bincount(block * slots + slot[member], minlength=len(blocks) * slots)
    ends = np.cumsum(counts).reshape(-1, slots)
    starts = np.empty((len(blocks), slots + 1), np.int32)
    starts[:, :-1] = ends - counts.reshape(-1, slots)
    starts[:, -1] = ends[:, -1]
    return starts, member.astype(np.int32)


def item_lists(index: BoxIndex, blocks: LatticeArray, visible: BoolArray | None = None) -> Lists:
    """Return ``starts`` (blocks + 1) and ``list`` of the visible items that affect each block."""
    starts = np.zeros(len(blocks) + 1, np.int32)
    if not len(index):
        return starts, np.zeros(0, np.int32)
    block, item = index.touching(blocks)
    if visible is not None:
        block, item = block[visible[item]], item[visible[item]]
    np.cumsum(np.bincount(block, minlength=len(blocks)), out=starts[1:])
    return starts, item.astype(np.int32)


def content_items(
    contents: Sequence[bytes | tuple[bytes, ...]], low: LatticeArray, high: LatticeArray
) -> StructuredArray:
    """Return `ITEM` rows of contents and their boxes (n, 2), sorted."""
    rows = np.zeros(len(contents), ITEM)
    joined = [b"".join(parts) if isinstance(parts, tuple) else parts for parts in contents]
    digests = b"".join([blake2b(each, digest_size=16).digest() for each in joined])
    rows["id"], rows["digest"] = np.frombuffer(digests, np.uint64).reshape(-1, 2).T
    rows["low"], rows["high"] = low, high
    return np.asarray(rows[np.argsort(rows, order=("id", "digest"))])


_OVERLAP = 0.5  # of the smaller rectangle, required to join two
_BLOCK = 4096  # rows compared at once
_MAX_REGIONS = 64  # repainted regions treated separately


def row_difference(old: StructuredArray, new: StructuredArray) -> tuple[Int64Array, Int64Array]:
    """Return the indices of rows that only the old and only the new array has, bit for bit.

    Both are sorted by unique ids. Blocks are compared as memory: k changes among n rows cost one pass over
    the memory and the search of k blocks.
    """
    removed, added = [_NONE], [_NONE]
    one, other = _words(old), _words(new)
    i = j = 0
    while old is not new and i < len(old) and j < len(new):
        rows = min(_BLOCK, len(old) - i, len(new) - j)
        mine, others = slice(i, i + rows), slice(j, j + rows)
        if not np.array_equal(one[mine], other[others]):
            ids, other_ids = old["id"][mine], new["id"][others]
            last = min(ids[-1], other_ids[-1])
            ids, other_ids = (each[: np.searchsorted(each, last, "right")] for each in (ids, other_ids))
            _, at, there = np.intersect1d(ids, other_ids, assume_unique=True, return_indices=True)
            same = (one[i + at] == other[j + there]).all(axis=1)
            removed.append(np.delete(np.arange(i, i + len(ids)), at[same]))
            added.append(np.delete(np.arange(j, j + len(other_ids)), there[same]))
            i, j = i + len(ids), j + len(other_ids)
        else:
            i, j = i + rows, j + rows
    if old is not new:
        removed.append(np.arange(i, len(old)))
        added.append(np.arange(j, len(new)))
    return np.concatenate(removed), np.concatenate(added)


def rows_only_in(one: StructuredArray, other: StructuredArray) -> StructuredArray:
    """Return the rows of one array that the other does not have, bit for bit; both sorted by unique ids."""
    only: StructuredArray = one[row_difference(one, other)[0]]
    return only


def _words(rows: StructuredArray) -> npt.NDArray[np.unsignedinteger]:
    """Return rows as words, (rows, words)."""
    size = math.gcd(rows.dtype.itemsize, 8)
    return np.ascontiguousarray(rows).view(f"u{size}").reshape(len(rows), rows.dtype.itemsize // size)


def widened(box: Bounds, distance: float) -> Bounds:
    """Return a rectangle with a margin on each side."""
    west, south, east, north = box
    return west - distance, south - distance, east + distance, north + distance


def repainted_boxes(old: UInt8Array | None, new: UInt8Array | None, pixel_size: float) -> list[Bounds]:
    """Return rectangles (m) around pixels painted in only one of two images of one size (None: empty)."""
    if old is new:
        return []
    masks = [np.zeros((1, 1), np.bool_) if image is None else image > 0 for image in (old, new)]
    changed = masks[0] != masks[1]
    lines = [np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0)]
    if not len(lines[0]):
        return []
    height, boxes = len(changed), []
    top, left = (int(each[0]) for each in lines)
    changed = changed[top : lines[0][-1] + 1, left : lines[1][-1] + 1]
    regions, count = ndimage.label(changed, structure=np.ones((3, 3)))
    if count > _MAX_REGIONS:
        regions = changed.astype(np.int32)
    for rows, columns in filter(None, ndimage.find_objects(regions)):
        south, north = (height - top - row for row in (rows.stop, rows.start))
        pixels = np.array([left + columns.start, south, left + columns.stop, north]) * pixel_size
        boxes.append((float(pixels[0]), float(pixels[1]), float(pixels[2]), float(pixels[3])))
    return boxes


def merge_boxes(boxes: Iterable[Bounds]) -> list[Bounds]:
    """Merge rectangles whose common bounding box adds little area; those inside others are left out."""
    left = np.array(list(dict.fromkeys(boxes)), dtype=np.float64).reshape(-1, 4)
    left = left[np.argsort(-_areas(left[:, :2], left[:, 2:]), kind="stable")]
    merged, count = np.zeros_like(left), 0
    while len(left):
        box, left, merging, grown = left[0], left[1:], True, False
        while merging and count:
            rows = merged[:count]
            low, high = np.minimum(rows[:, :2], box[:2]), np.maximum(rows[:, 2:], box[2:])
            areas, own = _areas(rows[:, :2], rows[:, 2:]), _areas(box[None, :2], box[None, 2:])
            growth = (_areas(low, high) - areas - own) / np.maximum(np.minimum(areas, own), 1e-9)
            best = int(growth.argmin())
            merging = bool(growth[best] <= -_OVERLAP)
            if merging:
                box, count, grown = np.concatenate([low[best], high[best]]), count - 1, True
                merged[best:count] = merged[best + 1 : count + 1]
        merged[count], count = box, count + 1
        if grown:
            left = left[((left[:, :2] < box[:2]) | (left[:, 2:] > box[2:])).any(axis=1)]
    return [(west, south, east, north) for west, south, east, north in merged[:count].tolist()]


def _areas(low: Float64Array, high: Float64Array) -> Float64Array:
    size = high - low
    return np.asarray(size[:, 0] * size[:, 1])
