"""Draped layers: vectors and rasters by path and hash that are shown on the terrain without changing it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.document.rasters import RASTER, RasterSource, content_hash, raster_problem
from sketchterrain.errors import InputError, check_keys, check_tables, format_value, one_line
from sketchterrain.features.table import Feature, checked_properties
from sketchterrain.io.files import too_large, wrap_read_errors
from sketchterrain.schema.parameters import (
    FRAME,
    Parameter,
    Properties,
    Sentinel,
    check_items,
    check_values,
    defaults,
    parameter_table,
)
from sketchterrain.schema.styles import STYLE

if TYPE_CHECKING:  # it takes a quarter of a second
    from shapely.geometry.base import BaseGeometry

MAX_DRAPES: Final = 64
"""The most draped layers of a sketch."""
MAX_CLASSES: Final = 256
"""The most classes of a layer."""
MAX_EDIT_BYTES: Final = 16 << 20
"""The most bytes of all edits of features in a sketch."""
BLENDS: Final = ("normal", "multiply", "screen", "add")

DRAPE: Final = parameter_table(
    RASTER["path"],
    RASTER["sha256"],
    Parameter("table", str, "", 0, 200, "", "layer of the file; empty is its first one"),
    replace(RASTER["band"], help="band of a raster; of a picture in colour the first one"),
    Parameter("title", str, "", 0, 200, "", "name in the list of layers; empty is the file's"),
    Parameter("visible", int, 1, 0, 1, "", "whether it is shown"),
    Parameter("opacity", float, 1.0, 0.0, 1.0, "", "of all of it"),
    Parameter(*("blend", str, "normal", 0, 8, ""), "how its colours mix with those below", choices=BLENDS),
    Parameter(
        *("finest", float, 0.0, 0.0, 1e6, "m"),
        "ground in a pixel below which it is hidden; 0 shows it however near",
        soft_range=(0.0, 100.0),
    ),
    Parameter(
        *("coarsest", float, 0.0, 0.0, 1e6, "m"),
        "ground in a pixel from which it is hidden; 0 shows it however far",
        sentinel=Sentinel(0.0, "Always", 50.0),
        soft_range=(0.0, 1000.0),
    ),
    Parameter("by", str, "", 0, 80, "", "property whose values are the layer's classes"),
    replace(FRAME["crs"], help="of a file without one, as EPSG:4326; empty is the sketch's"),
)
"""Keys of ``[[drape]]`` besides those of `STYLE`."""

CLASS: Final = parameter_table(
    Parameter("value", str, "", 0, 200, "characters", "of the property that `by` names"), *STYLE.values()
)
"""Keys of ``[[drape.class]]``."""

_ID: Final = Parameter("id", int, 0, 0, 2**63 - 1, "", "of the feature in the file; others are new features")
_SHAPES: Final = (0, 1, 3, 4, 5, 6)  # shapely's type ids of points, lines and areas, single or several
_ENTRY: Final = 72  # bytes of an edit in a layer


@dataclass(frozen=True)
class DrapeClass:
    """A style for features with a value of the property ``by``; keys that it lacks are the layer's.

    Raise InputError if a value is not as declared.
    """

    value: str
    style: Properties = field(default_factory=dict)

    def __post_init__(self) -> None:
        given = {"value": self.value, **self.style}
        _, *style = check_values(given, CLASS, "[[drape.class]]", "drape.class.").items()
        object.__setattr__(self, "style", MappingProxyType(dict(style)))

    def __hash__(self) -> int:
        return hash((self.value, tuple(self.style.items())))


@dataclass(frozen=True, eq=False)
class DrapedLayer:
    """A vector or raster file by its path, absolute once a sketch is loaded, with the keys of `DRAPE`.

    Raise InputError if a value is not as declared.
    """

    path: str
    values: Properties = field(default_factory=dict)  # by the names in `DRAPE`, without `path`
    style: Properties = field(default_factory=dict)  # by the names in `STYLE`
    classes: tuple[DrapeClass, ...] = ()
    # What replaces features of the file, or is added to it, until it is saved, by id; None: deleted
    edits: Mapping[int, Feature | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given = {"path": self.path, **self.values}
        checked = defaults(DRAPE) | check_values(given, DRAPE, "[[drape]]", "drape.")
        style = defaults(STYLE) | check_values(self.style, STYLE, "[[drape]]", "drape.")
        object.__setattr__(self, "path", checked.pop("path"))
        object.__setattr__(self, "values", MappingProxyType(checked))
        object.__setattr__(self, "style", MappingProxyType(style))
        if checked["crs"]:
            from sketchterrain.io.crs import parse_crs

            parse_crs(str(checked["crs"]))
        classes = check_items(DrapeClass, self.classes, "classes of a draped layer", most=MAX_CLASSES)
        object.__setattr__(self, "classes", classes)
        object.__setattr__(self, "edits", MappingProxyType(dict(self.edits)))

    # By hand: messages to other processes contain values of eq=False only once.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, DrapedLayer) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(self.path)

    def __getitem__(self, name: str) -> Any:
        """Return a value by its name in `DRAPE`."""
        return self.values[name]

    @property
    def title(self) -> str:
        """Its name in the list of layers."""
        return self["title"] or one_line(Path(self.path).stem)

    @property
    def file(self) -> RasterSource:
        """Its file by path and hash."""
        return RasterSource(self.path, sha256=self["sha256"])

    @property
    def stored_values(self) -> dict[str, Any]:
        """Values of `DRAPE` and `STYLE` to store: the path, and those that are not defaults."""
        values = {**self.values, **self.style}
        changed = {name: value for name, value in values.items() if value != _KEYS[name].default}
        return {"path": self.path, **changed}

    @property
    def source_key(self) -> tuple[object, ...]:
        """What its features and pixels depend on: the file and what is read of it, without edits."""
        return self.path, self["sha256"], self["table"], self["band"], self["crs"]

    @property
    def class_numbers(self) -> dict[str, int]:
        """Numbers of classes by value, of several with one value that of the first."""
        numbered = reversed(list(enumerate(self.classes)))
        return {each.value: number for number, each in numbered} if self["by"] else {}

    def style_of(self, number: int) -> Properties:
        """Return the whole style of a class by its number, of other features for -1."""
        return self.style if number < 0 else {**self.style, **self.classes[number].style}

    def replace(self, **changes: Any) -> DrapedLayer:
        """Return a layer with other values by the names of fields, of `DRAPE` and of `STYLE`."""
        values, style, fields = dict(self.values), dict(self.style), dict[str, Any]()
        for name, value in changes.items():
            table = style if name in STYLE else values if name in DRAPE and name != "path" else fields
            table[name] = value
        return replace(self, **{"values": values, "style": style, **fields})


_KEYS: Final = {**DRAPE, **STYLE}


def draped_layer(path: Path, /, **values: Any) -> DrapedLayer:
    """Return a layer of a file, with its hash and other values by the names in `DRAPE` and `STYLE`.

    A folder, as of a world, has no hash. Raise InputError if it is missing, or for a bad name or value.
    """
    check_keys(values, list(_KEYS)[1:])
    layer = DrapedLayer(str(path.absolute())).replace(**values)
    if problem := drape_problem(layer.replace(sha256="")):
        raise InputError(problem)
    with wrap_read_errors(path):
        return layer.replace(sha256="" if path.is_dir() else content_hash(layer.file))


def drape_problem(layer: DrapedLayer) -> str:
    """Return in one line that a layer's file is missing or has changed since it was added, else empty."""
    return "" if os.path.isdir(layer.path) else raster_problem(layer.file, "draped layer")  # noqa: PTH112 # no error


def moved_drapes(
    drapes: Iterable[DrapedLayer], change: Callable[[Float64Array], Float64Array]
) -> tuple[DrapedLayer, ...]:
    """Return layers whose edits have changed coordinates (n, 2), as in a sketch of another extent."""

    def moved(edit: Feature | None) -> Feature | None:
        return edit and replace(edit, rings=tuple(map(change, edit.rings)))

    return tuple(
        replace(each, edits={name: moved(edit) for name, edit in each.edits.items()}) if each.edits else each
        for each in drapes
    )


def new_drape_bytes(former: Sequence[DrapedLayer], drapes: Sequence[DrapedLayer]) -> int:
    """Return the approximate memory of edits that former layers do not have: they share the others."""
    known = {id(edit) for layer in former for edit in layer.edits.values()}
    changed = [layer for layer in drapes if all(layer is not each for each in former)]
    edits = [edit for layer in changed for edit in layer.edits.values()]
    return _ENTRY * len(edits) + sum(edit.nbytes for edit in edits if edit and id(edit) not in known)


def class_value(value: int | float | str | None) -> str:
    """Return a property's value as classes name it: 3, not 3.0."""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return "" if value is None else str(value)


def check_drapes(drapes: Iterable[object]) -> tuple[DrapedLayer, ...]:
    """Return draped layers, from the lowest up; raise InputError for too many, or too large edits."""
    checked = check_items(DrapedLayer, drapes, "draped layers", most=MAX_DRAPES)
    if sum(edit.nbytes for layer in checked for edit in layer.edits.values() if edit) > MAX_EDIT_BYTES:
        raise too_large("edits of draped layers that are not yet saved to their files", MAX_EDIT_BYTES)
    return checked


def parse_drape(table: Mapping[str, object]) -> DrapedLayer:
    """Return the layer in one ``[[drape]]`` table; raise InputError if it is invalid."""
    rest = dict(table)
    classes, edits = (
        check_tables(name, rest.pop(name, []), f"[[drape.{name}]] above it") for name in ("class", "edit")
    )
    check_keys(rest, [*_KEYS, "class", "edit"])
    if "path" not in rest:
        raise InputError(f"no path: expected {', '.join(_KEYS)}")
    styles = tuple(DrapeClass(each.pop("value", ""), each) for each in classes)
    layer = DrapedLayer(rest.pop("path"), classes=styles)  # type: ignore[arg-type] # it checks every value
    return _with_edits(layer, map(_parse_edit, edits)).replace(**rest)


_EditRow: TypeAlias = "tuple[Any, BaseGeometry | None, Mapping[str, Any]]"  # id, geometry and properties


def _with_edits(layer: DrapedLayer, rows: Iterable[_EditRow]) -> DrapedLayer:
    """Return a layer with edits that were read; raise InputError unless they are of different features."""
    edits = dict[int, Feature | None]()
    for name, geometry, properties in rows:
        if _ID.check(name, "drape.edit.id") in edits:
            raise InputError(f"two edits of feature {name}: expected one")
        edits[name] = None if geometry is None else draped_feature(geometry, properties, name)
    return replace(layer, edits=edits)


def _parse_edit(table: Mapping[str, Any]) -> _EditRow:
    """Return an edit of a file of format 1 or 2, with its geometry as WKT."""
    check_keys(table, ["id", "geometry", "deleted", "properties"], "[[drape.edit]]")
    if ("geometry" in table) == ("deleted" in table) or table.get("deleted", True) is not True:
        raise InputError("[[drape.edit]]: expected either a geometry or deleted = true")
    properties = table.get("properties", {})
    if not isinstance(properties, dict):
        raise InputError(f"drape.edit.properties = {format_value(properties)}: expected a table")
    import shapely

    try:
        return table.get("id"), shapely.from_wkt(table.get("geometry")), properties
    except (shapely.errors.GEOSException, TypeError) as error:
        raise InputError(f"drape.edit.geometry: expected WKT ({one_line(error)[:80]})") from None


def encode_edits(drapes: Sequence[DrapedLayer]) -> bytes:
    """Return the edits of layers as a FlatGeobuf file in metres of the sketch; a deleted one has no geometry.

    Columns are ``drape``, the number of the layer from 1, ``id``, and ``properties`` as JSON.
    """
    from sketchterrain.features.files import encode_table

    rows = [
        (number, name, layer.edits[name])
        for number, layer in enumerate(drapes, 1)
        for name in sorted(layer.edits)
    ]
    shapes = np.fromiter((edit and edit.geometry for *_, edit in rows), object, len(rows))
    columns = {
        "drape": np.array([number for number, *_ in rows], np.int64),
        "id": np.array([name for _, name, _ in rows], np.int64),
        "properties": tuple(json.dumps(dict(edit.properties) if edit else {}) for *_, edit in rows),
    }
    return encode_table("drapes", shapes, columns)


def with_edits(drapes: Sequence[DrapedLayer], data: bytes) -> tuple[DrapedLayer, ...]:
    """Return layers with the edits of `encode_edits`; raise InputError if they do not fit, or are damaged."""
    from sketchterrain.features.files import decode_table

    _, shapes, columns = decode_table(data)
    rows: list[list[_EditRow]] = [[] for _ in drapes]
    try:
        values = (columns[name] for name in ("drape", "id", "properties"))
        for number, name, text, geometry in zip(*values, shapes, strict=True):
            rows[range(len(rows)).index(number - 1)].append((int(name), geometry, json.loads(text)))
        return tuple(map(_with_edits, drapes, rows))
    except (LookupError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"expected edits of {len(drapes)} draped layers ({one_line(error)[:80]})") from None


def draped_feature(geometry: BaseGeometry, properties: Mapping[str, Any], name: int) -> Feature:
    """Return a feature of points, lines or areas (m), without heights; raise InputError for another one."""
    import shapely

    is_finite = bool((abs(shapely.get_coordinates(geometry)) < math.inf).all())
    if shapely.get_type_id(geometry) not in _SHAPES or geometry.is_empty or not is_finite:
        raise InputError(f"drape.edit.geometry = {one_line(geometry)[:60]}: expected points, lines or areas")
    return Feature.from_geometry(geometry, checked_properties(properties), name)
