"""All that a world follows from, as a value that is sent to whoever computes some of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.world.grid import World

__all__ = ["ENDINGS", "Form", "Job", "PlantsForm"]

Form = Literal["zarr", "tiles", "tif"]
"""A Zarr store; a folder of GeoTIFF tiles with VRTs; one GeoTIFF a layer."""
ENDINGS: Final[dict[str, str]] = {"zarr": ".zarr", "tiles": "", "tif": ".tif"}
"""Of an output's name."""
PlantsForm = Literal["none", "parquet", "flatgeobuf"]


@dataclass(frozen=True, eq=False)
class Job:
    """A world that is to be written.

    Attributes
    ----------
    sketch : Sketch
        With the seed that counts.
    recipe : TerrainRecipe
        Of that sketch: placed once, not again by each worker.
    world : World
    output : Path
        Absolute: a folder ``….zarr``, a folder, or a file ``….tif``.
    form : Form
    layers : tuple of str
        Which of `LAYERS`.
    plants : PlantsForm
    grass : bool
        Whether grass is among the plants.
    crs : str or None
        Coordinate reference system; None: metres from the sketch's south-west corner.
    origin : (float, float)
        Where that corner lies in it, m.
    step : float
        Heights are rounded to multiples of it, a power of two in m; 0 keeps every bit.
    fast : bool
        Whether kernels may trade bits for speed.
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
