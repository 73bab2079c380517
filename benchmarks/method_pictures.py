"""The pictures of the pages on materials, lakes, foliage and points (``docs/kernels``), from the terrain.

``python -m sketchterrain.benchmarks.method_pictures DIR`` writes them.
"""

from __future__ import annotations

import dataclasses
import io
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks.point_pictures import draw_points
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.parameters import MATERIALS
from sketchterrain.document.store import load_sketch
from sketchterrain.io.files import write_atomic
from sketchterrain.io.resources import preset_names
from sketchterrain.terrain.building import build
from sketchterrain.terrain.surfaces import Raster
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    Pixels = npt.NDArray[np.float64]

COLOURS = {
    "grass": "#7BA05B",
    "soil": "#8A6642",
    "rock": "#55565C",
    "scree": "#A9A49B",
    "sand": "#E6CC85",
    "snow": "#FAFCFF",
    "river_bed": "#3F7CBF",
    "forest_floor": "#24562B",
}
_SPECIES = {
    "spruce": ("#0B5D3B", "^"),
    "pine": ("#56B4A0", "^"),
    "oak": ("#6FA83B", "o"),
    "birch": ("#D9C23A", "o"),
    "shrub": ("#B5622A", "."),
}
_BLUE, _ORANGE, _INK = "#0072B2", "#D55E00", "#333333"
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])
_SIDE = 513
_PICTURED_LAKE = 0  # of valley_river
_EDGE, _PLOT = (3350.0, 4350.0), 400.0  # m: corner and side of the square whose plants are shown
_STYLE = {"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "savefig.dpi": 95}


def main(arguments: list[str]) -> int:
    """Write all pictures into the folder that is named."""
    import matplotlib as mpl

    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    context = ComputeContext()
    with mpl.rc_context(_STYLE):
        for name, draw in PICTURES.items():
            stream = io.BytesIO()
            draw(context).savefig(stream, format="png")
            write_atomic(folder / f"{name}.png", _small(stream.getvalue()))
    return 0


def draw_materials(context: ComputeContext) -> Any:
    """Draw every preset's weights as mixed colours, shaded by the sun."""
    figure = _figure(9.0, 9.6)
    for axes, name in zip(figure.subplots(2, 2).flat, preset_names(), strict=True):
        terrain = build(load_sketch(name), device=context)
        raster = terrain.raster(_SIDE)
        _show(axes, _mixed(raster) * _shade(raster)[..., None], terrain)
        axes.set_title(name, loc="left")
    figure.legend(handles=_patches(COLOURS), loc="outside lower center", ncols=len(MATERIALS), frameon=False)
    return figure


def draw_lakes(context: ComputeContext) -> Any:
    """Draw a lake from above with its depth, and the ground across it with and without it."""
    terrain = build(load_sketch("valley_river"), device=context)
    dry = Terrain(terrain.sketch, dataclasses.replace(terrain.recipe, lakes=()), context)
    lake = terrain.recipe.lakes[_PICTURED_LAKE]
    field = lake.shape
    rows, columns = field.inside.shape
    east, north = (np.linspace(0, (n - 1) * field.spacing, 400) for n in (columns, rows))
    x, y = np.meshgrid(field.west + east, field.south + north)
    height = terrain.heights(x, y).astype(np.float64)
    figure = _figure(9.0, 4.2)
    above, across = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    depth = np.where(height < lake.level, lake.level - height, np.nan)
    where: dict[str, Any] = {"extent": (0.0, float(east[-1]), 0.0, float(north[-1])), "origin": "lower"}
    above.imshow(_slope_shade(height, east, north), cmap="gray", vmin=0.0, vmax=1.1, **where)
    image = above.imshow(depth, cmap="Blues", vmin=0.0, **where)
    figure.colorbar(image, ax=above, label="depth, m", shrink=0.8)
    middle = int(np.argmax(np.nansum(depth, axis=1)))
    above.axhline(north[middle], color=_ORANGE, linewidth=1.0)
    above.set(xlabel="m east", ylabel="m north", title="valley_river's lake")
    along = np.linspace(0.0, east[-1], 2000)
    at = field.west + along, np.full(along.shape, field.south + north[middle])
    across.plot(along, dry.heights(*at), color=_INK, linewidth=0.9, linestyle="--", label="ground without it")
    bed = terrain.heights(*at)
    across.plot(along, bed, color=_ORANGE, linewidth=1.4, label="with it")
    wet = bed < lake.level
    across.fill_between(along, bed, lake.level, where=wet, color=_BLUE, alpha=0.25, label="water")
    low = lake.level - lake.depth
    across.set(xlabel="m east along the line", ylabel="m", ylim=(low - 3.0, low + 30.0), title="across it")
    across.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    return figure


def draw_foliage(context: ComputeContext) -> Any:
    """Draw how far apart plants are to stand at a forest's edge, and those that do."""
    from matplotlib.colors import LogNorm

    from sketchterrain.terrain.evaluator import Evaluator
    from sketchterrain.terrain.lattice import metres_per_unit
    from sketchterrain.vegetation.plants import SpacingBlocks
    from sketchterrain.vegetation.woods import LEAST, MOST, Woods

    terrain = build(load_sketch("valley_river"), device=context)
    figure = _figure(9.0, 4.9)
    apart, stand = figure.subplots(1, 2)
    unit = metres_per_unit(terrain.extent)
    west, south = _EDGE
    area = (west, south, west + _PLOT, south + _PLOT)
    woods = Woods(Evaluator(terrain.recipe, context))
    raster = SpacingBlocks(woods, terrain.extent).raster(*(round(each / unit) for each in area))
    spacing = np.ma.masked_greater(raster.spacing * unit, MOST)
    # A pixel lies about its vertex.
    left, low = ((at - raster.step / 2) * unit - start for at, start in zip(raster[:2], _EDGE, strict=True))
    rows, columns = (raster.step * unit * count for count in spacing.shape)
    image = apart.imshow(
        spacing,
        norm=LogNorm(LEAST, MOST),
        cmap="viridis",
        origin="lower",
        extent=(left, left + columns, low, low + rows),
    )
    ticks = [4, 8, 16, 32, 64]
    bar = figure.colorbar(
        image, ax=apart, shrink=0.8, ticks=ticks, format="%g", label="m from plant to plant"
    )
    bar.minorticks_off()
    apart.set(title="the spacing at a forest's edge", xlabel="m east", ylabel="m north")
    plants = terrain.foliage(*area)
    for number, (name, (colour, marker)) in enumerate(_SPECIES.items()):
        own = plants[plants["species"] == number]
        style = {"marker": marker, "label": name, "linewidths": 0.0}
        stand.scatter(own["x"] - west, own["y"] - south, 9.0 * own["scale"], colour, **style)
    stand.set(title="what stands there", xlabel="m east")
    for axes in (apart, stand):
        axes.set(xlim=(0.0, _PLOT), ylim=(0.0, _PLOT), aspect="equal")
    figure.legend(loc="outside lower center", ncols=len(_SPECIES), frameon=False)
    return figure


PICTURES: Mapping[str, Callable[[ComputeContext], Any]] = {
    "materials": draw_materials,
    "lakes": draw_lakes,
    "foliage": draw_foliage,
    "poisson": draw_points,
}
"""What draws each picture, by the name of its file."""


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _patches(colours: Mapping[str, str]) -> list[Any]:
    from matplotlib.patches import Patch

    return [Patch(facecolor=colour, edgecolor=_INK, label=name) for name, colour in colours.items()]


def _mixed(raster: Raster) -> Pixels:
    from matplotlib.colors import to_rgb

    colours = np.array([to_rgb(COLOURS[name]) for name in MATERIALS])
    return np.asarray(raster.materials.astype(np.float64) @ colours)


def _shade(raster: Raster) -> Pixels:
    return np.asarray(0.35 + 0.75 * np.clip(raster.normal.astype(np.float64) @ _SUN, 0.0, 1.0))


def _slope_shade(height: Pixels, east: Pixels, north: Pixels) -> Pixels:
    slope_north, slope_east = np.gradient(height, north, east)
    normal = np.stack([-slope_east, -slope_north, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(np.clip(normal @ _SUN, 0.0, 1.0))


def _show(axes: Any, pixels: Pixels, terrain: Terrain) -> None:
    east, north = (length / 1000 for length in terrain.size)
    axes.imshow(np.clip(pixels, 0.0, 1.0), extent=(0.0, east, 0.0, north))
    axes.set(xlabel="km")


def _small(png: bytes) -> bytes:
    """Return a picture in 256 colours: a third of the bytes, and no eye sees it."""
    from PIL import Image

    stream = io.BytesIO()
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
