"""Vector layers: points, lines and areas with ids, labels and properties, as immutable arrays."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.errors import InputError, format_value
from sketchterrain.schema.layers import LAYERS, VECTOR_LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import Parameter, Properties, Value, parameter_table

if TYPE_CHECKING:  # it takes a quarter of a second
    from shapely.geometry.base import BaseGeometry

POINT, LINE, AREA = range(3)
KINDS: Final = ("point", "line", "area")

STEP: Final = 1.0 / 1024.0
"""Coordinates are multiples of it (m), so that shared vertices are equal bit for bit."""

MAX_VERTICES, MAX_FEATURE_VERTICES = 4_000_000, 100_000
MAX_COORDINATE = 1e7  # m from the sketch's south-west corner
_MAX_ID = (1 << 31) - 1
_MAX_COLUMNS, _MAX_NAME = 60, 60
_RESERVED = ("id", "label")
_FEATURE_BYTES = 64  # of the objects of a feature
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


def one_number(places: Float64Array) -> npt.NDArray[np.complex128]:
    """Return one number of each position (n, 2), to be compared."""
    return np.asarray(places @ np.array([1.0, 1.0j]))


def vector_parameters(layer: str) -> Mapping[str, Parameter]:
    """Return the declared properties of a layer's features, those of its labels included."""
    return {**LAYERS[layer].parameters, **(LINES if "line" in LAYERS[layer].vectors else {})}


def _whole_numbers(given: object, dtype: type, what: str) -> npt.NDArray[Any]:
    """Return whole numbers, (n,), as a type; raise InputError for other values."""
    array = np.asarray(given)
    if array.ndim != 1 or (len(array) and array.dtype.kind not in "iu"):
        raise InputError(f"{what}: expected whole numbers (n,), got {array.dtype} {array.shape}")
    whole: npt.NDArray[Any] = array.astype(dtype)
    if (whole != array).any():
        raise InputError(f"{what}: expected numbers from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}")
    return whole


def _checked_column(given: object, name: object, layer: str) -> Column:
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
    """Raise InputError unless vertices are (m, 2) numbers that a layer can hold."""
    if vertices.ndim != 2 or vertices.shape[1] != 2 or vertices.dtype.kind not in "fiu":
        raise InputError(
            f"vertices of {layer}: expected numbers (m, 2), got {vertices.dtype} {vertices.shape}"
        )
    if len(vertices) > MAX_VERTICES:
        raise _too_many_vertices(layer, len(vertices))
    bad = ~(np.abs(vertices) <= MAX_COORDINATE).all(axis=1)  # also NaN
    if bad.any():
        x, y = vertices[np.argmax(bad)]
        raise InputError(f"{layer}: vertex {x:g}, {y:g}: expected numbers, at most {MAX_COORDINATE:g} m away")


def _too_many_vertices(layer: str, count: int) -> InputError:
    """Return the error of a layer with too many vertices."""
    return InputError(f"{layer}: {count} vertices: expected at most {MAX_VERTICES / 1e6:g} million")


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


@dataclass(frozen=True, eq=False)
class Feature:
    """A feature of a table: points, lines or areas, in the sketch's layers single ones."""

    kind: int  # POINT, LINE or AREA
    # (n, 2) each, m: points, lines, borders and holes, whose first vertex is not repeated
    rings: tuple[Float64Array, ...]
    label: int = 1
    properties: Properties = field(default_factory=dict)  # those that differ from the label's, and others
    id: int = 0  # 0: the next free one
    parts: tuple[int, ...] = (0,)  # the number of each part's first ring: of an area its border

    @classmethod
    def from_geometry(cls, geometry: BaseGeometry, properties: Properties, name: int = 0) -> Feature:
        """Return a feature of shapely points, lines or areas, single or several."""
        import shapely

        kind = int(shapely.get_dimensions(geometry))
        single = shapely.get_parts(geometry)
        single = single[shapely.get_dimensions(single) == kind]
        parts = [list(shapely.get_rings(each)) if kind == AREA else [each] for each in single]
        end = -1 if kind == AREA else None
        rings = tuple(shapely.get_coordinates(ring)[:end] for part in parts for ring in part)
        return cls(kind, rings, 1, properties, name, tuple(starts(list(map(len, parts)))[:-1].tolist()))

    @property
    def geometry(self) -> BaseGeometry:
        """Its shapely points, lines or areas."""
        import shapely

        parts = [self.rings[first:end] for first, end in pairwise((*self.parts, len(self.rings)))]
        if self.kind == AREA:
            shapes = [shapely.Polygon(border, holes) for border, *holes in parts]
            return shapes[0] if len(shapes) == 1 else shapely.MultiPolygon(shapes)
        if self.kind == LINE:
            return (
                shapely.LineString(self.rings[0]) if len(parts) == 1 else shapely.MultiLineString(self.rings)
            )
        places = np.concatenate(self.rings)
        return shapely.Point(places[0]) if len(parts) == 1 else shapely.MultiPoint(places)

    @property
    def nbytes(self) -> int:
        """Approximate memory."""
        values = sum(len(name) + len(str(value)) for name, value in self.properties.items())
        return _FEATURE_BYTES + values + sum(ring.nbytes for ring in self.rings)

    # By hand: messages to other processes contain values of eq=False only once.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, Feature) and self._content == other._content

    def __hash__(self) -> int:
        return hash((self.id, self.kind, self.parts, self.rings[0].tobytes()))

    @property
    def _content(self) -> tuple[object, ...]:
        rings = [(len(ring), ring.tobytes()) for ring in self.rings]
        return self.kind, self.label, self.id, self.parts, self.properties, rings


@dataclass(frozen=True, eq=False)
class VectorLayer:
    """Features of one layer, in metres from the sketch's south-west corner.

    Vertices at equal positions are one node: features that share it are connected, and it moves as one.
    A large layer consists of `pieces`; an edited one shares those that did not change, so that edits, and
    the memory of their history, cost what they change. Its arrays are joined when they are asked for.

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
        columns = {name: _checked_column(column, name, self.layer) for name, column in self.columns.items()}
        for array in (*arrays.values(), *columns.values()):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        object.__setattr__(self, "columns", MappingProxyType(columns))
        _check_features(self)
        _check_columns(self)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Join an array of all pieces, or the columns; those of a layer of one piece are always there."""
            if name not in _JOINERS or "pieces" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            value = _JOINERS[name](self.pieces, name)
            if name != "columns":
                value.setflags(write=False)
            object.__setattr__(self, name, value)
            return value

    def __reduce__(self) -> tuple[Any, ...]:
        if len(self.pieces) > 1:
            return _of_pieces, (self.layer, self.pieces)
        return VectorLayer, (self.layer, *self._arrays, dict(self.columns))

    def digest_parts(self) -> tuple[object, ...]:
        """Return what its digest for stages is of: that of each piece is kept."""
        return self.pieces if len(self.pieces) > 1 else (self.layer, *self._arrays, self.columns)

    @property
    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.vertices, self.rings, self.parts, self.kinds, self.ids, self.labels

    def __len__(self) -> int:
        return len(self.ids) if "ids" in self.__dict__ else int(self._firsts[-1, 0])

    @cached_property
    def pieces(self) -> tuple[VectorLayer, ...]:
        """Successive parts of a few hundred features; of a small layer itself alone."""
        block = self.rings[self.parts[:-1]] // _PIECE_VERTICES + np.arange(len(self)) // _PIECE_FEATURES
        cuts = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(self)]
        if len(cuts) == 2:
            return (_unchecked(self.layer, *self._arrays, dict(self.columns)),)
        return tuple(self._slice(first, end) for first, end in pairwise(cuts))

    @cached_property
    def _firsts(self) -> Int64Array:
        """(p + 1, 3) number of the first feature, ring and vertex of each piece, and of the ends."""
        return np.cumsum([(0, 0, 0), *(piece._size for piece in self.pieces)], axis=0)

    @cached_property
    def _size(self) -> tuple[int, int, int]:
        return len(self.ids), len(self.rings) - 1, len(self.vertices)

    @cached_property
    def _reach(self) -> Float64Array:
        """(p, 6) lowest and highest id of each piece, and its west, south, east and north."""
        return np.array([piece._own_reach for piece in self.pieces]).reshape(-1, 6)

    @cached_property
    def _own_reach(self) -> tuple[float, ...]:
        if not len(self):
            return np.inf, -np.inf, np.inf, np.inf, -np.inf, -np.inf
        low, high = self.vertices.min(axis=0).tolist(), self.vertices.max(axis=0).tolist()
        return float(self.ids.min()), float(self.ids.max()), *low, *high

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return int(self._firsts[-1, 2])

    @property
    def nbytes(self) -> int:
        """Approximate memory."""
        columns = sum(
            column.nbytes if isinstance(column, np.ndarray) else 64 * len(column)
            for column in self.columns.values()
        )
        return int(sum(array.nbytes for array in self._arrays)) + columns

    def release(self) -> None:
        """Free what is joined of the pieces again when it is asked for."""
        if self._is_edited:
            for name in self.__dict__.keys() - {"layer", "pieces", "_is_edited"}:
                del self.__dict__[name]

    @cached_property
    def _is_edited(self) -> bool:
        """Whether its arrays are joined from its pieces."""
        return False

    def texts(self, name: str) -> frozenset[str]:
        """Return the different texts of a property."""
        if len(self.pieces) > 1:
            return frozenset().union(*(piece._texts[name] for piece in self.pieces if name in piece._texts))
        return self._texts.get(name, frozenset())

    @cached_property
    def label_counts(self) -> Int64Array:
        """(256,) how many features have each label."""
        if len(self.pieces) > 1:
            return np.asarray(np.sum([piece.label_counts for piece in self.pieces], axis=0))
        return np.bincount(self.labels, minlength=256)

    @cached_property
    def _texts(self) -> Mapping[str, frozenset[str]]:
        return {name: frozenset(column) for name, column in self.columns.items() if isinstance(column, tuple)}

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

    def _find(self, name: int) -> tuple[int, int]:
        """Return the piece of a feature by its id, and its index there; raise KeyError for an unknown one."""
        low, high = self._reach[:, 0], self._reach[:, 1]
        for number in np.flatnonzero((low <= name) & (name <= high)).tolist():
            found = np.flatnonzero(self.pieces[number].ids == name)
            if len(found):
                return number, int(found[0])
        raise KeyError(name)

    def __contains__(self, name: int) -> bool:
        """Return whether a feature has an id."""
        try:
            self._find(name)
        except KeyError:
            return False
        return True

    def index(self, name: int) -> int:
        """Return the index of a feature by its id; raise KeyError for an unknown one."""
        number, index = self._find(name)
        return int(self._firsts[number, 0]) + index

    def feature(self, name: int) -> Feature:
        """Return a feature by its id; raise KeyError for an unknown one."""
        number, index = self._find(name)
        piece = self.pieces[number]
        rings = tuple(piece.ring(each) for each in range(*piece.parts[index : index + 2]))
        (properties,) = piece.properties([index])
        return Feature(int(piece.kinds[index]), rings, int(piece.labels[index]), properties, name)

    def features_at(self, x: float, y: float) -> Iterator[Feature]:
        """Yield the features with a vertex at a position (m): those of one node."""
        return self.features_among(np.array([(x, y)]))

    def features_among(self, places: Float64Array) -> Iterator[Feature]:
        """Yield the features with a vertex at positions (n, 2), m."""
        places = on_grid(places)
        for piece in self.pieces_near(*places.min(axis=0).tolist(), *places.max(axis=0).tolist()):
            # Pieces of areas that are sorted by their size are all everywhere: few have a vertex there.
            if len(places) > 1 or piece._has_easting(places[0, 0]):
                found = piece.ring_of_vertex[np.isin(one_number(piece.vertices), one_number(places))]
                yield from map(piece.feature, piece.ids[np.unique(piece.feature_of_ring[found])].tolist())

    def pieces_near(self, west: float, south: float, east: float, north: float) -> Iterator[VectorLayer]:
        """Yield the pieces that reach a rectangle (m)."""
        low, high = self._reach[:, 2:4], self._reach[:, 4:]
        near = ((low <= (east, north)) & (high >= (west, south))).all(axis=1)
        return (self.pieces[number] for number in np.flatnonzero(near).tolist())

    def _has_easting(self, x: float) -> bool:
        index = self._eastings.searchsorted(x)
        return bool(index < len(self._eastings) and self._eastings[index] == x)

    @cached_property
    def _eastings(self) -> Float64Array:
        return np.sort(self.vertices[:, 0])

    def properties(self, indices: Sequence[int] | Int64Array) -> list[dict[str, Value]]:
        """Return the own properties of features by their indices."""
        rows: list[dict[str, Value]] = [{} for _ in indices]
        for name, column in self.columns.items():
            values = np.array(column, object)[indices].tolist()
            for row, value in zip(rows, values, strict=True):
                if value != "" and value == value:  # NaN is none
                    row[name] = value
        return rows

    def edited(self, remove: Collection[int] = (), add: Sequence[Feature] | VectorLayer = ()) -> VectorLayer:
        """Return the layer without some features, by id, and with others, in their places or appended.

        A new feature of id 0 gets the next free one. Raise InputError for invalid features.
        """
        new = add if isinstance(add, VectorLayer) else self._layer_of(add)
        gone = np.unique(np.fromiter(remove, np.int64, len(remove)))
        pieces = list(self.pieces)
        between = (
            np.searchsorted(gone, self._reach[:, 0]),
            np.searchsorted(gone, self._reach[:, 1], side="right"),
        )
        replaces = np.zeros(len(new), np.bool_)
        for number in np.flatnonzero(between[0] < between[1]).tolist():
            piece = pieces[number]
            order = np.arange(len(piece))
            own, of_own, of_new = np.intersect1d(piece.ids, new.ids, return_indices=True)
            stays = np.isin(own, gone)
            order[of_own[stays]] = len(piece) + of_new[stays]
            replaces[of_new[stays]] = True
            kept = order[(order >= len(piece)) | ~np.isin(piece.ids, gone)]
            pieces[number] = _joined([piece, new])._taken(kept)
        pieces = [piece for piece in pieces if piece._size[0]]
        last = new._taken(np.flatnonzero(~replaces))
        if twice := next((each for each in last.ids.tolist() if each in self), None):
            raise InputError(
                f"{self.layer}: id {twice}: expected unique ids, there is a feature with this one"
            )
        if pieces and len(last) and len(pieces[-1]) + len(last) <= _PIECE_FEATURES:
            pieces[-1] = _joined([pieces[-1], last])
        elif len(last):
            pieces += last.pieces
        edited = _of_pieces(self.layer, pieces)
        if edited.vertex_count > MAX_VERTICES:
            raise _too_many_vertices(self.layer, edited.vertex_count)
        return edited

    @property
    def next_id(self) -> int:
        """The id of the next new feature."""
        return 1 + int(self._reach[:, 1].max(initial=0))

    def _layer_of(self, features: Sequence[Feature]) -> VectorLayer:
        """Return new features as a layer, with the next free ids."""
        free = self.next_id
        own = [ring for each in features for ring in each.rings]
        return VectorLayer(
            self.layer,
            np.concatenate([np.zeros((0, 2)), *own]),
            starts([len(ring) for ring in own]),
            starts([len(each.rings) for each in features]),
            np.array([each.kind for each in features], np.uint8),
            np.array([each.id or free + number for number, each in enumerate(features)], np.int64),
            np.array([each.label for each in features], np.uint8),
            property_columns([each.properties for each in features]),
        )

    def _slice(self, first: int, end: int) -> VectorLayer:
        """Return successive features."""
        parts = self.parts[first : end + 1]
        rings = self.rings[parts[0] : parts[-1] + 1]
        return _unchecked(
            self.layer,
            self.vertices[rings[0] : rings[-1]],
            rings - rings[0],
            parts - parts[0],
            *(array[first:end] for array in (self.kinds, self.ids, self.labels)),
            {name: column[first:end] for name, column in self.columns.items()},
        )

    def _taken(self, indices: Int64Array) -> VectorLayer:
        """Return some features, by their indices, in that order."""
        rings, of_ring = _ranges(self.parts, indices)
        vertices, of_vertex = _ranges(self.rings, rings)
        columns = {
            name: tuple(column[each] for each in indices.tolist())
            if isinstance(column, tuple)
            else column[indices]
            for name, column in self.columns.items()
        }
        arrays = (array[indices] for array in (self.kinds, self.ids, self.labels))
        return _unchecked(
            self.layer, self.vertices[vertices], starts(of_vertex), starts(of_ring), *arrays, columns
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
        corner: tuple[float, float] = (0.0, 0.0),
    ) -> VectorLayer:
        """Return a layer of shapely points, lines and polygons, (n,), around the sketch's `corner` (m).

        By default ids count from 1, and labels are 1.
        """
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
        at -= corner
        at = on_grid(at) if (np.abs(at) <= MAX_COORDINATE).all() else at
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
    """Raise InputError unless properties have a value for each feature, and declared ones an allowed one."""
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


def check_vectors(vectors: Mapping[str, VectorLayer]) -> Mapping[str, VectorLayer]:
    """Return vector layers by name, empty ones included; raise InputError if one is not as expected."""
    for name, layer in vectors.items():
        if not isinstance(layer, VectorLayer) or layer.layer != name:
            raise InputError(f"vectors of {format_value(name)}: expected a VectorLayer of that name")
    if sum(layer.vertex_count for layer in vectors.values()) > MAX_VERTICES:
        raise InputError(f"more than {MAX_VERTICES / 1e6:g} million vertices: simplify the vector layers")
    return MappingProxyType({name: vectors.get(name) or _EMPTY[name] for name in VECTOR_LAYERS})


_PIECE_FEATURES, _PIECE_VERTICES = 256, 4096  # most of a piece, unless one feature has more

_FIELDS: Final = ("vertices", *_WHOLE, "columns")


def _unchecked(layer: str, *values: Any) -> VectorLayer:
    """Return a layer of features that were checked before; properties that none has are left out."""
    *arrays, columns = values
    own = {name: column for name, column in columns.items() if _has_any(column)}
    found = object.__new__(VectorLayer)
    for array in (*arrays, *own.values()):
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    for name, value in zip(("layer", *_FIELDS), (layer, *arrays, MappingProxyType(own)), strict=True):
        object.__setattr__(found, name, value)
    return found


def _has_any(column: Column) -> bool:
    return any(column) if isinstance(column, tuple) else bool((column == column).any())


def _of_pieces(layer: str, pieces: Sequence[VectorLayer]) -> VectorLayer:
    """Return the layer of successive pieces."""
    pieces = tuple(pieces)
    if len(pieces) < 2:
        return pieces[0] if pieces else _EMPTY[layer]
    found = object.__new__(VectorLayer)
    for name, value in {"layer": layer, "pieces": pieces, "_is_edited": True}.items():
        object.__setattr__(found, name, value)
    return found if len(found) > _PIECE_FEATURES else _joined(pieces)


def _joined(pieces: Sequence[VectorLayer]) -> VectorLayer:
    """Return the layer of successive pieces as one."""
    return _unchecked(pieces[0].layer, *(_JOINERS[name](pieces, name) for name in _FIELDS))


def _join_arrays(pieces: Sequence[VectorLayer], name: str) -> npt.NDArray[Any]:
    return np.concatenate([getattr(piece, name) for piece in pieces])


def _join_starts(pieces: Sequence[VectorLayer], name: str) -> Int64Array:
    return starts(np.concatenate([np.diff(getattr(piece, name)) for piece in pieces]))


def _join_columns(pieces: Sequence[VectorLayer], _: str) -> Mapping[str, Column]:
    """Return the properties of all pieces, of the types that `property_columns` gives them."""
    columns: dict[str, Column] = {}
    for name in dict.fromkeys(name for piece in pieces for name in piece.columns):
        own = [piece.columns.get(name) for piece in pieces]
        if any(isinstance(column, tuple) for column in own):
            columns[name] = tuple(chain.from_iterable(map(_texts, own, map(len, pieces))))
        else:
            none = [np.full(len(piece), np.nan) for piece in pieces]
            columns[name] = np.concatenate(
                [empty if column is None else column for column, empty in zip(own, none, strict=True)]
            )
    return MappingProxyType(columns)


def _texts(column: Column | None, count: int) -> tuple[str, ...]:
    if column is None or isinstance(column, tuple):
        return column or ("",) * count
    return tuple("" if value != value else str(value) for value in column.tolist())


_JOINERS: Final[Mapping[str, Callable[[Sequence[VectorLayer], str], Any]]] = {
    **dict.fromkeys(("vertices", "kinds", "ids", "labels"), _join_arrays),
    **dict.fromkeys(("rings", "parts"), _join_starts),
    "columns": _join_columns,
}


def _ranges(starts: Int64Array, which: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Return the numbers of the elements of some parts, by where these start, and how many each has."""
    counts = starts[which + 1] - starts[which]
    first = np.cumsum(counts) - counts
    return np.repeat(starts[which] - first, counts) + np.arange(counts.sum()), counts


_EMPTY: Final = {name: VectorLayer(name) for name in VECTOR_LAYERS}
