"""Draped vector files: what of their tables is drawn near a box, with edits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from sketchterrain.array_types import Bounds, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, class_value, drape_problem
from sketchterrain.drape.vector_store import open_table
from sketchterrain.errors import one_line
from sketchterrain.features.levels import (
    Level,
    Parts,
    joined,
    level_of,
    parts_of,
    split_shapes,
    touch,
)
from sketchterrain.features.table import FeatureTable

_ROUNDED = math.sqrt(0.5)  # of a tolerance: the farthest that a vertex moves
_BATCH = 1 << 16  # values that are read at once


class VectorSource:
    """The table of a draped file with its edits, and what is drawn of it; versions share what stays."""

    def __init__(
        self,
        facts: Mapping[str, Any],
        stamp: tuple[int, int],
        table: FeatureTable,
        parts: dict[tuple[int, float], Parts],
    ) -> None:
        self.facts, self._stamp, self.table = facts, stamp, table
        self._parts = parts  # of edited features, by id and tolerance
        self._changed = np.array(sorted(table.edits), np.int64)
        self._levels: dict[int, Level] = {}

    @classmethod
    def open(cls, layer: DrapedLayer, frame: Mapping[str, Any], extent: float) -> VectorSource:
        """Open a layer's file, whose store is built if need be; raise InputError if it cannot be read."""
        facts, table = open_table(layer, frame, extent)
        return cls(facts, file_stamp(layer.path), table.with_edits(layer.edits), {})

    def updated(self, layer: DrapedLayer) -> VectorSource:
        """Return the source with a layer's edits; features whose edit is the same are shared."""
        edits, before = layer.edits, self.table.edits
        if edits == before:
            return self
        same = {name for name, edit in edits.items() if before.get(name, 0) == edit}
        parts = {key: each for key, each in self._parts.items() if key[0] in same}
        return VectorSource(self.facts, self._stamp, self.table.with_edits(edits), parts)

    def problem(self, layer: DrapedLayer) -> str:
        """Return in one line that the file is missing or has changed; empty if neither."""
        return source_problem(layer, self._stamp)

    def occupies(self, box: Bounds) -> bool:
        """Return whether a feature may have a part in a box (m)."""
        levels = [self.table.levels[0], *([self._edited_level(0)] if len(self._changed) else [])]
        return any(touch(level.groups, box).any() for level in levels)

    @property
    def nbytes(self) -> int:
        """Bytes in memory: those of edited features."""
        return sum(array.nbytes for parts in self._parts.values() for array in parts)

    @property
    def box(self) -> Float64Array:
        """West, south, east and north (m) of all features, NaN without any."""
        boxes = np.array([self.facts["box"], *map(self.box_of, self.table.edits)])
        return np.concatenate([np.fmin.reduce(boxes[:, :2]), np.fmax.reduce(boxes[:, 2:])])

    def query(self, box: Bounds, texel: float) -> list[tuple[Level, Int64Array]]:
        """Return levels and the items of them near a box (m), within a quarter of `texel` of the features."""
        limit = 0.25 * texel / _ROUNDED
        number = max(k for k, level in enumerate(self.table.levels) if level.tolerance <= limit)
        stored = self.table.levels[number]
        found = stored.touching(box)
        if not len(self._changed):
            return [(stored, found)]
        edited = self._edited_level(number)
        found = found[~np.isin(stored.items["feature"][found], self._changed)]
        return [(stored, found), (edited, edited.touching(box))]

    def _edited_level(self, number: int) -> Level:
        """Return the items of edited features."""
        if number not in self._levels:
            tolerance = self.table.levels[number].tolerance
            for name, edit in self.table.edits.items():
                if (name, tolerance) not in self._parts:
                    self._parts[name, tolerance] = _parts_of(name, edit and edit.geometry, tolerance)
            parts = joined([self._parts[name, tolerance] for name in self.table.edits])
            self._levels[number] = level_of(parts, tolerance)
        return self._levels[number]

    def parts(self, number: int) -> Parts:
        """Return the items of one feature with all of its vertices."""
        return _parts_of(number, self.table.geometry(number), 0.0)

    def box_of(self, number: int) -> Float64Array:
        """Return the box (m) of a feature; NaN without one."""
        return np.asarray(shapely.bounds(self.table.geometry(number)))

    def classes(
        self, features: npt.NDArray[Any], layer: DrapedLayer, memory: LRUCache
    ) -> npt.NDArray[np.int16]:
        """Return the numbers of features' classes in a layer, -1 for none; those of the file are cached."""
        by, numbers = layer["by"], layer.class_numbers
        if not numbers:
            return np.full(len(features), -1, np.int16)

        def stored() -> npt.NDArray[np.int16]:
            found, ids = np.full(self.table.count + 1, -1, np.int16), self.table.ids
            for first in range(0, len(ids), _BATCH):
                rows = np.arange(first, min(first + _BATCH, len(ids)))
                values = map(class_value, self.table.values(by, rows))
                found[ids[rows]] = [numbers.get(value, -1) for value in values]
            return found

        of_file: npt.NDArray[np.int16] = memory.get_or_compute(
            (self.table.levels[0], by, tuple(numbers.items())), stored
        )
        found: npt.NDArray[np.int16] = of_file[np.minimum(features, self.table.count)]
        for number in set(features[np.isin(features, self._changed)].tolist()):
            edit = self.table.edits[number]
            value = class_value(edit.properties.get(by) if edit else None)
            found[features == number] = numbers.get(value, -1)
        return found

    def changed_boxes(self, old: VectorSource, *, without: int | None = None) -> Float64Array:
        """Return boxes (n, 4), m, of features that another version has otherwise, `without` one of them."""
        edits, others = self.table.edits, old.table.edits
        ids = [
            number
            for number in edits.keys() | others.keys()
            if number != without and edits.get(number, 0) != others.get(number, 0)
        ]
        boxes = [source.box_of(number) for source in (self, old) for number in ids]
        return np.array(boxes, np.float64).reshape(-1, 4)


def _parts_of(number: int, geometry: BaseGeometry | None, tolerance: float) -> Parts:
    return parts_of(split_shapes(np.array([geometry], object), np.array([number])), tolerance)


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
