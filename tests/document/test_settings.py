"""``sketch.toml``: declared parameters, round trips, refusals."""

import contextlib
import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sketchterrain.document.material_rules import (
    DEFAULT_RULES,
    FACTOR,
    INPUTS,
    MAX_FACTORS,
    MAX_INPUTS,
    MAX_RULES,
    RULE,
    Factor,
    RuleChange,
    resolved_rules,
)
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.store import SETTINGS, file_limit
from sketchterrain.document.toml_format import parse_settings, settings_text
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import LOOK, SKETCH, Parameter
from tests.refusals import refused

_TABLES = {
    "sketch": SKETCH,
    **TABLES,
    **{name: layer.parameters for name, layer in LAYERS.items()},
    "look": LOOK,
    "material_rule": RULE,
    "material_rule.factor": FACTOR,
}
_ALL = [(f"{table}.{p.name}", p) for table, ps in _TABLES.items() for p in ps.values()]


def test_declarations_have_valid_types_and_ranges():
    for name, parameter in _ALL:
        assert parameter.kind in (int, float, str), name
        assert type(parameter.default) is parameter.kind, name
        assert parameter.check(parameter.default) == parameter.default, name
        assert parameter.help, name
        assert "\n" not in parameter.help, name
        assert "|" not in parameter.help + parameter.unit, name
        assert parameter.low < parameter.high, name
        assert math.isfinite(parameter.low), name
        assert math.isfinite(parameter.high), name

    for name, parameter in _ALL:
        if parameter.kind is str:
            continue
        assert parameter.check(parameter.low) == parameter.low, name
        assert parameter.check(parameter.high) == parameter.high, name
        assert type(parameter.check(parameter.low)) is parameter.kind, name
        for bad in (parameter.low - 1, parameter.high * 2 + 1, math.nan, math.inf, -math.inf, 10**400):
            refused("expected", parameter.check, bad)

    for _, parameter in _ALL:
        for bad in (None, True, False, [], {}, [1.0], b"1", 1j):
            refused("expected", parameter.check, bad)


def test_conversions_and_error_messages():
    assert SKETCH["extent"].check(100) == 100.0
    assert isinstance(SKETCH["extent"].check(100), float)
    assert SKETCH["seed"].check(np.int64(7)) == 7
    assert type(SKETCH["seed"].check(np.int64(7))) is int
    refused(r"^seed = 1\.0: expected a whole number from 0 to 922337203685477", SKETCH["seed"].check, 1.0)
    parameter = Parameter("mode", str, "a", 0, 9, "", "a choice", choices=("a", "b"))
    assert parameter.check("b") == "b"
    refused("mode = 'c': expected 'a' or 'b'", parameter.check, "c")
    with pytest.raises(InputError):
        SKETCH["name"].check("\ud800")  # no file can hold it
    refused("200 characters", SKETCH["name"].check, "x" * 201)
    assert parse_settings(b"\xef\xbb\xbfformat = 1\r\nextent = 10\r\n").extent == 10.0  # a byte order mark


def test_names_and_colours_are_distinct():
    assert all(name == layer.name for name, layer in LAYERS.items())
    assert len({layer.colour for layer in LAYERS.values()}) == len(LAYERS)
    assert all(0 <= channel <= 255 for layer in LAYERS.values() for channel in layer.colour)
    names = ["format", *SKETCH, *TABLES, *LAYERS, "look", "material_rule", "edit"]
    assert len(set(names)) == len(names)


_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=200)


def _values(table):
    def of(parameter):
        if parameter.kind is int:
            return st.integers(int(parameter.low), int(parameter.high))
        if parameter.choices:
            return st.sampled_from(parameter.choices)
        return st.floats(parameter.low, parameter.high)

    return st.fixed_dictionaries(
        {}, optional={name: of(p) for name, p in table.items() if p.kind is not str or p.choices}
    )


_LABELS = st.fixed_dictionaries(
    {},
    optional={
        (name, label): _values(layer.parameters)
        for name, layer in LAYERS.items()
        for label in (1, 2, 10, 255)
    },
)
SKETCHES = st.builds(
    lambda name, labels, top, **tables: Sketch(name=name, labels=labels, **top, **tables),
    name=_TEXT,
    labels=_LABELS,
    top=_values(SKETCH),
    **{name: _values(table) for name, table in TABLES.items()},
)


@settings(max_examples=30)
@given(SKETCHES)
def test_settings_round_trip(sketch):
    again = parse_settings(settings_text(sketch).encode())
    for key in (*SKETCH, *TABLES, "labels"):
        assert getattr(again, key) == getattr(sketch, key)
    assert settings_text(again) == settings_text(sketch)


_ROW = '[[material_rule]]\nname = "snow"\n'
_RAMP = f"{_ROW}[[material_rule.factor]]\n"
_ADD = "[[edit]]\naction='add'\ntype='{}'\nx=0\ny=0\nradius=1\nstrength={}"
_REFUSED = [
    ("seeed = 3", "unknown key 'seeed' = 3: expected .*; did you mean 'seed'"),
    ("[montain.1]", "unknown key 'montain' = .*; did you mean 'mountain'"),
    ("[mountain.1]\nheigth = 3.0", r"unknown key 'heigth' = 3.0 in \[mountain.1\]: .*did you mean 'height'"),
    ("[density]\nriver = 1", r"key 'river' = 1 in \[density\]: expected mountain, hill, dune, forest"),
    ("seed = 1.5", "seed = 1.5: expected a whole number"),
    ("extent = 1979-05-27", "extent = datetime.date.*: expected a number"),
    ("name = 3", "name = 3: expected a text of 0 to 200 characters"),
    ("extent = 0", "extent = 0: expected a number from 1 to 1000000 m"),
    ("[mountain.1]\nheight = nan", "mountain.1.height = nan: expected a number from 0 to 9000 m"),
    ("density = 3", r"\[density\] = 3: expected a table"),
    ("mountain.1 = 3", r"\[mountain.1\] = 3: expected a table"),
    ("[mountain]\nheight = 3", r"key 'height' = 3 in \[mountain\]: expected .* for example \[mountain.1\]"),
    ("[mountain.0]", "for a label from 1 to 255"),
    ("[mountain.-1]", "for a label from 1 to 255"),
    ("[mountain.'²']", "for a label from 1 to 255"),
    (f"[mountain.{'9' * 5000}]", "for a label from 1 to 255"),
    ('"a\\nb" = 1', r"unknown key 'a\\nb' = 1"),
    ("[look.gras]\nbump = 1.0", r"\[look\.'gras'\]: expected a material, grass, soil.*did you mean"),
    ('[look.grass]\ncolour = "green"', "look.grass.colour = 'green': expected a colour as \"#rrggbb\""),
    ("[look.rock]\nbump = 2.5", "look.rock.bump = 2.5: expected a number from 0 to 2"),
    ("[look.rock]\nshine = 1", r"shine.*\[look\.rock\]"),
    ("look = 3", r"\[look\.grass\] = 3: expected a table"),
    ("[look]\ngrass = 3", r"\[look\.grass\] = 3: expected a table"),
    ("edit = 3", "edit = 3: expected tables, each with"),
    ("[[edit]]", "number 1: no action: expected move, resize"),
    ("[[edit]]\naction = 'mov'", "number 1: action = 'mov': expected .*did you mean 'move'"),
    ("[[edit]]\naction = 'delete'", "no feature: expected action, feature"),
    ("[[edit]]\naction = 'delete'\nfeature = -1", "feature = -1: expected a whole number from 0"),
    ("[[edit]]\naction = 'move'\nfeature = 1\nx = 2", "edit move: expected x, y, no y given"),
    ("[[edit]]\naction = 'move'\nfeature = 1\nx = '2'\ny = 0", "edit move.x = '2': expected a number"),
    ("[[edit]]\naction = 'move'\nfeature = 1\nwidht = 2", "unknown key 'widht' = 2: expected action"),
    ("[[edit]]\naction = 'add'\nfeature = 1", "unknown key 'feature' = 1: expected action, type"),
    (_ADD.format("lake", 1), "add.type = 'lake': expected 'mountain'"),
    (_ADD.format("forest", 5), "add.strength = 5.0: expected a share"),
    ("[[edit]]\naction='delete'\nfeature=1\n[[edit]]\naction='x'", "number 2: action = 'x'"),
    ("material_rule = 3", r"material_rule = 3: expected tables, each with \[\[material_rule\]\]"),
    ("[[material_rule]]\ncover = 1", "number 1: no name: expected name, material, cover"),
    (f"{_ROW}covr = 3", r"number 1: unknown key 'covr' = 3: expected name, .*did you mean 'cover'"),
    (f'{_ROW}material = "mud"', "number 1: material = 'mud': expected grass, soil"),
    (f"{_ROW}cover = 1.5", "number 1: cover = 1.5: expected a number from 0 to 1"),
    (f'{_ROW}before = "ice"', "number 1: before = 'ice': expected one of dry_meadow, "),
    (f'{_ROW}before = "snow"', "number 1: before = 'snow': expected one of dry_meadow, "),
    ('[[material_rule]]\nname = "rok_face"', "a new rule needs a material; did you mean 'rock_face'"),
    (f"{_RAMP}steepnes = 1", r"unknown key 'steepnes' = 1 in \[\[material_rule.factor\]\]: .*'steepness'"),
    (f"{_RAMP}start = 1\nwater = 1", "number 1: factor.full = 1.0: expected at least 0.0001 from start"),
    (f"{_RAMP}shape = 'round'\nwater = 1", "factor.shape = 'round': expected 'smooth' or 'straight'"),
    (_RAMP, "number 1: factor: expected 1 to 6 of height, .*, got none"),
    (
        f"{_RAMP}height = 1\nsteepness = 1\nwater = 1\nwetness = 1\ndune = 1\nforest = 1\nmottle = 1",
        "got height, steepness, water, wetness, dune",
    ),
    (_ROW + "[[material_rule.factor]]\nwater = 1\n" * 5, "number 1: 5 factors: expected at most 4"),
    (_ROW + '[[material_rule]]\nname = "a"', r"\[\[material_rule\]\] number 2: name = 'a': a new rule"),
]
_NOT_TOML = [
    (b"", "format = 1 or 2 expected, got no such key"),
    (b"format = true", "format = 1 or 2 expected, got true"),
    (b"format = '1'", "format = 1 or 2 expected, got '1'"),
    (b"format = 0", "format = 1 or 2 expected, got 0"),
    (b"format = 3", "format = 1 or 2 expected, got 3"),
    (b"format = 1\nextent = \n", "not TOML: .*line 2"),
    (b"format = 1\nseed = 1\nseed = 2\n", "not TOML: .*line 3"),
    (b"format = 1\nname = 'caf\xe9'\n", "line 2 is not UTF-8"),
    (b"\x00\x01", "not TOML"),
    (b"\xff\xfe", "line 1 is not UTF-8"),
    (b"a = " + b"[" * 100_000, "nested too deeply"),
    (b"format = 1\n" + b".".join([b"a"] * 200_000) + b" = 1", "line 2 has more than 250 dots"),
    (b"format = 1\nextent" + b".1" * 250 + b" = 1", "extent = {'1': .*: expected a number"),
    (b"format = 1\nseed = 1" + b"0" * 5000, "expected|not TOML"),
]


def test_refused_settings_name_the_key_or_the_line():
    for text, message in [*_REFUSED, *_NOT_TOML]:
        refused(message, parse_settings, text if isinstance(text, bytes) else f"format = 1\n{text}".encode())


@given(st.binary(max_size=200))
def test_random_bytes_parse_or_raise_an_input_error(data):
    with contextlib.suppress(InputError):
        parse_settings(b"format = 1\n" + data)


def test_largest_settings_fit_the_file_limit():
    labels = {
        (name, label): {
            key: p.high - (p.high - p.low) / 3 if p.kind is float else p.choices[-1] if p.choices else p.high
            for key, p in layer.parameters.items()
        }
        for name, layer in LAYERS.items()
        for label in range(1, 256)
    }
    text = settings_text(Sketch(name="\x01" * 200, labels=labels)).encode()
    assert len(text) < file_limit(SETTINGS)
    assert parse_settings(text).labels == labels
    for name in ("." * 200, "🏔" * 200):
        assert parse_settings(settings_text(Sketch(name=name)).encode()).name == name


_WEIGHTS = st.dictionaries(
    st.sampled_from(list(INPUTS)),
    st.floats(-1e4, 1e4).filter(lambda value: value != 0),
    min_size=1,
    max_size=MAX_INPUTS,
)
_FACTORS = st.builds(
    lambda start, width, shape, weights: Factor(start, start + width, shape, **weights),
    st.floats(-100, 100),
    st.floats(0.01, 100) | st.floats(-100, -0.01),
    st.sampled_from(["smooth", "straight"]),
    _WEIGHTS,
)
_OLD = [rule.name for rule in DEFAULT_RULES]
_TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=40)
_CHANGES = st.builds(
    RuleChange,
    _TEXT,
    st.sampled_from(MATERIALS),
    st.none() | st.floats(0, 1),
    st.sampled_from(["", _OLD[0], _OLD[-1]]),
    st.none() | st.lists(_FACTORS, max_size=MAX_FACTORS).map(tuple),
) | st.builds(RuleChange, st.sampled_from(_OLD[1:-1]), st.none(), st.none() | st.floats(0, 1))


@settings(max_examples=40)
@given(st.lists(_CHANGES, max_size=5).map(tuple))
def test_rule_changes_round_trip(changes):
    sketch = Sketch(material_rules=changes)
    text = settings_text(sketch)
    again = parse_settings(text.encode())
    assert again.material_rules == changes
    assert settings_text(again) == text


def test_default_rules_match_the_declarations():
    assert [each.name for each in fields(Factor)] == list(FACTOR)
    assert {each.name for each in fields(RuleChange)} == {*RULE, "factors"}
    assert resolved_rules(()) == DEFAULT_RULES
    assert len(set(_OLD)) == len(_OLD) < MAX_RULES
    for rule in DEFAULT_RULES:
        change = RuleChange(rule.name, rule.material, rule.cover, factors=rule.factors)
        assert resolved_rules([change]) == DEFAULT_RULES


def test_changed_and_new_rules():
    rules = resolved_rules([RuleChange("rock_face", cover=0.25)])
    assert [rule.name for rule in rules] == _OLD
    old, new = (table[_OLD.index("rock_face")] for table in (DEFAULT_RULES, rules))
    assert (new.material, new.cover, new.factors) == ("rock", 0.25, old.factors)
    (bare,) = (r for r in resolved_rules([RuleChange("rock_face", factors=())]) if r.name == "rock_face")
    assert bare.factors == ()

    top, below = RuleChange("moss", "grass"), RuleChange("moss", "grass", before="snow")
    assert [rule.name for rule in resolved_rules([top])] == [*_OLD, "moss"]
    names = [rule.name for rule in resolved_rules([below])]
    assert names[names.index("moss") + 1] == "snow"
    moved = [rule.name for rule in resolved_rules([RuleChange("snow", before="dry_meadow")])]
    assert moved == ["snow", *(name for name in _OLD if name != "snow")]
    twice = resolved_rules([top, RuleChange("moss", cover=0.5)])
    assert [rule.cover for rule in twice if rule.name == "moss"] == [0.5]


def test_number_of_rules_is_limited():
    ramp = Factor(-1e4 / 3, 1e4 / 3, "straight", above_snow_line=1e4 / 3, wetness=1e4 / 3, mottle=-1e4 / 3)
    rows = [RuleChange(f"{n:040}", MATERIALS[-1], 1 / 3, "snow", (ramp,) * 4) for n in range(MAX_RULES)]
    most = tuple(rows[: MAX_RULES - len(DEFAULT_RULES)])
    text = settings_text(Sketch(material_rules=most)).encode()
    assert len(text) < file_limit(SETTINGS) / 8
    assert parse_settings(text).material_rules == most
    with pytest.raises(InputError, match=f"{MAX_RULES + 1} rules with those of the table: expected at most"):
        Sketch(material_rules=rows[: len(most) + 1])
