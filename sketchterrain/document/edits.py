"""Edits: the user's changes of generated features, stored with the sketch and reapplied at each build.

`ACTIONS` declares their keys in ``[[edit]]``.
"""

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sketchterrain.errors import InputError, check_keys, did_you_mean, format_value
from sketchterrain.schema.layers import LAYERS, POINT_LAYERS
from sketchterrain.schema.parameters import Parameter, Value, check_values, parameter_table

ADDED_BIT = 1 << 62
"""Set in the id of every feature that the user added."""

MAX_EDITS = 2000
"""The most edits of one sketch."""

_MAX_COORDINATE = 1e7  # m


@dataclass(frozen=True)
class Action:
    """A kind of edit, with its required and optional values besides the feature."""

    help: str
    required: Mapping[str, Parameter] = field(hash=False)
    optional: Mapping[str, Parameter] = field(default_factory=dict, hash=False)

    @property
    def values(self) -> Mapping[str, Parameter]:
        """All values, the required ones first."""
        return {**self.required, **self.optional}


def _position(name: str, direction: str) -> Parameter:
    return Parameter(
        *(name, float, 0.0, -_MAX_COORDINATE, _MAX_COORDINATE, "m"),
        f"{direction} of the sketch's south-west corner",
        soft_range=(0.0, 4096.0),
    )


_X, _Y = _position("x", "east"), _position("y", "north")
_FROM_X, _FROM_Y = (
    Parameter(
        *(f"from_{name}", float, 0.0, -_MAX_COORDINATE, _MAX_COORDINATE, "m"),
        f"former position, {direction}: identifies the point",
    )
    for name, direction in (("x", "east"), ("y", "north"))
)
_RADIUS = Parameter("radius", float, 100.0, 0.1, 1e5, "m", "ground radius of its support")
_STRENGTH = Parameter("strength", float, 1.0, 0.0, 9000.0, "", "height in m; of a forest the share of trees")
_TYPE = Parameter("type", str, POINT_LAYERS[0], 0, 10, "", "type of feature", choices=POINT_LAYERS)
_INDEX = Parameter("index", int, 0, 0, 100_000, "", "index of the control point, 0 at the source")
_FEATURE = Parameter("feature", int, 0, 0, 2**64 - 1, "", "id of the feature, as in features.json")
_SHAPE = (_TYPE, _X, _Y, _RADIUS, _STRENGTH)
_STYLE: dict[str, Parameter] = {}
for _name in POINT_LAYERS:
    _STYLE |= {each.name: each for each in LAYERS[_name].style if each.name not in _STYLE}

_RIVER = next(layer for layer in LAYERS.values() if layer.kind == "course")
_WIDTH = dataclasses.replace(_RIVER.main, low=0.5, help="from bank to bank", sentinel=None)

ACTIONS: Mapping[str, Action] = {
    "move": Action("moves a feature", parameter_table(_X, _Y)),
    "resize": Action("sets a feature's radius", parameter_table(_RADIUS)),
    "strength": Action("sets a feature's strength", parameter_table(_STRENGTH)),
    "delete": Action("removes a feature, a river or a lake", parameter_table()),
    "lock": Action("freezes a feature, whatever is painted", parameter_table(*_SHAPE), _STYLE),
    "add": Action("adds a feature; its id is a hash of its values", parameter_table(*_SHAPE), _STYLE),
    "move_point": Action(
        "moves a control point of a river",
        parameter_table(_INDEX, _X, _Y),
        parameter_table(_FROM_X, _FROM_Y),
    ),
    "width": Action("sets a river's width", parameter_table(_WIDTH)),
}
"""Kinds of edits by name."""


@dataclass(frozen=True)
class Edit:
    """One change of a generated feature; `ACTIONS` says which values an action needs, the others are None.

    ``feature`` is the id of a feature or river; that of an ``add`` is computed from its values. Raise
    InputError if the action is unknown, or a value is missing, unknown to the action or out of range.
    """

    action: str
    feature: int | None = None
    type: str | None = None
    x: float | None = None
    y: float | None = None
    radius: float | None = None
    strength: float | None = None
    peakiness: float | None = None
    erosion: float | None = None
    strata: float | None = None
    wavelength: float | None = None
    wind: float | None = None
    conifers: float | None = None
    index: int | None = None
    from_x: float | None = None
    from_y: float | None = None
    width: float | None = None

    def __post_init__(self) -> None:
        action, where = _action(self.action), f"edit {self.action}"
        for name, value in check_values(self._given(), action.values, where, f"{where}.").items():
            object.__setattr__(self, name, value)
        missing = [name for name in action.required if getattr(self, name) is None]
        if missing:
            raise InputError(f"{where}: expected {', '.join(action.required)}, no {missing[0]} given")
        if (self.from_x is None) != (self.from_y is None):
            raise InputError(f"{where}: expected both from_x and from_y, or none of them")
        if self.type and LAYERS[self.type].is_share and (self.strength or 0.0) > 1.0:
            raise InputError(f"{where}.strength = {self.strength}: expected a share from 0 to 1")
        is_added = self.action == "add"
        feature = added_id(self.values) if is_added else _FEATURE.check(self.feature, f"{where}.feature")
        object.__setattr__(self, "feature", feature)

    @property
    def values(self) -> dict[str, Value]:
        """The given values by name, without action and feature, in the order of their declaration."""
        return {
            name: value for name in ACTIONS[self.action].values if (value := getattr(self, name)) is not None
        }

    @property
    def target(self) -> tuple[object, ...]:
        """What it sets; of two edits with one target the later one wins."""
        return self.action, self.feature, self.index, self.from_x, self.from_y

    def _given(self) -> dict[str, Any]:
        fields = [each.name for each in dataclasses.fields(self) if each.name not in ("action", "feature")]
        return {name: value for name in fields if (value := getattr(self, name)) is not None}


def parse_edit(table: Mapping[str, object]) -> Edit:
    """Return the edit in one ``[[edit]]`` table; raise InputError if it is invalid."""
    name = table.get("action")
    if name is None:
        raise InputError(f"no action: expected {', '.join(ACTIONS)}")
    values = _action(name).values
    known = ["action", *values] if name == "add" else ["action", "feature", *values]
    check_keys(table, known)
    if "feature" in known and "feature" not in table:
        raise InputError(f"no feature: expected {', '.join(known)}")
    return Edit(**table)  # type: ignore[arg-type] # Edit checks every value


def _action(name: object) -> Action:
    if not isinstance(name, str) or name not in ACTIONS:
        raise InputError(
            f"action = {format_value(name)}: expected {', '.join(ACTIONS)}{did_you_mean(str(name), ACTIONS)}"
        )
    return ACTIONS[name]


def added_id(values: Mapping[str, Value]) -> int:
    """Return the id of the feature that an ``add`` of these values adds."""
    text = "\n".join(f"{name} = {value!r}" for name, value in sorted(values.items()))
    word = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
    return ADDED_BIT | (word >> 2)
