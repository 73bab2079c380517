"""Materials of the ground: a declaration each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

Tint = tuple[float, float, float]
"""Factors of red, green and blue of a linear albedo."""
Colour = tuple[int, int, int]
"""sRGB, 0 to 255."""

_NEUTRAL: Final = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Variation:
    """Variation of a texture's colour over the terrain, from `low` to `high`.

    The tint is a smoothstep from `start` to `full` of a sum of noises of about 1000, 100 and 10 m: `wide`,
    `middle` and `small`, of four channels each.
    """

    low: Tint
    high: Tint
    start: float
    full: float
    noise: str  # a sum of channels, such as "0.9 * wide.x + middle.y"


@dataclass(frozen=True)
class Texture:
    """A texture that kernels/material_layers.clh paints by the function of its name."""

    name: str
    width: float  # m that it covers where it is laid finest
    bump: float  # height range, texture widths
    low: float  # roughness of its lowest points
    high: float  # roughness of its highest points
    octaves: tuple[int, int]  # finest and coarsest on the terrain: blades of grass are never a metre wide
    rotation: float = math.pi  # largest rotation of its hexagons (rad): less if it has a direction
    arid_tint: Tint = _NEUTRAL  # at aridity 1, ...
    arid_from: float = 0.0  # ... from none at this aridity
    variations: tuple[Variation, ...] = ()
    bedded: bool = False  # beds on its faces
    of_rock: float = 0.0  # how much of it has the colour of the sketch's rock

    @property
    def is_directed(self) -> bool:
        """Whether it looks different when it is rotated."""
        return self.rotation < math.pi


@dataclass(frozen=True)
class Stones:
    """Loose stones on a material: their probability, the same in heaps only, and the same in their middle."""

    anywhere: float = 0.0
    heaps: float = 0.0
    middles: float = 0.0
    colours: tuple[float, float] | None = None  # weights between which they take on the material's colour
    worn: bool = False  # rounded by water


@dataclass(frozen=True)
class Material:
    """A material of the ground: its textures, what lies and grows on it, its colours in maps and overlays."""

    name: str
    title: str
    texture: Texture
    tint: Colour  # in topographic maps
    colour: Colour  # in overlays
    distant: Texture | None = None  # the texture seen beyond the trees, of ground that trees cover
    is_mapped: bool = True  # explained in the legend of a map
    pen: str = "ground"  # of contours: ground, rock or snow
    spacing: float | None = None  # m, least distance of tufts; None: nothing grows
    meadow: float = 0.0  # share of it that is a meadow, with flowers and tall grass
    sward: float = 1.0  # height of its tufts over those of a meadow
    undergrowth: float = 0.0  # share of it with ferns
    wet: float = 0.0  # share of it under water: grass that is mixed with it is reeds
    bunches: float = 0.0  # share of it with bunches of dry grass in arid terrain
    stones: Stones = Stones()
    tags: str = ""  # values of OpenStreetMap's tags that stand for it
    is_paved: bool = False  # no stone lies on it, nor beside it

    @property
    def is_wooded(self) -> bool:
        """Whether it is the ground of a forest."""
        return self.distant is not None


_RED: Final = (1.35, 0.98, 0.72)  # tint of stone and soil in a desert
_RED_FROM: Final = 0.4
_STRATA: Final = Variation((0.72, 0.75, 0.80), (1.16, 1.11, 1.03), -0.7, 0.7, "wide.y + 0.5 * middle.z")
_MEADOWS: Final = (  # lush to yellow; sedge; herbs
    Variation(
        *((0.96, 0.98, 1.06), (1.45, 1.22, 1.10), -0.5, 1.0),
        "0.8 * wide.x + 0.75 * middle.y + 0.55 * small.z",
    ),
    Variation(
        *(_NEUTRAL, (0.62, 0.74, 0.84), 0.05, 0.8),
        "0.5 * wide.w + 0.8 * middle.x + 0.6 * small.y",
    ),
    Variation(*((0.80, 0.85, 0.86), (1.20, 1.12, 1.02), -0.6, 0.6), "0.4 * middle.z + small.x"),
)
_TURF: Final = (  # olive to straw; grazed
    Variation(
        *((0.82, 0.96, 0.80), (1.30, 1.16, 1.18), -0.7, 0.8),
        "0.6 * wide.y + 0.7 * middle.w + 0.6 * small.x",
    ),
    Variation(*((0.80, 0.84, 0.84), (1.18, 1.12, 1.06), -0.6, 0.6), "0.4 * middle.x + small.w"),
)
_HEATHER: Final = (  # heather to bracken
    Variation(
        *((0.90, 0.84, 0.92), (1.18, 1.26, 0.95), -0.6, 0.6),
        "0.5 * wide.z + 0.8 * middle.y + 0.5 * small.y",
    ),
)
_LITTER: Final = Variation((0.80, 0.92, 0.90), (1.15, 1.08, 1.05), -0.6, 0.8, "middle.y + 0.6 * small.z")
_CROWNS: Final = Variation((0.80, 0.86, 0.86), (1.15, 1.10, 0.96), -0.6, 0.6, "middle.x + 0.5 * small.x")
_CANOPY: Final = Texture("canopy", 8.0, 0.060, 0.95, 0.85, (2, 2), variations=(_CROWNS,))

_DECLARED: Final = (
    Material(
        "grass",
        "Grassland",
        Texture(
            *("grass", 5.0, 0.010, 0.95, 0.80, (0, 2)),
            arid_tint=(1.5, 1.2, 1.0),
            variations=_MEADOWS,
        ),
        tint=(223, 230, 194),
        colour=(90, 170, 60),
        spacing=0.5,
        meadow=1.0,
        stones=Stones(0.002, middles=0.06),
        tags="meadow grass grassland",
    ),
    Material(
        "soil",
        "Bare soil",
        Texture("soil", 5.0, 0.030, 0.95, 0.85, (0, 3), arid_tint=_RED, arid_from=_RED_FROM, of_rock=0.3),
        tint=(228, 220, 190),
        colour=(130, 90, 50),
        spacing=1.5,
        bunches=1.0,
        stones=Stones(heaps=0.22),
    ),
    Material(
        "rock",
        "Rock",
        Texture(
            *("rock", 8.0, 0.150, 0.90, 0.75, (0, 2), 0.0, _RED, _RED_FROM),
            variations=(_STRATA,),
            bedded=True,
            of_rock=1.0,
        ),
        tint=(209, 204, 199),
        colour=(130, 130, 140),
        pen="rock",
        spacing=3.8,
        stones=Stones(0.5),
        tags="bare_rock rock cliff",
    ),
    Material(
        "scree",
        "Scree",
        Texture(
            *("scree", 7.0, 0.060, 0.95, 0.80, (0, 2)),
            arid_tint=_RED,
            arid_from=_RED_FROM,
            variations=(_STRATA,),
            of_rock=1.0,
        ),
        tint=(226, 218, 204),
        colour=(190, 180, 165),
        pen="rock",
        spacing=2.4,
        stones=Stones(1.0, colours=(0.15, 0.6)),
        tags="scree shingle",
    ),
    Material(
        "sand",
        "Sand",
        Texture("sand", 4.0, 0.018, 0.85, 0.75, (0, 2), 0.1),
        tint=(252, 236, 200),
        colour=(235, 205, 120),
        spacing=3.4,
        bunches=1.0,
        stones=Stones(heaps=0.03),
        tags="sand beach",
    ),
    Material(
        "snow",
        "Snow",
        Texture("snow", 6.0, 0.030, 0.75, 0.55, (0, 3), 0.2),
        tint=(240, 246, 252),
        colour=(250, 250, 255),
        pen="snow",
        stones=Stones(heaps=0.05),
        tags="glacier",
    ),
    Material(
        "river_bed",
        "River bed",
        Texture("river_bed", 5.0, 0.045, 0.60, 0.50, (0, 1), of_rock=0.5),
        tint=(226, 226, 203),
        colour=(60, 110, 200),
        is_mapped=False,
        spacing=3.0,
        wet=1.0,
        stones=Stones(0.75, colours=(0.3, 0.6), worn=True),
    ),
    Material(
        "forest_floor",
        "Forest floor",
        Texture("forest_floor", 4.0, 0.022, 0.95, 0.85, (0, 2), variations=(_LITTER,)),
        tint=(212, 224, 182),
        colour=(30, 90, 50),
        distant=_CANOPY,
        is_mapped=False,
        spacing=1.2,
        undergrowth=1.0,
        stones=Stones(heaps=0.10),
    ),
    Material(
        "gravel",
        "Gravel",
        Texture("gravel", 2.5, 0.035, 0.95, 0.80, (0, 2), of_rock=0.5),
        tint=(222, 217, 208),
        colour=(165, 150, 140),
        pen="rock",
        spacing=3.6,
        stones=Stones(0.12, colours=(0.3, 0.6)),
        tags="gravel fine_gravel pebblestone compacted",
    ),
    Material(
        "asphalt",
        "Asphalt",
        Texture("asphalt", 2.5, 0.006, 0.90, 0.70, (0, 2)),
        tint=(196, 196, 200),
        colour=(60, 60, 70),
        tags="asphalt paved",
        is_paved=True,
    ),
    Material(
        "dry_grass",
        "Dry grass",
        Texture(
            *("dry_grass", 5.0, 0.008, 0.95, 0.85, (0, 2)),
            arid_tint=(1.3, 1.1, 0.95),
            variations=_TURF,
        ),
        tint=(234, 230, 194),
        colour=(190, 175, 85),
        spacing=0.6,
        meadow=1.0,
        sward=0.55,
        stones=Stones(0.004, heaps=0.05),
    ),
    Material(
        "heath",
        "Heath",
        Texture("heath", 5.0, 0.028, 0.95, 0.85, (0, 1), variations=_HEATHER),
        tint=(218, 212, 184),
        colour=(120, 105, 70),
        spacing=0.9,
        meadow=0.6,
        sward=1.25,
        undergrowth=0.55,
        stones=Stones(0.004, heaps=0.08),
        tags="heath fell",
    ),
)

MATERIALS: Final = tuple(material.name for material in _DECLARED)
"""Names of the program's materials. The first is what rules are laid on."""

BEDROCK: Final = next(material.name for material in _DECLARED if material.texture.bedded)
"""The material of stones that lie on other materials, and of worlds without materials."""


@dataclass(frozen=True)
class MaterialTable:
    """The materials of a sketch, in the order of their weights."""

    materials: tuple[Material, ...] = _DECLARED

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the materials."""
        return tuple(material.name for material in self.materials)

    @property
    def layers(self) -> dict[str, Texture]:
        """Texture layers by name: a material's each, then those that are seen of them from afar."""
        distant = {texture.name: texture for each in self.materials if (texture := each.distant)}
        return {each.name: each.texture for each in self.materials} | distant

    def __len__(self) -> int:
        return len(self.materials)

    def __iter__(self) -> Iterator[Material]:
        return iter(self.materials)


def weight_words(materials: int) -> int:
    """Return how many words of 32 bits hold the weights of so many materials as bytes."""
    return (materials + 3) // 4


BUILT_IN: Final = MaterialTable()
"""The program's materials."""
