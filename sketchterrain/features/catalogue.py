"""What a placed feature and a placed river are, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FEATURE_TYPES: Final = ("mountain", "hill", "dune", "forest")
"""Types of point feature; a type's index is the code that stands in ``FEATURE["type"]``."""

FEATURE: Final = np.dtype(
    [
        ("id", "u8"),  # top bit: clear for painted features, set for those that fill unpainted ground
        ("type", "u1"),  # index into FEATURE_TYPES
        ("x", "f8"),  # m east of the sketch's south-west corner
        ("y", "f8"),  # m north of it
        ("radius", "f4"),  # m, ground radius of the compact support
        ("strength", "f4"),  # mountain, hill, dune: m of height; forest: share of the trees, 0..1
        ("peakiness", "f4"),  # mountain: 0 rounded .. 1 sharp; forest: see `conifer_code`; 0 for the others
        ("wavelength", "f4"),  # dune: m from crest to crest; 0 for the others
        ("wind", "f4"),  # dune: degrees the wind blows from; 0 for the others
        ("erosion", "f4"),  # mountain, hill: 0 no gullies .. 1 deep ones
        ("gullies", "f4"),  # mountain, hill: width of the widest gullies, in radii
        ("painted", "?"),  # False for features that fill unpainted ground
    ]
)
"""One placed feature. Arrays of it are sorted by id, the order in which terrain sums them."""

STYLE: Final = ("peakiness", "wavelength", "wind", "erosion", "gullies")
"""What a feature has as its label says it, by the names of the label's parameters; 0 where it has none."""

FILL_BIT: Final = np.uint64(1 << 63)
"""Set in the id of every feature that fills unpainted ground."""

BY_ELEVATION: Final = -1.0
"""The share of conifers of a forest in which the elevation decides."""


def conifer_code(share: float) -> float:
    """Return what stands in a forest's ``peakiness`` for its share of conifers: 0 is by elevation."""
    return 1.0 + share if share >= 0.0 else 0.0


def conifer_share(code: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the share of conifers, 0 … 1 or ``BY_ELEVATION``, that a forest's ``peakiness`` stands for."""
    return np.asarray(np.asarray(code, dtype=np.float64) - 1.0)


@dataclass(frozen=True, eq=False)
class River:
    """One reach of a river network, from its spring down to its mouth or its confluence.

    Attributes
    ----------
    id : int
        Stable name: the layer's code and the pixel where the reach begins.
    label : int
        Label in the river layer that painted it.
    points : (n, 3) float64
        Control points x, y (m, multiples of 1/1024; not where the reach ends on another's centreline) and z
        (m, water surface), upstream first.
    width, depth : (n,) float32
        Width of the water (m) and depth of the bed below it (m) at the control points.
    centreline : (m, 3) float64
        The curve through the control points in fine steps; z is the water surface and never rises.
    centreline_width, centreline_depth : (m,) float32
        Width and depth along the centreline (m).
    """

    id: int
    label: int
    points: npt.NDArray[np.float64]
    width: npt.NDArray[np.float32]
    depth: npt.NDArray[np.float32]
    centreline: npt.NDArray[np.float64]
    centreline_width: npt.NDArray[np.float32]
    centreline_depth: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ShapeField:
    """How deep inside a painted shape each place lies: samples of a signed distance.

    Attributes
    ----------
    west, south : float
        Position of the sample [0, 0] (m); rows run northward, columns eastward.
    spacing : float
        Metres between samples.
    inside : (rows, columns) float32
        Distance to the shape's border (m): positive inside, negative outside. The outermost samples are
        all outside by at least the margin that whoever reads the field needs.
    """

    west: float
    south: float
    spacing: float
    inside: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Lake:
    """A lake.

    Attributes
    ----------
    id : int
        Stable name: the layer's code and a pixel of the shape.
    label : int
        Label in the lake layer that painted it.
    shape : ShapeField
    level : float
        Height of the water's surface (m): what the rim can hold.
    depth : float
        Greatest depth (m).
    """

    id: int
    label: int
    shape: ShapeField
    level: float
    depth: float


@dataclass(frozen=True, eq=False)
class Cover:
    """A painted surface: one material laid over those that the rules choose.

    Attributes
    ----------
    id : int
        Stable name: the layer's code and a pixel of the shape.
    label : int
        Label in the material layer that painted it.
    shape : ShapeField
    material : int
        Index into the materials.
    strength : float
        0 … 1: how much of the ground it takes where it is painted.
    """

    id: int
    label: int
    shape: ShapeField
    material: int
    strength: float
