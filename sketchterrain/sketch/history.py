"""Undo and redo: changed tiles and settings of each step, within a memory limit.

The sketch at a step is rebuilt from the current one; unchanged layers stay the same arrays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from sketchterrain.sketch.box import union_box
from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.label_image import LabelImage, freeze_image
from sketchterrain.sketch.layer_change import LayerChange

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

    from sketchterrain.sketch.box import Box

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
    key: int
    changes: Mapping[str, LayerChange] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        return _STEP_BYTES + sum(change.bytes for change in self.changes.values())


class History:
    """Steps that led to a sketch, and those that were undone; the oldest are dropped beyond the limits."""

    def __init__(self, sketch: Sketch, *, most_bytes: int = MAX_BYTES, most_steps: int = MAX_STEPS) -> None:
        self._sketch = sketch
        self._keys = count()
        # The step at which a sketch was current, as long as the sketch is referenced.
        self._key_of: WeakKeyDictionary[Sketch, int] = WeakKeyDictionary()
        self._steps = [_Step("Open", _settings(sketch), self._new_key(sketch))]
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
    def bytes(self) -> int:
        """Memory of the steps, without the current sketch."""
        return self._bytes

    def record(
        self,
        title: str,
        sketch: Sketch,
        *,
        merge: Hashable | None = None,
        known: Mapping[str, LayerChange] | None = None,
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
                self._key_of[sketch] = self._steps[self._at].key
                self._merge = self._before_merge = None
                return boxes
        else:
            self._merge, self._before_merge = merge, None if merge is None else before
        # Equal settings are stored as one object.
        last = self._steps[self._at].settings
        settings = {key: last[key] if last[key] == each else each for key, each in _settings(sketch).items()}
        self._steps.append(_Step(title, settings, self._new_key(sketch), changes))
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
        layers = _replayed(self._sketch.layers, between, LayerChange.revert if back else LayerChange.apply)
        self._sketch = self._sketch.replace(layers=layers, **self._steps[position].settings)
        self._key_of[self._sketch] = self._steps[position].key
        self._at = position
        self._merge = self._before_merge = None
        return _boxes(between, self._sketch)

    def step_key(self, sketch: Sketch) -> int | None:
        """Return a number shared by all sketches that were current at the same step, or None."""
        return self._key_of.get(sketch)

    def _is_equal(self, position: int, sketch: Sketch, changes: Mapping[str, LayerChange]) -> bool:
        return not changes and _settings(sketch) == self._steps[position].settings

    def _new_key(self, sketch: Sketch) -> int:
        self._key_of[sketch] = next(self._keys)
        return self._key_of[sketch]

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


def _changes(before: Sketch, after: Sketch, known: Mapping[str, LayerChange]) -> dict[str, LayerChange]:
    changes = {}
    for name, image in after.layers.items():
        if image is not before.layers[name]:
            change = known.get(name) or LayerChange.between(before.layers[name], image)
            if change is not None:
                changes[name] = change
    return changes


def _replayed(
    layers: Mapping[str, LabelImage],
    steps: Sequence[_Step],
    replay: Callable[[LayerChange, LabelImage], LabelImage],
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
