"""A sheet of all plants: each species in two of its variants, at every level of detail but the farthest.

``python -m sketchterrain.benchmarks.plant_sheet DIR`` writes ``trees.jpg``.
"""

import io
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.benchmarks.grounds import BARE, open_ground
from sketchterrain.compute.context import ComputeContext
from sketchterrain.io.files import write_atomic
from sketchterrain.look.tree_species import HEIGHTS, SPECIES
from sketchterrain.render.camera import Camera
from sketchterrain.render.offscreen import canvas, read_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.vegetation.plants import PLANT

LEAVES: Final = (10.0, 0.7, 0.26, 0.12, 0.05)
"""`Quality.plant_lod_scale` at which plants of the sheet's size are drawn at each level of detail."""
EACH: Final = 2
"""Plants of a species."""
TALL: Final = 15.0
"""m, all of them, so that all are at the same level."""
WIDE: Final = (8.0, 9.0, 14.5, 8.0, 17.0)
"""m that a plant of each species takes."""
AWAY: Final = 125.0
MIDDLE: Final = (2100.0, 2000.0)
SIZE: Final = (1400, 236)


class _Row:
    """A terrain on which a row of plants stands, and nothing else."""

    def __init__(self, terrain: Terrain) -> None:
        self._terrain = terrain
        count = EACH * len(SPECIES)
        self._plants = np.zeros(count, PLANT)
        wide = np.repeat(WIDE, EACH)
        self._plants["x"] = MIDDLE[0] + np.cumsum(wide) - 0.5 * wide - 0.5 * wide.sum()
        self._plants["y"] = MIDDLE[1]
        self._plants["z"] = terrain.heights(self._plants["x"], self._plants["y"])
        self._plants["species"] = np.arange(count) // EACH
        self._plants["scale"] = TALL / np.array(HEIGHTS)[self._plants["species"]]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._terrain, name)

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        x, y = self._plants["x"], self._plants["y"]
        return self._plants[(x >= west) & (x < east) & (y >= south) & (y < north)]

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        yield
        return self.foliage(west, south, east, north)


def main(arguments: list[str]) -> int:
    """Write the sheet into the folder that is named."""
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    terrain: Any = _Row(open_ground(BARE, ComputeContext()))
    ground = float(terrain.heights([MIDDLE[0]], [MIDDLE[1]])[0])
    eye = (MIDDLE[0], MIDDLE[1] - AWAY, ground + 0.55 * TALL)
    view = float(np.degrees(2.0 * np.arctan(0.64 * TALL / AWAY)))
    camera = Camera(eye, (MIDDLE[0], MIDDLE[1], ground + 0.5 * TALL), view)
    sheet = Image.new("RGB", (SIZE[0], SIZE[1] * len(LEAVES)))
    for level, leaves in enumerate(LEAVES):
        with canvas(SIZE) as (context, texture, framebuffer):
            quality = Quality(plant_lod_scale=leaves, without=frozenset(("clouds", "grass", "rocks")))
            weather = Weather(clouds=0.0, wind=2.0)
            renderer = Renderer(context, terrain, sun=Sun(140.0, 38.0), weather=weather, quality=quality)
            renderer.prepare(camera, SIZE)
            renderer.draw(camera, framebuffer)
            sheet.paste(Image.fromarray(read_picture(texture)), (0, level * SIZE[1]))
    stream = io.BytesIO()
    sheet.save(stream, format="JPEG", quality=88, optimize=True)
    write_atomic(folder / "trees.jpg", stream.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
