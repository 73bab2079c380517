import contextlib
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, SKETCH, TABLES, Parameter, Sketch
from sketchterrain.sketch.contents import SETTINGS, file_limit
from sketchterrain.sketch.toml_text import parse_settings, settings_text

_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=200)


def _values(table: Mapping[str, Parameter]) -> SearchStrategy[dict[str, object]]:
    def of(parameter: Parameter) -> SearchStrategy[object]:
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


@given(SKETCHES)
def test_settings_round_trip(sketch: Sketch) -> None:
    again = parse_settings(settings_text(sketch).encode())
    for key in (*SKETCH, *TABLES, "labels"):
        assert getattr(again, key) == getattr(sketch, key)
    assert settings_text(again) == settings_text(sketch)


def test_the_example_of_the_format_and_any_name() -> None:
    for name in ('say "hi"', "C:\\sketch", "Größe 山 🏔", "two\nlines\r\n\t", "\x00\x1f\x7f", "'''"):
        assert parse_settings(settings_text(Sketch(name=name)).encode()).name == name

    sketch = parse_settings(
        b"""format = 1
name = "Valley with a river"
extent = 4096.0            # metres along the longer side
seed = 7
fidelity = 0.8
[density]
mountain = 0.02
hill = 0.2
[mountain.1]
height = 900.0             # m
peakiness = 0.6
multitude = 1
[river.1]
width = 18.0
depth = 3.0
"""
    )
    assert (sketch.name, sketch.extent, sketch.seed, sketch.fidelity) == (
        "Valley with a river",
        4096.0,
        7,
        0.8,
    )
    assert sketch.density == {"mountain": 0.02, "hill": 0.2, "dune": 0.0, "forest": 0.0}
    assert sketch.labels == {
        ("mountain", 1): {"height": 900.0, "peakiness": 0.6, "multitude": 1},
        ("river", 1): {"width": 18.0, "depth": 3.0},
    }
    # A byte order mark and the format alone are enough.
    assert parse_settings(b"\xef\xbb\xbfformat = 1\r\nextent = 10\r\n").extent == 10.0


def test_every_line_of_a_written_sketch_says_what_it_means() -> None:
    lines = settings_text(Sketch(labels={("dune", 1): {"wind": 90.0}})).splitlines()
    assert "wind = 90.0                  # where the wind blows from: 0 north, 90 east (0 to 360 °)" in lines
    keys = [line for line in lines if " = " in line and not line.startswith(("#", "format"))]
    assert len(keys) == len(SKETCH) + sum(len(table) for table in TABLES.values()) + 1
    assert all(" # " in line for line in keys)


_UNDECLARED = [
    ("", "format = 1 expected, got no such key"),
    ("format = 2", "format = 1 expected, got 2"),
    ("format = true", "format = 1 expected, got true"),
    ("format = 1.0", "format = 1 expected, got 1.0"),
    ("format = '1'", "format = 1 expected, got '1'"),
    ("seeed = 3", "unknown key 'seeed' = 3: expected .*; did you mean 'seed'"),
    ("[montain.1]", "unknown key 'montain' = .*; did you mean 'mountain'"),
    ("[mountain.1]\nheigth = 3.0", r"unknown key 'heigth' = 3.0 in \[mountain.1\]: .*did you mean 'height'"),
    (
        "[density]\nriver = 1",
        r"unknown key 'river' = 1 in \[density\]: expected mountain, hill, dune, forest",
    ),
    ("seed = 1.5", "seed = 1.5: expected a whole number"),
    ("seed = true", "seed = true: expected a whole number"),
    ("seed = '7'", "seed = '7': expected a whole number"),
    ("extent = true", "extent = true: expected a number from 1 to 1000000 m"),
    ("extent = 1979-05-27", "extent = datetime.date.*: expected a number"),
    ("extent = [1]", r"extent = \[1\]: expected a number"),
    ("name = 3", "name = 3: expected a text of 0 to 200 characters"),
    ("extent = nan", "extent = nan: expected a number"),
    ("extent = 0", "extent = 0: expected a number from 1 to 1000000 m"),
    ("[mountain.1]\nheight = nan", "mountain.1.height = nan: expected a number from 1 to 9000 m"),
    ("[mountain.1]\nmultitude = 0", "mountain.1.multitude = 0: expected a whole number from 1 to 500"),
    ("density = 3", r"\[density\] = 3: expected a table"),
    ("[[density]]", r"\[density\] = \[\{\}\]: expected a table"),
    ("mountain = 3", r"\[mountain.1\] = 3: expected a table"),
    ("mountain.1 = 3", r"\[mountain.1\] = 3: expected a table"),
    ("[mountain]\nheight = 3", r"key 'height' = 3 in \[mountain\]: expected .* for example \[mountain.1\]"),
    ("[mountain.0]", "for a label from 1 to 255"),
    ("[mountain.256]", "for a label from 1 to 255"),
    ("[mountain.01]", "for a label from 1 to 255"),
    ("[mountain.-1]", "for a label from 1 to 255"),
    ("[mountain.'²']", "for a label from 1 to 255"),
    (f"[mountain.{'9' * 5000}]", "for a label from 1 to 255"),
    ('"a\\nb" = 1', r"unknown key 'a\\nb' = 1"),
]
_NOT_TOML = [
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


def test_refused_settings_name_the_key_or_the_line() -> None:
    texts = [
        ((text if not text or text.startswith("format") else f"format = 1\n{text}").encode(), message)
        for text, message in _UNDECLARED
    ]
    for data, message in [*texts, *_NOT_TOML]:
        with pytest.raises(InputError, match=message) as caught:
            parse_settings(data)
        assert str(caught.value).isprintable(), message
        assert len(str(caught.value)) < 300, message


@given(st.binary(max_size=200))
def test_any_bytes_parse_or_raise_an_input_error(data: bytes) -> None:
    with contextlib.suppress(InputError):
        parse_settings(b"format = 1\n" + data)


def test_the_largest_settings_fit_the_limits() -> None:
    labels = {
        (name, label): {
            key: p.high - 1 / 3 if p.kind is float else p.choices[-1] if p.choices else p.high
            for key, p in layer.parameters.items()
        }
        for name, layer in LAYERS.items()
        for label in range(1, 256)
    }
    for name in ("\x01" * 200, "." * 200, "🏔" * 200):
        text = settings_text(Sketch(name=name, labels=labels)).encode()
        assert len(text) < file_limit(SETTINGS)
        assert parse_settings(text).labels == labels
