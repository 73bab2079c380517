"""Material rules: ramps over properties of the ground that decide where a material covers it.

`RULE` and `FACTOR` declare their keys in the sketch file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from sketchterrain.errors import InputError
from sketchterrain.sketch.parameter import Parameter, Value, check_items, parameter_table
from sketchterrain.sketch.parameters import MATERIALS

MAX_FACTORS = 4
"""The most factors of a rule."""

MAX_INPUTS = 4
"""The most inputs of a factor."""

_MAX_WEIGHT = 1e4
_MIN_RAMP = 1e-4  # narrower ramps are steps


def _weight(name: str, unit: str, text: str) -> Parameter:
    return Parameter(name, float, 0.0, -_MAX_WEIGHT, _MAX_WEIGHT, unit, text)


INPUTS: Mapping[str, Parameter] = parameter_table(
    _weight("height", "1/m", "weight of the elevation"),
    _weight("above_snow_line", "1/m", "weight of the elevation above [climate] snow_line"),
    _weight("above_tree_line", "1/m", "weight of the elevation above [climate] tree_line"),
    _weight("steepness", "", "weight of the slope, rise over run"),
    _weight("hollow", "", "weight of how hollow the ground is: by how much the slope changes over a cell"),
    _weight("aridity", "", "weight of [climate] aridity"),
    _weight("water", "", "weight of water: 1 in the middle, 0.75 at its edge, 0 away from it"),
    _weight("wetness", "", "weight of the wet ground beside water: 0.69 at its edge, 0 where the bank ends"),
    _weight("mountain", "", "weight of how much of a mountain it is, 0 to 1"),
    _weight("dune", "", "weight of desert sand, 0 to 1"),
    _weight("forest", "", "weight of the share of the places for trees that are taken, 0 to 1"),
    _weight("mottle", "", "weight of the ground cover's noise, about -1 to 1"),
)
"""Inputs that a factor can depend on."""

FACTOR: Mapping[str, Parameter] = parameter_table(
    Parameter("start", float, 0.0, -_MAX_WEIGHT, _MAX_WEIGHT, "", "weighted sum of the inputs that gives 0"),
    Parameter(
        "full", float, 1.0, -_MAX_WEIGHT, _MAX_WEIGHT, "", "weighted sum that gives 1; below start it falls"
    ),
    Parameter(
        "shape", str, "smooth", 0, 10, "", "flat at both ends, or a line", choices=("smooth", "straight")
    ),
    *INPUTS.values(),
)
"""Keys of ``[[material_rule.factor]]``."""

RULE: Mapping[str, Parameter] = parameter_table(
    Parameter("name", str, "mine", 1, 40, "characters", "one of the table's rules to change, or a new name"),
    Parameter("material", str, "rock", 0, 40, "", "what it lays on the ground", choices=MATERIALS),
    Parameter("cover", float, 1.0, 0.0, 1.0, "", "the most of the ground that it covers; 0 takes it away"),
    Parameter("before", str, "", 0, 40, "characters", "the rule below which it lies; by default on top"),
)
"""Keys of ``[[material_rule]]``."""


@dataclass(frozen=True)
class Factor:
    """A ramp from 0 to 1 over a weighted sum of inputs: 0 at ``start``, 1 at ``full`` and beyond."""

    start: float = cast(float, FACTOR["start"].default)
    full: float = cast(float, FACTOR["full"].default)
    shape: str = cast(str, FACTOR["shape"].default)
    height: float = 0.0
    above_snow_line: float = 0.0
    above_tree_line: float = 0.0
    steepness: float = 0.0
    hollow: float = 0.0
    aridity: float = 0.0
    water: float = 0.0
    wetness: float = 0.0
    mountain: float = 0.0
    dune: float = 0.0
    forest: float = 0.0
    mottle: float = 0.0

    def __post_init__(self) -> None:
        for name, parameter in FACTOR.items():
            object.__setattr__(self, name, parameter.check(getattr(self, name), f"factor.{name}"))
        if abs(self.full - self.start) < _MIN_RAMP:
            raise InputError(
                f"factor.full = {self.full!r}: expected at least {_MIN_RAMP} from start = {self.start!r}"
            )
        if not 1 <= len(self.weights) <= MAX_INPUTS:
            given = ", ".join(self.weights) or "none"
            raise InputError(f"factor: expected 1 to {MAX_INPUTS} of {', '.join(INPUTS)}, got {given}")

    @property
    def weights(self) -> dict[str, float]:
        """The weights that are not 0, by name, in the order of their declaration."""
        return {name: value for name in INPUTS if (value := getattr(self, name)) != 0}

    @property
    def values(self) -> dict[str, Value]:
        """The values to write to a file, by name."""
        ramp: dict[str, Value] = {"start": self.start, "full": self.full}
        if self.shape != FACTOR["shape"].default:
            ramp["shape"] = self.shape
        return ramp | self.weights


@dataclass(frozen=True)
class MaterialRule:
    """A rule that lays a material over those before it: its cover is ``cover`` (0 … 1) times all factors."""

    name: str
    material: str
    cover: float = 1.0
    factors: tuple[Factor, ...] = ()


@dataclass(frozen=True)
class RuleChange:
    """A sketch's change of a rule of the default table, or a new rule, which needs a material.

    None leaves a value as it is. ``before`` names the rule to insert it before: by default a new one is on
    top, and one of the table where it was.
    """

    name: str
    material: str | None = None
    cover: float | None = None
    before: str = ""
    factors: tuple[Factor, ...] | None = None

    def __post_init__(self) -> None:
        for name, parameter in RULE.items():
            value = getattr(self, name)
            if value is not None or name == "name":
                object.__setattr__(self, name, parameter.check(value, name))
        if self.factors is not None:
            object.__setattr__(
                self, "factors", check_items(Factor, self.factors, "factors", most=MAX_FACTORS)
            )

    @property
    def values(self) -> dict[str, Value]:
        """The values to write to a file, without factors, by name."""
        return {name: value for name in RULE if (value := getattr(self, name)) not in (None, "")}
