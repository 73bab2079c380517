"""The job of writing a world: all that its bytes follow from, as a value that travels to workers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from sketchterrain.sketch import Sketch
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import World

Form = Literal["zarr", "tiles", "tif"]
"""A Zarr store; a folder of GeoTIFF tiles with VRTs; one GeoTIFF a layer."""
ENDINGS: Final[dict[str, str]] = {"zarr": ".zarr", "tiles": "", "tif": ".tif"}
"""Of an output's name."""
PlantsForm = Literal["none", "parquet", "flatgeobuf"]


@dataclass(frozen=True, eq=False)
class Job:
    """A world that is to be written.

    `sketch` has the seed that counts, and `recipe` is placed once, not by each worker. `output` is absolute.
    `crs` None means metres from the sketch's south-west corner, which lies at `origin` in it. Heights are
    rounded to multiples of `step`, a power of two in m; 0 keeps every bit. With `fast`, kernels trade bits
    for speed.
    """

    sketch: Sketch
    recipe: TerrainRecipe
    world: World
    output: Path
    form: Form
    layers: tuple[str, ...]
    plants: PlantsForm = "none"
    grass: bool = False
    crs: str | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    step: float = 0.0
    fast: bool = False
