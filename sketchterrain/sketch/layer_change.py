"""Difference of a layer between two sketches: its changed tiles before and after, run-length encoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.sketch.box import Box
    from sketchterrain.sketch.label_image import LabelImage

TILE = 64
"""Pixels along a side of the stored tiles."""

_BLOCK_BYTES = 400  # overhead of the objects


@dataclass(frozen=True, eq=False)
class _Runs:
    """Run-length encoded labels: the start of each run and its label; or plain ones where runs are short."""

    length: int
    starts: npt.NDArray[np.uint32] | None
    labels: npt.NDArray[np.uint8]

    @classmethod
    def encode(cls, pixels: LabelImage) -> _Runs:
        flat = pixels.ravel()
        starts = np.append(0, np.flatnonzero(flat[1:] != flat[:-1]) + 1).astype(np.uint32)
        if 5 * len(starts) < len(flat):
            return cls(len(flat), starts, flat[starts])
        return cls(len(flat), None, flat.copy())

    @property
    def bytes(self) -> int:
        return self.labels.nbytes + (0 if self.starts is None else self.starts.nbytes)

    def decode(self) -> LabelImage:
        if self.starts is None:
            return self.labels
        return np.repeat(self.labels, np.diff(self.starts, append=np.uint32(self.length)))


@dataclass(frozen=True, eq=False)
class _Block:
    """A row of adjacent changed tiles."""

    box: Box
    before: _Runs
    after: _Runs


@dataclass(frozen=True, eq=False)
class LayerChange:
    """Difference of a layer between two sketches, which can be applied and reverted."""

    box: Box  # of the changed pixels; the whole layer if its size differs
    shapes: tuple[tuple[int, int], tuple[int, int]]  # (height, width) before and after
    bytes: int  # memory of this object
    _blocks: tuple[_Block, ...]

    @classmethod
    def between(
        cls, before: LabelImage, after: LabelImage, *, within: Box | None = None
    ) -> LayerChange | None:
        """Return the difference of two images, (height, width) uint8, or None if they are equal.

        Pixels outside of `within`, if given, are known to be equal.
        """
        shapes = ((before.shape[0], before.shape[1]), (after.shape[0], after.shape[1]))
        if before.shape != after.shape:
            box = (0, 0, *shapes[1])
            blocks = [_Block(box, _Runs.encode(before), _Runs.encode(after))]
        else:
            found = _changed_blocks(before, after, within or (0, 0, *shapes[0]))
            if found is None:
                return None
            box, boxes = found
            blocks = [
                _Block(each, *(_Runs.encode(_view(image, each)) for image in (before, after)))
                for each in boxes
            ]
        size = sum(block.before.bytes + block.after.bytes + _BLOCK_BYTES for block in blocks)
        return cls(box, shapes, size, tuple(blocks))

    @property
    def new_labels(self) -> frozenset[int]:
        """Labels in the changed tiles after the change that were not in them before."""
        before, after = (
            {label for runs in sides for label in np.unique(runs.labels).tolist()}
            for sides in zip(*((block.before, block.after) for block in self._blocks), strict=True)
        )
        return frozenset(after - before)

    def apply(self, image: LabelImage) -> LabelImage:
        """Return the layer after the change; `image`, the layer before it, may be written into."""
        return self._write(image, 1)

    def revert(self, image: LabelImage) -> LabelImage:
        """Return the layer before the change; `image`, the layer after it, may be written into."""
        return self._write(image, 0)

    def _write(self, image: LabelImage, side: int) -> LabelImage:
        runs = [(block.before, block.after)[side] for block in self._blocks]
        if self.shapes[0] != self.shapes[1]:
            return runs[0].decode().reshape(self.shapes[side]).copy()
        for block, each in zip(self._blocks, runs, strict=True):
            tiles = _view(image, block.box)
            tiles[:] = each.decode().reshape(tiles.shape)
        return image


def _view(image: LabelImage, box: Box) -> LabelImage:
    top, left, bottom, right = box
    return image[top:bottom, left:right]


def _changed_blocks(before: LabelImage, after: LabelImage, within: Box) -> tuple[Box, list[Box]] | None:
    """Return the box of the changed pixels and the tile blocks that contain them; None if equal."""
    height, width = before.shape
    first, last = within[1] // TILE * TILE, min(-(-within[3] // TILE) * TILE, width)
    # Eight pixels are compared as one uint64, so columns are padded to whole tiles.
    differs = np.zeros((TILE, -(-max(last - first, 1) // TILE) * TILE), dtype=np.bool_)
    columns = np.zeros(differs.shape[1], dtype=np.bool_)
    blocks: list[Box] = []
    top_row = bottom_row = 0
    for top in range(within[0] // TILE * TILE, min(within[2], height), TILE):
        bottom = min(top + TILE, height)
        rows = differs[: bottom - top]
        np.not_equal(
            before[top:bottom, first:last], after[top:bottom, first:last], out=rows[:, : last - first]
        )
        changed = np.bitwise_or.reduce(rows.view(np.uint64), axis=0).view(np.bool_)
        if not changed.any():
            continue
        columns |= changed
        inside = np.flatnonzero(rows.any(axis=1))
        top_row = top_row if blocks else top + int(inside[0])
        bottom_row = top + int(inside[-1]) + 1
        blocks += [
            (top, first + begin, bottom, min(first + end, width)) for begin, end in _tile_runs(changed)
        ]
    if not blocks:
        return None
    where = np.flatnonzero(columns)
    return (top_row, first + int(where[0]), bottom_row, first + int(where[-1]) + 1), blocks


def _tile_runs(changed: npt.NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the first and the end column of each run of tiles with a changed column."""
    tiles = changed.reshape(-1, TILE).any(axis=1)
    edges = np.flatnonzero(np.diff(tiles, prepend=False, append=False)) * TILE
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
