"""Feature types: record layout, height profiles, placement rules and crest lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.placement.hashing import hash_unit

if TYPE_CHECKING:
    from sketchterrain.array_types import StructuredArray


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


VISIBLE_SHARE: Final = 0.25
"""Share of its label's height at which a shape begins, to the eye and to the measure of adherence."""

_STEEPEST = 0.6  # added to the flank at fidelity 1
_LOOSE = 0.6  # fidelity up to which flanks are as gentle as they can be
_TIP = 0.12  # share of a radius over which a mountain's tip is rounded
_CUT_IN = 0.2  # how much farther a mountain reaches at fidelity 0, as valleys cut into its outline
_HALVINGS = 30


def flank(fidelity: float) -> float:
    """Return how much steeper than the plain cubic mountains and hills fall to their feet, 1 or more."""
    steep = max(fidelity - _LOOSE, 0.0) / (1.0 - _LOOSE)
    return 1.0 + _STEEPEST * steep * steep * steep


def cubic(t: Float64Array) -> Float64Array:
    """Return 2t³ - 3t² + 1: 1 at 0, 0 from 1 on."""
    s = np.minimum(t, 1.0)
    return np.asarray(2.0 * s**3 - 3.0 * s**2 + 1.0)


def hill_profile(t: Float64Array, steepness: float | Float64Array) -> Float64Array:
    """Return what a hill keeps of its height: all up to 1 - 1/steepness, then down to a hollow foot at 1.

    A round top, below it a slope that fades evenly into the ground, so that no edge tells where the foot is:
    nearly (1 - s)², but level at s = 0.
    """
    s = np.maximum(1.0 - steepness * (1.0 - np.minimum(t, 1.0)), 0.0)
    return np.asarray((1.0 - s) ** 2 * (1.0 + s * (2.0 + s * (1.4 * s - 3.0))))


def hill_slope(t: Float64Array, steepness: float | Float64Array) -> Float64Array:
    """Return how a hill's profile changes with the distance."""
    s = np.maximum(1.0 - steepness * (1.0 - np.minimum(t, 1.0)), 0.0)
    swell = 1.0 + s * (2.0 + s * (1.4 * s - 3.0))
    return np.asarray(steepness * (1.0 - s) * ((1.0 - s) * (2.0 + s * (4.2 * s - 6.0)) - 2.0 * swell))


def mountain_profile(
    t: Float64Array, peakiness: float | Float64Array, steepness: float | Float64Array
) -> Float64Array:
    """Return what a mountain keeps of its height: a hill's profile and a round tip (1 - t)², by peakiness."""
    share = 0.1 + 0.6 * peakiness
    tip = (1.0 - _rounded(t)) ** 2 / (1.0 - 0.5 * _TIP) ** 2
    return np.asarray((1.0 - share) * hill_profile(t, steepness) + share * tip)


def mountain_slope(
    t: Float64Array, peakiness: float | Float64Array, steepness: float | Float64Array
) -> Float64Array:
    """Return how a mountain's profile changes with the distance."""
    share = 0.1 + 0.6 * peakiness
    tip = -2.0 * (1.0 - _rounded(t)) * np.minimum(t / _TIP, 1.0) / (1.0 - 0.5 * _TIP) ** 2
    return np.asarray((1.0 - share) * hill_slope(t, steepness) + share * tip)


def _rounded(t: Float64Array) -> Float64Array:
    return np.where(t < _TIP, 0.5 * (t * t / _TIP + _TIP), np.minimum(t, 1.0))


def area_profile(t: Float64Array) -> Float64Array:
    """Return the cover of dunes or of a forest: full up to half a radius, then the cubic."""
    return cubic(np.maximum((t - 0.5) / 0.5, 0.0))


def visible_radius(name: str, share: Float64Array, peakiness: Float64Array, fidelity: float) -> Float64Array:
    """Return where a feature shows a quarter of its label's strength, in its ground radii.

    Parameters
    ----------
    name : str
        Type of feature.
    share : (n,) float64
        Its strength over its label's, more than a quarter.
    peakiness : (n,) float64
    fidelity : float
    """
    low, high = np.zeros(len(share)), np.ones(len(share))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if name == "mountain":
            profile = mountain_profile(middle, peakiness, flank(fidelity))
        elif name == "hill":
            profile = hill_profile(middle, flank(fidelity))
        else:
            profile = area_profile(middle)
        above = share * profile > VISIBLE_SHARE
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    # Valleys between ridges cut into an outline more than spurs add to it, less so near fidelity 1.
    return low / (1.0 + _CUT_IN * (1.0 - fidelity)) if name == "mountain" else low


LAYER_CODES: Final = {"mountain": 0, "hill": 1, "dune": 2, "forest": 3, "river": 4, "lake": 5, "material": 6}
"""Codes that ids and hashes carry. Never renumber: every terrain would change."""


@dataclass(frozen=True)
class TypeRule:
    """How one type of feature takes its size and strength from what was painted.

    Attributes
    ----------
    reach : float
        Where the ground shows a quarter of the label's strength, over the radius of the painted disc: 1 puts
        that on the painted border, if nothing else stands there.
    support : (low, high)
        Strength of the features between the summits, as a share of a summit of the same size.
    held : float
        Least share of the label's strength that a feature has at fidelity 1, so that all of the shape shows.
    size_power : float
        A smaller disc's strength goes with (its radius / the shape's largest) to this power.
    variation : float
        Hashed variation of a summit's strength, as a share to either side, but never above its label's.
    most_slope : float
        Strength is at most this times the disc's radius; tan 70° for what rises from the ground.
    fill_radius : float
        Largest ground radius (m) where nothing was painted; the smallest is 0.4 of it.
    fill_extent : float
        … and never more than this share of the sketch's extent.
    fill_slope : float
        Strength where nothing was painted is at most this times the ground radius.
    """

    reach: float
    support: tuple[float, float]
    held: float
    size_power: float
    variation: float
    most_slope: float
    fill_radius: float
    fill_extent: float
    fill_slope: float


_TAN_70 = 2.7474774194546216
_ANY = float("inf")

TYPES: Final[dict[str, TypeRule]] = {
    #                    reach  support      held  size  var.  slope    fill: radius extent slope
    "mountain": TypeRule(1.14, (0.55, 0.85), 0.36, 0.50, 0.00, _TAN_70, 2500.0, 0.30, 0.60),
    "hill": TypeRule(1.10, (0.45, 0.70), 0.36, 0.50, 0.25, _TAN_70, 350.0, 0.12, 0.40),
    "dune": TypeRule(1.03, (0.85, 1.00), 0.85, 0.25, 0.10, _TAN_70, 900.0, 0.20, 0.20),
    "forest": TypeRule(1.14, (0.90, 1.00), 0.90, 0.00, 0.05, _ANY, 260.0, 0.10, _ANY),
}
"""In the order in which they are placed: earlier types do not give way to later ones."""


@dataclass(frozen=True)
class Preference:
    """What a feature looks for, or away from, when it chooses its place near where it was painted.

    `what` says in which set `of` is looked up: ``'user'`` features (what was painted), ``'final'`` features
    (already placed), or the painted pixels of a ``'layer'``. Positive weights attract. `reach` is the
    distance at which the effect ends, in radii of the feature's disc.
    """

    feature: str
    what: Literal["user", "final", "layer"]
    of: str
    weight: float
    reach: float


PREFERENCES: Final = (
    Preference("mountain", "user", "mountain", +1.0, 2.0),
    Preference("mountain", "layer", "river", -2.0, 1.5),
    Preference("hill", "user", "hill", +1.0, 2.0),
    Preference("hill", "layer", "river", -1.5, 1.5),
    Preference("hill", "final", "mountain", -0.5, 2.0),
    Preference("dune", "user", "dune", +1.0, 2.0),
    Preference("dune", "layer", "river", -1.5, 1.5),
    Preference("dune", "final", "mountain", -0.5, 1.0),
    Preference("forest", "user", "forest", +1.0, 2.0),
    Preference("forest", "layer", "river", -0.5, 0.5),
    Preference("forest", "final", "dune", -1.0, 1.0),
)

SUMMIT_SHUNS_SUMMIT: Final = -1.5
"""Weight with which summits of one type keep apart (reach: two radii of the disc)."""

SPACING: Final[dict[tuple[str, str], float]] = {
    ("mountain", "mountain"): 0.60,
    ("mountain", "hill"): 0.50,
    ("mountain", "dune"): 0.80,
    ("hill", "hill"): 0.45,
    ("hill", "dune"): 0.70,
    ("dune", "dune"): 0.50,
    ("dune", "forest"): 0.80,
    ("forest", "forest"): 0.40,
}
"""Where nothing was painted, two features conflict when nearer than this times the sum of their radii."""

CLEARANCE: Final[dict[tuple[str, str], float]] = {
    ("mountain", "mountain"): 0.80,
    ("mountain", "hill"): 0.80,
    ("mountain", "river"): 1.00,
    ("mountain", "dune"): 0.90,
    ("mountain", "forest"): 0.60,
    ("hill", "mountain"): 0.40,
    ("hill", "hill"): 0.80,
    ("hill", "river"): 0.90,
    ("hill", "dune"): 0.90,
    ("hill", "forest"): 0.20,
    ("dune", "mountain"): 0.90,
    ("dune", "hill"): 0.90,
    ("dune", "river"): 1.20,
    ("dune", "dune"): 0.80,
    ("dune", "forest"): 1.00,
    ("forest", "mountain"): 0.00,
    ("forest", "hill"): 0.00,
    ("forest", "river"): 0.00,
    ("forest", "dune"): 1.00,
    ("forest", "forest"): 0.50,
}
"""What fills unpainted ground (first) keeps this many of its radii away from pixels of a painted layer
(second). Zero: only off the painted pixels themselves."""


_LEAST, _MOST = 0.15, 0.45  # half the length of a crest, in ground radii


def crest_offsets(points: StructuredArray) -> npt.NDArray[np.float64]:
    """Return half the crest of each feature, eastward and northward, in its ground radii.

    A function of the id, so that a feature that is moved keeps its crest.

    Parameters
    ----------
    points : (n,) array of FEATURE

    Returns
    -------
    (n, 2) float64, 0 for what was painted and for all but mountains.
    """
    number = points["id"].astype(np.uint64).view(np.int64)
    length = _LEAST + (_MOST - _LEAST) * hash_unit(0, "crest length", number)
    length[points["painted"] | (points["type"] != FEATURE_TYPES.index("mountain"))] = 0.0
    turn = np.pi * hash_unit(0, "crest direction", number)
    return np.stack([length * np.cos(turn), length * np.sin(turn)], axis=-1)
