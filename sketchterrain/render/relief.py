"""Height maps of the region around a view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.scene import TerrainSource


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights on a square grid of texel centres."""

    west: float
    south: float
    width: float
    heights: npt.NDArray[np.float32]

    @property
    def texel(self) -> float:
        """Width of a texel (m)."""
        return self.width / len(self.heights)

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Float64Array:
        """Interpolate heights (m); places outside take the border's."""
        n = len(self.heights)
        col = np.clip((np.asarray(x, np.float64) - self.west) / self.texel - 0.5, 0.0, n - 1.001)
        row = np.clip((np.asarray(y, np.float64) - self.south) / self.texel - 0.5, 0.0, n - 1.001)
        i, j = col.astype(np.intp), row.astype(np.intp)
        u, v = col - i, row - j
        h = self.heights
        south = h[j, i] * (1 - u) + h[j, i + 1] * u
        north = h[j + 1, i] * (1 - u) + h[j + 1, i + 1] * u
        return np.asarray(south * (1 - v) + north * v)

    def rasterized_mask(
        self, places: Sequence[npt.NDArray[Any]], widths: Sequence[npt.NDArray[Any]]
    ) -> HeightMap:
        """Make a map of the same square that is 1 around the given places and 0 elsewhere."""
        n = len(self.heights)
        marks = np.zeros((n, n), np.float32)
        for place, width in zip(places, widths, strict=True):
            cell = np.floor((place[:, :2] - [self.west, self.south]) / self.texel).astype(np.intp)
            reach = (width / self.texel / 2).astype(np.intp)
            value = np.clip(width / self.texel, 1 / 3, 1.0)
            for (i, j), r, v in zip(cell.tolist(), reach.tolist(), value.tolist(), strict=True):
                window = marks[max(j - r, 0) : max(j + r + 1, 0), max(i - r, 0) : max(i + r + 1, 0)]
                np.maximum(window, v, out=window)
        return HeightMap(self.west, self.south, self.width, marks)


def sample_heights(
    terrain: TerrainSource, centre: tuple[float, float], width: float, texels: int
) -> HeightMap:
    """Sample a square of a terrain, band-limited to what the texels can carry."""
    west, south = centre[0] - width / 2, centre[1] - width / 2
    along = (np.arange(texels) + 0.5) * (width / texels)
    heights = terrain.heights(west + along[None, :], south + along[:, None], cell_size=width / texels)
    return HeightMap(west, south, width, np.ascontiguousarray(heights, dtype=np.float32))
