"""Topographic maps: relief, contours, water, forests and peaks of a terrain with a legend, on an A3 sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from sketchterrain.errors import InputError
from sketchterrain.export.map.contours import choose_interval, contour_lines, label_contours, trace_contours
from sketchterrain.export.map.drawing import LabelSpace, MapSheet, RasterImage, sheet_png, sheet_svg
from sketchterrain.export.map.features import draw_forests, draw_lakes, draw_rivers, label_lakes, label_peaks
from sketchterrain.export.map.ground import fit_frame, sample_ground, shaded_relief
from sketchterrain.export.map.margins import border, grid_lines, grouped, legend, legend_entries, title
from sketchterrain.terrain import Terrain
from sketchterrain.whole_files import write_atomic

MAP_WIDTH: Final = 2400
"""Default width of a map's PNG (px): 8 px/mm."""


def write_map(path: Path, terrain: Terrain, *, size: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Write a terrain's map; see `map_sheet` and `write_sheet`."""
    _check_suffix(path)
    return write_sheet(path, map_sheet(terrain), size=size)


def write_sheet(path: Path, sheet: MapSheet, *, size: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Write a sheet as .png of `MAP_WIDTH` px, or fitting into a size (px), or as .svg in millimetres."""
    _check_suffix(path)
    if path.suffix.lower() == ".svg":
        return (write_atomic(path, sheet_svg(sheet).encode()),)
    width = MAP_WIDTH if size is None else min(size[0], int(size[1] * sheet.width / sheet.height))
    return (write_atomic(path, sheet_png(sheet, width=max(width, 1))),)


def map_sheet(terrain: Terrain) -> MapSheet:
    """Return a terrain's map as shapes on a sheet; the same terrain always gives the same sheet."""
    frame = fit_frame(terrain.size)
    ground = sample_ground(terrain, frame)
    interval = choose_interval(ground)
    contours = trace_contours(ground, interval)
    space = LabelSpace(frame.box)
    # Whoever comes first has the choice of places.
    peaks = label_peaks(terrain, ground, space, interval)
    levels = label_lakes(terrain, ground, space)
    rivers = draw_rivers(terrain, ground, space)
    heights = label_contours(contours, ground, space, interval)
    lakes, forests = draw_lakes(ground), draw_forests(ground)
    left, top, width, height = frame.box
    # Samples are pixel centres: the image reaches half a sample beyond the frame.
    x, y = (0.5 * step * frame.mm_per_metre for step in ground.spacing)
    image = RasterImage(shaded_relief(ground), (left - x, top - y, width + 2 * x, height + 2 * y))
    features = {"river": rivers, "lake": lakes, "forest": forests, "peak": peaks}
    present = {name for name, shapes in features.items() if shapes}
    entries = legend_entries(contours, ground, interval, present, heights)
    name = terrain.sketch.name or "Terrain"
    facts = [f"Topographic map 1 : {grouped(frame.scale)}"]
    facts += [f"contour interval {interval:g} m"] if contours else []
    facts += [f"{ground.height.min():.0f} to {ground.height.max():.0f} m"]
    margins, bottom = legend(frame, entries, f"Sketchterrain, seed {terrain.sketch.seed}")
    return MapSheet(
        f"{name}: topographic map",
        2.0 * frame.left + width,
        bottom,
        {
            "relief": [image],
            "forests": forests,
            "contours": contour_lines(contours, ground, heights, interval),
            "lakes": lakes,
            "rivers": rivers,
            "grid": grid_lines(frame),
            "labels": [*heights, *levels, *peaks],
            "border": border(frame),
            "title": title(frame, name, "   ·   ".join(facts)),
            "legend": margins,
        },
    )


def _check_suffix(path: Path) -> None:
    """Raise InputError for a path that ends neither in .png nor in .svg."""
    if path.suffix.lower() not in (".png", ".svg"):
        raise InputError(f"expected the name of a .png or .svg file for a map, got {path.name!r}")
