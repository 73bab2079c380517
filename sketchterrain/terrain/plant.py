"""Record of a plant: position, species, size, rotation and tint."""

from __future__ import annotations

from typing import Final

import numpy as np

STOREYS: Final = {
    "woody": ("spruce", "pine", "oak", "birch", "shrub"),
    "grass": ("grass", "flower", "fern"),
}
"""Names of the species by storey; each storey has its own spacing and ignores the other."""

SPECIES: Final = STOREYS["woody"] + STOREYS["grass"]
"""Names of the species, in the order of the ``species`` field."""

PLANT: Final = np.dtype(
    [
        ("x", "f8"),  # m east of the sketch's south-west corner
        ("y", "f8"),  # m north of it
        ("z", "f4"),  # m, height of the ground
        ("normal", "f4", 3),  # of the ground, a unit vector: east, north, up
        ("species", "u1"),  # index into SPECIES
        (
            "level",
            "u1",
        ),  # plants of this level and above are a Poisson-disk set at 2^level times the distance
        ("scale", "f4"),  # 1 is a mature plant
        ("rotation", "f4"),  # radians, counter-clockwise seen from above
        ("tint", "f4"),  # 0 … 1, position in its species' range of colours
    ]
)
"""One plant."""
