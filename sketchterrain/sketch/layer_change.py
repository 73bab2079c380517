"""What a step changed in a layer: the tiles that differ, before and after, as runs of one label."""

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
"""Pixels along a side of the tiles that are kept."""

_BLOCK_BYTES = 400  # of the objects themselves


@dataclass(frozen=True, eq=False)
class _Runs:
    """Labels one after the other: where each run begins, and of which label it is; or each of them."""

    length: int
    begin: npt.NDArray[np.uint32] | None
    label: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, pixels: LabelImage) -> _Runs:
        flat = pixels.ravel()
        begin = np.append(0, np.flatnonzero(flat[1:] != flat[:-1]) + 1).astype(np.uint32)
        if 5 * len(begin) < len(flat):
            return cls(len(flat), begin, flat[begin])
        return cls(len(flat), None, flat.copy())

    @property
    def bytes(self) -> int:
        return self.label.nbytes + (0 if self.begin is None else self.begin.nbytes)

    def pixels(self) -> LabelImage:
        if self.begin is None:
            return self.label
        return np.repeat(self.label, np.diff(self.begin, append=np.uint32(self.length)))


@dataclass(frozen=True, eq=False)
class _Block:
    """Tiles side by side that differ."""

    place: Box
    before: _Runs
    after: _Runs


@dataclass(frozen=True, eq=False)
class LayerChange:
    """How a layer differs between two sketches; it leads from either one to the other."""

    box: Box
    shapes: tuple[tuple[int, int], tuple[int, int]]
    bytes: int
    _blocks: tuple[_Block, ...]

    @classmethod
    def between(
        cls, before: LabelImage, after: LabelImage, *, within: Box | None = None
    ) -> LayerChange | None:
        """Compare two images of a layer."""
        shapes = ((before.shape[0], before.shape[1]), (after.shape[0], after.shape[1]))
        if before.shape != after.shape:
            box = (0, 0, *shapes[1])
            blocks = [_Block(box, _Runs.of(before), _Runs.of(after))]
        else:
            found = _differing(before, after, within or (0, 0, *shapes[0]))
            if found is None:
                return None
            box, places = found
            blocks = [
                _Block(
                    (top, left, bottom, right),
                    *(_Runs.of(i[top:bottom, left:right]) for i in (before, after)),
                )
                for top, left, bottom, right in places
            ]
        size = sum(block.before.bytes + block.after.bytes + _BLOCK_BYTES for block in blocks)
        return cls(box, shapes, size, tuple(blocks))

    @property
    def new_labels(self) -> frozenset[int]:
        """Labels that stand in the changed tiles after, but did not before."""
        before, after = (
            {label for runs in sides for label in np.unique(runs.label).tolist()}
            for sides in zip(*((block.before, block.after) for block in self._blocks), strict=True)
        )
        return frozenset(after - before)

    def redone(self, image: LabelImage) -> LabelImage:
        """Return the layer after the step; `image`, writable, is the layer before and is written into."""
        return self._turned(image, 1)

    def undone(self, image: LabelImage) -> LabelImage:
        """Return the layer before the step; `image`, writable, is the layer after and is written into."""
        return self._turned(image, 0)

    def _turned(self, image: LabelImage, side: int) -> LabelImage:
        runs = [(block.before, block.after)[side] for block in self._blocks]
        if self.shapes[0] != self.shapes[1]:
            return runs[0].pixels().reshape(self.shapes[side]).copy()
        for block, each in zip(self._blocks, runs, strict=True):
            tiles = _cut(image, block.place)
            tiles[:] = each.pixels().reshape(tiles.shape)
        return image


def _cut(image: LabelImage, place: Box) -> LabelImage:
    top, left, bottom, right = place
    return image[top:bottom, left:right]


def _differing(before: LabelImage, after: LabelImage, within: Box) -> tuple[Box, list[Box]] | None:
    """Return the box around what differs, and blocks of tiles that hold all of it; None: nothing differs."""
    height, width = before.shape
    first, last = within[1] // TILE * TILE, min(-(-within[3] // TILE) * TILE, width)
    # Eight pixels are looked at as one number, so there are whole tiles of them.
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
        seen = np.bitwise_or.reduce(rows.view(np.uint64), axis=0).view(np.bool_)
        if not seen.any():
            continue
        columns |= seen
        inside = np.flatnonzero(rows.any(axis=1))
        top_row = top_row if blocks else top + int(inside[0])
        bottom_row = top + int(inside[-1]) + 1
        blocks += [(top, first + begin, bottom, min(first + end, width)) for begin, end in _tile_runs(seen)]
    if not blocks:
        return None
    where = np.flatnonzero(columns)
    return (top_row, first + int(where[0]), bottom_row, first + int(where[-1]) + 1), blocks


def _tile_runs(seen: npt.NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the first column of each run of tiles in which something is seen, and the one after its last."""
    tiles = seen.reshape(-1, TILE).any(axis=1)
    edges = np.flatnonzero(np.diff(tiles, prepend=False, append=False)) * TILE
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
