"""A top-down map of a sketch's terrain: relief, contours, water, forests, peaks, a legend, on an A3 sheet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.files import write_png
from sketchterrain.export.map_border import border, grid_lines
from sketchterrain.export.map_contour_labels import label_contours
from sketchterrain.export.map_contour_lines import contour_lines, covers
from sketchterrain.export.map_contours import choose_interval, trace
from sketchterrain.export.map_frame import frame_of
from sketchterrain.export.map_ground import sample_ground
from sketchterrain.export.map_labels import Room
from sketchterrain.export.map_legend import covered, legend, legend_height, symbols, title
from sketchterrain.export.map_peaks import find_peaks, peak_signs
from sketchterrain.export.map_png import pixels_of
from sketchterrain.export.map_relief import relief_picture
from sketchterrain.export.map_sheet import Layer, Picture, Sheet
from sketchterrain.export.map_svg import svg_of
from sketchterrain.export.map_water import forests, lake_labels, lakes, rivers
from sketchterrain.terrain import MATERIALS
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.export.map_contours import Contour
    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_sheet import Shape
    from sketchterrain.terrain import Terrain

__all__ = ["MAP_WIDTH", "map_sheet", "write_map", "write_sheet"]

MAP_WIDTH: Final = 2400
"""px of a map's PNG if nothing else is asked for: eight a millimetre."""


def write_map(path: Path, terrain: Terrain, *, size: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Write a terrain's map; see `map_sheet` and `write_sheet`."""
    check_map_name(path)
    return write_sheet(path, map_sheet(terrain), size=size)


def write_sheet(path: Path, sheet: Sheet, *, size: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Write a sheet.

    Parameters
    ----------
    path
        Ends in ``.png`` or ``.svg``.
    sheet
    size
        Width and height (px) that a PNG fits into; it is `MAP_WIDTH` wide by default. An SVG has millimetres.

    Raises
    ------
    InputError
        If the name ends in something else.
    SketchterrainError
        If the file cannot be written.
    """
    check_map_name(path)
    if path.suffix.lower() == ".svg":
        return (write_whole(path, svg_of(sheet).encode()),)
    width = MAP_WIDTH if size is None else min(size[0], int(size[1] * sheet.width / sheet.height))
    return (write_png(path, pixels_of(sheet, width=max(width, 1))),)


def check_map_name(path: Path) -> None:
    """Refuse a file that is neither a PNG nor an SVG by its name.

    Raises
    ------
    InputError
        If it is not.
    """
    if path.suffix.lower() not in (".png", ".svg"):
        raise InputError(f"expected the name of a .png or .svg file for a map, got {path.name!r}")


def map_sheet(terrain: Terrain) -> Sheet:
    """Return a terrain's map as shapes on a sheet; the same terrain always gives the same sheet."""
    frame = frame_of(terrain.size)
    ground = sample_ground(terrain, frame)
    interval = choose_interval(ground, frame.scale)
    contours = trace(ground, frame, interval)
    room = Room(frame.box)
    peaks = peak_signs(find_peaks(terrain, ground, frame, interval), frame, room)
    levels = lake_labels(terrain, ground, frame, room)
    water, woods, flow = lakes(ground, frame), forests(ground, frame), rivers(terrain, ground, frame, room)
    labels = label_contours(contours, ground, frame, room, interval)
    left, top, width, height = frame.box
    # A pixel is a sample in its middle.
    half = [0.5 * step * frame.metre for step in ground.spacing]
    box = (left - half[0], top - half[1], width + 2 * half[0], height + 2 * half[1])
    found = {"river": flow, "lake": water, "forest": woods, "peak": peaks}
    shown = [name for name, shapes in found.items() if shapes] + _contours_shown(contours, ground)
    cover = ground.cover.mean(axis=(0, 1))
    entries = symbols(
        interval=interval if contours else None,
        shown=shown,
        tints=covered(dict(zip(MATERIALS, cover.tolist(), strict=True))),
        example=max((words.text for words in labels), key=lambda text: (abs(float(text)), text), default="0"),
    )
    sketch = terrain.sketch
    name = sketch.name or "Terrain"
    kind = f"Topographic map 1 : {frame.scale:,.10g}".replace(",", " ")
    kind += f"   ·   contour interval {interval:g} m" if contours else ""
    lowest, highest = float(ground.fine.min()), float(ground.fine.max())
    kind += f"   ·   {lowest:.0f} to {highest:.0f} m"
    note = f"Sketchterrain, seed {sketch.seed}"
    layers: dict[str, list[Shape]] = {
        "relief": [Picture(relief_picture(ground), box)],
        "forests": woods,
        "contours": [*contour_lines(contours, ground, frame, labels, interval)],
        "lakes": water,
        "rivers": flow,
        "grid": grid_lines(frame),
        "labels": [*labels, *levels, *peaks],
    }
    return Sheet(
        f"{name}: topographic map",
        frame.sheet_width,
        top + height + legend_height(frame, entries),
        [
            *(Layer(layer, shapes, frame.box) for layer, shapes in layers.items()),
            Layer("border", border(frame)),
            Layer("title", title(frame, name, kind)),
            Layer("legend", legend(frame, entries, note)),
        ],
        (253, 252, 248),
    )


def _contours_shown(contours: list[Contour], ground: MapGround) -> list[str]:
    """Return what the legend has to say of the contours."""
    kind = covers(ground)
    shown = ["index"] if any(contour.index for contour in contours) else []
    for code, name in ((1, "rock contours"), (2, "snow contours")):
        if np.mean(kind == code) > 0.005:
            shown.append(name)
    return shown
