"""Tables of features: points, lines and areas with ids, labels and properties, as immutable arrays."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import chain, pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.schema.layers import LAYERS, VECTOR_LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import Parameter, Properties, Value, parameter_table

if TYPE_CHECKING:  # it takes a quarter of a second
    from shapely.geometry.base import BaseGeometry

    from sketchterrain.features.levels import Level  # of tables
    from sketchterrain.features.picking import Curves  # of tables

Shapes: TypeAlias = npt.NDArray[np.object_]
"""Shapely geometries."""

POINT, LINE, AREA = range(3)
KINDS: Final = ("point", "line", "area")

DRAPED: Final = "drape"
"""The name of tables of draped files."""
NO_INTEGER: Final = np.iinfo(np.int64).min
"""A missing value in whole numbers of draped files."""

STEP: Final = 1.0 / 1024.0
"""Coordinates are multiples of it (m), so that shared vertices are equal bit for bit."""

MAX_VERTICES, MAX_FEATURE_VERTICES = 4_000_000, 100_000
MAX_COORDINATE = 1e7  # m from the sketch's south-west corner
_MAX_ID = (1 << 31) - 1
_MAX_COLUMNS, _MAX_NAME = 60, 60
_RESERVED = ("id", "label")
_NESTED = (-1, 4, 5, 6, 7)  # shapely's type ids: none, multi geometries and collections
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


def checked_properties(properties: Mapping[str, Any]) -> dict[str, Value]:
    """Return the properties that have values; raise InputError if a GeoPackage could not have one."""
    checked = dict[str, Value]()
    for name, value in properties.items():
        if not isinstance(name, str) or not 0 < len(name) <= 200:
            what = f"expected names of 1 to 200 characters, got {format_value(name)}"
            raise InputError(f"drape.edit.properties: {what}")
        if value is None or value != value:  # NaN
            continue
        if not isinstance(value, float | str) and not (isinstance(value, int) and abs(value) < 1 << 63):
            what = f"{one_line(name)} = {format_value(value)}: expected a number or text"
            raise InputError(f"drape.edit.properties.{what}")
        checked[name] = int(value) if isinstance(value, bool) else value
    return checked


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


def single_parts(shapes: Shapes, of: Int64Array) -> tuple[Shapes, Int64Array]:
    """Return the parts of multi geometries and collections, with the index of each one's feature."""
    import shapely

    while np.isin(shapely.get_type_id(shapes), _NESTED).any():
        shapes, part = shapely.get_parts(shapes, return_index=True)
        of = of[part]
    return shapes, of


class Rings(NamedTuple):
    """Rings of shapes: of each shape the points, lines or areas, those that have the most dimensions."""

    kinds: Int64Array  # (n,) of shapes: -1 of those without a place
    vertices: Float64Array  # (m, 2), without the last ones of borders and holes
    ring: Int64Array  # (m,) of each vertex
    feature: Int64Array  # (k,) index of each ring's shape
    begins: BoolArray  # (k,) whether it begins a part: of areas those that are borders

    @classmethod
    def of_shapes(cls, shapes: Shapes) -> Rings:
        """Return the rings of shapely geometries, single or several, (n,), in their order."""
        import shapely

        single, of = single_parts(shapes, np.arange(len(shapes)))
        kind = np.where(shapely.is_empty(single), -1, shapely.get_dimensions(single))
        kinds = np.full(len(shapes), -1)
        np.maximum.at(kinds, of, kind)
        kept = (kind == kinds[of]) & (kind >= 0)
        single, of, areas = single[kept], of[kept], kind[kept] == AREA
        borders, part = shapely.get_rings(single[areas], return_index=True)
        part = np.concatenate([np.flatnonzero(areas)[part], np.flatnonzero(~areas)])
        order = np.argsort(part, kind="stable")
        part, rings = part[order], np.concatenate([borders, single[~areas]])[order]
        vertices, ring = shapely.get_coordinates(rings, return_index=True)
        closing = np.append(ring[1:] != ring[:-1], True)[: len(ring)] & areas[part][ring]
        begins = np.append(True, part[1:] != part[:-1])[: len(part)]
        return cls(kinds, vertices[~closing], ring[~closing], of[part], begins)


class Texts:
    """Texts in UTF-8, one after the other, as in a file that is mapped into memory."""

    def __init__(self, content: npt.NDArray[np.uint8], ends: Int64Array) -> None:
        self._content, self._ends = content, ends

    def __getitem__(self, number: int) -> str:
        start = self._ends[number - 1] if number else 0
        return self._content[start : self._ends[number]].tobytes().decode()


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
        found = Rings.of_shapes(np.array([geometry]))
        rings = np.split(found.vertices, np.searchsorted(found.ring, range(1, len(found.feature))))
        parts = tuple(np.flatnonzero(found.begins).tolist())
        return cls(int(found.kinds[0]), tuple(rings), 1, properties, name, parts)

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

    def touches(self, box: Bounds) -> bool:
        """Return whether its box touches another, m."""
        places = np.concatenate(self.rings)
        return bool((places.min(axis=0) <= box[2:]).all() and (places.max(axis=0) >= box[:2]).all())

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


_Whole = TypeVar("_Whole", bound="InPieces")


class InPieces:
    """A dataclass of arrays, which may consist of successive `pieces` and are joined when asked for."""

    _is_edited = False  # whether its arrays are joined from its pieces

    if TYPE_CHECKING:

        @property
        def pieces(self) -> tuple[Any, ...]:
            """Successive parts of it, or itself alone."""

    else:

        def __getattr__(self, name: str) -> Any:
            """Join an array of all pieces; without pieces all arrays are there."""
            if name == "pieces":
                return (self,)
            if name not in self.__dataclass_fields__ or "pieces" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            value = _join(self.pieces, name)
            object.__setattr__(self, name, value)
            return value

    @classmethod
    def of_pieces(cls: type[_Whole], pieces: Sequence[_Whole]) -> _Whole:
        """Return what consists of some pieces."""
        return _restored(cls, {"pieces": tuple(pieces), "_is_edited": True})

    def digest_parts(self) -> tuple[Any, ...]:
        """Return what its digest for stages is of: that of each piece is kept."""
        return self.pieces if len(self.pieces) > 1 else tuple(self._values.values())

    def __reduce__(self) -> tuple[Any, ...]:
        if len(self.pieces) > 1:
            return self.of_pieces, (self.pieces,)
        values = {name: dict(value) if name == "columns" else value for name, value in self._values.items()}
        return _restored, (type(self), values)

    @property
    def _values(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]


def _restored(kind: type[_Whole], values: dict[str, Any]) -> _Whole:
    """Return a value of checked ones."""
    found = object.__new__(kind)
    for array in values.values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    vars(found).update(values)
    return found


def _join(pieces: Sequence[Any], name: str) -> Any:
    """Return an array of all pieces, read-only, or another value of them."""
    values = [getattr(piece, name) for piece in pieces]
    if name == "layer":
        return values[0]
    if name == "columns":
        return _join_columns(pieces)
    is_start = name in ("rings", "parts", "first")  # where parts of others start
    joined = starts(np.concatenate(list(map(np.diff, values)))) if is_start else np.concatenate(values)
    joined.setflags(write=False)
    return joined


@dataclass(frozen=True, eq=False)
class FeatureTable(InPieces):
    """Features of one layer, in metres from the sketch's south-west corner.

    Vertices at equal positions are one node: features that share it are connected, and it moves as one.
    A large layer consists of `pieces`; an edited one shares those that did not change, so that edits, and
    the memory of their history, cost what they change. Its arrays are joined when they are asked for.

    The table of a draped file (`mapped`) has its columns in files that are mapped into memory, and its
    `edits` beside them. Its vertices are not rounded, and its features may have several parts.

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

    # Of a draped file:
    edits: ClassVar[Mapping[int, Feature | None]] = MappingProxyType({})
    """What replaces features or is added, by id; None: deleted."""
    begins: ClassVar[BoolArray]  # whether each ring begins a part
    levels: ClassVar[tuple[Level, ...]]  # of generalisation, the finest first, with an index of places
    count: ClassVar[int]  # of features, those without a geometry too, which are not in the table
    mixed: ClassVar[Mapping[int, bytes]] = MappingProxyType({})
    """WKB of features with several kinds of parts, which cannot be edited, by id."""

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

    @classmethod
    def mapped(
        cls, arrays: Mapping[str, npt.NDArray[Any]], columns: Mapping[str, Any], **facts: Any
    ) -> FeatureTable:
        """Return the table of a draped file by its arrays, with ascending ids; texts of columns are `Texts`.

        `facts` are `levels`, `count` and `mixed`.
        """
        labels = np.broadcast_to(1, len(arrays["ids"]))
        return _restored(cls, {**arrays, "layer": DRAPED, "labels": labels, "columns": columns, **facts})

    def with_edits(self, edits: Mapping[int, Feature | None]) -> FeatureTable:
        """Return the table of a draped file with other edits."""
        return _restored(FeatureTable, {**vars(self), "edits": edits})

    @property
    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.vertices, self.rings, self.parts, self.kinds, self.ids, self.labels

    def __len__(self) -> int:
        return len(self.ids) if "ids" in self.__dict__ else sum(map(len, self.pieces))

    @cached_property
    def pieces(self) -> tuple[FeatureTable, ...]:
        """Successive parts of a few hundred features; of a small layer itself alone."""
        block = self.rings[self.parts[:-1]] // _PIECE_VERTICES + np.arange(len(self)) // _PIECE_FEATURES
        cuts = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(self)]
        if len(cuts) == 2:
            return (_unchecked(self.layer, *self._arrays, dict(self.columns)),)
        return tuple(self._slice(first, end) for first, end in pairwise(cuts))

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
        return sum(len(piece.vertices) for piece in self.pieces)

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
            for name in self.__dict__.keys() - {"pieces", "_is_edited"}:
                del self.__dict__[name]

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

    def _find(self, name: int) -> tuple[FeatureTable, int]:
        """Return the piece of a feature by its id, and its index there, without edits; raise InputError."""
        if self.layer == DRAPED:
            row = int(np.searchsorted(self.ids, name))
            if row < len(self.ids) and self.ids[row] == name:
                return self, row
            raise _missing(name)
        low, high = self._reach[:, 0], self._reach[:, 1]
        for number in np.flatnonzero((low <= name) & (name <= high)).tolist():
            piece = self.pieces[number]
            found = np.flatnonzero(piece.ids == name)
            if len(found):
                return piece, int(found[0])
        raise _missing(name)

    def __contains__(self, name: int) -> bool:
        """Return whether a feature has an id."""
        if name in self.edits:
            return self.edits[name] is not None
        try:
            self._find(name)
        except InputError:
            return False
        return True

    def feature(self, name: int) -> Feature:
        """Return a feature by its id; raise InputError without one."""
        if name in self.edits:
            if (edit := self.edits[name]) is None:
                raise _missing(name)
            return edit
        piece, index = self._find(name)
        first, end = piece.parts[index : index + 2].tolist()
        parts = np.flatnonzero(self.begins[first:end]).tolist() if self.layer == DRAPED else [0]
        (properties,) = piece.properties([index])
        label, rings = int(piece.labels[index]), tuple(map(piece.ring, range(first, end)))
        return Feature(int(piece.kinds[index]), rings, label, properties, name, tuple(parts))

    def geometry(self, name: int) -> BaseGeometry | None:
        """Return all parts of a feature, of several kinds too; None without one."""
        import shapely

        if name in self.mixed and name not in self.edits:
            return shapely.from_wkb(self.mixed[name])
        return self.feature(name).geometry if name in self else None

    def touching(self, box: Bounds) -> Int64Array:
        """Return the ids of the features that may touch a box (m)."""
        if self.layer != DRAPED:
            return self.ids[self.curves.touching(box)]
        stored = self.levels[0].items["feature"][self.levels[0].touching(box)]
        edited = [name for name, edit in self.edits.items() if edit and edit.touches(box)]
        return np.union1d(np.setdiff1d(stored, list(self.edits)), edited).astype(np.int64)

    def near(self, x: float, y: float, reach: float) -> list[Feature]:
        """Return the features that may be within a distance (m) of a position."""
        return list(map(self.feature, self.touching((x - reach, y - reach, x + reach, y + reach)).tolist()))

    @cached_property
    def curves(self) -> Curves:
        """Its features as they are drawn."""
        from sketchterrain.features.picking import Curves  # which reads tables

        return Curves.of(self)

    def curve(self, feature: Feature) -> BaseGeometry:
        """Return a feature as it is drawn."""
        from sketchterrain.features.picking import curve_of  # which reads tables

        return feature.geometry if self.layer == DRAPED else curve_of(feature)

    def features_at(self, x: float, y: float) -> Iterator[Feature]:
        """Yield the features with a vertex at a position (m): those of one node."""
        if self.layer != DRAPED:
            return self.features_among(np.array([(x, y)]))
        place, found = on_grid((x, y)), self.near(x, y, STEP)
        return (each for each in found if (on_grid(np.concatenate(each.rings)) == place).all(axis=1).any())

    def features_among(self, places: Float64Array) -> Iterator[Feature]:
        """Yield the features with a vertex at positions (n, 2), m."""
        places = on_grid(places)
        for piece in self.pieces_near(*places.min(axis=0).tolist(), *places.max(axis=0).tolist()):
            # Pieces of areas that are sorted by their size are all everywhere: few have a vertex there.
            if len(places) > 1 or piece._has_easting(places[0, 0]):
                found = piece.ring_of_vertex[np.isin(one_number(piece.vertices), one_number(places))]
                yield from map(piece.feature, piece.ids[np.unique(piece.feature_of_ring[found])].tolist())

    def pieces_near(self, west: float, south: float, east: float, north: float) -> Iterator[FeatureTable]:
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
        for name in self.columns:
            for row, value in zip(rows, self.values(name, indices), strict=True):
                if value is not None:
                    row[name] = value
        return rows

    def values(self, name: str, indices: Sequence[int] | Int64Array) -> list[Value | None]:
        """Return a property of features by their indices, without edits; None for missing ones."""
        if (column := self.columns.get(name)) is None:
            return [None] * len(indices)
        if not isinstance(column, np.ndarray):
            return [column[index] or None for index in indices]
        found = column[np.asarray(indices, np.int64)].tolist()
        return [None if value != value or value == NO_INTEGER else value for value in found]

    @property
    def fields(self) -> dict[str, str]:
        """Names of properties, with the type of their values: int64, float64 or text."""
        columns = self.columns.items()
        return {
            name: column.dtype.name if isinstance(column, np.ndarray) else "text" for name, column in columns
        }

    def edited(
        self, remove: Collection[int] = (), add: Sequence[Feature] | FeatureTable = ()
    ) -> FeatureTable:
        """Return the layer without some features, by id, and with others, in their places or appended.

        A new feature of id 0 gets the next free one. Raise InputError for invalid features.
        """
        if self.layer == DRAPED and not isinstance(add, FeatureTable):
            return self.with_edits(self._edits_with(remove, add))
        new = add if isinstance(add, FeatureTable) else self._layer_of(add)
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
        pieces = [piece for piece in pieces if len(piece)]
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

    def _edits_with(self, remove: Collection[int], add: Sequence[Feature]) -> dict[int, Feature | None]:
        """Return the edits of a draped file with further ones; raise InputError if a feature is invalid."""
        import shapely

        edits, left, new = {**self.edits, **dict.fromkeys(remove)}, set(remove), self.next_id
        for feature in add:
            exists = feature.id in left
            what = f"feature {feature.id}" if exists else "new feature"
            if exists and feature.id in self.mixed:
                raise InputError(f"{what}: expected points, lines or areas, not several kinds of parts")
            if not np.isfinite(np.concatenate(feature.rings)).all():
                raise InputError(f"{what}: expected finite coordinates")
            shape = feature.geometry
            if not shapely.is_valid(shape) and (not exists or shapely.is_valid(self.geometry(feature.id))):
                reason = one_line(shapely.is_valid_reason(shape))[:80]
                raise InputError(f"{what}: expected a valid geometry ({reason})")
            number = feature.id if exists else new
            left, new = left - {number}, new + (not exists)
            properties = checked_properties(feature.properties)
            edits[number] = replace(feature, id=number, label=1, properties=properties)
        return edits

    @property
    def next_id(self) -> int:
        """The id of the next new feature."""
        if self.layer == DRAPED:
            return max([self.count - 1, *self.edits]) + 1
        return 1 + int(self._reach[:, 1].max(initial=0))

    def _layer_of(self, features: Sequence[Feature]) -> FeatureTable:
        """Return new features as a layer, with the next free ids."""
        free = self.next_id
        own = [ring for each in features for ring in each.rings]
        return FeatureTable(
            self.layer,
            np.concatenate([np.zeros((0, 2)), *own]),
            starts([len(ring) for ring in own]),
            starts([len(each.rings) for each in features]),
            np.array([each.kind for each in features], np.uint8),
            np.array([each.id or free + number for number, each in enumerate(features)], np.int64),
            np.array([each.label for each in features], np.uint8),
            property_columns([each.properties for each in features]),
        )

    def _slice(self, first: int, end: int) -> FeatureTable:
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

    def _taken(self, indices: Int64Array) -> FeatureTable:
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

    def shapes(self) -> Shapes:
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
        shapes: Shapes,
        *,
        ids: npt.ArrayLike | None = None,
        labels: npt.ArrayLike | None = None,
        columns: Mapping[str, Column] = MappingProxyType({}),
        corner: tuple[float, float] = (0.0, 0.0),
    ) -> FeatureTable:
        """Return a layer of shapely points, lines and polygons, (n,), around the sketch's `corner` (m).

        By default ids count from 1, and labels are 1.
        """
        import shapely

        single = np.isin(shapely.get_type_id(shapes), (0, 1, 3)) & ~shapely.is_empty(shapes)
        if not single.all():
            number = int(np.argmin(single)) + 1
            raise InputError(f"feature {number}: expected a point, a line or an area that is not empty")
        kinds, at, ring, feature, _ = Rings.of_shapes(shapes)
        at = at - corner
        at = on_grid(at) if (np.abs(at) <= MAX_COORDINATE).all() else at
        closed = kinds[feature] == AREA
        twice = repeats(at, ring, closed)
        at, ring = at[~twice], ring[~twice]
        return cls(
            layer,
            at,
            starts(np.bincount(ring, minlength=len(feature))),
            starts(np.bincount(feature, minlength=len(shapes))),
            kinds.astype(np.uint8),
            np.arange(1, len(shapes) + 1) if ids is None else np.asarray(ids),
            np.ones(len(shapes), np.uint8) if labels is None else np.asarray(labels),
            columns,
        )


def _missing(name: int) -> InputError:
    return InputError(f"feature {name}: expected one that the layer has, with a geometry")


def _check_features(layer: FeatureTable) -> None:
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

    for piece in layer.pieces:
        shapes = piece.shapes()
        broken = ~shapely.is_valid(shapes) & (piece.kinds == AREA)
        if broken.any():
            which = int(np.argmax(broken))
            reason = shapely.is_valid_reason(shapes[which])
            raise InputError(
                f"{name} feature {piece.ids[which]}: expected an area that does not touch itself ({reason})"
            )


def _check_columns(layer: FeatureTable) -> None:
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


def check_vectors(vectors: Mapping[str, FeatureTable]) -> Mapping[str, FeatureTable]:
    """Return vector layers by name, empty ones included; raise InputError if one is not as expected."""
    for name, layer in vectors.items():
        if not isinstance(layer, FeatureTable) or layer.layer != name:
            raise InputError(f"vectors of {format_value(name)}: expected a FeatureTable of that name")
    if sum(layer.vertex_count for layer in vectors.values()) > MAX_VERTICES:
        raise InputError(f"more than {MAX_VERTICES / 1e6:g} million vertices: simplify the vector layers")
    return MappingProxyType({name: vectors.get(name) or _EMPTY[name] for name in VECTOR_LAYERS})


_PIECE_FEATURES, _PIECE_VERTICES = 256, 4096  # most of a piece, unless one feature has more

_FIELDS: Final = ("vertices", *_WHOLE, "columns")


def _unchecked(layer: str, *values: Any) -> FeatureTable:
    """Return a layer of features that were checked before; properties that none has are left out."""
    *arrays, columns = values
    own = {name: column for name, column in columns.items() if _has_any(column)}
    for array in own.values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    named = zip(("layer", *_FIELDS), (layer, *arrays, MappingProxyType(own)), strict=True)
    return _restored(FeatureTable, dict(named))


def _has_any(column: Column) -> bool:
    return any(column) if isinstance(column, tuple) else bool((column == column).any())


def _of_pieces(layer: str, pieces: Sequence[FeatureTable]) -> FeatureTable:
    """Return the layer of successive pieces."""
    if len(pieces) < 2:
        return pieces[0] if pieces else _EMPTY[layer]
    found = FeatureTable.of_pieces(pieces)
    return found if len(found) > _PIECE_FEATURES else _joined(pieces)


def _joined(pieces: Sequence[FeatureTable]) -> FeatureTable:
    """Return the layer of successive pieces as one."""
    return _unchecked(pieces[0].layer, *(_join(pieces, name) for name in _FIELDS))


def _join_columns(pieces: Sequence[FeatureTable]) -> Mapping[str, Column]:
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


def _ranges(starts: Int64Array, which: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Return the numbers of the elements of some parts, by where these start, and how many each has."""
    counts = starts[which + 1] - starts[which]
    first = np.cumsum(counts) - counts
    return np.repeat(starts[which] - first, counts) + np.arange(counts.sum()), counts


_EMPTY: Final = {name: FeatureTable(name) for name in VECTOR_LAYERS}
