"""Edits: what a person changed of what was generated, kept with the sketch and done again each time.

`ACTIONS` declares them as `parameters` declares the rest: their keys in ``[[edit]]``, their validation and
the reference page are made from it.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sketchterrain.errors import InputError
from sketchterrain.sketch.parameter import Parameter, Value, check_items, find_parameter, parameter_table
from sketchterrain.sketch.parameters import LAYERS
from sketchterrain.sketch.wording import did_you_mean, format_value

POINT_TYPES = ("mountain", "hill", "dune", "forest")
"""What can be added and locked; rivers are changed by their control points."""

ADDED_BIT = 1 << 62
"""Set in the id of every feature that a person added."""

MAX_EDITS = 2000
"""The most edits of one sketch."""

_FARTHEST = 1e7  # m


@dataclass(frozen=True)
class Action:
    """A kind of edit: what it does, and the values that it needs and that it may have."""

    help: str
    needs: Mapping[str, Parameter] = field(hash=False)
    takes: Mapping[str, Parameter] = field(default_factory=dict, hash=False)

    @property
    def values(self) -> Mapping[str, Parameter]:
        """Everything that can be given, the feature apart."""
        return {**self.needs, **self.takes}


def _position(name: str, way: str) -> Parameter:
    return Parameter(name, float, 0.0, -_FARTHEST, _FARTHEST, "m", f"{way} of the sketch's south-west corner")


_X, _Y = _position("x", "east"), _position("y", "north")
_FROM_X, _FROM_Y = (
    Parameter(f"from_{name}", float, 0.0, -_FARTHEST, _FARTHEST, "m", f"where the point was, {way}: names it")
    for name, way in (("x", "east"), ("y", "north"))
)
_RADIUS = Parameter("radius", float, 100.0, 0.1, 1e5, "m", "ground radius of its support")
_STRENGTH = Parameter("strength", float, 1.0, 0.0, 9000.0, "", "height in m; of a forest the share of trees")
_TYPE = Parameter("type", str, "mountain", 0, 10, "", "what it is", choices=POINT_TYPES)
_INDEX = Parameter("index", int, 0, 0, 100_000, "", "which control point, 0 at the spring")
_FEATURE = Parameter("feature", int, 0, 0, 2**64 - 1, "", "id of the feature, as in features.json")
_SHAPE = (_TYPE, _X, _Y, _RADIUS, _STRENGTH)
_STYLE = parameter_table(
    LAYERS["mountain"].parameters["peakiness"],
    LAYERS["mountain"].parameters["erosion"],
    LAYERS["mountain"].parameters["gullies"],
    LAYERS["dune"].parameters["wavelength"],
    LAYERS["dune"].parameters["wind"],
    LAYERS["forest"].parameters["conifers"],
)

_WIDTH = dataclasses.replace(LAYERS["river"].parameters["width"], low=0.5, help="from bank to bank")

ACTIONS: Mapping[str, Action] = {
    "move": Action("puts a feature somewhere else", parameter_table(_X, _Y)),
    "resize": Action("gives a feature another radius", parameter_table(_RADIUS)),
    "strength": Action("gives a feature another strength", parameter_table(_STRENGTH)),
    "delete": Action("takes a feature, a river or a lake away", parameter_table()),
    "lock": Action("keeps a feature as it is, whatever is painted", parameter_table(*_SHAPE), _STYLE),
    "add": Action("adds a feature; its id is made from its values", parameter_table(*_SHAPE), _STYLE),
    "move_point": Action(
        "puts a control point of a river somewhere else",
        parameter_table(_INDEX, _X, _Y),
        parameter_table(_FROM_X, _FROM_Y),
    ),
    "width": Action("gives a river another width", parameter_table(_WIDTH)),
}
"""What can be changed, by name."""


@dataclass(frozen=True)
class Edit:
    """One change of what was generated."""

    action: str
    feature: int | None = None
    type: str | None = None
    x: float | None = None
    y: float | None = None
    radius: float | None = None
    strength: float | None = None
    peakiness: float | None = None
    erosion: float | None = None
    gullies: float | None = None
    wavelength: float | None = None
    wind: float | None = None
    conifers: float | None = None
    index: int | None = None
    from_x: float | None = None
    from_y: float | None = None
    width: float | None = None

    def __post_init__(self) -> None:
        action = _action(self.action)
        for name, value in self._given().items():
            parameter = find_parameter(action.values, name, value, f"edit {self.action}")
            object.__setattr__(self, name, parameter.check(value, f"edit {self.action}.{name}"))
        missing = [name for name in action.needs if getattr(self, name) is None]
        if missing:
            raise InputError(f"edit {self.action}: expected {', '.join(action.needs)}, no {missing[0]} given")
        if (self.from_x is None) != (self.from_y is None):
            raise InputError(f"edit {self.action}: expected both from_x and from_y, or none of them")
        if self.type == "forest" and (self.strength or 0.0) > 1.0:
            raise InputError(f"edit {self.action}.strength = {self.strength}: expected a share from 0 to 1")
        if self.action == "add":
            object.__setattr__(self, "feature", _id_of(self.values))
        else:
            object.__setattr__(self, "feature", _FEATURE.check(self.feature, f"edit {self.action}.feature"))

    @property
    def values(self) -> dict[str, Value]:
        """What is given, by name, without action and feature; in the order of the declaration."""
        return {
            name: value for name in ACTIONS[self.action].values if (value := getattr(self, name)) is not None
        }

    @property
    def target(self) -> tuple[object, ...]:
        """What it decides; of two edits with one target the later one counts."""
        return self.action, self.feature, self.index, self.from_x, self.from_y

    def _given(self) -> dict[str, Any]:
        fields = [each.name for each in dataclasses.fields(self) if each.name not in ("action", "feature")]
        return {name: value for name in fields if (value := getattr(self, name)) is not None}


def parse_edit(table: Mapping[str, object]) -> Edit:
    """Return the edit that one ``[[edit]]`` table says."""
    name = table.get("action")
    if name is None:
        raise InputError(f"no action: expected {', '.join(ACTIONS)}")
    action = _action(name)
    first = ("action",) if name == "add" else ("action", "feature")
    known = [*first, *action.values]
    for key, value in table.items():
        if key not in known:
            raise InputError(
                f"unknown key {format_value(key)} = {format_value(value)}: expected {', '.join(known)}"
                f"{did_you_mean(key, known)}"
            )
    if "feature" in first and "feature" not in table:
        raise InputError(f"no feature: expected {', '.join(known)}")
    return Edit(**table)  # type: ignore[arg-type] # Edit checks every value


def checked_edits(edits: Iterable[Edit]) -> tuple[Edit, ...]:
    """Return edits as a sketch keeps them."""
    return check_items(Edit, edits, "edits", most=MAX_EDITS)


def _action(name: object) -> Action:
    if not isinstance(name, str) or name not in ACTIONS:
        raise InputError(
            f"action = {format_value(name)}: expected {', '.join(ACTIONS)}{did_you_mean(str(name), ACTIONS)}"
        )
    return ACTIONS[name]


def _id_of(values: Mapping[str, Value]) -> int:
    text = "\n".join(f"{name} = {value!r}" for name, value in sorted(values.items()))
    word = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
    return ADDED_BIT | (word >> 2)
