"""Draped layers: vectors and rasters by path and hash that are shown on the terrain without changing it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from sketchterrain.document.parameters import (
    LOOK,
    Parameter,
    Properties,
    Sentinel,
    check_items,
    check_values,
    defaults,
    parameter_table,
)
from sketchterrain.document.rasters import RASTER
from sketchterrain.errors import InputError, one_line, unknown_key

MAX_DRAPES: Final = 64
"""The most draped layers of a sketch."""
MAX_CLASSES: Final = 256
"""The most classes of a layer."""
BLENDS: Final = ("normal", "multiply", "screen", "add")

_COLOUR: Final = LOOK["colour"]

STYLE: Final = parameter_table(
    replace(_COLOUR, default="#e03131", help="colour of lines, outlines and points; empty draws none"),
    replace(_COLOUR, name="fill", help="colour inside of areas; empty leaves them open"),
    Parameter("fill_opacity", float, 0.5, 0.0, 1.0, "", "of the inside of areas"),
    Parameter(
        *("width", float, 2.0, 0.0, 10000.0, ""),
        "of lines and outlines, diameter of points, in its unit",
        soft_range=(0.0, 20.0),
    ),
    Parameter("unit", str, "px", 0, 2, "", "of width and dashes", choices=("m", "px")),
    Parameter(
        *("dash", str, "", 0, 80, ""),
        "lengths of dashes and gaps in turn, as 6 3; empty is a solid line",
        form=(r"\d+(\.\d+)?( \d+(\.\d+)?){1,7}", 'lengths as "6 3"'),
    ),
    Parameter("cap", str, "round", 0, 6, "", "ends of lines", choices=("butt", "round", "square")),
    Parameter("join", str, "round", 0, 5, "", "corners of lines", choices=("bevel", "mitre", "round")),
    Parameter("hatch", str, "none", 0, 5, "", "of the inside of areas", choices=("cross", "lines", "none")),
    Parameter("hatch_angle", float, 45.0, -360.0, 360.0, "°", "of its lines, counterclockwise from east"),
    Parameter(
        *("hatch_spacing", float, 10.0, 0.1, 10000.0, ""),
        "from one of its lines to the next, in the unit of width",
        soft_range=(2.0, 50.0),
    ),
    Parameter("label", str, "", 0, 80, "", "property that labels features; empty labels none"),
    Parameter("label_size", float, 13.0, 6.0, 72.0, "px", "height of labels", soft_range=(8.0, 32.0)),
    replace(_COLOUR, name="label_colour", default="#202020", help="of labels; they have a pale outline"),
)
"""Keys of the style of a draped layer, and of its classes."""

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
)
"""Keys of ``[[drape]]`` besides those of `STYLE`."""


@dataclass(frozen=True)
class DrapeClass:
    """A style for features with a value of the property ``by``; keys that it lacks are the layer's.

    Raise InputError if a value is not as declared.
    """

    value: str
    style: Properties = field(default_factory=dict)

    def __post_init__(self) -> None:
        checked = check_values(self.style, STYLE, "[[drape.class]]", "drape.class.")
        object.__setattr__(self, "style", MappingProxyType(checked))

    def __hash__(self) -> int:
        return hash((self.value, tuple(self.style.items())))

    def __reduce__(self) -> tuple[Any, ...]:
        return DrapeClass, (self.value, dict(self.style))


@dataclass(frozen=True)
class FeatureEdit:
    """What replaces a feature of the file, or what is added to it, until the file is saved.

    `geometry` is WKB in metres of the sketch; empty deletes the feature. `properties` are all of its
    properties. An id beyond those of the file is that of a new feature.
    """

    id: int
    geometry: bytes = b""
    properties: tuple[tuple[str, int | float | str | None], ...] = ()


@dataclass(frozen=True, eq=False)
class DrapedLayer:
    """A vector or raster file by its path, absolute once a sketch is loaded, with the keys of `DRAPE`.

    Raise InputError if a value is not as declared.
    """

    path: str
    values: Properties = field(default_factory=dict)  # by the names in `DRAPE`, without `path`
    style: Properties = field(default_factory=dict)  # by the names in `STYLE`
    classes: tuple[DrapeClass, ...] = ()
    edits: Mapping[int, FeatureEdit] = field(default_factory=dict)  # by feature
    crs: str = ""  # of what has none itself; empty is the sketch's

    def __post_init__(self) -> None:
        given = {"path": self.path, **self.values}
        checked = defaults(DRAPE) | check_values(given, DRAPE, "[[drape]]", "drape.")
        style = defaults(STYLE) | check_values(self.style, STYLE, "[[drape]]", "drape.")
        object.__setattr__(self, "path", checked.pop("path"))
        object.__setattr__(self, "values", MappingProxyType(checked))
        object.__setattr__(self, "style", MappingProxyType(style))
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
    def source_key(self) -> tuple[object, ...]:
        """What its features and pixels depend on: the file and what is read of it, without edits."""
        return self.path, self["sha256"], self["table"], self["band"], self.crs

    def style_of(self, number: int) -> Properties:
        """Return the whole style of a class by its number, of other features for -1."""
        return self.style if number < 0 else {**self.style, **self.classes[number].style}

    def replace(self, **changes: Any) -> DrapedLayer:
        """Return a layer with other values by the names of fields, of `DRAPE` and of `STYLE`."""
        values, style, fields = dict(self.values), dict(self.style), dict[str, Any]()
        for name, value in changes.items():
            table = values if name in DRAPE and name != "path" else style if name in STYLE else fields
            table[name] = value
        return replace(self, **{"values": values, "style": style, **fields})


def parse_drape(table: Mapping[str, object]) -> DrapedLayer:
    """Return the layer in one ``[[drape]]`` table; raise InputError if it is invalid."""
    raise NotImplementedError(table)


def check_drapes(drapes: Iterable[object]) -> tuple[DrapedLayer, ...]:
    """Return a sketch's draped layers, from the lowest to the highest; raise InputError for too many."""
    return check_items(DrapedLayer, drapes, "draped layers", most=MAX_DRAPES)


__all__ = ["DRAPE", "STYLE", "DrapeClass", "DrapedLayer", "FeatureEdit", "InputError", "unknown_key"]
