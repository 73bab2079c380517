"""Which of many boxes touch a block of ground: a grid of several sizes of cell, built once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Lattice = npt.NDArray[np.int64]

# Blocks times items up to which comparing them all is quicker than looking them up.
_FEW = 1 << 14
# Cells of one size are so many times as long as those of the next smaller one, as a power of two.
_SIZE_BITS = 2


class ReachIndex:
    """Boxes on the lattice, to be asked which of them touch blocks of ground.

    Each box lies in one cell, by its south-west corner, of a grid whose cells are at least as large as the
    box: what touches a block stands in its cells or in those just west and south of them. Cells of one row
    lie beside each other in one sorted array, so that a row of a block is a pair of binary searches.

    Parameters
    ----------
    low, high : (n, 2) int64
        South-west and north-east corners, lattice units.
    reach : (n,) float64
        How much farther each box reaches on all sides, lattice units; rounded up.
    """

    def __init__(self, low: Lattice, high: Lattice, reach: npt.NDArray[np.float64]) -> None:
        grow = np.ceil(reach).astype(np.int64)[:, None]
        self._low, self._high = low - grow, high + grow
        self._levels: tuple[Lattice, ...] | None = None

    def __len__(self) -> int:
        return len(self._low)

    def touching(self, blocks: Lattice) -> tuple[Lattice, Lattice]:
        """Return pairs (block, item) of those that touch, borders included, by block and then by item.

        Parameters
        ----------
        blocks : (m, 4) int64
            West, south, east and north, lattice units.
        """
        if len(self) * len(blocks) <= _FEW:
            touch = _meet(blocks[:, None], self._low, self._high)
            block, item = np.nonzero(touch)
            return block, item
        block, item = self._candidates(blocks)
        kept = _meet(blocks[block], self._low[item], self._high[item])
        bits = len(self).bit_length()
        order = np.sort(block[kept] << bits | item[kept])
        return order >> bits, order & ((1 << bits) - 1)

    def _candidates(self, blocks: Lattice) -> tuple[Lattice, Lattice]:
        """Pairs of blocks and items in cells that may hold what touches them."""
        if self._levels is None:
            self._levels = self._built()
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

    def _built(self) -> tuple[Lattice, ...]:
        """For each size of cell its bits, columns, rows and first key; all items' keys, sorted, and items."""
        low, span = self._low, np.max(self._high - self._low, axis=1)
        origin = low.min(axis=0)
        whole = int((low.max(axis=0) - origin).max()) + 1
        # No more rows than a few for each item of a row, however small the items.
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


def _meet(blocks: Lattice, low: Lattice, high: Lattice) -> npt.NDArray[np.bool_]:
    """Whether blocks (…, 4) and boxes (…, 2) have a point in common."""
    return np.asarray(
        (blocks[..., 0] <= high[..., 0])
        & (blocks[..., 2] >= low[..., 0])
        & (blocks[..., 1] <= high[..., 1])
        & (blocks[..., 3] >= low[..., 1])
    )


def _runs(count: Lattice) -> tuple[Lattice, Lattice]:
    """For runs of these lengths, one after another: whose each place is, and its number in the run."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
