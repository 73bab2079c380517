"""Vector sources: the store of a file, and the edits of its features."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from sketchterrain.array_types import Bounds, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, checked_properties, class_value, drape_problem
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
from sketchterrain.features.table import STEP, Feature, on_grid

_ROUNDED = math.sqrt(0.5)  # of a tolerance: the farthest that a vertex moves
_BATCH = 1 << 16  # values that are read at once


class _EditedFeature:
    """Items of an edited feature at each level in use."""

    def __init__(self, number: int, edit: Feature | None) -> None:
        self._number, self._edit = number, edit
        self._parts: dict[float, Parts] = {}

    @cached_property
    def geometry(self) -> BaseGeometry | None:
        return self._edit and self._edit.geometry

    @cached_property
    def _split(self) -> Shapes2D:
        return split_shapes(np.array([self.geometry], object), np.array([self._number]))

    def parts(self, tolerance: float) -> Parts:
        if tolerance not in self._parts:
            self._parts[tolerance] = parts_of(self._split, tolerance)
        return self._parts[tolerance]

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for parts in self._parts.values() for array in parts)


@lru_cache(maxsize=8)
def _stored_feature(store: VectorStore, number: int) -> Feature | None:
    """Return a feature of a file, None without a geometry; the last ones are kept."""
    geometry = store.geometries([number])[0] if 0 <= number < store.count else None
    if geometry is None:
        return None
    values = {name: value for name, value in store.properties(number).items() if value is not None}
    return Feature.from_geometry(geometry, values, number)


class VectorSource:
    """Features of a draped layer with its edits, by id; versions share what they do not change."""

    def __init__(
        self,
        store: VectorStore,
        stamp: tuple[int, int],
        edits: Mapping[int, Feature | None],
        known: Mapping[int, _EditedFeature],
    ) -> None:
        self.store, self._stamp, self.edits = store, stamp, edits
        self._edited = {name: known.get(name) or _EditedFeature(name, edit) for name, edit in edits.items()}
        self._changed = np.array(sorted(edits), np.int64)
        self._levels: dict[int, Level] = {}

    @classmethod
    def open(cls, layer: DrapedLayer, frame: Mapping[str, Any], extent: float) -> VectorSource:
        """Open a layer's file, whose store is built if need be; raise InputError if it cannot be read."""
        store = open_store(layer, frame, extent)
        return cls(store, file_stamp(layer.path), layer.edits, {})

    def updated(self, layer: DrapedLayer) -> VectorSource:
        """Return the source with a layer's edits; features whose edit is the same are shared."""
        return self if self.edits == layer.edits else self._with(layer.edits)

    def _with(self, edits: Mapping[int, Feature | None]) -> VectorSource:
        own = ((name, each) for name, each in self._edited.items() if name in edits)
        same = {name: each for name, each in own if self.edits[name] == edits[name]}
        return VectorSource(self.store, self._stamp, edits, same)

    def edited(self, remove: Sequence[int] = (), add: Sequence[Feature] = ()) -> VectorSource:
        """Return the source without some features, and with others, in their places or with new ids.

        Raise InputError if a feature becomes invalid.
        """
        edits, left, new = {**self.edits, **dict.fromkeys(remove)}, set(remove), self.next_id
        for feature in add:
            what, before = "new feature", self.geometry(feature.id) if feature.id in left else None
            if before is not None:
                what = f"feature {feature.id}"
                if before.geom_type == "GeometryCollection":
                    raise InputError(f"{what}: expected points, lines or areas, not several kinds of parts")
            if not np.isfinite(np.concatenate(feature.rings)).all():
                raise InputError(f"{what}: expected finite coordinates")
            geometry = feature.geometry
            if not shapely.is_valid(geometry) and (before is None or shapely.is_valid(before)):
                reason = one_line(shapely.is_valid_reason(geometry))[:80]
                raise InputError(f"{what}: expected a valid geometry ({reason})")
            number = feature.id if feature.id in left else new
            left, new = left - {number}, new + (number == new)
            properties = checked_properties(feature.properties)
            edits[number] = replace(feature, id=number, label=1, properties=properties)
        return self._with(edits)

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
        """Return a feature, of one with several kinds of parts the areas; raise InputError without one."""
        found = self.edits[number] if number in self.edits else _stored_feature(self.store, number)
        if found is None:
            raise InputError(f"feature {number}: expected one that the layer has, with a geometry")
        return found

    def __contains__(self, number: int) -> bool:
        """Return whether there is a feature with an id."""
        known = self.edits[number] if number in self.edits else _stored_feature(self.store, number)
        return known is not None

    def near(self, x: float, y: float, reach: float) -> list[Feature]:
        """Return the features that may be within a distance (m) of a place."""
        found = self.features((x - reach, y - reach, x + reach, y + reach))
        return list(map(self.feature, found.tolist()))

    def features_at(self, x: float, y: float) -> list[Feature]:
        """Return the features with a vertex at a position (m), rounded as those of vectors are."""
        place, near = on_grid((x, y)), self.near(x, y, STEP)
        return [each for each in near if (on_grid(np.concatenate(each.rings)) == place).all(axis=1).any()]

    def geometry(self, number: int) -> BaseGeometry | None:
        """Return the geometry of a feature in metres of the sketch; None without one."""
        if number in self._edited:
            return self._edited[number].geometry
        return self.store.geometries([number])[0] if 0 <= number < self.store.count else None

    def properties(self, number: int) -> Mapping[str, int | float | str | None]:
        """Return the properties of a feature, of one of the file all, those without a value too."""
        if number in self.edits:
            return edit.properties if (edit := self.edits[number]) else {}
        return self.store.properties(number)

    def parts(self, number: int) -> Parts:
        """Return the items of one feature with all of its vertices."""
        return parts_of(split_shapes(np.array([self.geometry(number)], object), np.array([number])), 0.0)

    def box_of(self, number: int) -> Float64Array:
        """Return the box (m) of a feature; NaN without one."""
        return np.asarray(shapely.bounds(self.geometry(number)))

    def values(self, name: str, ids: Sequence[int]) -> list[int | float | str | None]:
        """Return a property of features."""
        stored = [each for each in ids if each not in self.edits]
        known = dict(zip(stored, self.store.values(name, stored), strict=True))
        return [known[each] if each in known else self.properties(each).get(name) for each in ids]

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
            value = self.properties(number).get(by)
            found[features == number] = numbers.get(class_value(value), -1)
        return found

    def changed_boxes(self, old: VectorSource, *, without: int | None = None) -> Float64Array:
        """Return boxes (n, 4), m, of features that another version has otherwise, `without` one of them."""
        ids = [
            number
            for number in self.edits.keys() | old.edits.keys()
            if number != without and self.edits.get(number, 0) != old.edits.get(number, 0)
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
