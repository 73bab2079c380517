from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sketchterrain.errors import InputError
from sketchterrain.sketch import (
    DEFAULT_RULES,
    FACTOR,
    INPUTS,
    MATERIALS,
    RULE,
    Factor,
    RuleChange,
    Sketch,
    resolved_rules,
)
from sketchterrain.sketch.contents import SETTINGS, file_limit
from sketchterrain.sketch.material_rule import MOST_FACTORS, MOST_INPUTS
from sketchterrain.sketch.material_rules import MOST_RULES
from sketchterrain.sketch.toml_text import parse_settings, settings_text

_WEIGHTS = st.dictionaries(
    st.sampled_from(list(INPUTS)),
    st.floats(-1e4, 1e4).filter(lambda value: value != 0),
    min_size=1,
    max_size=MOST_INPUTS,
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
    st.none() | st.lists(_FACTORS, max_size=MOST_FACTORS).map(tuple),
) | st.builds(RuleChange, st.sampled_from(_OLD[1:-1]), st.none(), st.none() | st.floats(0, 1))


@given(st.lists(_CHANGES, max_size=5).map(tuple))
def test_changes_of_rules_round_trip(changes: tuple[RuleChange, ...]) -> None:
    sketch = Sketch(material_rules=changes)
    text = settings_text(sketch)
    again = parse_settings(text.encode())
    assert again.material_rules == changes
    assert settings_text(again) == text


def test_the_default_rules_hold_to_the_declarations() -> None:
    assert [each.name for each in fields(Factor)] == list(FACTOR)
    assert {each.name for each in fields(RuleChange)} == {*RULE, "factors"}
    assert resolved_rules(()) == DEFAULT_RULES
    assert len(set(_OLD)) == len(_OLD) < MOST_RULES
    for rule in DEFAULT_RULES:
        change = RuleChange(rule.name, rule.material, rule.cover, factors=rule.factors)
        assert resolved_rules([change]) == DEFAULT_RULES


def test_changed_rules_keep_what_is_not_given_and_new_ones_lie_on_top_or_before_another() -> None:
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
    moved = [rule.name for rule in resolved_rules([RuleChange("snow", before="dry_soil")])]
    assert moved == ["snow", *(name for name in _OLD if name != "snow")]
    twice = resolved_rules([top, RuleChange("moss", cover=0.5)])
    assert [rule.cover for rule in twice if rule.name == "moss"] == [0.5]


def test_every_line_of_a_written_rule_says_what_it_means() -> None:
    change = RuleChange(
        "moss", "grass", 0.5, "snow", (Factor(0.2, 0.9, "straight", wetness=1.0, mottle=0.1),)
    )
    text = settings_text(Sketch(material_rules=(change,)))
    lines = text[text.index("[[material_rule]]") :].splitlines()
    keys = [line for line in lines if " = " in line]
    assert len(keys) == 9
    assert all(" # " in line for line in keys)


_ROW = '[[material_rule]]\nname = "snow"\n'
_RAMP = f"{_ROW}[[material_rule.factor]]\n"
_REFUSED = [
    ("material_rule = 3", r"material_rule = 3: expected tables, each with \[\[material_rule\]\]"),
    ("[material_rule]", r"material_rule = \{\}: expected tables"),
    ("[[material_rule]]\ncover = 1", "number 1: no name: expected name, material, cover"),
    (f"{_ROW}covr = 3", r"number 1: unknown key 'covr' = 3: expected name, .*did you mean 'cover'"),
    (f"{_ROW}name = 3", "not TOML"),
    ("[[material_rule]]\nname = 3", "number 1: name = 3: expected a text of 1 to 40 characters"),
    (f'{_ROW}material = "mud"', "number 1: material = 'mud': expected 'grass' or 'soil'"),
    (f"{_ROW}cover = 1.5", "number 1: cover = 1.5: expected a number from 0 to 1"),
    (f"{_ROW}cover = nan", "number 1: cover = nan: expected"),
    (f"{_ROW}cover = true", "number 1: cover = true: expected"),
    (f'{_ROW}before = "ice"', "number 1: before = 'ice': expected one of dry_soil, "),
    (f'{_ROW}before = "snow"', "number 1: before = 'snow': expected one of dry_soil, "),
    ('[[material_rule]]\nname = "rok_face"', "a new rule needs a material; .*did you mean 'rock_face'"),
    (f"{_ROW}factor = 3", "number 1: factor = 3: expected tables"),
    (f"{_RAMP}steepnes = 1", r"unknown key 'steepnes' = 1 in \[\[material_rule.factor\]\]: .*'steepness'"),
    (f"{_RAMP}steepness = 'x'", "number 1: factor.steepness = 'x': expected a number from -10000"),
    (f"{_RAMP}start = 1\nwater = 1", "number 1: factor.full = 1.0: expected at least 0.0001 from start"),
    (f"{_RAMP}shape = 'round'\nwater = 1", "factor.shape = 'round': expected 'smooth' or 'straight'"),
    (_RAMP, "number 1: factor: expected 1 to 4 of height, .*, got none"),
    (
        f"{_RAMP}height = 1\nwater = 1\ndune = 1\nforest = 1\nmottle = 1",
        "got height, water, dune, forest, mottle",
    ),
    (_ROW + "[[material_rule.factor]]\nwater = 1\n" * 5, "number 1: 5 factors: expected at most 4"),
    (_ROW + '[[material_rule]]\nname = "a"', r"\[\[material_rule\]\] number 2: name = 'a': a new rule"),
]


def test_refused_rules_name_number_and_key(folder: Callable[..., Path], refusal: Callable[..., str]) -> None:
    for text, message in _REFUSED:
        place = folder(text)
        assert refusal(place).startswith(f"{place}/sketch.toml: "), text
        with pytest.raises(InputError, match=message) as caught:
            parse_settings(f"format = 1\n{text}".encode())
        assert len(str(caught.value)) < 300
    with pytest.raises(InputError, match="expected RuleChange values, got 'snow'"):
        Sketch(material_rules=("snow",))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected Factor values, got 3"):
        RuleChange("snow", factors=(3,))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="name = None"):
        RuleChange(None)  # type: ignore[arg-type]


def test_the_most_rules_fit_and_no_more() -> None:
    ramp = Factor(-1e4 / 3, 1e4 / 3, "straight", above_snow_line=1e4 / 3, wetness=1e4 / 3, mottle=-1e4 / 3)
    rows = [RuleChange(f"{n:040}", MATERIALS[-1], 1 / 3, "snow", (ramp,) * 4) for n in range(MOST_RULES)]
    most = tuple(rows[: MOST_RULES - len(DEFAULT_RULES)])
    text = settings_text(Sketch(material_rules=most)).encode()
    assert len(text) < file_limit(SETTINGS) / 8
    assert parse_settings(text).material_rules == most
    with pytest.raises(InputError, match=f"{MOST_RULES + 1} rules with those of the table: expected at most"):
        Sketch(material_rules=rows[: len(most) + 1])  # type: ignore[arg-type]
