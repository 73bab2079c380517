"""Values of vector layers: kinds, limits, rounding, properties as columns, and what is refused."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.materials import MATERIALS
from sketchterrain.document.parameters import Parameter, Properties, parameter_table
from sketchterrain.errors import InputError, format_value

if TYPE_CHECKING:
    from sketchterrain.document.vectors import VectorLayer  # whose values these are

POINT, LINE, AREA = range(3)
KINDS: Final = ("point", "line", "area")

STEP: Final = 1.0 / 1024.0
"""Coordinates are multiples of it (m), so that shared vertices are equal bit for bit."""

MAX_VERTICES, MAX_FEATURE_VERTICES = 4_000_000, 100_000
MAX_COORDINATE = 1e7  # m from the sketch's south-west corner
_MAX_ID = (1 << 31) - 1
_MAX_COLUMNS, _MAX_NAME = 60, 60
_RESERVED = ("id", "label")
WHOLE: Final = {
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


def vector_parameters(layer: str) -> Mapping[str, Parameter]:
    """Return the declared properties of a layer's features, those of its labels included."""
    return {**LAYERS[layer].parameters, **(LINES if "line" in LAYERS[layer].vectors else {})}


def whole_numbers(given: object, dtype: type, what: str) -> npt.NDArray[Any]:
    """Return whole numbers, (n,), as a type; raise InputError for other values."""
    array = np.asarray(given)
    if array.ndim != 1 or (len(array) and array.dtype.kind not in "iu"):
        raise InputError(f"{what}: expected whole numbers (n,), got {array.dtype} {array.shape}")
    whole: npt.NDArray[Any] = array.astype(dtype)
    if (whole != array).any():
        raise InputError(f"{what}: expected numbers from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}")
    return whole


def checked_column(given: object, name: object, layer: str) -> Column:
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
        return whole_numbers(array, np.int64, what)
    raise InputError(f"{what}: expected an array of numbers (n,), or a tuple of texts")


def check_vertices(vertices: Float64Array, layer: str) -> None:
    """Raise InputError unless vertices are (m, 2) numbers that a layer can hold."""
    if vertices.ndim != 2 or vertices.shape[1] != 2 or vertices.dtype.kind not in "fiu":
        raise InputError(
            f"vertices of {layer}: expected numbers (m, 2), got {vertices.dtype} {vertices.shape}"
        )
    if len(vertices) > MAX_VERTICES:
        raise too_many_vertices(layer, len(vertices))
    bad = ~(np.abs(vertices) <= MAX_COORDINATE).all(axis=1)  # also NaN
    if bad.any():
        x, y = vertices[np.argmax(bad)]
        raise InputError(f"{layer}: vertex {x:g}, {y:g}: expected numbers, at most {MAX_COORDINATE:g} m away")


def too_many_vertices(layer: str, count: int) -> InputError:
    """Return the error of a layer with too many vertices."""
    return InputError(f"{layer}: {count} vertices: expected at most {MAX_VERTICES / 1e6:g} million")


def check_features(layer: VectorLayer) -> None:
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


def check_columns(layer: VectorLayer) -> None:
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
