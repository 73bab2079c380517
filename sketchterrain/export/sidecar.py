"""The sidecar of an export, ``terrain.json``, with import settings as rows; the adherence image."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from sketchterrain.document.layers import LAYERS
from sketchterrain.export.files import write_json, write_png
from sketchterrain.export.rasters import ORIENTATION
from sketchterrain.export.sampled import SampleGrid
from sketchterrain.export.target import Export, ExportOutput

if TYPE_CHECKING:
    from sketchterrain.terrain.adherence import Adherence
    from sketchterrain.terrain.terrain import Terrain


# Okabe and Ito's palette for colour-blind readers.
_COLOURS = {"both": (0, 158, 115), "painted only": (230, 130, 0), "terrain only": (204, 70, 150)}
_LEGEND = {
    "both": "as painted",
    "painted only": "missing: painted, but not in the terrain",
    "terrain only": "spill: in the terrain, but not painted",
}
_TINT = 0.55  # opacity of the colours over the hillshade
_SHORTER_SIDE = 512  # px of a panel
_GAP, _HEADING, _LEGEND_HEIGHT, _TITLE_HEIGHT = 14, 34, 34, 24  # px
_TEXT = (40, 40, 40)
_PAPER = (255, 255, 255)
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])


def write_adherence_image(path: Path, terrain: Terrain, adherence: Adherence) -> tuple[Path, ...]:
    """Write a panel for each painted layer over the terrain's hillshade, with a legend, as a PNG."""
    shade = _hillshade(terrain)
    panels = [
        _panel(shade, images.painted, images.affected, _title(adherence, name))
        for name, images in adherence.images.items()
    ]
    nothing = np.zeros(shade.shape, bool)
    panels = panels or [_panel(shade, nothing, nothing, "not painted")]
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    width, height = panels[0].size
    size = (columns * (width + _GAP) + _GAP, _HEADING + rows * (height + _GAP) + _GAP + _LEGEND_HEIGHT)
    image = Image.new("RGB", size, _PAPER)
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        image.paste(panel, (_GAP + column * (width + _GAP), _HEADING + row * (height + _GAP)))
    draw, sketch = ImageDraw.Draw(image), terrain.sketch
    heading = f"{sketch.name}, seed {sketch.seed}, fidelity {sketch.fidelity:g}: adherence of each layer"
    draw.text((_GAP, 8), heading, fill=_TEXT, font=ImageFont.load_default(17))
    _draw_legend(draw, size[1] - _LEGEND_HEIGHT)
    return (write_png(path, np.asarray(image, np.uint8)),)


def _panel(
    shade: npt.NDArray[np.float32], painted: npt.NDArray[np.bool_], terrain: npt.NDArray[np.bool_], title: str
) -> Image.Image:
    pixels = np.repeat(shade[..., None], 3, axis=-1)
    areas = {
        "both": painted & terrain,
        "painted only": painted & ~terrain,
        "terrain only": terrain & ~painted,
    }
    for name, area in areas.items():
        colour = np.array(_COLOURS[name], np.float32)
        pixels[area] = (1.0 - _TINT) * pixels[area] + _TINT * colour * (pixels[area] / 200.0)
    image = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
    scale = _SHORTER_SIDE / min(image.size)
    size = (max(round(image.width * scale), 1), max(round(image.height * scale), 1))
    resampling = Image.Resampling.NEAREST if scale > 1.0 else Image.Resampling.BOX
    panel = Image.new("RGB", (size[0], size[1] + _TITLE_HEIGHT), _PAPER)
    panel.paste(image.resize(size, resampling), (0, _TITLE_HEIGHT))
    ImageDraw.Draw(panel).text((0, 3), title, fill=_TEXT, font=ImageFont.load_default(14))
    return panel


def _title(adherence: Adherence, name: str) -> str:
    layer = adherence.layers[name]
    shapes = f"{layer.shapes} shape" + ("" if layer.shapes == 1 else "s")
    parts = [f"{name}: {shapes}", f"{layer.lost} lost"]
    if layer.iou_mean is not None:
        parts.append(f"overlap {layer.iou_mean:.0%}")
    courses = [river.mean_distance for river in adherence.rivers if river.mean_distance is not None]
    if LAYERS[name].kind == "course" and courses:
        # A stroke gives a river's course and its label the width: the overlap alone would mislead.
        parts.append(f"course {np.mean(courses):.1f} px off")
    return ", ".join(parts)


def _draw_legend(draw: ImageDraw.ImageDraw, top: int) -> None:
    font = ImageFont.load_default(14)
    left = float(_GAP)
    for name, colour in _COLOURS.items():
        draw.rectangle((left, top + 4, left + 18, top + 20), fill=colour)
        draw.text((left + 26, top + 4), _LEGEND[name], fill=_TEXT, font=font)
        left += 26 + draw.textlength(_LEGEND[name], font=font) + 26


def _hillshade(terrain: Terrain) -> npt.NDArray[np.float32]:
    """Return greys from 60 to 245 at each pixel of the sketch, lit from the north-west."""
    sketch, step = terrain.sketch, terrain.sketch.pixel_size
    x = (np.arange(-1, sketch.width_px + 1) + 0.5) * step
    y = (sketch.height_px - np.arange(-1, sketch.height_px + 1) - 0.5) * step
    height = terrain.heights(x[None, :], y[:, None], cell_size=step)
    east = (height[1:-1, 2:] - height[1:-1, :-2]) / (2.0 * step)
    north = (height[:-2, 1:-1] - height[2:, 1:-1]) / (2.0 * step)
    light = (_SUN[2] - east * _SUN[0] - north * _SUN[1]) / np.sqrt(1.0 + east**2 + north**2)
    return np.asarray(60.0 + 185.0 * np.clip(light, 0.0, 1.0), np.float32)


SIDECAR = "terrain.json"

_MAX_ENTRIES = 4  # of a list in rows; the sidecar has all
_DIGITS = 10  # of a number in rows


def sidecar(export: Export, output: ExportOutput, target: str) -> dict[str, Any]:
    """Return the content of the sidecar; a target's own facts replace the common ones."""
    height, tiling = export.samples.height, export.tiling
    facts = dict(output.facts)
    heights = {"minimum": float(height.min()), "maximum": float(height.max()), "units": "m"}
    content = {
        "format": 1,
        "target": target,
        "program": f"sketchterrain {version('sketchterrain')}",
        "sketch": export.terrain.sketch.name,
        "seed": export.terrain.sketch.seed,
        "grid": _grid_entry(export.grid),
        "heights": heights | facts.pop("heights", {}),
        "byte_order": "as the files' formats have it",
        "orientation": ORIENTATION,
    }
    if tiling.count > 1:
        content["tiling"] = {
            "columns": tiling.columns,
            "rows": tiling.rows,
            "overlap": tiling.overlap,
            "first": tiling.first,
            "y_counts_from": "south" if tiling.from_south else "north",
        }
    content["tiles"] = [
        {
            "name": tiling.tile_name(export.name, tile),
            "x": tile.x,
            "y": tile.y,
            "left": tile.left,
            "top": tile.top,
            **_grid_entry(export.grid.window(tile.left, tile.top, tile.columns, tile.rows)),
        }
        for tile in tiling.tiles(export.grid.columns, export.grid.rows)
    ]
    content |= facts
    files = [{"file": path.name, "what": what} for path, what in output.files.items()]
    return content | {"files": [*files, {"file": SIDECAR, "what": "this"}], "import": output.settings}


def write_sidecar(export: Export, output: ExportOutput, target: str) -> tuple[Path, dict[str, Any]]:
    """Write ``terrain.json`` into the export's folder, and return its path and content."""
    content = sidecar(export, output, target)
    return write_json(export.folder / SIDECAR, content), content


def _grid_entry(grid: SampleGrid) -> dict[str, Any]:
    dx, dy = grid.spacing
    return {
        "columns": grid.columns,
        "rows": grid.rows,
        "spacing": {"x": dx, "y": dy},
        "bounds": {"west": grid.west, "south": grid.south, "east": grid.east, "north": grid.north},
    }


class SettingRow(NamedTuple):
    """One import setting, or a heading (with an empty value) of those below it."""

    depth: int  # number of headings above
    name: str
    value: str


def setting_rows(settings: Mapping[str, Any]) -> list[SettingRow]:
    """Return a target's import settings as rows.

    >>> setting_rows({"Flip": False})
    [SettingRow(depth=0, name='Flip', value='no')]
    """
    return list(_rows(settings, 0))


def _rows(settings: Mapping[str, Any], depth: int) -> Iterator[SettingRow]:
    for name, value in settings.items():
        if isinstance(value, dict) and not all(isinstance(item, (int, float)) for item in value.values()):
            yield SettingRow(depth, name, "")
            yield from _rows(value, depth + 1)
        elif isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
            for number, entry in enumerate(value[:_MAX_ENTRIES], start=1):
                title = name.removesuffix("s") + (f" {number}" if len(value) > 1 else "")
                yield SettingRow(depth, title, "")
                yield from _rows(entry, depth + 1)
            if len(value) > _MAX_ENTRIES:
                yield SettingRow(depth, name, f"{len(value) - _MAX_ENTRIES} more in {SIDECAR}")
        else:
            yield SettingRow(depth, name, _text(value))


def _text(value: object) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_text(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "none" if value is None else str(value)
