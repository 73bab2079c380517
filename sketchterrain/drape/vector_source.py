"""Vector sources: the store of a file, and the edits of its features."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from sketchterrain.array_types import Bounds, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, FeatureEdit, class_value, drape_problem
from sketchterrain.drape.vector_store import VectorStore, open_store
from sketchterrain.errors import InputError, one_line
from sketchterrain.features.levels import (
    Level,
    Parts,
    Shapes2D,
    joined,
    level_of,
    parts_of,
    split_shapes,
    touch,
)

_ROUNDED = math.sqrt(0.5)  # of a tolerance: the farthest that a vertex moves
_BATCH = 1 << 16  # values that are read at once


class Feature(NamedTuple):
    """A feature of a layer."""

    id: int
    geometry: BaseGeometry  # in metres of the sketch
    properties: dict[str, int | float | str | None]


class _EditedFeature:
    """Items of an edited feature at each level in use."""

    def __init__(self, edit: FeatureEdit) -> None:
        self.id = edit.id
        self.shape: BaseGeometry | None = shapely.from_wkb(edit.geometry) if edit.geometry else None
        self._parts: dict[float, Parts] = {}

    @cached_property
    def _split(self) -> Shapes2D:
        return split_shapes(np.array([self.shape], object), np.array([self.id]))

    def parts(self, tolerance: float) -> Parts:
        if tolerance not in self._parts:
            self._parts[tolerance] = parts_of(self._split, tolerance)
        return self._parts[tolerance]

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for parts in self._parts.values() for array in parts)


class VectorSource:
    """Features of a layer with its edits; versions share what they do not change."""

    def __init__(
        self,
        store: VectorStore,
        stamp: tuple[int, int],
        edits: Mapping[int, FeatureEdit],
        known: Mapping[int, _EditedFeature],
    ) -> None:
        self.store, self._stamp, self._edits = store, stamp, edits
        self._edited = {number: known.get(number) or _EditedFeature(edit) for number, edit in edits.items()}
        self._changed = np.array(sorted(edits), np.int64)
        self._levels: dict[int, Level] = {}

    @classmethod
    def open(cls, layer: DrapedLayer, frame: Mapping[str, Any], extent: float) -> VectorSource:
        """Open a layer's file, whose store is built if need be; raise InputError if it cannot be read."""
        store = open_store(layer, frame, extent)
        return cls(store, file_stamp(layer.path), layer.edits, {})

    def updated(self, layer: DrapedLayer) -> VectorSource:
        """Return the source with a layer's edits; features whose edit is the same are shared."""
        if self._edits == layer.edits:
            return self
        edited = self._edited.items()
        same = {number: each for number, each in edited if self._edits[number] == layer.edits.get(number)}
        return VectorSource(self.store, self._stamp, layer.edits, same)

    def problem(self, layer: DrapedLayer) -> str:
        """Return in one line that the file is missing or has changed; empty if neither."""
        return source_problem(layer, self._stamp)

    def occupies(self, box: Bounds) -> bool:
        """Return whether a feature may have a part in a box (m)."""
        levels = [self.store.levels[0], *([self._edited_level(0)] if self._edited else [])]
        return any(touch(level.groups, box).any() for level in levels)

    @property
    def nbytes(self) -> int:
        """Bytes in memory: those of edited features."""
        return sum(each.nbytes for each in self._edited.values())

    @property
    def box(self) -> Float64Array:
        """West, south, east and north (m) of all features, NaN without any."""
        boxes = np.array([self.store.box, *map(self.box_of, self._edited)])
        return np.concatenate([np.fmin.reduce(boxes[:, :2]), np.fmax.reduce(boxes[:, 2:])])

    @property
    def next_id(self) -> int:
        """The id of the next feature that is created."""
        return max([self.store.count - 1, *self._edited]) + 1

    @property
    def fields(self) -> dict[str, str]:
        """Names of properties, with the type of their values: int64, float64 or text."""
        return self.store.fields

    def query(self, box: Bounds, texel: float) -> list[tuple[Level, Int64Array]]:
        """Return levels and the items of them near a box (m), within a quarter of `texel` of the features."""
        limit = 0.25 * texel / _ROUNDED
        number = max(k for k, level in enumerate(self.store.levels) if level.tolerance <= limit)
        stored = self.store.levels[number]
        found = stored.touching(box)
        if not len(self._changed):
            return [(stored, found)]
        edited = self._edited_level(number)
        found = found[~np.isin(stored.items["feature"][found], self._changed)]
        return [(stored, found), (edited, edited.touching(box))]

    def _edited_level(self, number: int) -> Level:
        """Return the items of edited features."""
        if number not in self._levels:
            tolerance = self.store.levels[number].tolerance
            parts = joined([each.parts(tolerance) for each in self._edited.values()])
            self._levels[number] = level_of(parts, tolerance)
        return self._levels[number]

    def features(self, box: Bounds) -> Int64Array:
        """Return the ids of features with parts whose boxes touch a box, ascending."""
        found = [level.items["feature"][number] for level, number in self.query(box, 0.0)]
        return np.unique(np.concatenate(found)).astype(np.int64)

    def feature(self, number: int) -> Feature:
        """Return a feature; raise InputError if it was deleted, or has no geometry."""
        if (shape := self._shape(number)) is None:
            raise InputError(f"feature {number}: expected one that the layer has, with a geometry")
        if number in self._edited:
            return Feature(number, shape, dict(self._edits[number].properties))
        return Feature(number, shape, self.store.properties(number))

    def _shape(self, number: int) -> BaseGeometry | None:
        if number in self._edited:
            return self._edited[number].shape
        return self.store.geometries([number])[0] if 0 <= number < self.store.count else None

    def parts(self, number: int) -> Parts:
        """Return the items of one feature with all of its vertices."""
        return parts_of(split_shapes(np.array([self._shape(number)], object), np.array([number])), 0.0)

    def box_of(self, number: int) -> Float64Array:
        """Return the box (m) of a feature; NaN without one."""
        return np.asarray(shapely.bounds(self._shape(number)))

    def values(self, name: str, ids: Sequence[int]) -> list[int | float | str | None]:
        """Return a property of features."""
        stored = [each for each in ids if each not in self._edited]
        known = dict(zip(stored, self.store.values(name, stored), strict=True))
        edits = {each: dict(self._edits[each].properties) for each in ids if each in self._edits}
        return [edits[each].get(name) if each in edits else known[each] for each in ids]

    def classes(
        self, features: npt.NDArray[Any], layer: DrapedLayer, memory: LRUCache
    ) -> npt.NDArray[np.int16]:
        """Return the numbers of features' classes in a layer, -1 for none; those of the file are cached."""
        by, numbers, count = layer["by"], layer.class_numbers, self.store.count
        found = np.full(len(features), -1, np.int16)
        if not numbers:
            return found

        def stored() -> npt.NDArray[np.int16]:
            batches = (range(count)[first : first + _BATCH] for first in range(0, count, _BATCH))
            values = (value for batch in batches for value in self.store.values(by, batch))
            return np.fromiter((numbers.get(class_value(value), -1) for value in values), np.int16, count)

        known = features < count
        of_file = memory.get_or_compute((self.store, by, tuple(numbers.items())), stored)
        found[known] = of_file[features[known]]
        for number in set(features[np.isin(features, self._changed)].tolist()):
            value = dict(self._edits[number].properties).get(by)
            found[features == number] = numbers.get(class_value(value), -1)
        return found

    def changed_boxes(self, old: VectorSource, *, without: int | None = None) -> Float64Array:
        """Return boxes (n, 4), m, of features that another version has otherwise, `without` one of them."""
        ids = [
            number
            for number in self._edits.keys() | old._edits.keys()
            if number != without and self._edits.get(number) != old._edits.get(number)
        ]
        boxes = [source.box_of(number) for source in (self, old) for number in ids]
        return np.array(boxes, np.float64).reshape(-1, 4)


def file_stamp(path: str) -> tuple[int, int]:
    """Return the size and modification time of a file; -1 if it is missing."""
    try:
        facts = Path(path).stat()
    except OSError:
        return -1, -1
    return facts.st_size, facts.st_mtime_ns


def source_problem(layer: DrapedLayer, stamp: tuple[int, int]) -> str:
    """Return in one line that a file is missing or differs from a stamp or the layer's hash, else empty."""
    problem = drape_problem(layer)
    if problem or layer["sha256"] or file_stamp(layer.path) == stamp:
        return problem
    return f"draped layer {one_line(layer.path)}: its content has changed since it was added"
