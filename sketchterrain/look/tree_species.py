"""The plants there are: how each species grows, how its leaves sit, what colours it has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from sketchterrain.look.tree_shape import BROAD, NEEDLES

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Colours:
    """Albedos, linear.

    Attributes
    ----------
    leaf : (3,)
        Of leaves in the middle of the crown.
    fresh : (3,)
        What is added to those at its border.
    bark, bark_above : (3,)
        At the foot, and where boughs begin.
    marks : float
        Share of the bark that is dark.
    """

    leaf: Colour
    fresh: Colour
    bark: Colour
    bark_above: Colour
    marks: float = 0.0


@dataclass(frozen=True)
class Crown:
    """A plant with boughs that reach out into a round crown. Lengths are heights of the plant.

    Attributes
    ----------
    profile : (k, 2)
        Heights and the crown's radii there.
    tips, boughs : int
        Ends of twigs, and boughs that bear them.
    filling : float
        Share of the tips that lie deep in the crown.
    lumps : float
        How far the crown bulges, of its radius.
    trunk_top, thick, bend, lowest : float
        Where the trunk ends, its radius, how far it wavers, where the lowest bough leaves it.
    rise, arch : float
        How steeply boughs leave the trunk, how they arch.
    sprays : int
        Sprays of leaves at a tip.
    clump : (3,)
        Radius and height of the tuft that they fill, and how much it hangs below its tip, of its height.
    leaf : (2,)
        Length and half width of a spray.
    droop : float
        How much leaves point down.
    kind : float
        What is cut out of a spray.
    colours : Colours
    sizes : (5,)
        Of leaves (last of the hull) in each coarser level, over the finest one's: all cover the same area.
    """

    profile: tuple[tuple[float, float], ...]
    tips: int
    boughs: int
    filling: float
    lumps: float
    trunk_top: float
    thick: float
    bend: float
    lowest: float
    rise: float
    arch: float
    sprays: int
    clump: tuple[float, float, float]
    leaf: tuple[float, float]
    droop: float
    kind: float
    colours: Colours
    sizes: tuple[float, ...]


@dataclass(frozen=True)
class Whorls:
    """A plant with a straight trunk and whorls of boughs. Lengths are heights of the plant.

    Attributes
    ----------
    tiers, boughs : int
        Whorls, and boughs of each.
    spread, lowest, hang : float
        Reach of the lowest boughs, where they begin, how much they hang.
    thick, bend : float
        Radius of the trunk, how far it wavers.
    sprays : int
        Pairs of sprays along the longest bough.
    leaf : (2,)
        Length and half width of a spray.
    kind : float
        What is cut out of a spray.
    colours : Colours
    sizes : (5,)
        Of leaves (last of the hull) in each coarser level, over the finest one's: all cover the same area.
    """

    tiers: int
    boughs: int
    spread: float
    lowest: float
    hang: float
    thick: float
    bend: float
    sprays: int
    leaf: tuple[float, float]
    kind: float
    colours: Colours
    sizes: tuple[float, ...]


_SPRUCE: Final = Whorls(
    tiers=26,
    boughs=7,
    spread=0.215,
    lowest=0.055,
    hang=1.0,
    thick=0.019,
    bend=0.006,
    sprays=11,
    leaf=(0.078, 0.020),
    kind=NEEDLES,
    colours=Colours(
        (0.042, 0.070, 0.030), (0.034, 0.044, 0.010), (0.085, 0.064, 0.050), (0.10, 0.075, 0.058)
    ),
    sizes=(1.41, 2.3, 4.16, 8.43, 1.73),
)
_PINE: Final = Crown(
    profile=((0.36, 0.04), (0.44, 0.17), (0.56, 0.14), (0.66, 0.23), (0.78, 0.21), (0.90, 0.16), (1.0, 0.04)),
    tips=78,
    boughs=17,
    filling=0.30,
    lumps=0.27,
    trunk_top=0.93,
    thick=0.020,
    bend=0.032,
    lowest=0.30,
    rise=0.35,
    arch=0.5,
    sprays=26,
    clump=(0.064, 0.036, 0.0),
    leaf=(0.042, 0.017),
    droop=-0.35,
    kind=NEEDLES,
    colours=Colours(
        (0.058, 0.088, 0.040), (0.036, 0.042, 0.012), (0.095, 0.075, 0.060), (0.30, 0.150, 0.075)
    ),
    sizes=(1.24, 2.08, 3.5, 7.51, 1.7),
)
_OAK: Final = Crown(
    profile=(
        (0.20, 0.20), (0.27, 0.36), (0.40, 0.46), (0.56, 0.47), (0.72, 0.42), (0.86, 0.29), (0.97, 0.08),
    ),
    tips=112,
    boughs=20,
    filling=0.22,
    lumps=0.11,
    trunk_top=0.62,
    thick=0.036,
    bend=0.028,
    lowest=0.20,
    rise=0.45,
    arch=1.0,
    sprays=30,
    clump=(0.094, 0.066, 0.0),
    leaf=(0.047, 0.021),
    droop=0.15,
    kind=BROAD,
    colours=Colours((0.078, 0.118, 0.028), (0.030, 0.034, 0.002), (0.105, 0.086, 0.066), (0.10, 0.08, 0.06)),
    sizes=(1.54, 2.66, 4.67, 9.46, 1.63),
)  # fmt: skip
_BIRCH: Final = Crown(
    profile=(
        (0.22, 0.05),
        (0.32, 0.15),
        (0.48, 0.20),
        (0.65, 0.185),
        (0.82, 0.125),
        (0.94, 0.06),
        (1.0, 0.01),
    ),
    tips=104,
    boughs=24,
    filling=0.30,
    lumps=0.17,
    trunk_top=0.97,
    thick=0.0115,
    bend=0.018,
    lowest=0.20,
    rise=1.25,
    arch=0.8,
    sprays=18,
    clump=(0.040, 0.068, 0.45),
    leaf=(0.032, 0.0145),
    droop=0.75,
    kind=BROAD,
    colours=Colours(
        (0.104, 0.146, 0.034), (0.032, 0.036, 0.004), (0.50, 0.48, 0.44), (0.42, 0.39, 0.35), 0.10
    ),
    sizes=(1.35, 2.3, 4.1, 8.68, 1.58),
)
_SHRUB: Final = Crown(
    profile=((0.03, 0.30), (0.20, 0.52), (0.45, 0.56), (0.70, 0.44), (0.92, 0.20)),
    tips=44,
    boughs=12,
    filling=0.25,
    lumps=0.14,
    trunk_top=0.22,
    thick=0.040,
    bend=0.05,
    lowest=0.02,
    rise=0.8,
    arch=0.9,
    sprays=26,
    clump=(0.15, 0.13, 0.0),
    leaf=(0.115, 0.048),
    droop=-0.1,
    kind=BROAD,
    colours=Colours(
        (0.074, 0.106, 0.032), (0.030, 0.032, 0.004), (0.085, 0.068, 0.052), (0.085, 0.068, 0.052)
    ),
    sizes=(1.07, 1.54, 2.7, 5.55, 1.58),
)

forms: Final[dict[str, Crown | Whorls]] = {
    "spruce": _SPRUCE,
    "pine": _PINE,
    "oak": _OAK,
    "birch": _BIRCH,
    "shrub": _SHRUB,
}
"""How each species grows, in the terrain's order."""
SPECIES: Final = tuple(forms)
"""In the terrain's order."""
HEIGHTS: Final = (17.0, 15.5, 12.0, 12.5, 1.9)
"""m, of a grown plant of each species."""
