"""What a label is like, in a few words: the property that tells it apart best, and how much is painted."""

from __future__ import annotations

from typing import Final

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.ui.panels.wording import number, with_unit

_MAIN: Final = {
    "mountain": "height",
    "hill": "height",
    "river": "width",
    "dune": "height",
    "forest": "density",
    "lake": "depth",
    "material": "material",
}
"""The property that tells labels of a layer apart best."""


def label_detail(sketch: Sketch, layer: str, label: int, pixels: int) -> str:
    """Return for example ``"900 m · 1.2 km²"``."""
    name = _MAIN[layer]
    main = with_unit(LAYERS[layer].parameters[name], sketch.properties(layer, label)[name])
    if layer == "forest":
        main = f"density {main}"
    square = pixels * sketch.pixel_size**2
    return f"{main} · {_area(square)}" if square else f"{main} · not painted"


def _area(square_metres: float) -> str:
    if square_metres < 1e4:
        return f"{number(square_metres, decimals=0)} m²"
    return f"{number(square_metres / 1e6, decimals=1 if square_metres >= 1e6 else 2)} km²"
