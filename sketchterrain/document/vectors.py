"""Vector layers: points, lines and areas with ids, labels and properties, as immutable arrays."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b
from types import MappingProxyType
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.materials import MATERIALS
from sketchterrain.document.parameters import Parameter, Properties, Value, parameter_table
from sketchterrain.errors import InputError, format_value

POINT, LINE, AREA = range(3)
KINDS: Final = ("point", "line", "area")

STEP: Final = 1.0 / 1024.0
"""Coordinates are multiples of it (m), so that shared vertices are equal bit for bit."""

MAX_VERTICES, MAX_FEATURE_VERTICES = 4_000_000, 100_000
_MAX_COORDINATE = 1e7  # m from the sketch's south-west corner
_MAX_ID = (1 << 31) - 1
_MAX_COLUMNS, _MAX_NAME = 60, 60
_RESERVED = ("id", "label")
_WHOLE: Final = {
    "rings": np.int64,
    "parts": np.int64,
    "kinds": np.uint8,
    "ids": np.int64,
    "labels": np.uint8,
}
"""Types of the arrays of whole numbers."""

LINES: Mapping[str, Parameter] = parameter_table(
    Parameter("smooth", int, 0, 0, 1, "", "1: its vertices are the control points of a smooth curve"),
    Parameter("directed", int, 0, 0, 1, "", "1: it runs from its first vertex to its last one; 0: downhill"),
)
"""Properties of lines besides those of their layer."""

Column: TypeAlias = Float64Array | Int64Array | tuple[str, ...]
"""A property of each feature; NaN is none."""


def on_grid(places: npt.ArrayLike) -> Float64Array:
    """Return positions (m) rounded as those of vertices are."""
    return np.asarray(np.rint(np.asarray(places, np.float64) / STEP) * STEP + 0.0)


VECTOR_LAYERS: Final = tuple(layer.name for layer in LAYERS.values() if layer.vectors)


def vector_parameters(layer: str) -> Mapping[str, Parameter]:
    """Return the declared properties of a layer's features, those of its labels included."""
    return {**LAYERS[layer].parameters, **(LINES if "line" in LAYERS[layer].vectors else {})}


@dataclass(frozen=True, eq=False)
class VectorFeature:
    """A point, line or area of a vector layer."""

    kind: int  # POINT, LINE or AREA
    # (n, 2) each, m: one of a point or a line; an area's border and holes, whose first vertex is not repeated
    rings: tuple[Float64Array, ...]
    label: int = 1
    properties: Properties = field(default_factory=dict)  # those that differ from the label's, and others
    id: int = 0  # 0: the next free one


@dataclass(frozen=True, eq=False)
class VectorLayer:
    """Features of one layer, in metres from the sketch's south-west corner.

    Vertices at equal positions are one node: features that share it are connected, and it moves as one.

    Parameters
    ----------
    layer : a name in `VECTOR_LAYERS`
    vertices : (m, 2), m; rounded to `STEP`
    rings : (k + 1,) ring r has the vertices rings[r] … rings[r + 1]
    parts : (n + 1,) feature i has the rings parts[i] … parts[i + 1]: of an area its border, then its holes
    kinds : (n,) uint8, POINT, LINE or AREA
    ids : (n,) stable, unique, 1 to 2³¹ − 1
    labels : (n,) uint8, 1 to 255
    columns : properties by name: (n,) float64 or int64, or n texts

    Raises
    ------
    InputError
        If a value is not as described, a line has less than two vertices or an area touches itself.
    """

    layer: str
    vertices: Float64Array = field(default_factory=lambda: np.zeros((0, 2)))
    rings: Int64Array = field(default_factory=lambda: np.zeros(1, np.int64))
    parts: Int64Array = field(default_factory=lambda: np.zeros(1, np.int64))
    kinds: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    ids: Int64Array = field(default_factory=lambda: np.zeros(0, np.int64))
    labels: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    columns: Mapping[str, Column] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.layer not in VECTOR_LAYERS:
            raise InputError(
                f"{format_value(self.layer)}: expected a vector layer, {', '.join(VECTOR_LAYERS)}"
            )
        vertices = np.asarray(self.vertices)
        _check_vertices(vertices, self.layer)
        arrays = {"vertices": on_grid(vertices)}
        for name, dtype in _WHOLE.items():
            arrays[name] = _whole_numbers(getattr(self, name), dtype, f"{self.layer}: {name}")
        columns = {name: _column(column, name, self.layer) for name, column in self.columns.items()}
        for array in (*arrays.values(), *columns.values()):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        object.__setattr__(self, "columns", MappingProxyType(columns))
        _check_features(self)
        _check_columns(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return VectorLayer, (self.layer, *self._arrays, dict(self.columns))

    @property
    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.vertices, self.rings, self.parts, self.kinds, self.ids, self.labels

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def nbytes(self) -> int:
        """Approximate memory."""
        columns = sum(
            column.nbytes if isinstance(column, np.ndarray) else 64 * len(column)
            for column in self.columns.values()
        )
        return int(sum(array.nbytes for array in self._arrays)) + columns

    @cached_property
    def digest(self) -> str:
        """Hash of everything in the layer."""
        columns = sorted((name, np.asarray(column).tolist()) for name, column in self.columns.items())
        parts = [self.layer.encode(), *(array.tobytes() for array in self._arrays), repr(columns).encode()]
        return blake2b(b"".join(blake2b(part).digest() for part in parts), digest_size=16).hexdigest()

    @cached_property
    def feature_of_ring(self) -> Int64Array:
        """(k,) index of each ring's feature."""
        return np.repeat(np.arange(len(self)), np.diff(self.parts))

    @cached_property
    def ring_of_vertex(self) -> Int64Array:
        """(m,) index of each vertex's ring."""
        return np.repeat(np.arange(len(self.rings) - 1), np.diff(self.rings))

    def ring(self, number: int) -> Float64Array:
        """Return the vertices of a ring, (n, 2), m."""
        return self.vertices[self.rings[number] : self.rings[number + 1]]

    def index(self, name: int) -> int:
        """Return the index of a feature by its id; raise KeyError for an unknown one."""
        found = np.flatnonzero(self.ids == name)
        if not len(found):
            raise KeyError(name)
        return int(found[0])

    def feature(self, name: int) -> VectorFeature:
        """Return a feature by its id; raise KeyError for an unknown one."""
        index = self.index(name)
        rings = tuple(self.ring(each) for each in range(*self.parts[index : index + 2]))
        (properties,) = self.properties([index])
        return VectorFeature(int(self.kinds[index]), rings, int(self.labels[index]), properties, name)

    def properties(self, indices: Sequence[int] | Int64Array) -> list[dict[str, Value]]:
        """Return the own properties of features by their indices."""
        rows: list[dict[str, Value]] = [{} for _ in indices]
        for name, column in self.columns.items():
            values = np.array(column, object)[indices].tolist()
            for row, value in zip(rows, values, strict=True):
                if value != "" and value == value:  # NaN is none
                    row[name] = value
        return rows

    def edited(self, remove: Collection[int] = (), add: Sequence[VectorFeature] = ()) -> VectorLayer:
        """Return the layer without some features, by id, and with others appended.

        A new feature of id 0 gets the next free one. Raise InputError for invalid features.
        """
        kept = ~np.isin(self.ids, list(remove))
        rings = kept[self.feature_of_ring]
        counts = np.diff(self.rings)[rings]
        free = int(self.ids.max(initial=0)) + 1
        ids = [each.id or free + number for number, each in enumerate(add)]
        own = [ring for each in add for ring in each.rings]
        return VectorLayer(
            self.layer,
            np.concatenate([self.vertices[rings[self.ring_of_vertex]], *own]),
            starts([*counts.tolist(), *map(len, own)]),
            starts([*np.diff(self.parts)[kept].tolist(), *(len(each.rings) for each in add)]),
            np.append(self.kinds[kept], [each.kind for each in add]).astype(np.uint8),
            np.append(self.ids[kept], np.array(ids, np.int64)),
            np.append(self.labels[kept], [each.label for each in add]).astype(np.uint8),
            property_columns([*self.properties(np.flatnonzero(kept)), *(each.properties for each in add)]),
        )

    def shapes(self) -> npt.NDArray[np.object_]:
        """Return shapely geometries, (n,)."""
        import shapely

        kinds, of = self.kinds[self.feature_of_ring], self.ring_of_vertex
        rings = np.empty(len(kinds), dtype=object)
        rings[kinds == POINT] = shapely.points(self.vertices[kinds[of] == POINT])
        for kind, make in ((LINE, shapely.linestrings), (AREA, shapely.linearrings)):
            own = kinds[of] == kind
            make(self.vertices[own], indices=of[own], out=rings)
        found = rings[self.parts[:-1]]
        areas = kinds == AREA
        shapely.polygons(rings[areas], indices=self.feature_of_ring[areas], out=found)
        return found

    @classmethod
    def from_shapes(
        cls,
        layer: str,
        shapes: npt.NDArray[np.object_],
        *,
        ids: npt.ArrayLike | None = None,
        labels: npt.ArrayLike | None = None,
        columns: Mapping[str, Column] = MappingProxyType({}),
    ) -> VectorLayer:
        """Return a layer of shapely points, lines and polygons, (n,); ids and labels count from 1, are 1."""
        import shapely

        kinds = np.asarray(shapely.get_dimensions(shapes))
        single = np.isin(shapely.get_type_id(shapes), (0, 1, 3)) & ~shapely.is_empty(shapes)
        if not single.all():
            number = int(np.argmin(single)) + 1
            raise InputError(f"feature {number}: expected a point, a line or an area that is not empty")
        areas = np.flatnonzero(kinds == AREA)
        borders, of = shapely.get_rings(shapes[areas], return_index=True)
        others = np.flatnonzero(kinds != AREA)
        feature = np.concatenate([areas[of], others])
        order = np.argsort(feature, kind="stable")
        rings, feature = np.concatenate([borders, shapes[others]])[order], feature[order]
        at, ring = shapely.get_coordinates(rings, return_index=True)
        at = on_grid(at) if (np.abs(at) <= _MAX_COORDINATE).all() else at
        closed = kinds[feature] == AREA
        closing = np.append(ring[1:] != ring[:-1], True)[: len(ring)] & closed[ring]
        at, ring = at[~closing], ring[~closing]
        twice = repeats(at, ring, closed)
        at, ring = at[~twice], ring[~twice]
        return cls(
            layer,
            at,
            starts(np.bincount(ring, minlength=len(rings))),
            starts(np.bincount(feature, minlength=len(shapes))),
            kinds.astype(np.uint8),
            np.arange(1, len(shapes) + 1) if ids is None else np.asarray(ids),
            np.ones(len(shapes), np.uint8) if labels is None else np.asarray(labels),
            columns,
        )


def check_vectors(vectors: Mapping[str, VectorLayer]) -> Mapping[str, VectorLayer]:
    """Return vector layers by name, empty ones included; raise InputError if one is not as expected."""
    for name, layer in vectors.items():
        if not isinstance(layer, VectorLayer) or layer.layer != name:
            raise InputError(f"vectors of {format_value(name)}: expected a VectorLayer of that name")
    if sum(len(layer.vertices) for layer in vectors.values()) > MAX_VERTICES:
        raise InputError(f"more than {MAX_VERTICES / 1e6:g} million vertices: simplify the vector layers")
    return MappingProxyType({name: vectors.get(name) or _EMPTY[name] for name in VECTOR_LAYERS})


def _whole_numbers(given: object, dtype: type, what: str) -> npt.NDArray[Any]:
    """Return whole numbers, (n,), as a type; raise InputError for other values."""
    array = np.asarray(given)
    if array.ndim != 1 or (len(array) and array.dtype.kind not in "iu"):
        raise InputError(f"{what}: expected whole numbers (n,), got {array.dtype} {array.shape}")
    whole: npt.NDArray[Any] = array.astype(dtype)
    if (whole != array).any():
        raise InputError(f"{what}: expected numbers from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}")
    return whole


def _column(given: object, name: object, layer: str) -> Column:
    """Return a property's values; raise InputError if they or its name cannot be stored."""
    if (
        not isinstance(name, str)
        or not 0 < len(name) <= _MAX_NAME
        or not name.isprintable()
        or name in _RESERVED
    ):
        raise InputError(f"{layer}: property {format_value(name)}: expected another name")
    what = f"{layer}: property {name}"
    if isinstance(given, tuple) and all(isinstance(value, str) for value in given):
        if re.search("[\0\ud800-\udfff]", "".join(given)):
            raise InputError(f"{what}: expected texts without NUL that can be encoded in UTF-8")
        return given
    array = np.asarray(given)
    if array.ndim == 1 and array.dtype.kind == "f":
        return array.astype(np.float64)
    if array.ndim == 1 and array.dtype.kind in "iu":
        return _whole_numbers(array, np.int64, what)
    raise InputError(f"{what}: expected an array of numbers (n,), or a tuple of texts")


def _check_vertices(vertices: Float64Array, layer: str) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 2 or vertices.dtype.kind not in "fiu":
        raise InputError(
            f"vertices of {layer}: expected numbers (m, 2), got {vertices.dtype} {vertices.shape}"
        )
    if len(vertices) > MAX_VERTICES:
        raise InputError(
            f"{layer}: {len(vertices)} vertices: expected at most {MAX_VERTICES / 1e6:g} million"
        )
    bad = ~(np.abs(vertices) <= _MAX_COORDINATE).all(axis=1)  # also NaN
    if bad.any():
        x, y = vertices[np.argmax(bad)]
        raise InputError(
            f"{layer}: vertex {x:g}, {y:g}: expected numbers, at most {_MAX_COORDINATE:g} m away"
        )


def _check_features(layer: VectorLayer) -> None:
    """Raise InputError unless ids are unique and shapes are those that the layer takes."""
    ids, name = layer.ids, layer.layer
    counts, rings = np.diff(layer.rings), np.diff(layer.parts)
    sizes = {len(layer.labels), len(layer.kinds), len(rings), len(ids)}
    ends = ((layer.rings, len(layer.vertices)), (layer.parts, len(counts)))
    matches = all(len(at) and at[0] == 0 and at[-1] == end for at, end in ends)
    if sizes != {len(ids)} or not matches or (counts < 0).any() or (rings < 1).any():
        raise InputError(f"vectors of {name}: their arrays do not match in length")
    if len(ids) and (ids.min() < 1 or ids.max() > _MAX_ID or len(np.unique(ids)) < len(ids)):
        raise InputError(f"{name}: expected unique ids from 1 to {_MAX_ID}")
    if (layer.labels < 1).any():
        raise InputError(f"{name}: expected labels from 1 to 255")
    kinds = layer.kinds[layer.feature_of_ring]
    twice = layer.ring_of_vertex[repeats(layer.vertices, layer.ring_of_vertex, kinds == AREA)]
    few = (counts <= kinds) | (np.bincount(twice, minlength=len(counts)) > 0)
    allowed = np.isin(kinds, [KINDS.index(kind) for kind in LAYERS[name].vectors])
    for wrong, expected in (
        (~allowed, " or ".join(LAYERS[name].vectors)),
        ((kinds != AREA) & (np.repeat(rings, rings) != 1), "one part, unless it is an area"),
        ((kinds == POINT) & (counts != 1), "one vertex"),
        (few & (kinds == LINE), "a line of two vertices or more, none twice in a row"),
        (few & (kinds == AREA), "an area of three vertices or more, none twice in a row"),
        (counts > MAX_FEATURE_VERTICES, f"at most {MAX_FEATURE_VERTICES} vertices a line or border"),
    ):
        if wrong.any():
            which = int(layer.ids[layer.feature_of_ring[np.argmax(wrong)]])
            raise InputError(f"{name} feature {which}: expected {expected}")
    if (layer.kinds != AREA).all():
        return
    import shapely

    shapes = layer.shapes()
    broken = ~shapely.is_valid(shapes) & (layer.kinds == AREA)
    if broken.any():
        which = int(np.argmax(broken))
        reason = shapely.is_valid_reason(shapes[which])
        raise InputError(
            f"{name} feature {layer.ids[which]}: expected an area that does not touch itself ({reason})"
        )


def _check_columns(layer: VectorLayer) -> None:
    declared = vector_parameters(layer.layer)
    if len(layer.columns) > _MAX_COLUMNS:
        raise InputError(f"{layer.layer}: {len(layer.columns)} properties: expected at most {_MAX_COLUMNS}")
    for name, column in layer.columns.items():
        if len(column) != len(layer):
            raise InputError(
                f"{layer.layer}: property {name}: expected {len(layer)} values, got {len(column)}"
            )
        if name not in declared:
            continue
        parameter, values = declared[name], np.asarray(column)
        if parameter.choices == MATERIALS and isinstance(column, tuple):
            continue  # a sketch may have others: it checks them
        if parameter.kind is str and isinstance(column, tuple):
            wrong = ~np.isin(values, ["", *map(str, parameter.choices)])
        elif parameter.kind is str or isinstance(column, tuple):
            wrong = np.ones(len(values), np.bool_)
        else:
            allowed = (values >= parameter.low) & (values <= parameter.high)
            wrong = ~(allowed & ((parameter.kind is float) | (values == np.rint(values))) | np.isnan(values))
        if wrong.any():
            which = int(np.argmax(wrong))
            raise InputError(
                f"{layer.layer} feature {layer.ids[which]}: {name} = {format_value(values[which].item())}: "
                f"expected {parameter.expected}"
            )


def repeats(vertices: Float64Array, ring: Int64Array, closed: BoolArray) -> BoolArray:
    """Return which vertices are at the place of the one before them in their ring.

    `ring` is each vertex's ring; before the first vertex of a closed one is its last.
    """
    first = np.append(True, ring[1:] != ring[:-1])[: len(ring)]
    last = np.append(first[1:], True)[: len(ring)]
    found = np.append(False, (vertices[1:] == vertices[:-1]).all(axis=1))[: len(ring)]
    found[first] = (vertices[first] == vertices[last]).all(axis=1) & closed[ring[first]]
    return found


def property_columns(properties: Sequence[Properties]) -> dict[str, Column]:
    """Return properties of features as columns; those that no feature has are left out."""
    columns: dict[str, Column] = {}
    for name in dict.fromkeys(name for each in properties for name in each):
        values = [each.get(name) for each in properties]
        if any(isinstance(value, str) for value in values):
            columns[name] = tuple("" if value is None else str(value) for value in values)
        elif all(isinstance(value, int) for value in values):
            columns[name] = np.array(values, np.int64)
        else:
            columns[name] = np.array([np.nan if value is None else value for value in values], np.float64)
    return columns


def starts(counts: npt.ArrayLike) -> Int64Array:
    """Return where each of successive parts of some lengths starts, and the end of the last one."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, dtype=np.int64))]).astype(np.int64)


_EMPTY: Final = {name: VectorLayer(name) for name in VECTOR_LAYERS}
