"""The look of materials in a sketch."""

from __future__ import annotations

import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import Sketch
from sketchterrain.sketch.toml_text import parse_settings, settings_text

LOOK = {"sand": {"size": 9.0}, "grass": {"colour": "#3f6B2a", "roughness": 0.5, "bump": 0.0}}


def parse(text: str) -> Sketch:
    return parse_settings(f"format = 1\n{text}".encode())


def test_only_given_values_are_kept_in_the_order_of_materials() -> None:
    sketch = Sketch(look=LOOK)
    assert dict(sketch.look) == LOOK
    assert list(sketch.look) == ["grass", "sand"]
    text = settings_text(sketch)
    assert parse_settings(text.encode()).look == sketch.look
    assert "[look.grass]" in text
    assert parse("").look == {}
    assert "look" not in settings_text(Sketch())


_REFUSED = [
    ("[look.gras]\nbump = 1.0", r"\[look\.'gras'\]: expected a material, grass, soil.*did you mean"),
    ('[look.grass]\ncolour = "green"', "look.grass.colour = 'green': expected a colour as \"#rrggbb\""),
    ('[look.grass]\ncolour = "#12345g"', 'expected a colour as "#rrggbb"'),
    ("[look.grass]\ncolour = 7", 'expected a colour as "#rrggbb"'),
    ("[look.rock]\nbump = 2.5", "look.rock.bump = 2.5: expected a number from 0 to 2"),
    ("[look.rock]\nroughness = 1.5", "look.rock.roughness = 1.5"),
    ("[look.rock]\nshine = 1", r"shine.*\[look\.rock\]"),
    ("look = 3", r"\[look\.grass\] = 3: expected a table"),
    ("[look]\ngrass = 3", r"\[look\.grass\] = 3: expected a table"),
]


def test_refused_looks_name_the_material_and_the_key() -> None:
    for text, message in _REFUSED:
        with pytest.raises(InputError, match=message) as caught:
            parse(text)
        assert "\n" not in str(caught.value)
