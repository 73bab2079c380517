"""The starter sketch: a small painting with every property written out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sketchterrain.sketch.document import DEFAULT_SIDE, LabelImage, Sketch
from sketchterrain.sketch.parameters import LAYERS

_Dab = tuple[float, float, float]
"""Column, row and radius of a round brush, px."""

_MOUNTAIN: Sequence[_Dab] = (
    (96, 160, 34),
    (140, 128, 46),
    (176, 140, 52),
    (222, 112, 40),
    (236, 158, 44),
    (176, 190, 30),
)
_RIVER: Sequence[_Dab] = (
    (270, 196, 3),
    (296, 240, 4),
    (282, 292, 4),
    (330, 336, 5),
    (392, 352, 5),
    (416, 410, 6),
    (468, 446, 6),
    (511, 480, 7),
)


def starter_sketch() -> Sketch:
    """Return a sketch of one mountain and one river, with label 1 of every layer declared in full."""
    return Sketch(
        name="My sketch",
        seed=1,
        density={"hill": 0.5, "forest": 0.5},
        layers={"mountain": _stroke(_MOUNTAIN), "river": _stroke(_RIVER)},
        labels={
            (layer.name, 1): {name: parameter.default for name, parameter in layer.parameters.items()}
            for layer in LAYERS.values()
        },
    )


def _stroke(dabs: Sequence[_Dab]) -> LabelImage:
    """Return a layer with label 1 along the polyline through the dabs, as wide as they are."""
    rows, columns = np.ogrid[:DEFAULT_SIDE, :DEFAULT_SIDE]
    image = np.zeros((DEFAULT_SIDE, DEFAULT_SIDE), dtype=np.uint8)
    for start, end in pairwise(dabs):
        for part in np.linspace(0.0, 1.0, 24):
            column, row, radius = (a + (b - a) * part for a, b in zip(start, end, strict=True))
            image[(columns - column) ** 2 + (rows - row) ** 2 <= radius**2] = 1
    return image
