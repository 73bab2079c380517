"""Tree species: parameters of growth, bark and leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array

SOLID, BANDED, BROAD, NEEDLES = 0.0, 0.125, 0.5, 1.0
"""Alpha mask (kernels/render/sprig.glsl): none on furrowed or banded bark, leaf pairs, needles."""


class Leaves(NamedTuple):
    """Sprays of leaves, in heights of the plant."""

    root: Float64Array  # (n, 3)
    along: Float64Array  # (n, 3) from root to tip
    across: Float64Array  # (n, 3) half the width
    normal: Float64Array  # (n, 3) unit normals that light them
    albedo: Float64Array  # (n, 3)
    phase: Float64Array  # (n,) 0..1, of its bough in the wind


class Triangles(NamedTuple):
    """Triangles with their vertex attributes."""

    position: Float64Array  # (n, 3, 3)
    normal: Float64Array  # (n, 3, 3)
    albedo: Float64Array  # (n, 3, 3)
    openness: Float64Array  # (n, 3) openness to sky and sun, 0..1
    leaf_uv: Float64Array  # (n, 3, 2) across -1..1 and along 0..1
    mask: Float64Array  # (n,) what is cut out: `SOLID`, `BANDED`, `BROAD` or `NEEDLES`
    leafiness: Float64Array  # (n,) 0 wood … 1 leaf: lets light through and flutters
    phase: Float64Array  # (n,) 0..1


def unit(vectors: Float64Array) -> Float64Array:
    """Normalise vectors."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def perpendicular(vectors: Float64Array) -> Float64Array:
    """Return a unit vector perpendicular to each of (…, 3) vectors, horizontal where possible."""
    across = np.cross(vectors, [0.0, 0.0, 1.0])
    upright = np.linalg.norm(across, axis=-1, keepdims=True) < 1e-3 * np.linalg.norm(
        vectors, axis=-1, keepdims=True
    )
    return unit(np.where(upright, np.cross(vectors, [1.0, 0.0, 0.0]), across))


def joined_triangles(parts: Sequence[Triangles]) -> Triangles:
    """Concatenate triangles."""
    return Triangles(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Colours:
    """Linear albedos."""

    leaf: Colour  # in the middle of the crown
    fresh: Colour  # added to those at its border
    bark: Colour  # at the foot
    bark_above: Colour  # where boughs begin
    marks: float = 0.0  # share of the bark that is dark


@dataclass(frozen=True)
class Crown:
    """A plant with boughs that end in a round crown. Lengths are heights of the plant."""

    heights: tuple[float, ...]  # of the crown's profile
    radii: tuple[float, ...]  # of the crown there
    tips: int  # ends of twigs
    boughs: int  # main branches, which bear the twigs
    filling: float  # share of the tips deep inside the crown
    lumps: float  # bulges of the crown, of its radius
    trunk_top: float
    trunk_radius: float
    bend: float  # deviation of the trunk from a line
    lowest: float  # height of the lowest bough
    rise: float  # steepness of the boughs at the trunk
    arch: float  # of the boughs
    sprays: int  # of leaves at a tip
    clump: tuple[float, float, float]  # tuft of leaves: radius, height, share of it below the tip
    leaf: tuple[float, float]  # length and half width of a spray
    droop: float  # tendency of leaves to point down
    mask: float  # alpha mask of a spray
    colours: Colours
    sizes: tuple[float, ...]  # of leaves in each coarser level (last: hull, cone), for an equal covered area


@dataclass(frozen=True)
class Whorls:
    """A plant with a straight trunk and whorls of boughs. Lengths are heights of the plant."""

    tiers: int
    boughs: int  # of each tier
    spread: float  # length of the lowest boughs
    lowest: float  # their height
    hang: float  # tendency of boughs to hang
    trunk_radius: float
    bend: float  # deviation of the trunk from a line
    sprays: int  # pairs along the longest bough
    leaf: tuple[float, float]  # length and half width of a spray
    mask: float  # alpha mask of a spray
    colours: Colours
    sizes: tuple[float, ...]  # as of `Crown`


GROWTH_FORMS: Final[dict[str, Crown | Whorls]] = {
    "spruce": Whorls(
        tiers=26,
        boughs=7,
        spread=0.215,
        lowest=0.055,
        hang=1.0,
        trunk_radius=0.019,
        bend=0.006,
        sprays=11,
        leaf=(0.078, 0.020),
        mask=NEEDLES,
        colours=Colours(
            (0.042, 0.070, 0.030), (0.034, 0.044, 0.010), (0.085, 0.064, 0.050), (0.10, 0.075, 0.058)
        ),
        sizes=(1.41, 2.3, 4.16, 8.43, 1.73, 2.39),
    ),
    "pine": Crown(
        heights=(0.36, 0.44, 0.56, 0.66, 0.78, 0.90, 1.0),
        radii=(0.04, 0.17, 0.14, 0.23, 0.21, 0.16, 0.04),
        tips=78,
        boughs=17,
        filling=0.30,
        lumps=0.27,
        trunk_top=0.93,
        trunk_radius=0.020,
        bend=0.032,
        lowest=0.30,
        rise=0.35,
        arch=0.5,
        sprays=26,
        clump=(0.064, 0.036, 0.0),
        leaf=(0.042, 0.017),
        droop=-0.35,
        mask=NEEDLES,
        colours=Colours(
            (0.058, 0.088, 0.040), (0.036, 0.042, 0.012), (0.095, 0.075, 0.060), (0.30, 0.150, 0.075)
        ),
        sizes=(1.24, 2.08, 3.5, 7.51, 1.7, 2.81),
    ),
    "oak": Crown(
        heights=(0.20, 0.27, 0.40, 0.56, 0.72, 0.86, 0.97),
        radii=(0.20, 0.36, 0.46, 0.47, 0.42, 0.29, 0.08),
        tips=112,
        boughs=20,
        filling=0.22,
        lumps=0.11,
        trunk_top=0.62,
        trunk_radius=0.036,
        bend=0.028,
        lowest=0.20,
        rise=0.45,
        arch=1.0,
        sprays=30,
        clump=(0.094, 0.066, 0.0),
        leaf=(0.047, 0.021),
        droop=0.15,
        mask=BROAD,
        colours=Colours(
            (0.054, 0.086, 0.023), (0.021, 0.026, 0.002), (0.105, 0.086, 0.066), (0.10, 0.08, 0.06)
        ),
        sizes=(1.54, 2.66, 4.67, 9.46, 1.63, 2.62),
    ),
    "birch": Crown(
        heights=(0.22, 0.32, 0.48, 0.65, 0.82, 0.94, 1.0),
        radii=(0.05, 0.15, 0.20, 0.185, 0.125, 0.06, 0.01),
        tips=104,
        boughs=24,
        filling=0.30,
        lumps=0.17,
        trunk_top=0.97,
        trunk_radius=0.0115,
        bend=0.018,
        lowest=0.20,
        rise=1.25,
        arch=0.8,
        sprays=18,
        clump=(0.040, 0.068, 0.45),
        leaf=(0.032, 0.0145),
        droop=0.75,
        mask=BROAD,
        colours=Colours(
            (0.074, 0.110, 0.029), (0.023, 0.028, 0.003), (0.50, 0.48, 0.44), (0.42, 0.39, 0.35), 0.10
        ),
        sizes=(1.35, 2.3, 4.1, 8.68, 1.58, 2.42),
    ),
    "shrub": Crown(
        heights=(0.03, 0.20, 0.45, 0.70, 0.92),
        radii=(0.30, 0.52, 0.56, 0.44, 0.20),
        tips=44,
        boughs=12,
        filling=0.25,
        lumps=0.14,
        trunk_top=0.22,
        trunk_radius=0.040,
        bend=0.05,
        lowest=0.02,
        rise=0.8,
        arch=0.9,
        sprays=26,
        clump=(0.15, 0.13, 0.0),
        leaf=(0.115, 0.048),
        droop=-0.1,
        mask=BROAD,
        colours=Colours(
            (0.053, 0.080, 0.026), (0.022, 0.026, 0.003), (0.085, 0.068, 0.052), (0.085, 0.068, 0.052)
        ),
        sizes=(1.07, 1.54, 2.7, 5.55, 1.58, 2.68),
    ),
}
"""Growth parameters of each species, in the terrain's order."""
SPECIES: Final = tuple(GROWTH_FORMS)  # in the terrain's order
HEIGHTS: Final = (17.0, 15.5, 12.0, 12.5, 1.9)  # m, of a grown plant of each species
