"""What a sketch says of its materials' looks."""

from __future__ import annotations

import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import Sketch
from sketchterrain.sketch.toml_text import parse_settings, settings_text

LOOK = {"sand": {"size": 9.0}, "grass": {"colour": "#3f6B2a", "roughness": 0.5, "bump": 0.0}}


def parse(text: str) -> Sketch:
    return parse_settings(f"format = 1\n{text}".encode())


def test_only_what_is_given_is_kept_in_the_order_of_materials() -> None:
    sketch = Sketch(look=LOOK)
    assert dict(sketch.look) == LOOK
    assert list(sketch.look) == ["grass", "sand"]


def test_it_survives_its_file() -> None:
    sketch = Sketch(look=LOOK)
    text = settings_text(sketch)
    assert parse_settings(text.encode()).look == sketch.look
    assert "[look.grass]" in text


def test_a_file_without_it_leaves_all_as_the_program_has_it() -> None:
    assert parse("").look == {}
    assert "look" not in settings_text(Sketch())


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[look.gras]\nbump = 1.0", r"\[look\.'gras'\]: expected a material, grass, soil.*did you mean"),
        ('[look.grass]\ncolour = "green"', "look.grass.colour = 'green': expected a colour as \"#rrggbb\""),
        ('[look.grass]\ncolour = "#12345g"', 'expected a colour as "#rrggbb"'),
        ("[look.grass]\ncolour = 7", 'expected a colour as "#rrggbb"'),
        ("[look.rock]\nbump = 2.5", "look.rock.bump = 2.5: expected a number from 0 to 2"),
        ("[look.rock]\nroughness = 1.5", "look.rock.roughness = 1.5"),
        ("[look.rock]\nshine = 1", r"shine.*\[look\.rock\]"),
        ("look = 3", r"\[look\.grass\] = 3: expected a table"),
        ("[look]\ngrass = 3", r"\[look\.grass\] = 3: expected a table"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(text: str, line: str) -> None:
    with pytest.raises(InputError, match=line) as caught:
        parse(text)
    assert "\n" not in str(caught.value)
