"""Spatial index: which of many boxes touch a block; a grid with several cell sizes, built once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import LatticeArray


# Blocks times items up to which brute force is quicker.
_FEW = 1 << 14
# Ratio of successive cell sizes, as a power of two.
_SIZE_BITS = 2


class BoxIndex:
    """Index of boxes on the lattice, given by corners (n, 2) and a margin (n,) on all sides, rounded up.

    Each box is stored in the cell of its south-west corner, in a grid whose cells are at least as large as
    the box: boxes that touch a block are in its cells or in those just west and south of them. Cells of one
    row are adjacent in one sorted array, so that a row of a block is a pair of binary searches.
    """

    def __init__(self, low: LatticeArray, high: LatticeArray, margin: npt.NDArray[np.float64]) -> None:
        grow = np.ceil(margin).astype(np.int64)[:, None]
        self._low, self._high = low - grow, high + grow
        self._levels: tuple[LatticeArray, ...] | None = None

    def __len__(self) -> int:
        return len(self._low)

    def touching(self, blocks: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs (block, item) that touch blocks (m, 4), borders included, by block, then by item."""
        if len(self) * len(blocks) <= _FEW:
            touch = _overlap(blocks[:, None], self._low, self._high)
            block, item = np.nonzero(touch)
            return block, item
        block, item = self._candidates(blocks)
        touch = _overlap(blocks[block], self._low[item], self._high[item])
        bits = len(self).bit_length()
        order = np.sort(block[touch] << bits | item[touch])
        return order >> bits, order & ((1 << bits) - 1)

    def _candidates(self, blocks: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs of blocks and items in cells near them."""
        if self._levels is None:
            self._levels = self._build()
        bits, origin, width, rows, base, keys, items = self._levels
        # One row of this for every size of cell and block.
        size, block = (np.ravel(part) for part in np.indices((len(bits), len(blocks))))
        shift, area = bits[size][:, None], blocks[block]
        first = np.maximum(((area[:, :2] - origin) >> shift) - 1, 0)
        last = np.minimum((area[:, 2:] - origin) >> shift, np.stack([width, rows], axis=-1)[size] - 1)
        count = np.where(last[:, 0] >= first[:, 0], np.maximum(last[:, 1] - first[:, 1] + 1, 0), 0)
        part, offset = _runs(count)
        row = base[size[part]] + (first[part, 1] + offset) * width[size[part]]
        start = np.searchsorted(keys, row + first[part, 0])
        end = np.searchsorted(keys, row + last[part, 0], side="right")
        of, place = _runs(end - start)
        return block[part[of]], items[start[of] + place]

    def _build(self) -> tuple[LatticeArray, ...]:
        """Return, for each cell size, bits, columns, rows and first key; the sorted keys of all items.

        The items.
        """
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


def _overlap(blocks: LatticeArray, low: LatticeArray, high: LatticeArray) -> npt.NDArray[np.bool_]:
    """Return whether blocks (…, 4) and boxes (…, 2) have a point in common."""
    return np.asarray(
        (blocks[..., 0] <= high[..., 0])
        & (blocks[..., 2] >= low[..., 0])
        & (blocks[..., 1] <= high[..., 1])
        & (blocks[..., 3] >= low[..., 1])
    )


def _runs(count: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
    """Return, for concatenated runs of these lengths, each element's run and its index in the run."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
