"""Parameters: types with unit, range and default, and the settings of a sketch as a whole."""

from __future__ import annotations

import copyreg
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

from sketchterrain.errors import InputError, check_keys, format_value
from sketchterrain.schema.geology import ROCKS

Value: TypeAlias = int | float | str

_T = TypeVar("_T")

Properties: TypeAlias = Mapping[str, Any]
"""Values by the names of their parameters, each of its parameter's kind."""


class Sentinel(NamedTuple):
    """A number that stands for a choice, such as -1 for "By elevation"; `start` is the first real number."""

    value: float
    title: str
    start: float


@dataclass(frozen=True)
class Parameter:
    """A setting: its key in the sketch file, its allowed values, and one line of help."""

    name: str
    kind: type[int] | type[float] | type[str]
    default: Value
    low: float  # of a str: its least length
    high: float
    unit: str  # empty for a pure number
    help: str
    choices: tuple[Value, ...] = ()
    form: tuple[str, str] = ("", "")  # of a str that is not empty: a regular expression, and its name
    sentinel: Sentinel | None = None
    soft_range: tuple[float, float] | None = None  # of sliders, where it is narrower than low … high

    @property
    def range(self) -> str:
        """The allowed values as text, for example ``"0 to 1"``."""
        if self.choices:
            return " or ".join(repr(choice) for choice in self.choices)
        if self.form[1]:
            return self.form[1]
        return f"{format_number(self.low)} to {format_number(self.high)}"

    @property
    def expected(self) -> str:
        """The allowed values for an error, for example ``"a number from 1 to 9000 m"``."""
        if self.choices or self.form[1]:
            return self.range
        if self.kind is str:
            return f"a text of {self.range} {self.unit}"
        what = "a whole number" if self.kind is int else "a number"
        return f"{what} from {self.range} {self.unit}".rstrip()

    def check(self, value: object, key: str | None = None) -> Value:
        """Return `value` as this parameter's kind; an int is valid for a float, nothing else is converted.

        Raise InputError, naming `key`, if it is of another type, not finite, out of range or not a choice.
        """
        checked = self._convert(value)
        if checked is None:
            raise InputError(f"{key or self.name} = {format_value(value)}: expected {self.expected}")
        return checked

    def _convert(self, value: object) -> Value | None:
        converted = _text(value) if self.kind is str else _real(value, whole=self.kind is int)
        size = len(converted) if isinstance(converted, str) else converted
        if converted is None or size is None or not self.low <= size <= self.high:  # also refuses NaN
            return None
        if self.choices and converted not in self.choices:
            return None
        if self.form[0] and converted and not re.fullmatch(self.form[0], str(converted)):
            return None
        return self.kind(converted)


def _text(value: object) -> str | None:
    # A lone surrogate cannot be encoded as UTF-8.
    if not isinstance(value, str) or any("\ud800" <= char <= "\udfff" for char in value):
        return None
    return value


def _real(value: object, *, whole: bool) -> float | None:
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        return None
    return int(value) if isinstance(value, Integral) else float(value)


def format_number(value: float) -> str:
    """Return a number without a needless fraction: 600, not 600.0."""
    return str(int(value)) if math.isfinite(value) and value == int(value) else repr(value)


def check_items(kind: type[_T], values: Iterable[object], key: str, *, most: int) -> tuple[_T, ...]:
    """Return values as a tuple; raise InputError if one is not a `kind` or there are more than `most`."""
    items = []
    for value in values:
        if not isinstance(value, kind):
            raise InputError(f"{key}: expected {kind.__name__} values, got {format_value(value)}")
        items.append(value)
    if len(items) > most:
        raise InputError(f"{len(items)} {key}: expected at most {most}")
    return tuple(items)


def _read_only(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))  # as in sketches


def parameter_table(*parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by name."""
    return MappingProxyType({parameter.name: parameter for parameter in parameters})


def check_values(
    values: Mapping[str, object], table: Mapping[str, Parameter], where: str, prefix: str
) -> dict[str, Value]:
    """Return checked values in the order of a table; `where` names it and `prefix` its keys in errors."""
    check_keys(values, table, where)
    checked = {name: table[name].check(value, f"{prefix}{name}") for name, value in values.items()}
    return {name: checked[name] for name in table if name in checked}


def defaults(table: Mapping[str, Parameter]) -> dict[str, Value]:
    """Return the default of each parameter, by name."""
    return {name: parameter.default for name, parameter in table.items()}


FORMAT = 2
"""Version of the sketch file format.

In format 1 mountains and hills without a height had a default one, and a width of gullies, ``gullies``.
"""


SKETCH: Mapping[str, Parameter] = parameter_table(
    Parameter("name", str, "Untitled", 0, 200, "characters", "title of the sketch"),
    Parameter(
        *("extent", float, 4096.0, 1.0, 1e6, "m", "length of the sketch's longer side"),
        soft_range=(128.0, 262144.0),
    ),
    Parameter("seed", int, 0, 0, 2**63 - 1, "", "random seed of the terrain"),
    Parameter(
        "fidelity", float, 0.8, 0.0, 1.0, "", "0 is a loose guideline, 1 is exactly where it was painted"
    ),
)
"""Keys at the top of the file."""

GROUND: Mapping[str, Parameter] = parameter_table(
    Parameter("relief", float, 40.0, 0.0, 2000.0, "m", "height of the ground's ridges above its valleys"),
    Parameter(
        *("wavelength", float, 1600.0, 50.0, 20000.0, "m"),
        "distance over which the relief is greater and less",
    ),
    Parameter("roughness", float, 0.45, 0.2, 0.7, "", "how uneven the uplift of unpainted ground is"),
    Parameter(
        *("surroundings", float, 1.0, 0.0, 3.0, ""),
        "height of ranges far beyond the sketch, over that of its highest label; 0 leaves a plain",
        soft_range=(0.0, 1.5),
    ),
)
"""Keys of ``[ground]``: the plain under and between the features."""

GEOLOGY: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("rock", str, "gneiss", 1, 20, "", "its colour, and how it is bedded and jointed"),
        choices=tuple(ROCKS),
    ),
    Parameter("dip", float, 16.0, 0.0, 90.0, "°", "slope of its beds; hard ones stand out as ribs"),
    Parameter("dip_direction", float, 120.0, 0.0, 360.0, "°", "where its beds slope down to: 90 is east"),
)
"""Keys of ``[geology]``: the rock; it changes materials, but no heights."""

CLIMATE: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("snow_line", float, 1e4, -1e4, 1e4, "m", "elevation above which there is snow"),
        sentinel=Sentinel(1e4, "No snow", 2000.0),
        soft_range=(0.0, 5000.0),
    ),
    Parameter(
        *("tree_line", float, 1e4, -1e4, 1e4, "m", "elevation above which no trees grow"),
        sentinel=Sentinel(1e4, "No limit", 1800.0),
        soft_range=(0.0, 5000.0),
    ),
    Parameter(
        *("aridity", float, 0.2, 0.0, 1.0, ""),
        "0 is lush, 1 is a desert; from 0.5 on more of the ground is level",
    ),
)
"""Keys of ``[climate]``: snow and vegetation."""

COAST: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("sea_level", float, -1e4, -1e4, 1e4, "m"),
        "elevation below which is sea; 0 by default where a sea is painted",
        sentinel=Sentinel(-1e4, "No sea", 0.0),
        soft_range=(-200.0, 200.0),
    ),
    Parameter(
        *("beach", float, 40.0, 2.0, 1000.0, "m", "width of the beaches along the shore"),
        soft_range=(2.0, 200.0),
    ),
    Parameter(
        *("shelf", float, 800.0, 10.0, 1e5, "m", "distance from a painted coast to the greatest depth"),
        soft_range=(50.0, 5000.0),
    ),
)
"""Keys of ``[coast]``: the sea's level and its shores."""

SKIES: Final = ("cumulus", "stratocumulus", "stratus", "cirrus", "clear")

WEATHER: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("hour", float, -1.0, -1.0, 24.0, "h"),
        "local solar time; -1 is whichever light shows the ground best",
        sentinel=Sentinel(-1.0, "Best light", 12.0),
        soft_range=(0.0, 24.0),
    ),
    Parameter("latitude", float, 45.0, -90.0, 90.0, "°", "north of the equator; how high the sun climbs"),
    Parameter(
        *("sky", str, SKIES[0], 1, 13, "characters"),
        "kind of clouds; stratus is a closed grey layer",
        choices=SKIES,
    ),
    Parameter("clouds", float, 0.35, 0.0, 1.0, "", "share of the sky that they cover; 1 is overcast"),
    Parameter("wind", float, 4.0, 0.0, 40.0, "m/s", "moves plants and clouds"),
    Parameter("wind_from", float, 245.0, 0.0, 360.0, "°", "where the wind blows from: 0 north, 90 east"),
    Parameter("haze", float, 1.0, 0.0, 10.0, "", "1 is a clear day, 10 a murky one"),
)
"""Keys of ``[weather]``: lighting and air of pictures; they do not change the terrain."""

FRAME: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("crs", str, "", 0, 20_000, "characters"),
        "coordinate reference system in metres, as EPSG:25832; empty is none",
    ),
    Parameter("east", float, 0.0, -1e9, 1e9, "m", "easting of the sketch's south-west corner in it"),
    Parameter("north", float, 0.0, -1e9, 1e9, "m", "northing of that corner"),
    Parameter(
        *("vertical", str, "", 0, 40, ""),
        "vertical datum of elevations, as EPSG:5773; empty is none",
        form=(r"[A-Za-z]+:[0-9]+", 'a code as "EPSG:5773"'),
    ),
)
"""Keys of ``[frame]``: the sketch's place on Earth; it does not change the terrain."""

BASE: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("detail", float, 1.0, 0.0, 1.0, ""),
        "strength of detail finer than the elevation data; 0 leaves them smooth",
    ),
    Parameter(
        *("margin", float, -1.0, -1.0, 1e5, "m"),
        "distance from their rim inward over which the data blend in; -1 is 4 % of their shorter side",
        sentinel=Sentinel(-1.0, "Automatic", 1000.0),
        soft_range=(10.0, 10000.0),
    ),
)
"""Keys of ``[base]``: real elevation beneath the sketch, of rasters whose role is elevation."""

LOOK: Mapping[str, Parameter] = parameter_table(
    Parameter(
        *("colour", str, "", 0, 7, ""),
        "its mean colour in sRGB; empty is the program's own",
        form=("#[0-9a-fA-F]{6}", 'a colour as "#rrggbb"'),
    ),
    Parameter(
        "size", float, 0.0, 0.0, 1000.0, "m", "width of its texture near the eye; 0 is the program's own"
    ),
    Parameter("roughness", float, -1.0, -1.0, 1.0, "", "0 mirrors, 1 is dull; -1 is the program's own"),
    Parameter("bump", float, 1.0, 0.0, 2.0, "", "how high its relief is, over the program's own; 0 is flat"),
)
"""Keys of ``[look.MATERIAL]``: appearance of a material; it does not change the terrain."""
