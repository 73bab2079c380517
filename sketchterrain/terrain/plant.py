"""What a plant is, as data: where it stands, its species, size, turn and tint."""

from __future__ import annotations

from typing import Final

import numpy as np

STOREYS: Final = {
    "woody": ("spruce", "pine", "oak", "birch", "shrub"),
    "grass": ("grass", "flower", "fern"),
}
"""Names of the species by storey; each storey keeps distances of its own and ignores the other."""

SPECIES: Final = STOREYS["woody"] + STOREYS["grass"]
"""Names of the species, in the order of the ``species`` field."""

PLANT: Final = np.dtype(
    [
        ("x", "f8"),  # m east of the sketch's south-west corner
        ("y", "f8"),  # m north of it
        ("z", "f4"),  # m, height of the ground
        ("normal", "f4", 3),  # of the ground, a unit vector: east, north, up
        ("species", "u1"),  # index into SPECIES
        ("level", "u1"),  # those of it and above are a Poisson-disk set at 2^level times the distance
        ("scale", "f4"),  # 1 is a grown plant
        ("rotation", "f4"),  # radians, counter-clockwise seen from above
        ("tint", "f4"),  # 0 … 1, where its colour lies among its species' colours
    ]
)
"""One plant."""
