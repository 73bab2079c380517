"""Orthophotos: colours of the ground from above, in pixels that halve from level to level."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.document.rasters import content_digests, raster_problem
from sketchterrain.elevation.pictures import read_picture
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.rasters import RasterSource
    from sketchterrain.document.sketch import Sketch

_SIDE: Final = 4096  # px along the sketch's longer side
WHITE: Final = 0.55
"""Albedo of a white pixel: photographs are brightened."""
ROOTS: Final = (np.arange(256) / 255.0) ** (0.5 * 2.2)
"""√ of the albedo of pixels over that of white ones: their gamma is 2.2."""


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """A photograph in a sketch."""

    pixels: npt.NDArray[np.uint8]  # (rows, columns, 4) sRGB and opacity, row 0 northernmost
    box: tuple[float, float, float, float]  # west, south, east, north, m

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without cached properties."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def _levels(self) -> tuple[npt.NDArray[np.float32], ...]:
        """√ of the albedo times the opacity, and the opacity, 0 … 255, each level half as fine."""
        root = (255.0 * np.sqrt(WHITE) * ROOTS).astype(np.float32)
        share = self.pixels[..., 3:].astype(np.float32)
        levels = [np.concatenate([root[self.pixels[..., :3]] * (share / 255.0), share], axis=-1)]
        while max(levels[-1].shape[:2]) > 1:
            rows, columns = levels[-1].shape[:2]
            padded = np.pad(levels[-1], ((0, rows % 2), (0, columns % 2), (0, 0)), mode="edge")
            quads = padded.reshape(-(-rows // 2), 2, -(-columns // 2), 2, 4)
            levels.append(quads.mean(axis=(1, 3), dtype=np.float32))
        return tuple(levels)

    def sample(self, x: Float64Array, y: Float64Array, texel: float) -> npt.NDArray[np.float32]:
        """Return colours (rows, columns, 4) at columns x and rows y (m) for texels (m), as of a level."""
        west, south, east, north = self.box
        rows, columns = self.pixels.shape[:2]
        pixel = max((east - west) / columns, (north - south) / rows)
        number = int(np.clip(np.floor(np.log2(max(texel / pixel, 1.0)) + 0.5), 0, len(self._levels) - 1))
        level = self._levels[number]
        down = (north - y) * rows / (north - south) / 2**number - 0.5
        across = (x - west) * columns / (east - west) / 2**number - 0.5
        at = [np.clip(each, 0.0, side - 1.0) for each, side in zip((down, across), level.shape, strict=False)]
        first = [np.minimum(each.astype(int), side - 1) for each, side in zip(at, level.shape, strict=False)]
        after = [np.minimum(each + 1, side - 1) for each, side in zip(first, level.shape, strict=False)]
        part = [(each - low).astype(np.float32) for each, low in zip(at, first, strict=True)]
        upper, lower = (
            level[row[:, None], first[1]] * (1 - part[1][:, None])
            + level[row[:, None], after[1]] * part[1][:, None]
            for row in (first[0], after[0])
        )
        found = upper * (1 - part[0][:, None, None]) + lower * part[0][:, None, None]
        inside = ((y >= south) & (y <= north))[:, None] & ((x >= west) & (x <= east))
        return np.where(inside[..., None], found, np.float32(0.0))


def orthophotos(sketch: Sketch, run: Runner) -> tuple[Orthophoto, ...]:
    """Return the orthophotos of a sketch that can be read, from the lowest to the highest."""
    place = part_of(sketch, "frame.crs", "frame.east", "frame.north", "extent", "size")
    return tuple(
        run(_orthophoto, source, place, content_digests([source]), hashed=False)
        for source in sketch.rasters
        if source.role == "orthophoto" and not raster_problem(source)
    )


def _orthophoto(source: RasterSource, place: Sketch, content: list[str]) -> Orthophoto:
    del content  # a file that changes is read again
    return Orthophoto(*read_picture(source, place, side=_SIDE))
