"""Topographic map sheets: all layers with grid, border, title, legend, scale bar and north arrow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import UInt8Array
from sketchterrain.errors import InputError
from sketchterrain.export.drapes import DrapedShapes, draped_shapes
from sketchterrain.export.map import features
from sketchterrain.export.map.drawing import (
    PAPER,
    LabelSpace,
    MapSheet,
    MapText,
    Points,
    Polygons,
    Polylines,
    RasterImage,
    Shape,
    rectangle,
    sheet_png,
    sheet_svg,
    styled,
)
from sketchterrain.export.map.relief import (
    LAND_CLASSES,
    MARGIN,
    MapFrame,
    MapSamples,
    fit_frame,
    nearest_round,
    sample_map,
    shaded_relief,
)
from sketchterrain.export.map.roads import draw_roads, road_legend
from sketchterrain.features.table import single_parts
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.files import write_atomic
from sketchterrain.roads.road_types import RoadNetwork
from sketchterrain.schema.layers import LAND_USES
from sketchterrain.schema.parameters import Properties
from sketchterrain.schema.styles import PIXEL, rgb_from_hex

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes

Entry: TypeAlias = tuple[str, list[Shape]]
"""Meaning and symbol; the symbol's left end is at the origin, at half its height."""

INK, GREY, WHITE = (38, 36, 34), (92, 90, 88), (255, 255, 255)
GRID: Final = 25.0  # mm between grid lines, at least
BAND, OUTER = (0.9, 1.9), 3.0  # mm from the map to both sides of the chequered band, and to the outer line
TITLE, SUBTITLE, TEXT = 7.2, 2.9, 2.5  # mm
WIDTH, HEIGHT, COLUMN, ROW = 11.0, 4.4, 52.0, 6.6  # mm of symbols, and of the legend
ABOVE, SCALE_WIDTH = 13.0, 78.0  # mm from the map to the legend; of scale bar and north arrow
BAR: Final = (36.0, 5)  # mm, approximate length of the scale bar; its parts


def grid_lines(frame: MapFrame) -> list[Shape]:
    """Return the grid's faint lines, with crosses at their intersections."""
    *places, step = _grid(frame)
    lengths, edge = (frame.east, frame.north), 0.01 * step
    east, north = (at[(edge < at) & (at < end - edge)] for at, end in zip(places, lengths, strict=True))
    lines = [frame.to_sheet([[x, 0.0], [x, frame.north]]) for x in east]
    lines += [frame.to_sheet([[0.0, y], [frame.east, y]]) for y in north]
    arms = 1.6 * np.array([[[-1.0, 0.0], [1.0, 0.0]], [[0.0, -1.0], [0.0, 1.0]]])  # mm
    crosses = [frame.to_sheet([x, y]) + arm for x in east for y in north for arm in arms]
    return [Polylines(lines, INK, 0.08, 0.28), Polylines(crosses, INK, 0.14, 0.75)]


def _grid(frame: MapFrame) -> tuple[Points, Points, float]:
    """Return the places (m) of the grid's lines eastward and northward, and their distance (m)."""
    step = nearest_round(GRID / frame.mm_per_metre, up=True)
    east, north = (
        np.arange(-corner % step, length + 0.01 * step, step)
        for corner, length in zip(frame.corner, (frame.east, frame.north), strict=True)
    )
    return east, north, step


def border(frame: MapFrame) -> list[Shape]:
    """Return the border: lines, a band of black and white, and the coordinates (m) of the grid."""
    left, top, width, height = frame.box
    right, bottom = left + width, top + height
    near, far = BAND
    wide, out, size = far - near, OUTER + 1.9, 2.0
    east, north, step = _grid(frame)

    def around(off: float) -> Points:
        return rectangle(left - off, top - off, width + 2 * off, height + 2 * off)

    black: list[Points] = []
    labels: list[MapText] = []
    for metres in east.tolist():
        x = left + metres * frame.mm_per_metre
        length = max(min(step / 2 * frame.mm_per_metre, right - x), 0.0)
        black += [rectangle(x, y, length, wide) for y in (top - far, bottom + near)]
        text = grouped(metres + frame.corner[0])
        labels += [MapText(text, x, y, size, GREY, "middle") for y in (top - out, bottom + out)]
    for metres in north.tolist():
        y = bottom - metres * frame.mm_per_metre
        length = max(min(step / 2 * frame.mm_per_metre, y - top), 0.0)
        black += [rectangle(x, y - length, wide, length) for x in (left - far, right + near)]
        text = grouped(metres + frame.corner[1])
        labels += [MapText(text, x, y, size, GREY, "middle", -90) for x in (left - out, right + out)]
    pens = ((0.0, 0.2), (near, 0.12), (far, 0.12), (OUTER, 0.45))
    lines = [Polylines([around(off)], INK, pen) for off, pen in pens]
    paper = Polygons([around(1000.0), around(0.0)], PAPER)  # covers shapes outside of the map
    return [paper, Polygons([around(far), around(near)], WHITE), Polygons(black, INK), *lines, *labels]


def title(frame: MapFrame, name: str, subtitle: str) -> list[Shape]:
    """Return the map's title and subtitle."""
    head = MapText(name, MARGIN, 11.0, TITLE, INK, bold=True)
    width = 2.0 * frame.left + frame.box[2] - 2.0 * MARGIN
    if head.width > width:
        head = replace(head, size=TITLE * width / head.width)
    return [head, MapText(subtitle, MARGIN, 17.6, SUBTITLE, GREY)]


def legend_entries(
    contours: Sequence[features.Contour],
    samples: MapSamples,
    interval: float,
    present: set[str],
    heights: list[MapText],
    network: RoadNetwork,
) -> list[Entry]:
    """Return the entries of the legend; `present` has some of rivers, lakes, forests and peaks."""
    entries: list[Entry] = []
    patch = rectangle(0.0, -HEIGHT / 2, WIDTH, HEIGHT)
    if any(contour.index for contour in contours):
        example = max((height.text for height in heights), key=len, default="0")
        label = MapText(example, WIDTH / 2, 0.0, features.LABEL_SIZE, features.LABEL_COLOUR, "middle")
        gap = WIDTH / 2 + (label.width / 2 + 0.4) * np.array([-1.0, 1.0])
        lines = [np.array([[start, 0.0], [end, 0.0]]) for start, end in ((0.0, gap[0]), (gap[1], WIDTH))]
        symbol: list[Shape] = [Polylines(lines, features.PENS["ground"], features.WIDTHS[True]), label]
        entries.append((f"Index contour, each {features.INDEX * interval:g} m", symbol))
    if contours:
        entries.append((f"Contour, each {interval:g} m", _contours(["ground"])))
        pens = features.pen_numbers(samples)
        stony = [
            name for number, name in enumerate(features.PENS) if number and np.mean(pens == number) > 0.005
        ]
        entries += [(f"Contours on {' and '.join(stony)}", _contours(stony))] if stony else []
    course = _wave(0.0, 0.5, WIDTH, 0.6)
    arrow = features.flow_arrow(np.array([5.7, -1.5]), np.array([1.0, 0.0]))
    angle = np.linspace(0.0, 2 * np.pi, 48)
    radius = 1.0 + 0.08 * np.sin(3 * angle)
    shore = np.stack([WIDTH / 2 * (1.0 + radius * np.cos(angle)), 2.2 * radius * np.sin(angle)], axis=-1)
    level = MapText("12", WIDTH / 2, 0.0, 2.0, features.LEVEL, "middle")
    lake: list[Shape] = [
        Polygons([shore], features.WATER),
        Polylines([shore], features.BANK, features.SHORE_WIDTH),
        level,
    ]
    deep = [rectangle(WIDTH * part, -HEIGHT / 2, WIDTH * (1.0 - part), HEIGHT) for part in (1 / 3, 2 / 3)]
    sea: list[Shape] = [Polygons([patch], features.WATER)]
    sea += [Polygons([ring], features.DEEP, features.DEEPER) for ring in deep]
    sea += [Polylines([patch[[0, 3]]], features.BANK, features.SHORE_WIDTH)]
    river = [Polylines([course], features.BANK, 0.8), Polylines([course], features.WATER, 0.52), *arrow]
    peak = [*features.peak_triangle(2.4, 0.4), MapText("345", 4.0, 0.0, features.PEAK_SIZE, INK)]
    meadow = next(iter(samples.materials)).tint
    known: dict[str, Entry] = {
        "rivers": ("River, flow", river),
        "lakes": ("Lake, water level (m)", lake),
        "sea": (f"Sea, depth lines each {features.depth_step(samples.sea_depth):g} m", sea),
        "forests": ("Forest", [Polygons([patch], meadow), *features.forest([patch])]),
        "peaks": ("Summit, height (m)", peak),
    }
    entries += [entry for name, entry in known.items() if name in present]
    entries += road_legend(network, WIDTH, HEIGHT)
    bare = 1.0 if samples.land is None else 1.0 - samples.land.sum(axis=-1)
    tints = [
        (material.title, material.tint)
        for index, material in enumerate(samples.materials)
        if material.is_mapped and (bare * samples.cover[..., index]).mean() > 0.01
    ]
    if samples.land is not None:
        used = samples.land.reshape(-1, len(LAND_USES)).max(axis=0) > 0.0
        land = [each for name, each in LAND_CLASSES.items() if used[LAND_USES.index(name)]]
        tints = [(each.title, rgb_from_hex(each.style["fill"])) for each in land] + tints
    for meaning, tint in tints:
        entries.append((meaning, [Polygons([patch], tint), Polylines([patch], GREY, 0.1)]))
    return entries


def legend(frame: MapFrame, entries: Sequence[Entry], note: str) -> tuple[list[Shape], float]:
    """Return legend, scale bar, north arrow and a note below a map, and the bottom of the sheet (mm)."""
    left, top, width, height = frame.box
    right, top = 2.0 * left + width - MARGIN, top + height + ABOVE
    columns = max(int((right - MARGIN - SCALE_WIDTH) / COLUMN), 1)
    rows = max(-(-len(entries) // columns), 4)
    shapes: list[Shape] = []
    for number, (meaning, symbol) in enumerate(entries):
        column, row = divmod(number, rows)
        entry = [*symbol, MapText(meaning, WIDTH + 2.2, 0.0, TEXT, INK)]
        shapes += [_moved(shape, MARGIN + column * COLUMN, top + row * ROW + 2.6) for shape in entry]
    shapes += [_moved(shape, right - 6.0, top + 10.0) for shape in _north_arrow()]
    shapes += [_moved(shape, right - SCALE_WIDTH + 14.0, top + 3.0) for shape in _scale_bar(frame)]
    bottom = top + rows * ROW
    return [*shapes, MapText(note, right, bottom + 2.2, 2.0, GREY, "end")], bottom + 5.0


def grouped(number: float) -> str:
    """Return a number with spaces between thousands."""
    return f"{number:,.10g}".replace(",", " ")


def _moved(shape: Shape, x: float, y: float) -> Shape:
    if isinstance(shape, MapText):
        return replace(shape, x=shape.x + x, y=shape.y + y)
    if isinstance(shape, Polylines | Polygons):
        return replace(shape, paths=[path + np.array([x, y]) for path in shape.paths])
    return shape


def _wave(x: float, y: float, width: float, height: float) -> Points:
    along = np.linspace(0.0, 1.0, 24)
    return np.stack([x + along * width, y + height * np.sin(2 * np.pi * along)], axis=-1)


def _contours(pens: Sequence[str]) -> list[Shape]:
    part, gap = WIDTH / len(pens), 0.8 if len(pens) > 1 else 0.0
    waves = ([_wave(i * part, y, part - gap, 0.35) for y in (-1.1, 0.0, 1.1)] for i in range(len(pens)))
    return [
        Polylines(paths, features.PENS[pen], features.WIDTHS[False])
        for pen, paths in zip(pens, waves, strict=True)
    ]


def _scale_bar(frame: MapFrame) -> list[Shape]:
    length, parts = BAR
    part = nearest_round(length / parts / frame.mm_per_metre)
    wide = part * frame.mm_per_metre
    parts = max(min(round(length / wide), 6), 2)
    white, black = ([rectangle(i * wide, 4.6, wide, 1.3) for i in range(first, parts, 2)] for first in (1, 0))
    unit, metres = ("km", 1000.0) if part >= 500.0 else ("m", 1.0)
    numbers = range(0, parts + 1, 1 if wide > 9.0 else 2)
    name = "the sketch's own coordinate system" if "[" in frame.crs else frame.crs
    origin = f"of {name}" if name else "from the sketch's south-west corner"
    return [
        MapText(f"1 : {grouped(frame.scale)}", 0.0, 0.0, 3.6, INK, bold=True),
        Polygons(white, WHITE),
        Polygons(black, INK),
        Polylines([rectangle(0.0, 4.6, parts * wide, 1.3)], INK, 0.14),
        *(MapText(f"{i * part / metres:g}", i * wide, 7.8, 2.1, INK, "middle") for i in numbers),
        MapText(unit, parts * wide + 2.6, 5.25, 2.1, INK),
        MapText("Heights and coordinates in metres", 0.0, 12.0, 2.1, GREY),
        MapText(origin, 0.0, 14.8, 2.1, GREY),
    ]


def _north_arrow() -> list[Shape]:
    tip, tail, west, east = [0.0, -8.0], [0.0, 4.5], [-3.1, 7.5], [3.1, 7.5]
    return [
        Polygons([np.array([tip, tail, west])], INK),
        Polygons([np.array([tip, east, tail])], WHITE),
        Polylines([np.array([tip, east, tail, west, tip])], INK, 0.2),
        MapText("N", 0.0, 10.6, 4.0, INK, "middle", bold=True),
    ]


MAP_WIDTH: Final = 2400
"""Default width of a map's PNG (px): 8 px/mm."""


def write_map(
    path: Path, terrain: Terrain, *, size: tuple[int, int] | None = None, drapes: Drapes | None = None
) -> tuple[Path, ...]:
    """Write a terrain's map; see `map_sheet` and `write_sheet`."""
    _check_suffix(path)
    return write_sheet(path, map_sheet(terrain, drapes), size=size)


def write_sheet(path: Path, sheet: MapSheet, *, size: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Write a sheet as .png of `MAP_WIDTH` px, or fitted into a size (px), or as .svg in millimetres."""
    _check_suffix(path)
    if path.suffix.lower() == ".svg":
        return (write_atomic(path, sheet_svg(sheet).encode()),)
    width = MAP_WIDTH if size is None else min(size[0], int(size[1] * sheet.width / sheet.height))
    return (write_atomic(path, sheet_png(sheet, width=max(width, 1))),)


def map_sheet(terrain: Terrain, drapes: Drapes | None = None) -> MapSheet:
    """Return a terrain's map, with draped layers, as shapes on a sheet, deterministically.

    The grid is that of the sketch's CRS if it has one.
    """
    frame = fit_frame(terrain.size, terrain.sketch.frame)
    cell = max(terrain.size) / 1024.0
    layers = draped_shapes(drapes, terrain, (0.0, 0.0, *terrain.size), cell)
    samples = sample_map(terrain, frame)
    interval = features.choose_interval(samples)
    contours = features.trace_contours(samples, interval)
    space = LabelSpace(frame.box)
    # In order of priority for space.
    peaks = features.label_peaks(terrain, samples, space, interval)
    levels = features.label_lakes(terrain, samples, space)
    rivers = features.draw_rivers(terrain, samples, space)
    heights = features.label_contours(contours, samples, space, interval)
    lakes, sea = (features.draw_still_water(depth, samples) for depth in (samples.depth, samples.sea_depth))
    forests = features.draw_forests(samples)
    roads = draw_roads(terrain.features.network, frame)
    left, top, width, height = frame.box
    # Samples are pixel centres: the image extends half a sample beyond the frame.
    x, y = (0.5 * step * frame.mm_per_metre for step in samples.spacing)
    relief = with_rasters(shaded_relief(samples), drapes, samples)
    image = RasterImage(relief, (left - x, top - y, width + 2 * x, height + 2 * y))
    drawn = {"rivers": rivers, "lakes": lakes, "sea": sea, "forests": forests, "peaks": peaks}
    present = {name for name, shapes in drawn.items() if shapes}
    entries = legend_entries(contours, samples, interval, present, heights, terrain.features.network)
    drawn_layers, layer_entries = draw_drapes(layers, frame)
    entries += layer_entries
    name = terrain.sketch.name or "Terrain"
    facts = [f"Topographic map 1 : {grouped(frame.scale)}"]
    facts += [f"contour interval {interval:g} m"] if contours else []
    facts += [f"{samples.height.min():.0f} to {samples.height.max():.0f} m"]
    margins, bottom = legend(frame, entries, f"Sketchterrain, seed {terrain.sketch.seed}")
    return MapSheet(
        f"{name}: topographic map",
        2.0 * frame.left + width,
        bottom,
        {
            "relief": [image],
            "forests": forests,
            "contours": features.contour_lines(contours, samples, heights, interval),
            "sea": sea,
            "lakes": lakes,
            "rivers": rivers,
            **({"roads": roads} if roads else {}),
            **({"drapes": drawn_layers} if drawn_layers else {}),
            "grid": grid_lines(frame),
            "labels": [*heights, *levels, *peaks],
            "border": border(frame),
            "title": title(frame, name, "   ·   ".join(facts)),
            "legend": margins,
        },
    )


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".svg"):
        raise InputError(f"expected the name of a .png or .svg file for a map, got {path.name!r}")


def draw_drapes(layers: Iterable[DrapedShapes], frame: MapFrame) -> tuple[list[Shape], list[Entry]]:
    """Return the features of layers, the lowest first, and entries of the legend; patterns are filled."""
    shapes, entries = list[Shape](), list[Entry]()
    sample = replace(frame, left=0.0, top=0.0, north=0.0, scale=1000.0)  # mm
    patch = shapely.box(0.0, -HEIGHT / 2, WIDTH, HEIGHT / 2)
    samples = patch.centroid, shapely.LineString([(0.0, 0.0), (WIDTH, 0.0)]), patch
    for layer in layers:
        for name, style, geometry in layer.by_style():
            look = {**style, "opacity": layer.layer["opacity"]}
            if style["unit"] == "m":
                look |= {"unit": frame.mm_per_metre}
            shapes += _drawn(geometry, look, frame)
            kind = int(shapely.get_dimensions(geometry).max())
            entries.append((name, _drawn(np.array([samples[kind]]), look, sample)))
    return shapes, entries


def with_rasters(image: UInt8Array, drapes: Drapes | None, samples: MapSamples) -> UInt8Array:
    """Return the image of a map's samples under the visible rasters, the lowest first."""
    if drapes is None:
        return image
    rows, columns, _ = image.shape
    across, up = samples.spacing
    result = image.astype(np.float64)
    for number, source in drapes.rasters(across):
        west, north = -0.5 * across, samples.frame.north + 0.5 * up
        pixels = source.pixels(west, north, across, columns, int(rows * up / across) + 1)
        pixels = pixels[((np.arange(rows) + 0.5) * up / across).astype(int)]
        share = float(drapes.layers[number]["opacity"]) / 255.0 * pixels[..., 3:]
        result += share * (pixels[..., :3] - result)
    return np.rint(result).astype(np.uint8)


def _drawn(geometry: npt.NDArray[np.object_], look: Properties, frame: MapFrame) -> list[Shape]:
    parts, _ = single_parts(shapely.force_2d(geometry), np.arange(len(geometry)))
    unit, kind = PIXEL if look["unit"] == "px" else float(look["unit"]), shapely.get_dimensions(parts)
    casings, above = styled(
        look,
        unit,
        lines=[frame.to_sheet(each.coords) for each in parts[kind == 1]],
        rings=[frame.to_sheet(each.coords) for each in shapely.get_rings(parts[kind == 2])],
        points=list(frame.to_sheet(shapely.get_coordinates(parts[kind == 0]))),
        opacity=float(look["opacity"]),
    )
    return [*casings, *above]
