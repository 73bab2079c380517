"""What a picture may cost, as one number."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from sketchterrain.errors import InputError

PARTS: Final = ("shadows", "clouds", "haze", "water", "trees", "rocks", "grass", "detail")
"""Of a picture, that can be left out; ``detail`` is the relief and the fine structure of textures."""

SOFTWARE: Final = ("llvmpipe", "softpipe", "swrast", "swiftshader", "basic render", "gdi generic")
"""In the names of drivers that draw on the CPU."""
SHARED: Final = ("intel", "mali", "adreno", "videocore", "apple")
"""In the names of those that share the CPU's memory."""
ON_CPU: Final = 0.1
ON_SHARED: Final = 0.5
ON_CARD: Final = 0.8
_NUMBERS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
_TOLERANCES: Final = (12.0, 7.0, 2.0, 1.4, 1.0)
_STEEPS: Final = (64.0, 16.0, 4.0, 2.8, 2.0)
_WOODS: Final = (250.0, 400.0, 1000.0, 1550.0, 2400.0)
_LEAVES: Final = (0.15, 0.25, 0.6, 0.77, 1.0)
_THIN: Final = (30.0, 22.0, 10.0, 6.0, 4.0)
_PLANTS: Final = (3e3, 6e3, 3e4, 6e4, 1.2e5)
_COVERED: Final = (0.3, 0.5, 1.0)
"""Numbers of `_GRASS` and `_BLADES`: below the first the ground is bare."""
_GRASS: Final = (30.0, 60.0, 110.0)
_BLADES: Final = (0.3, 0.55, 1.0)
_MOVING_SCALES: Final = (0.33, 0.45, 0.67, 1.0, 1.0)


@dataclass(frozen=True)
class Quality:
    """What a picture, and each frame of a moving one, may cost.

    All of it follows from one number, `of`:

    ====================  =========  =======  =======  ========  ===========================================
    number                0          0.25     0.5      1         scales
    ====================  =========  =======  =======  ========  ===========================================
    tolerance             12         7        2        1         τ, px of the whole picture
    steep                 64         16       4        2         excess at which neighbours of tiles are split
    reach                 3          4        5        7         draw distance, extents
    samples               1          1        1        2         samples a pixel, along each axis
    materials             1          1        2        3         materials blended at a pixel
    planes                1          1        2        2         planes that they are textured from
    octaves               1          1        2        2         sizes in which they are laid
    hexes                 1          1        3        3         hexagons that hide their repetition
    material_texels       512        512      1024     1024      side of their textures
    map_texels            256        384      512      768       side of the light maps
    cloud_steps           0          0        64       96        along a line of sight through clouds; 0 flat
    light_maps            2          2        3        3         maps of the light on the ground
    shade_maps            0          1        2        2         maps of the plants' shadows
    shade_texels          1024       1024     2048     2048      their side
    surface_texels        256        256      512      1024      side of the maps of the drawn ground
    woods                 250        400      1000     2400      distance up to which plants stand, m
    leaves                0.15       0.25     0.6      1         plants' height in pixels for a finer mesh
    thin                  30         22       10       4         height in pixels below which they thin out
    plants                3000       6000     30000    120000    plants that are drawn at most
    grass                 0          0        60       110       distance up to which grass stands, m
    blades                0.3        0.3      0.55     1         grass and stones, over what there are at 1
    moving_scale          0.33       0.45     0.67     1         side of the picture until it is complete
    quads                 32         32       64       64        quads along a tile's side
    tile_memory           128        181      256      512       MiB for tiles
    budget                6          7        8        10        ms a frame for what is new
    ====================  =========  =======  =======  ========  ===========================================

    So the ground's shading reads 2 material texels a pixel at 0, and at 1 mostly 12 to 24, 72 at most.
    Pictures are whole from 0.75 on.
    """

    tolerance: float = 1.0
    steep: float = 2.0
    reach: float = 7.0
    samples: int = 2
    materials: int = 3
    planes: int = 2
    octaves: int = 2
    hexes: int = 3
    material_texels: int = 1024
    map_texels: int = 768
    light_maps: int = 3
    cloud_steps: int = 96
    shade_maps: int = 2
    shade_texels: int = 2048
    surface_texels: int = 1024
    woods: float = 2400.0
    leaves: float = 1.0
    thin: float = 4.0
    plants: int = 120_000
    grass: float = 110.0
    blades: float = 1.0
    moving_scale: float = 1.0
    quads: int = 64
    tile_memory: int = 512 << 20
    budget: float = 0.010
    without: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in sorted(self.without):
            if name not in PARTS:
                raise InputError(f"expected a part of a picture, one of {', '.join(PARTS)}, got {name!r}")

    def includes(self, part: str) -> bool:
        """Tell whether a part of `PARTS` is drawn."""
        return part not in self.without

    @classmethod
    def from_level(cls, number: float, *, without: Iterable[str] = ()) -> Quality:
        """Return the quality of one number, 0 (cheapest) to 1 (best); see the table of the class."""
        if not 0.0 <= number <= 1.0:
            raise InputError(f"expected a quality from 0 to 1, got {number:g}")
        rich = number >= 0.5
        return cls(
            tolerance=_between(number, _TOLERANCES),
            steep=_between(number, _STEEPS),
            reach=3.0 + 4.0 * number,
            samples=2 if number >= 0.75 else 1,
            materials=3 if number >= 0.75 else 2 if number >= 0.4 else 1,
            planes=2 if rich else 1,
            octaves=2 if rich else 1,
            hexes=3 if rich else 1,
            material_texels=1024 if rich else 512,
            map_texels=64 * round(4.0 + 8.0 * number),
            light_maps=3 if rich else 2,
            cloud_steps=32 + round(64 * number) if rich else 0,
            shade_maps=2 if rich else 1 if number >= 0.2 else 0,
            shade_texels=2048 if rich else 1024,
            surface_texels=256 if number < 0.4 else 512 if number < 0.75 else 1024,
            woods=_between(number, _WOODS),
            leaves=_between(number, _LEAVES),
            thin=_between(number, _THIN),
            plants=round(_between(number, _PLANTS)),
            grass=float(np.interp(number, _COVERED, _GRASS)) if number >= _COVERED[0] else 0.0,
            blades=float(np.interp(number, _COVERED, _BLADES)),
            moving_scale=_between(number, _MOVING_SCALES),
            quads=64 if rich else 32,
            tile_memory=round((128 << 20) * 4.0**number),
            budget=0.006 + 0.004 * number,
            without=frozenset(without),
        )

    @classmethod
    def for_renderer(cls, name: str) -> Quality:
        """Return what suits a driver by the name that it gives itself, ``GL_RENDERER``.

        A machine without a GPU gets what two cores draw at 20 frames a second and 1280×720.
        """
        low = name.lower()
        if any(part in low for part in SOFTWARE):
            return cls.from_level(ON_CPU)
        return cls.from_level(ON_SHARED if any(part in low for part in SHARED) else ON_CARD)


def _between(number: float, values: tuple[float, ...]) -> float:
    """Interpolate values at `_NUMBERS`, each step by the same factor."""
    return round(float(np.exp(np.interp(number, _NUMBERS, np.log(values)))), 6)
