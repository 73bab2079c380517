"""Legends: the meaning of colours and of layer names, and refusals."""

from __future__ import annotations

import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.trace.legend import INK, NOTHING, OWN_LEGEND, Legend, Meaning, meant_by, read_legend


def test_colours_stand_for_layers_within_the_tolerance() -> None:
    for layer in LAYERS:
        assert OWN_LEGEND.meaning(LAYERS[layer].colour) == Meaning(layer, 1), layer

    assert OWN_LEGEND.meaning((255, 255, 255)) == NOTHING
    assert OWN_LEGEND.meaning((9, 1, 1)) == INK
    assert OWN_LEGEND.meaning((0xAA, 0xD3, 0xDF)) == Meaning("lake", 1)
    assert OWN_LEGEND.meaning((255, 0, 0)) is None

    for tolerance, meaning in ((0.0, None), (0.2, Meaning("river", 3))):
        legend = Legend.given(["river.3=#00f"], tolerance=tolerance)
        assert legend.meaning((0, 0, 255)) == Meaning("river", 3)
        assert legend.meaning((20, 40, 235)) == meaning


def test_a_legend_file_is_read(tmp_path) -> None:
    path = tmp_path / "legend.toml"
    path.write_text(
        '[[colour]]\nrgb = "#8b5a2b"\nlayer = "mountain"\n'
        '[[colour]]\nrgb = "0000ff"\nlayer = "river"\nlabel = 2\n'
        '[[colour]]\nrgb = "#000"\nlayer = "ink"\n'
    )
    legend = read_legend(path)
    assert list(legend.colours.items()) == [
        ((139, 90, 43), Meaning("mountain", 1)),
        ((0, 0, 255), Meaning("river", 2)),
        ((0, 0, 0), INK),
    ]


def test_malformed_legends_are_refused_in_one_line(tmp_path) -> None:
    for text, told in [
        ("", r"expected tables \[\[colour\]\]"),
        ("colour = 3", r"expected tables \[\[colour\]\]"),
        ("x = 3", "unknown key 'x'"),
        ("colour = []", "at least one colour"),
        ("[[colour]]\nrgb='#1'\nlayer='hill'", r'1: expected a colour as "#rrggbb", got \'#1\''),
        ("[[colour]]\nrgb='#123456'", r"1: expected layer, a layer's name, got None"),
        ("[[colour]]\nrgb='#123456'\nlayer='hils'", "unknown layer 'hils'.*did you mean 'hill'"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=0", "label from 1 to 255, got 0"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlabel=true", "expected label, 1 to 255, got true"),
        ("[[colour]]\nrgb='#123456'\nlayer='ink'\nlabel=2", "ink has no labels"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\nlable=2", "unknown key 'lable'.*did you mean 'label'"),
        ("[[colour]]\nrgb='#1', x", "not TOML"),
        ("[[colour]]\nrgb='#123456'\nlayer='hill'\n" * 1001, "1001 colours: expected at most 1000"),
        (
            "[[colour]]\nrgb='#123'\nlayer='hill'\n[[colour]]\nrgb='#112233'\nlayer='lake'",
            "#112233 stands for hill 1 and for lake 1",
        ),
    ]:
        path = tmp_path / "legend.toml"
        path.write_text(text)
        with pytest.raises(InputError, match=f"legend.toml: .*{told}") as error:
            read_legend(path)
        assert "\n" not in str(error.value), text[:80]

    with pytest.raises(InputError, match="cannot be read"):
        read_legend(tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read"):
        read_legend(tmp_path)
    (tmp_path / "large.toml").write_bytes(b"#" * (1 << 21))
    with pytest.raises(InputError, match="too large for a legend"):
        read_legend(tmp_path / "large.toml")

    for text in ["", "mountain", "=#123456", "mountain.=#123456", "mountain=red", "no.1=#123456"]:
        with pytest.raises(InputError, match="colour "):
            Legend.given([text])


def test_layer_names_mean_layers_and_labels() -> None:
    for name, meant in [
        ("mountain", Meaning("mountain", 1)),
        ("Mountains", Meaning("mountain", 1)),
        (" river 2 ", Meaning("river", 2)),
        ("forest.1", Meaning("forest", 1)),
        ("LAKE_3.png", Meaning("lake", 3)),
        ("dune (12)", Meaning("dune", 12)),
        ("hill#4", Meaning("hill", 4)),
        ("Materials", Meaning("material", 1)),
        ("mountain 0", None),
        ("river 256", None),
        ("Background", None),
        ("mountain copy", None),
        ("", None),
        ("rivers of gold", None),
    ]:
        assert meant_by(name) == meant, name
