"""What reaches each tile, and how far full detail is from each level, as a picture.

``python -m sketchterrain.benchmarks.tile_picture FILE`` draws it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.benchmarks.grounds import open_ground, scattered_keys
from sketchterrain.compute.context import ComputeContext
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.patch_layout import tile_patches

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.surfaces import Tile
    from sketchterrain.terrain.terrain import Terrain

_PRESET = "valley_river"
_LEVEL = 5
_LEVELS = range(2, 9)
_TILES, _PLACES = 24, 400
_SEED = 3
_BLUE, _VERMILION = "#0072B2", "#D55E00"


def draw_tiles() -> Any:
    """Return a figure: features a tile over the shaded ground, and bounds of detail over levels."""
    from matplotlib.figure import Figure

    terrain = open_ground(_PRESET, ComputeContext())
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_counts(left, terrain)
    _draw_bounds(right, terrain)
    return figure


def _draw_counts(axes: Any, terrain: Terrain) -> None:
    counts = _reaching(terrain)
    raster = terrain.raster(513)
    light = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])
    shade = np.clip(raster.normal @ light, 0, 1)
    extent = (0.0, terrain.size[0], 0.0, terrain.size[1])
    axes.imshow(shade, cmap="gray", extent=extent, vmin=0, vmax=1)
    shown = axes.imshow(counts, cmap="viridis", alpha=0.55, extent=extent, origin="lower")
    axes.figure.colorbar(shown, ax=axes, label="features, lakes and arcs of rivers that reach a tile")
    axes.set(title=f"{_PRESET}, tiles of level {_LEVEL}", xlabel="m", ylabel="m")


def _reaching(terrain: Terrain) -> npt.NDArray[np.int64]:
    """How many things reach each tile, rows from the south."""
    side = 2**_LEVEL
    keys = [(column, row) for row in range(side) for column in range(side)]
    patches = tile_patches(_LEVEL, keys, terrain.extent, up=0)
    lists = KernelArguments(terrain.recipe, terrain.context).cull(patches.blocks, patches.cell_size).lists
    features = lists["feature_starts"][:, -1] - lists["feature_starts"][:, 0]
    waters = sum(np.diff(lists[f"{name}_starts"]) for name in ("lake", "river"))
    return np.asarray((features + waters).reshape(side, side), np.int64)


def _draw_bounds(axes: Any, terrain: Terrain) -> None:
    rng = np.random.default_rng(_SEED)
    cells, bounds, found = [], [], []
    for level in _LEVELS:
        tiles = terrain.tiles(scattered_keys(level, _TILES, terrain, seed=_SEED))
        cells.append(tiles[0].cell_size)
        bounds.append([tile.detail_bound for tile in tiles])
        found.append([_missing(terrain, tile, rng) for tile in tiles])
    for values, name, colour in ((bounds, "bound", _VERMILION), (found, "largest difference", _BLUE)):
        middle = [float(np.median(each)) for each in values]
        low, high = ([float(pick(each)) for each in values] for pick in (np.min, np.max))
        axes.plot(cells, middle, "o-", color=colour, markersize=4, label=f"{name}: median of {_TILES} tiles")
        axes.fill_between(cells, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.set(xscale="log", yscale="log", xlabel="cell size, m", ylabel="m")
    axes.set(title="Full detail against a level")
    axes.legend(frameon=False, fontsize=8)


def _missing(terrain: Terrain, tile: Tile, rng: np.random.Generator) -> float:
    west, south, east, north = tile.bounds
    x, y = rng.uniform(west, east, _PLACES), rng.uniform(south, north, _PLACES)
    full, shown = (terrain.heights(x, y, cell_size=cell).astype(np.float64) for cell in (0.0, tile.cell_size))
    return max(float(np.abs(full - shown).max()), 1e-6)


if __name__ == "__main__":
    draw_tiles().savefig(Path(sys.argv[1]), dpi=110, metadata={"Software": None})
