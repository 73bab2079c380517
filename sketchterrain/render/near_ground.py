"""The ground around a moving eye, kept as a small map, so that its motion need not ask a device each time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.relief import sample_heights

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.relief import HeightMap
    from sketchterrain.render.scene import TerrainSource

NARROWEST: Final = 48.0
"""m, side of the smallest map."""
SPREADS: Final = 4.0
"""Side of a map, in the spread of the places that are asked for …"""
TOO_WIDE: Final = 4.0
"""… and how many times that a map may be wide before there is a finer one."""


class NearGround:
    """Heights of a terrain by interpolation in a map around the places that are asked for.

    It is a `Ground` for `Walk` and `Orbit`. A map is made when a place lies outside the last one, or when all
    lie so near to one another that a finer map shows more.

    Parameters
    ----------
    terrain
        Whose ground.
    texels
        Along a side of the map; near the ground they are 48 m / 128 wide.
    """

    def __init__(self, terrain: TerrainSource, *, texels: int = 128) -> None:
        self._terrain = terrain
        self._texels = texels
        self._map: HeightMap | None = None

    def __call__(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return heights (m) at places (m), arrays that broadcast together."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        low = np.array([x.min(), y.min()])
        high = np.array([x.max(), y.max()])
        wanted = max(NARROWEST, SPREADS * float((high - low).max()))
        if self._map is None or not _serves(self._map, low, high, wanted):
            east, north = (0.5 * (low + high)).tolist()
            self._map = sample_heights(self._terrain, (east, north), wanted, self._texels)
        return self._map.at(x, y)


def _serves(
    kept: HeightMap, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], wanted: float
) -> bool:
    corner = np.array([kept.west, kept.south]) + kept.texel  # half a texel in, the last samples lie
    inside = (low >= corner).all() and (high <= corner + kept.width - 2.0 * kept.texel).all()
    return bool(inside) and kept.width <= TOO_WIDE * wanted
