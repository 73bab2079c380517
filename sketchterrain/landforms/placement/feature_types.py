"""Feature types: record layout, height profiles, placement and placement rules."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.document.edits import Edit
from sketchterrain.io.resources import kernel_constants
from sketchterrain.schema.layers import LAYERS, PATCH_LAYERS, POINT_LAYERS

(_WAVE_PEAK,) = kernel_constants("layers/plateaus.clh", "WAVE_PEAK")

GroundHeight: TypeAlias = Callable[[Float64Array, Float64Array], npt.NDArray[np.floating[Any]]]
"""Height (m) of some ground at positions x, y (n,), m."""

FEATURE_TYPES: Final = POINT_LAYERS
"""Types of point feature; the index of a type is its code in ``FEATURE["type"]``."""

FEATURE: Final = np.dtype(
    [
        ("id", "u8"),  # top bit: clear for painted features, set for features of the fill
        ("type", "u1"),  # index into FEATURE_TYPES
        ("x", "f8"),  # m east of the sketch's south-west corner
        ("y", "f8"),  # m north of it
        ("radius", "f4"),  # m, of the compact support
        ("strength", "f4"),  # mountain, hill, dune: m of height; forest: share of the trees, 0..1
        ("peakiness", "f4"),  # mountain: 0 rounded .. 1 sharp; forest: see `conifer_code`; 0 for the others
        ("wavelength", "f4"),  # dune: m from crest to crest; 0 for the others
        ("wind", "f4"),  # dune: degrees the wind blows from; 0 for the others
        ("erosion", "f4"),  # mountain, hill: 0 gentle flanks .. 1 steep ones
        ("strata", "f4"),  # mountain: 0 even rock .. 1 cliffs and benches
        ("painted", "?"),  # False for features of the fill
    ]
)
"""One placed feature. Arrays of it are sorted by id, the order in which terrain sums them."""

FILL_BIT: Final = np.uint64(1 << 63)
"""Set in the id of every feature of the fill."""

BY_ELEVATION: Final = -1.0
"""Share of conifers of a forest where elevation decides."""


def conifer_code(share: float) -> float:
    """Return the code stored in a forest's ``peakiness`` for its share of conifers: 0 is by elevation."""
    return 1.0 + share if share >= 0.0 else 0.0


def conifer_share(code: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the share of conifers, 0 … 1 or ``BY_ELEVATION``, stored in a forest's ``peakiness``."""
    return np.asarray(np.asarray(code, dtype=np.float64) - 1.0)


def stored_style(name: str, properties: Mapping[str, Any]) -> dict[str, float]:
    """Return the fields of a type's features that store its parameters besides the strength."""
    values = {each.name: properties[each.name] for each in LAYERS[name].style}
    if "conifers" in values:
        values["peakiness"] = conifer_code(float(values.pop("conifers")))
    return values


def has_parameter(points: StructuredArray, name: str) -> npt.NDArray[np.bool_]:
    """Return which features' types have a parameter."""
    types = [code for code, layer in enumerate(FEATURE_TYPES) if name in LAYERS[layer].parameters]
    return np.isin(points["type"], types)


def style_of(point: np.void) -> dict[str, Any]:
    """Return the parameters of a feature besides its strength, as stored."""
    names = [each.name for each in LAYERS[FEATURE_TYPES[point["type"]]].style]
    code = point["peakiness"]
    return {name: float(conifer_share(code)) if name == "conifers" else point[name] for name in names}


def lock_edit(point: np.void) -> Edit:
    """Return the edit that fixes a placed feature exactly as it is."""
    name = FEATURE_TYPES[int(point["type"])]
    values = {key: point[key] for key in ("x", "y", "radius", "strength")} | style_of(point)
    floats: dict[str, Any] = {key: float(value) for key, value in values.items()}
    return Edit("lock", int(point["id"]), type=name, **floats)


@dataclass(frozen=True, eq=False)
class River:
    """One reach of a river network, from its spring down to its mouth or confluence."""

    id: int  # stable: layer code and the first pixel of the reach
    label: int  # in the river layer
    # (n, 3) control points, upstream first: x, y (m, in steps of 1/1024 except at a confluence), water level
    points: npt.NDArray[np.float64]
    width: npt.NDArray[np.float32]  # (n,) of the water at the control points, m
    depth: npt.NDArray[np.float32]  # (n,) of the bed below the water surface, m
    # (m, 3) dense samples of the curve; z is the water surface and never rises
    centreline: npt.NDArray[np.float64]
    centreline_width: npt.NDArray[np.float32]  # (m,) m
    centreline_depth: npt.NDArray[np.float32]  # (m,) m
    # (n,) at the control points, m, without natural variation; None for banks as painted
    mean_width: npt.NDArray[np.float32] | None = None
    # (m,) m, as `centreline_width`, but that of the river a brook joins where the brook lies in its water
    bed_width: npt.NDArray[np.float32] | None = None


def move_edit(river: River, index: int, *, x: float, y: float) -> Edit:
    """Return the edit that moves a control point to (x, y), m, identified by its current position."""
    from_x, from_y = (float(each) for each in river.points[index, :2])
    return Edit("move_point", river.id, index=index, x=x, y=y, from_x=from_x, from_y=from_y)


@dataclass(frozen=True, eq=False)
class ShapeField:
    """Signed distance to a painted shape's border, sampled on a grid."""

    west: float  # of sample [0, 0], m; columns run eastward
    south: float  # m; rows run northward
    spacing: float  # m between samples
    # (rows, columns) m, positive inside; the outermost samples are outside by the margin
    inside: npt.NDArray[np.float32]


def distance_inside(field: ShapeField, at: Float64Array) -> Float64Array:
    """Return the distance inside a shape (m) at positions (n, 2); beyond its field, the value at the rim."""
    from scipy.ndimage import map_coordinates  # slow to import: not for a list of targets

    column = (at[:, 0] - field.west) / field.spacing
    row = (at[:, 1] - field.south) / field.spacing
    return np.asarray(
        map_coordinates(field.inside.astype(np.float64), [row, column], order=1, mode="nearest")
    )


def is_inside(field: ShapeField, at: Float64Array) -> npt.NDArray[np.bool_]:
    """Return which positions (n, 2), m, are in a shape; beyond its field, none are."""
    low = np.array([field.west, field.south])
    size = field.spacing * (np.array(field.inside.shape[::-1]) - 1)
    near = np.asarray(np.all((at >= low) & (at <= low + size), axis=1), np.bool_)
    near[near] = distance_inside(field, at[near]) > 0.0
    return near


@dataclass(frozen=True, eq=False)
class Lake:
    """A lake."""

    id: int  # stable: layer code and a pixel of the shape
    label: int  # in the lake layer
    shape: ShapeField
    level: float  # height of the water surface, m
    depth: float  # greatest depth, m


def lake_centre(lake: Lake) -> Float64Array:
    """Return the middle (m) of the rectangle that a lake's field covers."""
    field = lake.shape
    size = np.array(field.inside.shape[::-1]) - 1
    return np.asarray(np.array([field.west, field.south]) + 0.5 * field.spacing * size)


@dataclass(frozen=True, eq=False)
class Cover:
    """A painted surface: one material on top of those that the rules select."""

    id: int  # stable: layer code and a pixel of the shape
    label: int  # in the material layer
    shape: ShapeField
    material: int  # index into the materials
    strength: float  # 0 … 1, share of the surface


VISIBLE_SHARE: Final = 0.25
"""Share of its label's height above which a shape counts as visible, also in the measure of adherence."""

_STEEPEST = 0.6  # added to the flank at fidelity 1
_LOOSE = 0.6  # fidelity up to which flanks are gentlest
_HILL_FOOT, _PEAK_MIN, _PEAK_RANGE, _TIP = 1.4, 0.1, 0.6, 0.12
_CUT_IN = 0.2  # radius added to a mountain at fidelity 0, as valleys cut into its outline
_HALVINGS = 30


def flank(fidelity: float) -> float:
    """Return how much steeper than the plain cubic mountains and hills fall to their feet, ≥ 1."""
    steep = max(fidelity - _LOOSE, 0.0) / (1.0 - _LOOSE)
    return 1.0 + _STEEPEST * steep * steep * steep


def cubic(t: Float64Array) -> Float64Array:
    """Return 2t³ - 3t² + 1: 1 at 0, 0 from 1 on."""
    s = np.minimum(t, 1.0)
    return np.asarray(2.0 * s**3 - 3.0 * s**2 + 1.0)


def smoothstep(t: Float64Array) -> Float64Array:
    """Return 0 up to 0, 1 from 1 on, smooth between."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def even_wave(x: Float64Array) -> Float64Array:
    """Return a wave between -1 and 1 with period 1, 0 at whole numbers."""
    t = x - np.floor(x)
    return np.asarray(_WAVE_PEAK * t * (1 - t) * (1 - 2 * t))


def hill_profile(t: Float64Array, steepness: float | Float64Array) -> Float64Array:
    """Return the share of a hill's height at t: 1 up to 1 - 1/steepness, then down to a concave foot at 1.

    A round top, below it a slope that fades evenly into the terrain, without an edge at the foot: nearly
    (1 - s)², but level at s = 0.
    """
    s = np.maximum(1.0 - steepness * (1.0 - np.minimum(t, 1.0)), 0.0)
    return np.asarray((1.0 - s) ** 2 * (1.0 + s * (2.0 + s * (_HILL_FOOT * s - 3.0))))


def mountain_profile(
    t: Float64Array, peakiness: float | Float64Array, steepness: float | Float64Array
) -> Float64Array:
    """Return the share of a mountain's height: a hill's profile and a round tip (1 - t)², by peakiness."""
    share = _PEAK_MIN + _PEAK_RANGE * peakiness
    tip = (1.0 - _rounded(t)) ** 2 / (1.0 - 0.5 * _TIP) ** 2
    return np.asarray((1.0 - share) * hill_profile(t, steepness) + share * tip)


def _rounded(t: Float64Array) -> Float64Array:
    return np.where(t < _TIP, 0.5 * (t * t / _TIP + _TIP), np.minimum(t, 1.0))


def area_profile(t: Float64Array) -> Float64Array:
    """Return the cover of dunes or of a forest: full up to half a radius, then the cubic."""
    return cubic(np.maximum((t - 0.5) / 0.5, 0.0))


def height_profile(name: str, t: Float64Array, peakiness: Float64Array, steepness: float) -> Float64Array:
    """Return the share of a feature's strength at t ground radii from its centre."""
    if name == "mountain":
        return mountain_profile(t, peakiness, steepness)
    return hill_profile(t, steepness) if name == "hill" else area_profile(t)


def visible_radius(name: str, share: Float64Array, peakiness: Float64Array, fidelity: float) -> Float64Array:
    """Return where a feature reaches a quarter of its label's strength, in its ground radii.

    `share` (n,) is its strength over its label's, more than a quarter.
    """
    low, high = np.zeros(len(share)), np.ones(len(share))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        profile = height_profile(name, middle, peakiness, flank(fidelity))
        above = share * profile > VISIBLE_SHARE
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    # Valleys between ridges cut into an outline more than spurs add to it, less so near fidelity 1.
    return low / (1.0 + _CUT_IN * (1.0 - fidelity)) if name == "mountain" else low


LAYER_CODES: Final = {name: layer.code for name, layer in LAYERS.items()}
"""Layer codes in ids and hashes."""


@dataclass(frozen=True)
class TypeRule:
    """How one type of feature derives its size and strength from paint."""

    radius_ratio: float  # visible radius over the painted disc's; 1 is on the painted border
    # (low, high) strength between the summits, as a share of a summit of the same size
    support: tuple[float, float]
    min_share: float  # least share of the label's strength at fidelity 1, so that all of the shape is visible
    size_power: float  # a smaller disc's strength scales with (radius / the shape's largest) to this power
    variation: float  # hashed variation of a summit's strength to either side, never above its label's
    max_slope: float  # strength over the disc's radius, at most; tan 70° for landforms
    fill_radius: float  # largest ground radius of the fill, m; the smallest is 0.4 of it
    fill_extent: float  # … and at most this share of the sketch's extent
    fill_slope: float  # strength of the fill over its ground radius, at most


TAN_70: Final = 2.7474774194546216
"""Greatest height of a landform over its disc's radius."""
_ANY = float("inf")

TYPES: Final[dict[str, TypeRule]] = {
    #                    radius support      min.  size  var.  slope    fill: radius extent slope
    "mountain": TypeRule(1.14, (0.55, 0.85), 0.36, 0.50, 0.00, TAN_70, 2500.0, 0.30, 0.60),
    "hill": TypeRule(1.10, (0.45, 0.70), 0.36, 0.50, 0.25, TAN_70, 350.0, 0.12, 0.40),
    "dune": TypeRule(1.03, (0.85, 1.00), 0.85, 0.25, 0.10, TAN_70, 900.0, 0.20, 0.20),
    "forest": TypeRule(1.14, (0.90, 1.00), 0.90, 0.00, 0.05, _ANY, 260.0, 0.10, _ANY),
}
"""In the order of placement: earlier types take precedence."""


@dataclass(frozen=True)
class Preference:
    """Attraction (weight > 0) or repulsion of a feature when it selects its position near its painted one.

    `what` is the set in which `of` is looked up: ``'user'`` features (painted), ``'final'`` features (already
    placed), or painted pixels of a ``'layer'``. `range` is the distance at which the effect ends, in disc
    radii.
    """

    feature: str
    what: Literal["user", "final", "layer"]
    of: str
    weight: float
    range: float


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

SUMMIT_REPULSION: Final = -1.5
"""Weight of the repulsion between summits of one type within two radii of the disc."""

SPACING: Final[dict[tuple[str, str], float]] = {
    ("mountain", "dune"): 0.80,
    ("hill", "dune"): 0.70,
    ("dune", "dune"): 0.50,
    ("dune", "forest"): 0.80,
    ("forest", "forest"): 0.40,
}
"""A placed or fill feature (first) and one of the fill conflict within this times the sum of their radii."""

CLEARANCE: Final[dict[tuple[str, str], float]] = {
    (name, layer.name): clearance
    for layer in LAYERS.values()
    for name, clearance in zip(PATCH_LAYERS, layer.clearance, strict=False)
}
"""Clearance of fill features (first) from pixels of a painted layer (second), in radii; 0: only unpainted."""
