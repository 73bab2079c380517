"""Figures of the documentation, and the gallery of presets.

``python -m sketchterrain.benchmarks.figures NAME DIR``: ``methods`` (materials, lakes, foliage and points of
``docs/kernels``), ``textures`` (every material near and tiled), ``trees`` (every species at each level of
detail) or ``gallery`` (each preset from three heights in three lights, with a contact sheet).
"""

from __future__ import annotations

import argparse
import io
import math
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from sketchterrain.benchmarks.plotting import BLUE, GREEN, INK, VERMILION, new_figure
from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.files import write_atomic
from sketchterrain.io.resources import preset_names
from sketchterrain.look.texture_levels import emboss, paint_layer
from sketchterrain.look.tree_species import HEIGHTS, SPECIES
from sketchterrain.render.offscreen import canvas, read_picture, render_picture
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun, Weather
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.vegetation.graded_poisson import GradedPoisson, SpacingRaster
from sketchterrain.vegetation.plants import PLANT

if TYPE_CHECKING:
    Pixels = npt.NDArray[np.float64]

_LEVEL_COLOURS = (INK, BLUE, GREEN, VERMILION)
_LEAST = 1 << 14  # lattice units
_WIDE = 24  # distances that the pictures are wide


def draw_points(context: ComputeContext) -> Any:
    """Draw points at one distance by their level, and points whose distance grows eastward."""
    from matplotlib.patches import Circle

    figure = new_figure(9.0, 5.4)
    one, graded = figure.subplots(1, 2)
    radius = _LEAST
    area = (0, 0, _WIDE * radius, _WIDE * radius)
    points = PoissonDisk(context, radius, seed=4, levels=3).within(area)
    for level, colour in enumerate(_LEVEL_COLOURS):
        own = points.position[points.level == level] / radius
        one.scatter(own[:, 0], own[:, 1], 5.0 * 1.7**level, colour, linewidths=0.0, label=f"level {level}")
    one.set(title="one distance, with levels", xlabel="distances", xlim=(0.0, _WIDE), ylim=(0.0, _WIDE))
    found = GradedPoisson(context, _growing, least=radius, most=8 * radius, levels=1, seed=4).within(area)
    place, spacing = np.stack([found["x"], found["y"]], axis=-1) / radius, found["spacing"] / radius
    for at, apart in zip(place, spacing, strict=True):
        graded.add_patch(Circle(at, apart / 2.0, facecolor=_LEVEL_COLOURS[1], alpha=0.25, linewidth=0.0))
    graded.scatter(place[:, 0], place[:, 1], 3.0, _LEVEL_COLOURS[0], linewidths=0.0)
    graded.set(title="distances of 1 to 4: no two discs overlap", xlabel="least distances")
    graded.set(xlim=(0.0, _WIDE), ylim=(0.0, _WIDE))
    for axes in (one, graded):
        axes.set_aspect("equal")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _growing(west: int, south: int, east: int, north: int) -> SpacingRaster:
    """Return a distance that grows from 1 to 4 of 2^14 lattice units over _WIDE of them."""
    step = 1 << 13
    column, row = west // step, south // step
    x = np.arange(column, -(-east // step) + 1) * (step / _LEAST)
    spacing = _LEAST * (1.0 + 3.0 * np.clip(x / _WIDE, 0.0, 1.0)) * np.ones((-(-north // step) + 1 - row, 1))
    return SpacingRaster(column * step, row * step, step, spacing.astype(np.float32))


_SPECIES = {
    "spruce": ("#0B5D3B", "^"),
    "pine": ("#56B4A0", "^"),
    "oak": ("#6FA83B", "o"),
    "birch": ("#D9C23A", "o"),
    "shrub": ("#B5622A", "."),
}
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])
_RASTER_SIDE = 513
_PICTURED_LAKE = 0  # of valley_river
_EDGE, _PLOT = (3350.0, 4350.0), 400.0  # m: corner and side of the square whose plants are shown
_STYLE = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "savefig.dpi": 95,
}


def write_methods(folder: Path) -> None:
    """Write the figures of methods as PNG files."""
    import matplotlib as mpl

    context = ComputeContext()
    with mpl.rc_context(_STYLE):
        for name, draw in METHODS.items():
            stream = io.BytesIO()
            draw(context).savefig(stream, format="png")
            # 256 colours take a third of the bytes without a visible difference.
            picture = Image.open(stream).convert("RGB").quantize(256, dither=Image.Dither.NONE)
            _write(folder / f"{name}.png", picture, optimize=True)


def draw_materials(context: ComputeContext) -> Any:
    """Draw every preset's weights as mixed colours, shaded by the sun."""
    from matplotlib.patches import Patch

    colours = np.array([each.colour for each in BUILT_IN]) / 255.0
    names = preset_names()
    rows = math.ceil(len(names) / 2)
    figure = new_figure(9.0, 4.8 * rows)
    every = figure.subplots(rows, 2).ravel()
    for axes in every[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(every[: len(names)], names, strict=True):
        terrain = build(load_sketch(name), device=context)
        raster = terrain.raster(_RASTER_SIDE)
        shade = 0.35 + 0.75 * np.clip(raster.normal.astype(np.float64) @ _SUN, 0.0, 1.0)
        pixels = raster.materials.astype(np.float64) @ colours * shade[..., None]
        east, north = (length / 1000 for length in terrain.size)
        axes.imshow(np.clip(pixels, 0.0, 1.0), extent=(0.0, east, 0.0, north))
        axes.set(xlabel="km")
        axes.set_title(name, loc="left")
    patches = [
        Patch(facecolor=colour, edgecolor=INK, label=name)
        for colour, name in zip(colours, BUILT_IN.names, strict=True)
    ]
    figure.legend(handles=patches, loc="outside lower center", ncols=math.ceil(len(BUILT_IN) / 2))
    return figure


def draw_lakes(context: ComputeContext) -> Any:
    """Draw a lake from above with its depth, and the ground across it with and without it."""
    terrain = build(load_sketch("valley_river"), device=context)
    dry = Terrain(terrain.sketch, terrain.recipe.with_layers([LakesLayer(())]), context)
    lake = terrain.recipe.lakes[_PICTURED_LAKE]
    field = lake.shape
    rows, columns = field.inside.shape
    east, north = (np.linspace(0, (n - 1) * field.spacing, 400) for n in (columns, rows))
    x, y = np.meshgrid(field.west + east, field.south + north)
    height = terrain.heights(x, y).astype(np.float64)
    figure = new_figure(9.0, 4.2)
    above, across = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    depth = np.where(height < lake.level, lake.level - height, np.nan)
    where: dict[str, Any] = {"extent": (0.0, float(east[-1]), 0.0, float(north[-1])), "origin": "lower"}
    above.imshow(_slope_shade(height, east, north), cmap="gray", vmin=0.0, vmax=1.1, **where)
    image = above.imshow(depth, cmap="Blues", vmin=0.0, **where)
    figure.colorbar(image, ax=above, label="depth, m", shrink=0.8)
    middle = int(np.argmax(np.nansum(depth, axis=1)))
    above.axhline(north[middle], color=VERMILION, linewidth=1.0)
    above.set(xlabel="m east", ylabel="m north", title="valley_river's lake")
    along = np.linspace(0.0, east[-1], 2000)
    at = field.west + along, np.full(along.shape, field.south + north[middle])
    across.plot(along, dry.heights(*at), color=INK, linewidth=0.9, linestyle="--", label="ground without it")
    bed = terrain.heights(*at)
    across.plot(along, bed, color=VERMILION, linewidth=1.4, label="with it")
    wet = bed < lake.level
    across.fill_between(along, bed, lake.level, where=wet, color=BLUE, alpha=0.25, label="water")
    low = lake.level - lake.depth
    across.set(xlabel="m east along the line", ylabel="m", ylim=(low - 3.0, low + 30.0), title="across it")
    across.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    return figure


def draw_foliage(context: ComputeContext) -> Any:
    """Draw how far apart plants are to stand at a forest's edge, and those that do."""
    from matplotlib.colors import LogNorm

    from sketchterrain.geometry.lattice import metres_per_unit
    from sketchterrain.terrain.evaluator import Evaluator
    from sketchterrain.vegetation.plants import SpacingBlocks
    from sketchterrain.vegetation.woods import MAX_SPACING, MIN_SPACING, Woods

    terrain = build(load_sketch("valley_river"), device=context)
    figure = new_figure(9.0, 4.9)
    apart, stand = figure.subplots(1, 2)
    unit = metres_per_unit(terrain.extent)
    west, south = _EDGE
    area = (west, south, west + _PLOT, south + _PLOT)
    woods = Woods(Evaluator(terrain.recipe, context))
    raster = SpacingBlocks(woods, terrain.extent).raster(*(round(each / unit) for each in area))
    spacing = np.ma.masked_greater(raster.spacing * unit, MAX_SPACING)
    # A pixel lies about its vertex.
    left, low = ((at - raster.step / 2) * unit - start for at, start in zip(raster[:2], _EDGE, strict=True))
    rows, columns = (raster.step * unit * count for count in spacing.shape)
    image = apart.imshow(
        spacing,
        norm=LogNorm(MIN_SPACING, MAX_SPACING),
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
    figure.legend(loc="outside lower center", ncols=len(_SPECIES))
    return figure


METHODS: Mapping[str, Callable[[ComputeContext], Any]] = {
    "materials": draw_materials,
    "lakes": draw_lakes,
    "foliage": draw_foliage,
    "poisson": draw_points,
}
"""What draws each picture, by the name of its file."""


def _slope_shade(height: Pixels, east: Pixels, north: Pixels) -> Pixels:
    slope_north, slope_east = np.gradient(height, north, east)
    normal = np.stack([-slope_east, -slope_north, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(np.clip(normal @ _SUN, 0.0, 1.0))


_TEXTURE_SIDE = 1024  # texels
_PANEL, _CAPTION = 320, 30  # px
_ACROSS = 3  # materials side by side
_TILES = 3
_TO_SUN = (-0.6, 0.5, 0.62)
_SUNLIGHT, _SKYLIGHT = (2.4, 2.3, 2.1), (0.56, 0.67, 0.84)
_EXPOSURE = {"snow": 0.55, "sand": 0.9}  # 1.6 for the others


def draw_textures(context: ComputeContext) -> Image.Image:
    """Draw all textures, three a row: a third of the texture's width, and three times three of it."""
    rows = -(-len(BUILT_IN.layers) // _ACROSS)
    picture = Image.new("RGB", (2 * _PANEL * _ACROSS, (_PANEL + _CAPTION) * rows), "white")
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(18)
    for index, (name, layer) in enumerate(BUILT_IN.layers.items()):
        painted = paint_layer(context, name, _TEXTURE_SIDE)
        light = _lit(painted, emboss(context, painted, layer))
        light *= _EXPOSURE.get(name, 1.6)
        near = light[: _TEXTURE_SIDE // 3, : _TEXTURE_SIDE // 3]
        tiled = np.tile(light, (_TILES, _TILES, 1))
        left, top = 2 * _PANEL * (index % _ACROSS), (_PANEL + _CAPTION) * (index // _ACROSS)
        draw.text((left + 6, top + 4), name.replace("_", " "), fill=INK, font=font)
        for column, part in enumerate((near, tiled)):
            panel = _developed(part).resize((_PANEL, _PANEL), Image.Resampling.BOX)
            picture.paste(panel, (left + column * _PANEL, top + _CAPTION))
    return picture


def _lit(painted: npt.NDArray[Any], relief: npt.NDArray[Any]) -> npt.NDArray[Any]:
    normal = np.concatenate([-relief[..., :2], np.ones_like(relief[..., :1])], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    sun = np.clip(normal @ (np.array(_TO_SUN) / np.linalg.norm(_TO_SUN)), 0.0, None)[..., None]
    openness = relief[..., 3:]
    light = np.array(_SUNLIGHT) * sun * (0.5 + 0.5 * openness) + np.array(_SKYLIGHT) * openness
    return np.asarray(painted[..., :3] * light)


def _developed(light: npt.NDArray[Any]) -> Image.Image:
    shown = np.clip(light * (1.0 + light / 4.0) / (1.0 + light), 0.0, 1.0) ** (1.0 / 2.2)
    return Image.fromarray((255.0 * shown[::-1]).astype(np.uint8))


def write_textures(folder: Path) -> None:
    """Write ``textures.jpg``."""
    _write(folder / "textures.jpg", draw_textures(ComputeContext()), quality=88)


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


class _PlantRow:
    """A terrain whose only plants are one row of all species."""

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


def write_trees(folder: Path) -> None:
    """Write ``trees.jpg``: each species in two variants, a row per level of detail except the farthest."""
    plain = Sketch(ground={"relief": 4.0, "surroundings": 0.0})
    terrain: Any = _PlantRow(build(plain, device=ComputeContext()))
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
    _write(folder / "trees.jpg", sheet, quality=88, optimize=True)


VIEWS: Final = ("ground", "hill", "air")
LIGHTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "dawn": {"hour": 6.5, "clouds": 0.25},
    "noon": {"hour": 12.5, "clouds": 0.4},
    "overcast": {"hour": 10.0, "clouds": 1.0},
}
"""What `Weather.from_sketch` is given for each."""
_THUMBNAIL: Final = (640, 360)


def write_gallery(folder: Path, presets: Sequence[str], size: tuple[int, int], level: float) -> None:
    """Write each preset from three heights in three lights, and a contact sheet."""
    for preset in presets:
        terrain = build(load_sketch(preset))
        sheet = Image.new("RGB", (_THUMBNAIL[0] * len(LIGHTS), _THUMBNAIL[1] * len(VIEWS)))
        for row, view in enumerate(VIEWS):
            for column, (light, conditions) in enumerate(LIGHTS.items()):
                weather = Weather.from_sketch(terrain.sketch, **conditions)
                quality = Quality.from_level(level)
                pixels = render_picture(terrain, size=size, view=view, weather=weather, quality=quality)
                picture = Image.fromarray(pixels)
                _write(folder / f"{preset}-{view}-{light}.png", picture)
                place = (column * _THUMBNAIL[0], row * _THUMBNAIL[1])
                sheet.paste(picture.resize(_THUMBNAIL, Image.Resampling.LANCZOS), place)
        _write(folder / f"{preset}.png", sheet)


def _write(path: Path, picture: Image.Image, **options: Any) -> None:
    stream = io.BytesIO()
    picture.save(stream, format="JPEG" if path.suffix == ".jpg" else "PNG", **options)
    write_atomic(path, stream.getvalue())


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the requested figures into a folder."""
    parser = argparse.ArgumentParser(prog="python -m sketchterrain.benchmarks.figures", description=__doc__)
    parser.add_argument("name", choices=("methods", "textures", "trees", "gallery"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("presets", nargs="*", default=preset_names(), help="of the gallery")
    parser.add_argument("--size", default="1920x1080", help="of the gallery")
    parser.add_argument("--quality", type=float, default=1.0, help="of the gallery")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.name == "gallery":
        width, height = (int(part) for part in options.size.split("x"))
        write_gallery(options.folder, options.presets, (width, height), options.quality)
    else:
        {"methods": write_methods, "textures": write_textures, "trees": write_trees}[options.name](
            options.folder
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
