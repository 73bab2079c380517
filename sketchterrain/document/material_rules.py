"""Material rules: where materials cover the ground, the default table, and changes of it."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from sketchterrain.errors import InputError, check_keys, check_tables, did_you_mean, format_value
from sketchterrain.schema.parameters import Parameter, Value, check_items, parameter_table

MAX_FACTORS = 4
"""The most factors of a rule."""

MAX_INPUTS = 6
"""The most inputs of a factor."""

_MAX_WEIGHT = 1e4
_MIN_RAMP = 1e-4  # narrower ramps are steps


def _weight(name: str, unit: str, text: str) -> Parameter:
    return Parameter(name, float, 0.0, -_MAX_WEIGHT, _MAX_WEIGHT, unit, text)


INPUTS: Mapping[str, Parameter] = parameter_table(
    _weight("height", "1/m", "weight of the elevation"),
    _weight("above_snow_line", "1/m", "weight of the elevation above [climate] snow_line"),
    _weight("above_tree_line", "1/m", "weight of the elevation above [climate] tree_line"),
    _weight("above_sea", "1/m", "weight of the elevation above the sea; a rule with it needs a sea"),
    _weight("steepness", "", "weight of the slope, rise over run"),
    _weight("northness", "", "weight of the aspect: sine of the slope times cosine of its bearing, -1 to 1"),
    _weight("hollow", "", "weight of the curvature: change of slope over a cell, positive in hollows"),
    _weight("bedding", "", "weight of the rock's beds, from -1 (soft, ledges) to 1 (hard, ribs)"),
    _weight("aridity", "", "weight of [climate] aridity"),
    _weight("water", "", "weight of water: 1 in the middle, 0.75 at its edge, 0 away from it"),
    _weight(
        "wetness", "", "weight of the wetness: 0 on ridges and slopes, up to 1 on valley floors and in water"
    ),
    _weight("mountain", "", "weight of mountains, 0 to 1"),
    _weight("dune", "", "weight of desert sand, 0 to 1"),
    _weight("forest", "", "weight of the tree cover, 0 to 1"),
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
    Parameter("material", str, "rock", 0, 40, "", "the material that it applies"),
    Parameter("cover", float, 1.0, 0.0, 1.0, "", "maximum cover; 0 disables the rule"),
    Parameter("before", str, "", 0, 40, "characters", "the rule to insert it before; by default on top"),
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
    above_sea: float = 0.0
    steepness: float = 0.0
    northness: float = 0.0
    hollow: float = 0.0
    bedding: float = 0.0
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


MAX_RULES = 36
"""The most rules of a sketch, those of the default table included."""

Weights: TypeAlias = dict[str, Any]  # floats by input; Any, since mypy checks ** against every argument
# Banks are green in deserts too, valley floors where there is some rain.
_DRY: Weights = {"aridity": 1.0, "mottle": 0.12, "wetness": -0.16, "water": -0.15}
# Grass is short and straw-coloured on sunny slopes, green on shaded ones and where water gathers.
_SUNNY: Weights = {"mottle": 0.7, "northness": -1.6, "wetness": -0.9, "aridity": 1.0}
# … and on crests and steep slopes, whose soils are thin.
_THIN_SOIL: Weights = {"steepness": 0.9, "hollow": -6.0, "northness": -0.7, "wetness": -0.5}
# Dwarf shrubs and tall herbs grow in drifts where cattle rarely graze: on rough, shaded slopes.
_UNGRAZED: Weights = {"mottle": -0.75, "steepness": 0.5, "northness": 0.6, "wetness": -0.25}
# Soil lies bare on eroding crests and slopes; grass holds on level ground, in hollows and on valley floors.
_BARE: Weights = {"mottle": 0.45, "hollow": -4.0, "steepness": 0.9, "wetness": -0.6}
_ALPINE: Weights = {"above_tree_line": 1.0, "mottle": 90.0}
_DWARF: Weights = {"above_tree_line": 1.0, "mottle": -260.0}
# Noise frays the edges of rock; rock in mountains is harder, gullies fill up, soft beds wear back to ledges.
_STONY: Weights = {"steepness": 1.0, "mottle": 0.34, "mountain": 0.25, "hollow": -0.8, "bedding": 0.36}
_DEBRIS: Weights = {"steepness": 1.0, "mottle": 0.36, "mountain": 0.15, "hollow": 0.8}
_IN_MOUNTAINS = Factor(shape="straight", mountain=1.0)

DEFAULT_RULES: tuple[MaterialRule, ...] = (
    MaterialRule("dry_meadow", "dry_grass", 0.9, (Factor(-0.25, 0.7, **_SUNNY),)),
    MaterialRule("dry_crest", "dry_grass", 0.8, (Factor(0.15, 0.75, **_THIN_SOIL),)),
    MaterialRule("heath", "heath", 0.85, (Factor(0.28, 0.55, **_UNGRAZED),)),
    # Dwarf shrubs take over below the tree line and give way to alpine turf above it.
    MaterialRule(
        "alpine_heath",
        "heath",
        0.75,
        (Factor(-260.0, -60.0, **_DWARF), Factor(260.0, 90.0, **_ALPINE)),
    ),
    MaterialRule("dry_soil", "soil", 1.0, (Factor(0.3, 0.3 + 1 / 3, **_DRY),)),
    MaterialRule("patchy_soil", "soil", 0.6, (Factor(0.6, 1.0, **_BARE),)),
    MaterialRule("desert_sand", "sand", 1.0, (Factor(0.62, 0.87, **_DRY),)),
    # Above the tree line grass thins out into bare stone.
    MaterialRule("alpine_scree", "scree", 0.8, (Factor(40.0, 290.0, **_ALPINE), _IN_MOUNTAINS)),
    MaterialRule(
        "forest_floor",
        "forest_floor",
        1.0,
        (Factor(0.0, 0.8, "straight", forest=1.0), Factor(290.0, 40.0, **_ALPINE)),
    ),
    # Aprons of debris thin out downhill into grass; rock comes out where it is steeper, or higher.
    MaterialRule("slope_scree", "scree", 0.85, (Factor(0.54, 0.98, **_DEBRIS),)),
    MaterialRule("alpine_rock", "rock", 0.9, (Factor(0.0, 300.0, **_ALPINE), Factor(0.55, 1.1, **_STONY))),
    MaterialRule("rock_face", "rock", 1.0, (Factor(0.8, 1.3, **_STONY),)),
    # Turf climbs ledges of soft beds up to somewhat above the tree line.
    MaterialRule(
        "ledge_turf",
        "grass",
        0.85,
        (
            Factor(0.0, -0.45, bedding=1.0, mottle=0.3, hollow=-1.0),
            Factor(0.65, 0.95, steepness=1.0, mountain=0.25),
            Factor(1.9, 1.4, steepness=1.0, aridity=2.5),
            Factor(250.0, 0.0, **_ALPINE),
        ),
    ),
    # Debris from the faces collects in gullies and at their feet, at the angle of repose.
    MaterialRule(
        "scree_fan",
        "scree",
        0.9,
        (
            Factor(0.1, 0.35, mountain=1.0),
            Factor(-0.05, 0.09, hollow=1.0, mottle=0.08, bedding=-0.03),
            Factor(0.34, 0.6, steepness=1.0, mottle=0.15),
            Factor(1.25, 0.85, steepness=1.0, mottle=-0.15),
        ),
    ),
    MaterialRule(
        "dune_sand",
        "sand",
        1.0,
        (Factor(shape="straight", dune=1.0), Factor(1.15, 0.9, steepness=1.0)),
    ),
    MaterialRule(
        "snow",
        "snow",
        1.0,
        (
            Factor(0.0, 150.0, above_snow_line=1.0, mottle=150.0, hollow=380.0),
            Factor(1.5, 0.9, steepness=1.0, mottle=0.4, hollow=-1.6, bedding=0.3),
        ),
    ),
    # Along a shore grass down to the water, mud and bars of gravel and sand take turns, in long stretches.
    MaterialRule(
        "muddy_bank",
        "soil",
        0.8,
        (Factor(0.6, 0.68, water=1.0, mottle=-0.14), Factor(-0.1, -0.4, mottle=1.0)),
    ),
    MaterialRule(
        "beach",
        "sand",
        0.8,
        (
            Factor(0.62, 0.68, water=1.0, mottle=0.14),
            Factor(0.2, 0.5, mottle=1.0),
            Factor(0.4, 0.2, steepness=1.0),
        ),
    ),
    MaterialRule(
        "gravel_bar",
        "river_bed",
        0.9,
        (Factor(0.640625, 0.71875, water=1.0, mottle=0.046875), Factor(0.1, 0.4, mottle=1.0)),
    ),
    MaterialRule("river_bed", "river_bed", 1.0, (Factor(0.6875, 0.75, water=1.0),)),
    # Reeds stand in shallow water off shores without bars.
    MaterialRule(
        "reeds",
        "grass",
        0.75,
        (
            Factor(0.69, 0.73, water=1.0),
            Factor(0.79, 0.765, water=1.0),
            Factor(0.12, -0.08, mottle=1.0),
            Factor(50.0, -150.0, above_tree_line=1.0),
        ),
    ),
    MaterialRule(
        "sea_sand",
        "sand",
        1.0,
        (
            Factor(0.02, 0.2, water=1.0, mottle=0.03),
            Factor(3.0, 1.2, above_sea=1.0),
            Factor(0.75, 0.5, steepness=1.0),
        ),
    ),
)
"""The default table; each rule covers those before it, and below them all is grass."""


def resolved_rules(changes: Iterable[RuleChange]) -> tuple[MaterialRule, ...]:
    """Return the default table with changes applied in order.

    Raise InputError if a new rule has no material, ``before`` is no rule's name, or there are more than
    `MAX_RULES`.
    """
    rules = list(DEFAULT_RULES)
    for change in changes:
        old = next((rule for rule in rules if rule.name == change.name), None)
        if old is None and change.material is None:
            names = [rule.name for rule in rules]
            hint = did_you_mean(change.name, names) or f"; there are {', '.join(names)}"
            raise InputError(f"name = {format_value(change.name)}: a new rule needs a material{hint}")
        at = len(rules) if old is None else rules.index(old)
        given = {key: getattr(change, key) for key in ("material", "cover", "factors")}
        given = {key: value for key, value in given.items() if value is not None}
        rule = dataclasses.replace(old or MaterialRule(change.name, cast(str, change.material)), **given)
        if old is not None:
            rules.remove(old)
        if change.before:
            at = _index_of(change.before, rules)
        rules.insert(at, rule)
    if len(rules) > MAX_RULES:
        raise InputError(f"{len(rules)} rules with those of the table: expected at most {MAX_RULES}")
    return tuple(rules)


def check_rule_changes(changes: Iterable[RuleChange], materials: Sequence[str]) -> tuple[RuleChange, ...]:
    """Return changes as a tuple; raise InputError if one is not a `RuleChange` or cannot be applied."""
    checked = tuple(changes)
    for number, change in enumerate(checked, 1):
        if not isinstance(change, RuleChange):
            raise InputError(f"material_rules: expected RuleChange values, got {format_value(change)}")
        try:
            if change.material is not None and change.material not in materials:
                near = did_you_mean(change.material, materials)
                raise InputError(
                    f"material = {format_value(change.material)}: expected {', '.join(materials)}{near}"
                )
            resolved_rules(checked[:number])
        except InputError as error:
            raise InputError(f"[[material_rule]] number {number}: {error}") from None
    return checked


def parse_rule_change(table: Mapping[str, object]) -> RuleChange:
    """Return the change in one ``[[material_rule]]`` table; raise InputError for a bad key or value."""
    known = [*RULE, "factor"]
    check_keys(table, known)
    if "name" not in table:
        raise InputError(f"no name: expected {', '.join(known)}")
    values = {name: value for name, value in table.items() if name != "factor"}
    factors = _parse_factors(table["factor"]) if "factor" in table else None
    return RuleChange(**values, factors=factors)  # type: ignore[arg-type] # RuleChange checks every value


def _parse_factors(value: object) -> tuple[Factor, ...]:
    tables = check_tables("factor", value, "[[material_rule.factor]] above it")
    for table in tables:
        check_keys(table, FACTOR, "[[material_rule.factor]]")
    return tuple(Factor(**table) for table in tables)


def _index_of(name: str, rules: Sequence[MaterialRule]) -> int:
    names = [rule.name for rule in rules]
    if name not in names:
        raise InputError(
            f"before = {format_value(name)}: expected one of {', '.join(names)}{did_you_mean(name, names)}"
        )
    return names.index(name)
