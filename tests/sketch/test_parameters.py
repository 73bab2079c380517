import math

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import FACTOR, LAYERS, LOOK, RULE, SKETCH, TABLES, Parameter, reference_table

_TABLES = {
    "sketch": SKETCH,
    **TABLES,
    **{name: layer.parameters for name, layer in LAYERS.items()},
    "look": LOOK,
    "material_rule": RULE,
    "material_rule.factor": FACTOR,
}
_ALL = [(f"{table}.{p.name}", p) for table, ps in _TABLES.items() for p in ps.values()]


def test_each_declaration_is_whole_and_holds_to_its_type_and_range() -> None:
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
            with pytest.raises(InputError, match="expected"):
                parameter.check(bad)

    for _, parameter in _ALL:
        for bad in (None, True, False, [], {}, [1.0], b"1", 1j):
            with pytest.raises(InputError, match="expected"):
                parameter.check(bad)


def test_a_whole_number_is_a_number_and_errors_name_key_value_unit_and_range() -> None:
    assert SKETCH["extent"].check(100) == 100.0
    assert isinstance(SKETCH["extent"].check(100), float)
    assert SKETCH["seed"].check(np.int64(7)) == 7
    assert type(SKETCH["seed"].check(np.int64(7))) is int
    with pytest.raises(
        InputError, match=r"seed = 1\.0: expected a whole number from 0 to 9223372036854775807"
    ):
        SKETCH["seed"].check(1.0)
    with pytest.raises(InputError):
        SKETCH["seed"].check(2**63)

    with pytest.raises(InputError) as caught:
        LAYERS["mountain"].parameters["height"].check("high", "mountain.1.height")
    assert str(caught.value) == "mountain.1.height = 'high': expected a number from 1 to 9000 m"
    parameter = Parameter("mode", str, "a", 0, 9, "", "a choice", choices=("a", "b"))
    assert parameter.check("b") == "b"
    with pytest.raises(InputError, match="mode = 'c': expected 'a' or 'b'"):
        parameter.check("c")
    with pytest.raises(InputError):
        SKETCH["name"].check("\ud800")  # no file can hold it
    with pytest.raises(InputError, match="200 characters"):
        SKETCH["name"].check("x" * 201)


def test_names_are_distinct_and_the_reference_lists_every_parameter() -> None:
    assert all(name == layer.name for name, layer in LAYERS.items())
    assert len({layer.colour for layer in LAYERS.values()}) == len(LAYERS)
    assert all(0 <= channel <= 255 for layer in LAYERS.values() for channel in layer.colour)
    names = ["format", *SKETCH, *TABLES, *LAYERS, "look", "material_rule", "edit"]
    assert len(set(names)) == len(names)

    text = reference_table()
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) == len(_ALL)
    assert all(line.count("|") == 6 for line in rows)
    assert "| `height` | 600 | 1 to 9000 | m | from foot to summit |" in rows
    assert "### `[dune.1]`" in text
