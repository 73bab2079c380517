"""Undo and redo: changes of label layers, stored as tiles."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sketchterrain.document.drapes import new_drape_bytes
from sketchterrain.document.label_layers import Box, LabelImage, freeze_image, labels_in, union_box
from sketchterrain.document.sketch import Sketch

TILE = 64
"""Pixels along a side of the stored tiles."""

_BLOCK_BYTES = 400  # overhead of the objects


@dataclass(frozen=True, eq=False)
class _TileRun:
    """A row of adjacent changed tiles, or a whole layer."""

    box: Box
    before: bytes  # compressed
    after: bytes

    @classmethod
    def of_images(cls, box: Box, before: LabelImage, after: LabelImage) -> _TileRun:
        return cls(box, *(zlib.compress(image.tobytes(), 1) for image in (before, after)))


@dataclass(frozen=True, eq=False)
class ImageChange:
    """Difference of a layer between two sketches, which can be applied and reverted."""

    box: Box  # of the changed pixels; the whole layer if its size differs
    shapes: tuple[tuple[int, int], tuple[int, int]]  # (height, width) before and after
    bytes: int  # memory of this object
    _blocks: tuple[_TileRun, ...]

    @classmethod
    def between(
        cls, before: LabelImage, after: LabelImage, *, within: Box | None = None
    ) -> ImageChange | None:
        """Return the difference of two images, (height, width) uint8, or None if they are equal.

        Pixels outside of `within`, if given, are known to be equal.
        """
        shapes = ((before.shape[0], before.shape[1]), (after.shape[0], after.shape[1]))
        if before.shape != after.shape:
            box = (0, 0, *shapes[1])
            blocks = [_TileRun.of_images(box, before, after)]
        else:
            found = _changed_blocks(before, after, within or (0, 0, *shapes[0]))
            if found is None:
                return None
            box, boxes = found
            blocks = [_TileRun.of_images(each, _view(before, each), _view(after, each)) for each in boxes]
        size = sum(len(block.before) + len(block.after) + _BLOCK_BYTES for block in blocks)
        return cls(box, shapes, size, tuple(blocks))

    @property
    def new_labels(self) -> frozenset[int]:
        """Labels, but 0, in the changed tiles after the change that were not in them before."""
        before, after = (
            {label for packed in sides for label in labels_in(_unpacked(packed)[None])}
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
        labels = [_unpacked((block.before, block.after)[side]) for block in self._blocks]
        if self.shapes[0] != self.shapes[1]:
            return labels[0].reshape(self.shapes[side]).copy()
        for block, each in zip(self._blocks, labels, strict=True):
            tiles = _view(image, block.box)
            tiles[:] = each.reshape(tiles.shape)
        return image


def _unpacked(packed: bytes) -> LabelImage:
    return np.frombuffer(zlib.decompress(packed), np.uint8)


def _view(image: LabelImage, box: Box) -> LabelImage:
    top, left, bottom, right = box
    return image[top:bottom, left:right]


def _changed_blocks(before: LabelImage, after: LabelImage, within: Box) -> tuple[Box, list[Box]] | None:
    """Return the box of the changed pixels and the tile blocks that contain them; None if equal."""
    height, width = before.shape
    first, last = within[1] // TILE * TILE, min(-(-within[3] // TILE) * TILE, width)
    columns = np.zeros(max(last - first, 0), dtype=np.bool_)
    blocks: list[Box] = []
    top_row = bottom_row = 0
    for top in range(within[0] // TILE * TILE, min(within[2], height), TILE):
        bottom = min(top + TILE, height)
        differs = before[top:bottom, first:last] != after[top:bottom, first:last]
        changed = differs.any(axis=0)
        if not changed.any():
            continue
        columns |= changed
        inside = np.flatnonzero(differs.any(axis=1))
        top_row = top_row if blocks else top + int(inside[0])
        bottom_row = top + int(inside[-1]) + 1
        tiles = np.logical_or.reduceat(changed, np.arange(0, len(changed), TILE))
        edges = first + TILE * np.flatnonzero(np.diff(tiles, prepend=False, append=False))
        runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        blocks += [(top, begin, bottom, min(end, width)) for begin, end in runs]
    if not blocks:
        return None
    where = np.flatnonzero(columns)
    return (top_row, first + int(where[0]), bottom_row, first + int(where[-1]) + 1), blocks


MAX_BYTES = 256 << 20
MAX_STEPS = 1000

_STEP_BYTES = 2048
"""Approximate memory of a step's settings: most are shared with the step before."""

_SETTINGS = tuple(each.name for each in dataclasses.fields(Sketch) if each.name != "layers")


@dataclass(frozen=True, eq=False)
class _Step:
    """A sketch as its difference from the one before."""

    title: str
    settings: Mapping[str, Any]
    changes: Mapping[str, ImageChange] = field(default_factory=dict)
    new_bytes: int = 0  # of vectors, rasters and draped layers that the step before does not have
    key: object = field(default_factory=object)

    @property
    def bytes(self) -> int:
        return _STEP_BYTES + self.new_bytes + sum(change.bytes for change in self.changes.values())


class History:
    """Steps that led to a sketch, and those that were undone; the oldest are dropped beyond the limits."""

    def __init__(self, sketch: Sketch, *, most_bytes: int = MAX_BYTES, most_steps: int = MAX_STEPS) -> None:
        self._sketch = sketch
        self._steps = [_Step("Open", _settings(sketch))]
        self._at = 0
        self._most_bytes, self._most_steps = most_bytes, most_steps
        self._bytes = self._steps[0].bytes
        self._merge: Hashable | None = None
        self._before_merge: Sketch | None = None

    @property
    def sketch(self) -> Sketch:
        """The current sketch."""
        return self._sketch

    @property
    def titles(self) -> tuple[str, ...]:
        """The title of each step, the initial one first, undone ones included."""
        return tuple(step.title for step in self._steps)

    @property
    def position(self) -> int:
        """Index in `titles` of the current step."""
        return self._at

    @property
    def key(self) -> object:
        """Key of the current step, the same after it was undone and redone."""
        return self._steps[self._at].key

    @property
    def bytes(self) -> int:
        """Memory of the steps, without the current sketch."""
        return self._bytes

    def record(
        self,
        title: str,
        sketch: Sketch,
        *,
        merge: Hashable | None = None,
        known: Mapping[str, ImageChange] | None = None,
    ) -> Mapping[str, Box]:
        """Add a step unless it changes nothing, drop undone ones, and return the changed box of each layer.

        Successive steps with an equal `merge` key are one step, as of a slider that is dragged, and none if
        they lead back to where they began. `known` gives changes of layers that the caller has computed.
        """
        before = self._sketch
        changes = _changes(before, sketch, known or {})
        boxes = {name: change.box for name, change in changes.items()}
        if self._is_equal(self._at, sketch, changes):
            return boxes
        self._drop(self._at + 1, len(self._steps))
        self._sketch = sketch
        if merge is not None and merge == self._merge and self._before_merge is not None:
            title, changes = self._steps[-1].title, _changes(self._before_merge, sketch, {})
            self._drop(self._at, self._at + 1)
            self._at -= 1
            if self._is_equal(self._at, sketch, changes):  # a drag back to where it began
                self._merge = self._before_merge = None
                return boxes
        else:
            self._merge, self._before_merge = merge, None if merge is None else before
        # Equal settings are stored as one object.
        last = self._steps[self._at].settings
        settings = {key: last[key] if last[key] == each else each for key, each in _settings(sketch).items()}
        new_bytes = 0
        for name, former in last["vectors"].items():
            if (vectors := sketch.vectors[name]) is not former:
                known_pieces = set(former.pieces)
                new_bytes += sum(piece.nbytes for piece in vectors.pieces if piece not in known_pieces)
                former.release()
        new_bytes += sum(each.nbytes for each in sketch.rasters if each not in last["rasters"])
        new_bytes += new_drape_bytes(last["drapes"], sketch.drapes)
        self._steps.append(_Step(title, settings, changes, new_bytes))
        self._bytes += self._steps[-1].bytes
        self._at += 1
        self._enforce_limits()
        return boxes

    def go_to(self, position: int) -> Mapping[str, Box]:
        """Undo or redo up to a step, and return the changed box of each layer."""
        if not 0 <= position < len(self._steps):
            raise IndexError(f"step {position}: expected 0 to {len(self._steps) - 1}")
        back = position < self._at
        between = self._steps[self._at : position : -1] if back else self._steps[self._at + 1 : position + 1]
        layers = _replayed(self._sketch.layers, between, ImageChange.revert if back else ImageChange.apply)
        self._sketch = self._sketch.replace(layers=layers, **self._steps[position].settings)
        self._at = position
        self._merge = self._before_merge = None
        return _boxes(between, self._sketch)

    def _is_equal(self, position: int, sketch: Sketch, changes: Mapping[str, ImageChange]) -> bool:
        return not changes and _settings(sketch) == self._steps[position].settings

    def _drop(self, begin: int, end: int) -> None:
        self._bytes -= sum(step.bytes for step in self._steps[begin:end])
        del self._steps[begin:end]

    def _enforce_limits(self) -> None:
        while self._at > 1 and (self._bytes > self._most_bytes or self._at > self._most_steps):
            self._drop(0, 1)
            self._at -= 1
            # The first step has nothing to revert to.
            self._bytes -= self._steps[0].bytes
            self._steps[0] = dataclasses.replace(self._steps[0], changes={})
            self._bytes += self._steps[0].bytes


def _settings(sketch: Sketch) -> dict[str, Any]:
    return {key: getattr(sketch, key) for key in _SETTINGS}


def _changes(before: Sketch, after: Sketch, known: Mapping[str, ImageChange]) -> dict[str, ImageChange]:
    changes = {}
    for name, image in after.layers.items():
        if image is not before.layers[name]:
            change = known.get(name) or ImageChange.between(before.layers[name], image)
            if change is not None:
                changes[name] = change
    return changes


def _replayed(
    layers: Mapping[str, LabelImage],
    steps: Sequence[_Step],
    replay: Callable[[ImageChange, LabelImage], LabelImage],
) -> dict[str, LabelImage]:
    """Return the layers after steps were undone or redone; unchanged ones are the same arrays."""
    written: dict[str, LabelImage] = {}
    for step in steps:
        for name, change in step.changes.items():
            image = written[name] if name in written else layers[name].copy()
            written[name] = replay(change, image)
    return {**layers, **{name: freeze_image(image) for name, image in written.items()}}


def _boxes(steps: Sequence[_Step], sketch: Sketch) -> dict[str, Box]:
    """Return the changed box of each layer, within the size of the resulting sketch."""
    boxes: dict[str, Box] = {}
    for step in steps:
        for name, change in step.changes.items():
            resized = change.shapes[0] != change.shapes[1]
            whole = (0, 0, sketch.height_px, sketch.width_px) if resized else None
            boxes[name] = union_box(whole, union_box(boxes.get(name), change.box)) or change.box
    height, width = sketch.height_px, sketch.width_px
    return {name: (top, left, min(b, height), min(r, width)) for name, (top, left, b, r) in boxes.items()}
